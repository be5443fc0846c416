"""Bad input through the command line: exit code 2, a message that helps, and nothing written.

- Every message names the file (or the key), the place, the value and what to do about it.
- No traceback, nothing on stdout, and no file that was not there before.
- What can be lived with is a warning: a camera that sees nothing, broken pixels that are masked.
"""

import json
import re
import shutil

import numpy as np
import OpenImageIO as oiio
import pytest
from small_captures import Ball, edit_json, jaxrender, write_ball, write_json

from jaxrender.io import read_image, write_image


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A capture that is fine: three photographs of 16 x 16 pixels."""
    folder = tmp_path_factory.mktemp("good") / "cap"
    write_ball(folder, Ball(views=3, size=16, noise=0))
    return folder


@pytest.fixture
def work(good, tmp_path, monkeypatch):
    """A working directory with a copy of the good capture in ``cap``."""
    shutil.copytree(good, tmp_path / "work" / "cap")
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path / "work"


def contents(folder):
    return {
        path.relative_to(folder): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def refused(work, capsys, command):
    """Run a command that must be refused; returns what it said."""
    before = contents(work)
    assert jaxrender(*command, cache=work.parent / "cache") == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    assert contents(work) == before
    assert not (work.parent / "cache").exists()
    said = [line for line in err.splitlines() if not re.match(r"\[ +\d+\.\d s\]", line)]
    assert said
    return "\n".join(said)


def fit(*overrides):
    return ["fit", "cap/config.yaml", "output=out", *overrides]


# ---------------------------------------------------------------- ways to spoil a capture


def nothing(folder):
    pass


def append(text):
    def change(folder):
        with (folder / "config.yaml").open("a") as stream:
            stream.write(text)

    return change


def written(name, text):
    return lambda folder: (folder / name).write_text(text)


def removed(name):
    return lambda folder: (folder / name).unlink()


def truncated(name, fraction=0.5):
    def change(folder):
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: int(fraction * len(data))])

    return change


def write_any(path, pixels):
    """Write an EXR of whatever values, which the project's own writer refuses."""
    rows, columns, channels = pixels.shape
    output = oiio.ImageOutput.create(str(path))
    output.open(str(path), oiio.ImageSpec(columns, rows, channels, "float"))
    output.write_image(np.ascontiguousarray(pixels, np.float32))
    output.close()


def pixel(place, value, name="images/1.exr"):
    def change(folder):
        image = read_image(folder / name)
        pixels = np.concatenate([image.pixels, image.alpha[..., None]], axis=-1)
        pixels[place] = value
        write_any(folder / name, pixels)

    return change


def environment(shape, value=1.0, name="e.exr"):
    return lambda folder: write_any(folder / name, np.full((*shape, 3), value))


def keys(**given):
    return lambda folder: edit_json(folder / "transforms.json", lambda all_: all_.update(given))


def frame(number, **given):
    def change(content):
        content["frames"][number].update(given)

    return lambda folder: edit_json(folder / "transforms.json", change)


def pose(number, factors):
    """Multiply the columns of a pose."""

    def change(content):
        matrix = np.array(content["frames"][number]["transform_matrix"]) * factors
        content["frames"][number]["transform_matrix"] = matrix.tolist()

    return lambda folder: edit_json(folder / "transforms.json", change)


def small_mask(folder):
    write_image(folder / "mask.png", np.ones((4, 4, 3)))
    frame(0, mask_path="mask.png")(folder)


def eight_bits(folder):
    image = read_image(folder / "images/1.exr")
    write_image(folder / "images/1.png", image.pixels.clip(0, 1))
    frame(1, file_path="images/1.png")(folder)


def black(folder):
    for number in range(3):
        pixel((..., slice(0, 3)), 0, f"images/{number}.exr")(folder)


def clipped(folder):
    for path in sorted((folder / "images").glob("*.exr")):
        image = read_image(path)
        values = np.minimum(image.pixels, 0.01)
        write_any(path, np.concatenate([values, image.alpha[..., None]], axis=-1))


MESH = "capture.geometry={mesh: cap/m.obj}"
TRIANGLE = "v 0 0 0\nv {} 0 0\nv 0 1 0\n"
LIT_BY = "lighting={environment: {path: cap/e.exr}}"
CURVE = "capture.response={curve: cap/c.txt}"

CASES = {
    # The config itself.
    "unknown key": (
        append("ligting: {}\n"),
        [],
        r"^cap/config\.yaml:6:1: unknown key 'ligting', did you mean 'lighting'\?$",
    ),
    "duplicate key": (
        append("task: brdf\n"),
        [],
        r"^cap/config\.yaml:6:1: duplicate key 'task', first given at line 1$",
    ),
    "mistyped value": (
        nothing,
        ["samples.count=many"],
        r"samples\.count: found 'many', accepted: a whole number of at least 1$",
    ),
    "sigma 0": (nothing, ["brdf.sigma=0"], r"brdf\.sigma: found 0; .* must be above 0$"),
    "sigma negative": (nothing, ["brdf.sigma=-1"], r"brdf\.sigma: found -1; .* must be above 0$"),
    "mu 1": (nothing, ["brdf.mu=1"], r"brdf\.mu: found 1; .* must be above 1$"),
    "mu bounds": (nothing, ["brdf.mu={bounds: [0.5, 2]}"], r"brdf\.mu: found 0\.5; .* above 1$"),
    "start out of reach": (
        nothing,
        ["brdf.sigma={start: 2.0}"],
        r"^brdf\.sigma: start 2\.0 is outside \[0\.01, 1\.0\]$",
    ),
    "no light": (nothing, ["lighting={}"], r"no light given; lighting needs one of environment"),
    # Photographs.
    "missing image": (
        removed("images/1.exr"),
        [],
        r"transforms\.json: frame 1 \(images/1\.exr\): `file_path`: .*1\.exr does not exist; mend",
    ),
    "truncated image": (
        truncated("images/1.exr"),
        [],
        r"images/1\.exr: the pixels cannot be read, is the file cut short\?",
    ),
    "empty image": (truncated("images/1.exr", 0), [], r"images/1\.exr: not a readable image"),
    "nan": (
        pixel((8, 7, 1), np.nan),
        [],
        r"images/1\.exr: channel G, pixel \(row 8, column 7\): the value is nan; 1 of 256 pixels "
        r"are negative or not finite: mend the picture, or .* with `invalid: mask`$",
    ),
    "infinite": (
        pixel((3, slice(2, 5), 2), np.inf),
        [],
        r"images/1\.exr: channel B, pixel \(row 3, column 2\): the value is inf; 3 of 256 pixels",
    ),
    "negative": (
        pixel((8, slice(7, 9), 0), -0.5),
        [],
        r"images/1\.exr: channel R, pixel \(row 8, column 7\): the value is -0\.5; 2 of 256",
    ),
    "8 bits without a response": (
        eight_bits,
        [],
        r"images/1\.png: integer pixel values .* state capture\.response: srgb",
    ),
    "size": (
        keys(w=20, h=20),
        [],
        r"images/0\.exr: frame 0: the picture is 16 x 16 pixels, its camera says 20 x 20; scale",
    ),
    "all black": (black, [], r"transforms\.json: every usable pixel is black; check"),
    "all clipped": (
        clipped,
        [],
        r"transforms\.json: 100 % of the usable values are clipped: they stand at the highest",
    ),
    "no usable pixel": (
        nothing,
        ["capture.erode=40"],
        r"no pixel is usable; removed: silhouette \d+; loosen capture\.erode, ",
    ),
    "missing mask": (
        frame(0, mask_path="m.png"),
        [],
        r"frame 0 \(images/0\.exr\): `mask_path`: .*m\.png does not exist; mend the path",
    ),
    "mask of another size": (
        small_mask,
        [],
        r"mask\.png: frame 0: the picture is 4 x 4 pixels, its camera says 16 x 16",
    ),
    "negative exposure": (
        frame(0, exposure=-1),
        [],
        r"frame 0 \(images/0\.exr\): `exposure` is -1; it must be positive$",
    ),
    "no exposure in the metadata": (
        nothing,
        ["capture.exposure=metadata"],
        r"images/0\.exr: no exposure time in its metadata; give frames\[\]\.exposure",
    ),
    # Cameras.
    "missing transforms": (
        removed("transforms.json"),
        [],
        r"cap/transforms\.json: no such file; mend the path$",
    ),
    "a folder for transforms": (
        nothing,
        ["capture.transforms=cap"],
        r"cap: a folder; give the path of the file inside it$",
    ),
    "broken transforms": (
        written("transforms.json", '{"frames": [1,'),
        [],
        r"transforms\.json:1:15: Expecting value; mend the JSON there$",
    ),
    "no frames": (
        written("transforms.json", "{}"),
        [],
        r"transforms\.json: `frames` must be a list with at least one frame$",
    ),
    "scaled pose": (
        pose(1, [2, 2, 2, 1]),
        [],
        r"frame 1 \(images/1\.exr\): transform_matrix's 3 x 3 part deviates from a rotation by 3 ",
    ),
    "reflected pose": (
        pose(1, [-1, 1, 1, 1]),
        [],
        r"frame 1 \(images/1\.exr\): transform_matrix's 3 x 3 part is a reflection",
    ),
    "no camera sees it": (
        nothing,
        ["capture.geometry={sphere: {center: [0, 0, 50]}}"],
        r"transforms\.json: no camera sees the object: check the poses .* capture\.geometry$",
    ),
    "path outside": (
        frame(0, file_path="../other.exr"),
        [],
        r"frame 0 \(\.\./other\.exr\): `file_path` leads outside .*cap; move the file",
    ),
    # Shape.
    "mesh vertex": (
        written("m.obj", TRIANGLE.format("nan") + "f 1 2 3\n"),
        [MESH],
        r"m\.obj: vertex 1 \(counted from 0\) is \[nan  0\.  0\.\]; 1 of 3 are not finite: mend",
    ),
    "mesh without faces": (
        written("m.obj", TRIANGLE.format("1")),
        [MESH],
        r"m\.obj: the file has no faces; export triangles$",
    ),
    "missing mesh": (nothing, [MESH], r"cap/m\.obj: no such mesh file; mend the path$"),
    # Light.
    "aspect": (
        environment((8, 8)),
        [LIT_BY],
        r"e\.exr: the panorama is 8 x 8 \(width x height\); the convention 'z-up' wants 2:1",
    ),
    "broken environment": (
        environment((8, 16), np.nan),
        [LIT_BY],
        r"e\.exr: channel R, pixel \(row 0, column 0\): the value is nan; .* mend the picture$",
    ),
    "dark environment": (
        environment((8, 16), 0.0),
        [LIT_BY],
        r"^lighting \(.*e\.exr\): the light is zero: give an environment or sources",
    ),
    "dark source": (
        nothing,
        ["lighting={directional: [{direction: [0, 0, 1], irradiance: 0}]}"],
        r"^lighting: the light is zero: give an environment or sources with radiance$",
    ),
    "missing environment": (nothing, [LIT_BY], r"cap/e\.exr: no such image file; mend the path$"),
    "missing lights": (removed("lights.json"), [], r"lights\.json: no such file; mend the path$"),
    "too few lights": (
        lambda folder: edit_json(folder / "lights.json", lambda lights: lights.pop()),
        [],
        r"lights\.json: lights for 2 photographs, but the capture has 3; one entry each$",
    ),
    "lights of others": (
        lambda folder: write_json(folder / "lights.json", {"0": [], "1": [], "7": []}),
        [],
        r"lights\.json: no photograph is named '7'; the photographs are 0, 1, 2$",
    ),
    "no light in any photograph": (
        lambda folder: write_json(folder / "lights.json", [[], [], []]),
        [],
        r"^lighting \(.*lights\.json\): the light is zero",
    ),
    # Response.
    "missing curve": (nothing, [CURVE], r"cap/c\.txt: no such file; mend the path$"),
    "broken curve": (
        written("c.txt", "0 0\n.5 x\n"),
        [CURVE],
        r"c\.txt:2: found '\.5 x'; each line is two numbers, value radiance$",
    ),
    "descending curve": (
        written("c.txt", "0 0\n1 1\n.5 2\n"),
        [CURVE],
        r"c\.txt: a curve's values must increase strictly, but entry 2 is 0\.5 after 1\.0: sort",
    ),
    "short curve": (
        written("c.txt", "0 0\n.01 1\n"),
        [CURVE],
        r"images/0\.exr: pixel \(row \d+, column \d+\): the values .* leave the response curve, "
        r"which covers 0 to 0\.01; 68 of 68 usable pixels do: extend the curve",
    ),
    # Samples.
    "fewer samples than unknowns": (
        nothing,
        ["samples.count=3"],
        r"^samples\.count is 3, and 204 pixels are usable: 3 samples cannot determine 6 unknowns",
    ),
    "fewer refined samples than unknowns": (
        nothing,
        ["solve.refine_samples=2"],
        r"^solve\.refine_samples is 2; give more, or refine: off: 2 samples cannot determine",
    ),
    # Recipes.
    "missing recipe": (nothing, ["capture={recipe: r.yaml}"], r"work/r\.yaml: no such file$"),
    "broken recipe": (
        written("r.yaml", "geometry: {sphere: {}}\nbrdf: {kd: .1, ks: .1, sigma: 0, mu: 1}\n"),
        ["capture={recipe: cap/r.yaml}"],
        r"r\.yaml:1:1: missing key 'lighting', .*\n.*r\.yaml:2:31: brdf\.sigma: found 0, .*\n"
        r".*r\.yaml:2:38: brdf\.mu: found 1, accepted: 'none' or a number above 1$",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_refused(work, capsys, name):
    spoil, overrides, message = CASES[name]
    spoil(work / "cap")
    said = refused(work, capsys, fit(*overrides))
    assert re.search(message, said), said


@pytest.mark.parametrize(
    "name", ["truncated image", "aspect", "fewer samples than unknowns", "missing mesh"]
)
def test_a_dry_run_refuses_the_same(work, capsys, name):
    spoil, overrides, message = CASES[name]
    spoil(work / "cap")
    assert re.search(message, refused(work, capsys, fit(*overrides, "--dry-run")))


def test_all_errors_of_a_config_are_said_at_once(work, capsys):
    append("ligting: {}\n")(work / "cap")
    said = refused(work, capsys, fit("brdf.sigma=0", "samples.cuont=1"))
    assert said.splitlines() == [
        "cap/config.yaml:6:1: unknown key 'ligting', did you mean 'lighting'?",
        "command line: brdf.sigma=0: brdf.sigma: found 0; every value here must be above 0",
        "command line: samples.cuont=1: unknown key 'cuont', did you mean 'count'?",
    ]


def test_an_exposure_that_no_sample_tells(work, capsys):
    for number in (0, 2):
        pixel((slice(0, 12), ..., 3), 0, f"images/{number}.exr")(work / "cap")
    overrides = ["solve.free_exposure=true", "capture.erode=1", "samples.count=10"]
    said = refused(work, capsys, fit(*overrides, "brdf={ks: 0.1, sigma: 0.2, mu: 1.5}"))
    assert re.search(
        r"images/[02]\.exr: none of its pixels is among the 10 samples drawn, so "
        r"solve\.free_exposure cannot fit its exposure; raise samples\.count$",
        said,
    )


# ---------------------------------------------------------------- output folders


def test_a_folder_that_holds_other_files(work, capsys):
    (work / "out").mkdir()
    (work / "out" / "thesis.tex").write_text("mine")
    for flags in ([], ["--force"], ["--dry-run"]):
        said = refused(work, capsys, fit(*flags))
        assert re.search(r"work/out: holds files that are not a jaxrender result .* choose", said)


def test_a_folder_that_another_run_filled(work, capsys):
    marker = {"made_by": "jaxrender", "version": "0", "fingerprint": "another"}
    (work / "out").mkdir()
    write_json(work / "out" / "run.json", marker)
    for flags in ([], ["--dry-run"]):
        said = refused(work, capsys, fit(*flags))
        assert re.search(r"out: holds the result of another run .* or give --force", said)


def test_a_file_in_the_way(work, capsys):
    (work / "out").write_text("mine")
    assert "out: a file is in the way; choose" in refused(work, capsys, fit())


def test_a_finished_result_that_was_damaged_is_named(work, capsys):
    """What is reused, or rendered again, must still be there."""
    for text in (None, "{"):
        (work / "out").mkdir()
        (work / "out" / "config.yaml").write_text((work / "cap/config.yaml").read_text())
        if text is not None:
            (work / "out" / "result.json").write_text(text)
        said = refused(work, capsys, ["render", "out", "--out", "again"])
        wanted = "holds no finished result (no result.json); run fit" if text is None else "cannot"
        assert wanted in said
        shutil.rmtree(work / "out")


# ---------------------------------------------------------------- what can be lived with


def test_a_camera_that_sees_nothing_is_a_warning(work, capsys):
    pose(1, [[-1, 1, -1, 1]] * 3 + [[1, 1, 1, 1]])(work / "cap")
    before = contents(work)
    assert jaxrender(*fit("--dry-run")) == 0
    out, err = capsys.readouterr()
    assert re.search(r"images/1\.exr: warning: its camera does not see the object; skipped\n", err)
    assert "samples of 2 photographs" in out
    assert contents(work) == before


def test_masked_pixels_are_counted(work, capsys):
    pixel((8, slice(7, 9), 0), np.nan)(work / "cap")
    assert jaxrender(*fit("--dry-run", "capture.invalid=mask")) == 0
    out, err = capsys.readouterr()
    assert re.search(r"images/1\.exr: masked 2 of 256 pixels that are negative or not finite", err)
    good = int(re.search(r"to (\d+) samples", out).group(1))
    assert jaxrender(*fit("--dry-run", "capture.invalid=refuse", "capture.erode=1")) == 2
    assert 0 < good < 204


# ---------------------------------------------------------------- recipes

RECIPE = {
    "geometry": {"sphere": {}},
    "brdf": {"kd": 0.1, "ks": 0.1, "sigma": 0.2, "mu": 1.5},
    "lighting": {"directional": [{"direction": [0, 0, 1], "irradiance": 1}]},
    "views": {"count": 2, "width": 8, "height": 8},
}
AREA = {"direction": [0, 0, 1], "width_degrees": 20, "radiance": 0}


@pytest.mark.parametrize(
    ("section", "value", "message"),
    [
        ("views", {"elevation_degrees": 90}, r"r\.json: views\.elevation_degrees 90: "),
        ("views", {"distance": 0.5}, r"r\.json: views: no camera sees the object; change distance"),
        ("lighting", {"directional": [], "area": [AREA]}, r"r\.json: lighting: the light is zero;"),
        ("lighting", {"environment": {"path": "e.exr"}}, r"work/e\.exr: no such image file; mend"),
        ("geometry", {"sphere": None, "mesh": "m.ply"}, r"work/m\.ply: no such mesh file; mend"),
        ("brdf", {"sigma": -0.1}, r"r\.json:\d+:\d+: brdf\.sigma: found -0\.1, accepted: a number"),
    ],
)
def test_recipes_that_cannot_be_rendered(work, capsys, section, value, message):
    recipe = json.loads(json.dumps(RECIPE))
    recipe[section] |= value
    # JSON is YAML.
    write_json(work / "r.json", {k: v for k, v in recipe.items() if v is not None})
    said = refused(work, capsys, ["synth", "r.json", "--out", "capture"])
    assert re.search(message, said), said
