"""One table: every command with every kind of BRDF.

All kinds hold the same material, so that what a command makes of a kind is near what it makes of
the material itself: as near as the kind holds it.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from brdf_kinds import KINDS, MODEL, NUMBERS, evaluate, made, pairs
from small_captures import jaxrender, write_json

from jaxrender.brdf import IsotropicMean, IsotropicTable, directional_albedo
from jaxrender.geometry import Mesh
from jaxrender.harmonics import LatLongGrid
from jaxrender.io import read_image, read_table, write_environment, write_image, write_mesh
from jaxrender.io.merl import read_merl
from jaxrender.lighting import Environment
from jaxrender.pipelines import analyze as analysis
from jaxrender.pipelines.brdf_sources import names_file, names_result, source_of
from jaxrender.pipelines.config import ViewsConfig
from jaxrender.pipelines.shrm_files import read_shrm
from jaxrender.pipelines.source_lobes import lobe_named
from jaxrender.pipelines.synth import cameras_of
from jaxrender.spectra import central_spectrum_of, spectrum_of

# How far what a command makes of a kind may be off, as a part of the whole.
NEAR = {
    MODEL: 1e-6,
    "result": 1e-6,
    "half.nc": 0.02,
    "paint.binary": 0.02,
    "paint.bsdf": 0.05,
    "paint.bin": 0.06,
    "paint.alta": 0.2,
    "paint.brdf": 0.2,
    "table.nc": 0.12,
    "tree.nc": 0.2,
}
# Kinds that the default run looks at, and commands that it leaves out.
QUICK, SLOW = ("result", MODEL), ("prefilter", "compress")
GRAY = (MODEL, "paint.brdf")


class Command(NamedTuple):
    """What a command makes of a BRDF: numbers a channel; the kinds that it does not take."""

    numbers: Callable[[str, Path], np.ndarray]
    refuses: tuple[str, ...] = ()


def run(*words: object) -> None:
    assert jaxrender(*words) == 0


def synth(named: str, folder: Path) -> np.ndarray:
    """Photograph a ball under a lamp and a wide light."""
    recipe = {
        "geometry": {"sphere": {}},
        "brdf": {"file": named},
        "lighting": {
            "directional": [{"direction": [0.35, 0.8, 0.5], "irradiance": 1.2}],
            "area": [{"direction": [0.9, 0.5, 0.4], "width_degrees": 40.0, "radiance": 1.0}],
        },
        "views": {"count": 1, "width": 12, "height": 12},
        "noise": {"relative": 0.0},
    }
    write_json(folder / "recipe.json", recipe)
    run("synth", folder / "recipe.json", "--out", folder / "capture")
    truth = json.loads((folder / "capture/truth.json").read_text())
    assert truth["brdf"] == {"file": named}
    assert truth["material"]["name"] == Path(named).name
    return read_image(folder / "capture/images/view_000.exr").pixels


def a_probe(folder: Path) -> Path:
    """Write a gray probe: a sky with a soft sun."""
    grid = LatLongGrid(16, 32)
    sun = np.exp(6 * (grid.directions() @ [0.6, 0.0, 0.8] - 1))[..., None]
    write_environment(folder / "probe.exr", Environment(0.2 + sun * np.ones(3)))
    return folder / "probe.exr"


def render(named: str, folder: Path) -> np.ndarray:
    """Show a ball and its cover by two cameras in a probe."""
    cameras = ViewsConfig(count=2, width=10, height=10, step_degrees=90.0)
    frames = [
        {"file_path": f"{number}.exr", "transform_matrix": one.world_from_camera.tolist()}
        for number, one in enumerate(cameras_of(cameras, np.zeros(3)))
    ]
    inside = {"w": 10, "h": 10, "fl_x": 10 / 2 / np.tan(np.radians(6)), "frames": frames}
    write_json(folder / "transforms.json", inside)
    write_mesh(folder / "ball.ply", Mesh.ellipsoid(np.ones(3), 2))
    light = "--environment", a_probe(folder), "--camera", folder / "transforms.json"
    run("render", named, *light, "--mesh", folder / "ball.ply", "--out", folder / "seen")
    return np.stack([read_image(folder / f"seen/{number}.exr").pixels for number in (0, 1)])


def prefilter(named: str, folder: Path) -> np.ndarray:
    """Filter a probe by the material, head-on and for every viewer."""
    light = a_probe(folder), "--brdf", named, "--out", folder / "maps"
    run("prefilter", *light, "--shrm", "--degree", 4, "--view-degree", 2)
    (seen,) = (folder / "maps").glob("*_shrm.nc")
    name = seen.name.removesuffix("_shrm.nc")
    shrm, about = read_shrm(seen)
    assert about.brdf == named
    head_on = read_image(folder / f"maps/{name}.exr").pixels
    maps = np.asarray(shrm.maps)[::4, ::4, 0], head_on[::4, ::4]
    return np.concatenate([one.reshape(-1, 3) for one in maps])


def analyze(named: str, folder: Path) -> np.ndarray:
    """Read the lobe's spectrum to degree 4 from the table."""
    lobe = lobe_named(named)
    said = analysis.analyze(a_probe(folder), brdfs=[named], band_limit=7).table
    assert all(sentence in said for sentence in lobe.said)
    transfers = lobe.transfers(4)
    # Degree 0 is the light that leaves head-on, of each channel.
    albedo = directional_albedo(source_of(named).colours, [1.0], "outgoing")[0]
    np.testing.assert_allclose(transfers[0], albedo, rtol=0.03)
    for degree, row in zip(range(5), re.findall(r"^ +\d+ +\S+ +(\S+)", said, re.M)):
        assert float(row) == pytest.approx(transfers[degree].mean(), rel=1e-3, abs=1e-5)
    return transfers


def export(named: str, folder: Path) -> np.ndarray:
    """Write the material as MERL has it, and read that."""
    run("export", named, "--to", "merl", "--lossy", "--out", folder / "files")
    brdf = read_merl(folder / "files/material.binary").brdf()
    return np.asarray(evaluate(brdf, *pairs(500)))


def measure(named: str, folder: Path) -> np.ndarray:
    """Measure flat ground of the material, which has the material's own BRDF."""
    write_image(folder / "flat.exr", np.full((3, 4, 3), 0.5))
    ground = folder / "flat.exr", "--brdf", named, "--size", 4, "--samples", 16, "--bounces", 1
    run("measure", *ground, "--out", folder / "ground.nc")
    return np.asarray(read_table(folder / "ground.nc").values)


def compress(named: str, folder: Path) -> np.ndarray:
    """Make a tree of the material, and read that."""
    size = "--size", 8, "--cell-samples", 1, "--keep", 0.5
    run("compress", named, *size, "--out", folder / "made.nc")
    return np.asarray(evaluate(source_of(str(folder / "made.nc")).colours, *pairs(500)))


COMMANDS = {
    "synth": Command(synth, (MODEL,)),
    "render": Command(render),
    "prefilter": Command(prefilter, (MODEL,)),
    "analyze": Command(analyze, (MODEL,)),
    "export": Command(export),
    "measure": Command(measure, (MODEL,)),
    # A result is what the others are held against.
    "compress": Command(compress, (MODEL, "result")),
}


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("kinds")


@pytest.fixture(scope="session")
def expected(folder, tmp_path_factory):
    """What each command makes of the material itself, made once."""
    found = {}

    def look(command: str) -> np.ndarray:
        if command not in found:
            place = tmp_path_factory.mktemp(command)
            found[command] = COMMANDS[command].numbers(made(folder, "result"), place)
        return found[command]

    return look


def _cases():
    for command, kind in ((c, k) for c in COMMANDS for k in (MODEL, *KINDS)):
        if kind not in COMMANDS[command].refuses:
            marks = () if kind in QUICK and command not in SLOW else pytest.mark.slow
            yield pytest.param(command, kind, marks=marks, id=f"{command}-{kind.split(':')[0]}")


@pytest.mark.parametrize(("command", "kind"), [*_cases()])
def test_a_command_takes_a_brdf(command, kind, folder, tmp_path, expected):
    found = COMMANDS[command].numbers(made(folder, kind), tmp_path)
    wanted = expected(command)
    if kind in GRAY:
        found, wanted = (numbers.mean(axis=-1) for numbers in (found, wanted))
    assert np.abs(found - wanted).sum() <= NEAR[kind] * np.abs(wanted).sum()


def test_a_recipe_of_a_result_is_that_of_its_numbers(folder, tmp_path, expected):
    """The model whose numbers the result holds gives the same photographs."""
    synth(made(folder, "result"), tmp_path)
    recipe = json.loads((tmp_path / "recipe.json").read_text())
    choices = {"fresnel": "half", "masking": "smith"}
    recipe["brdf"] = {"model": "microfacet"} | choices | NUMBERS
    write_json(tmp_path / "recipe.json", recipe)
    run("synth", tmp_path / "recipe.json", "--out", tmp_path / "own")
    own = read_image(tmp_path / "own/images/view_000.exr").pixels
    np.testing.assert_allclose(expected("synth"), own, rtol=1e-5)


@pytest.mark.slow
def test_a_ball_alone_is_that_of_its_result(folder, tmp_path, capsys):
    """Without cameras and mesh: one ball, as its picture in white light says, the BRDF's albedo."""
    grid = LatLongGrid(128, 256)
    write_environment(tmp_path / "white.exr", Environment(np.ones((*grid.shape, 3))))
    words = "render", MODEL, "--environment", tmp_path / "white.exr", "--out", tmp_path / "a"
    run(*words)
    pixels = read_image(tmp_path / "a/view.exr").pixels
    middle = pixels[60:68, 60:68].mean(axis=(0, 1))
    wanted = directional_albedo(source_of(MODEL).colours, [1.0])[0]
    np.testing.assert_allclose(middle, wanted, rtol=0.02)
    capsys.readouterr()
    run(*words)
    assert "rendered before" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((MODEL,), "no result folder, and a BRDF has no light of its own: give an --environment"),
        ((MODEL, "--environment", "no.exr"), "no.exr: no such file"),
        ((MODEL, "--environment", "no.exr", "--model", "dual"), "--model dual goes with a result"),
        (("paint.xyz", "--environment", "probe.exr"), "mend|unknown kind|no BRDF"),
    ],
)
def test_what_render_asks_for(tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    a_probe(tmp_path)
    assert jaxrender("render", *words, "--out", "seen") == 2
    assert re.search(said, capsys.readouterr().err)
    assert not (tmp_path / "seen").exists()


def test_what_an_export_cannot_hold_is_refused(folder, tmp_path, capsys):
    """Light is not the material's own; a surface that turns is said to lose its turning."""
    words = "export", MODEL, "--to", "harmonics", "--out", tmp_path / "files"
    assert jaxrender(*words) == 2
    assert "a BRDF brings no light, which the format harmonics needs; choose one of gltf" in (
        capsys.readouterr().err
    )
    words = "export", made(folder, "paint.bin"), "--to", "rgl", "--out", tmp_path / "files"
    assert jaxrender(*words) == 2
    assert "would lose how the surface differs with its turning" in capsys.readouterr().err
    assert not (tmp_path / "files").exists()


def test_what_has_no_isotropy_says_how_to_get_it(folder):
    brdf = source_of(made(folder, "paint.bin")).brdf
    for use in (
        lambda: central_spectrum_of(brdf, (2, 2)),
        lambda: spectrum_of(brdf, 2),
        lambda: IsotropicTable.of(brdf, (4, 4, 4)),
    ):
        with pytest.raises(ValueError, match=r"anisotropic.*IsotropicMean\(brdf\)"):
            use()
    assert IsotropicTable.of(IsotropicMean(brdf), (4, 4, 4)).isotropic


@pytest.mark.parametrize(
    ("named", "kind"),
    [
        ("ggx:sigma=0.2", "model"),
        ("paint.binary", "file"),
        ("folder/paint.nc", "file"),
        ("runs/cat", "result"),
        ("{}/there", "result"),
        ("{}/paint", "file"),
    ],
)
def test_a_name_tells_what_it_is(tmp_path, named, kind):
    """A file without a suffix is a file once it is there; a folder need not be there."""
    (tmp_path / "there").mkdir()
    (tmp_path / "paint").touch()
    named = named.format(tmp_path)
    assert names_file(named) == (kind != "model")
    assert names_result(named) == (kind == "result")
