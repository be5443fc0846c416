"""One table: every command with every kind of BRDF.

All kinds hold the same material, so that what a command makes of a kind is near what it makes of
the material itself: as near as the kind holds it.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from brdf_kinds import KINDS, MODEL, NUMBERS, made
from small_captures import jaxrender, write_json

from jaxrender.io import read_image

# How far what a command makes of a kind may be off, as a part of the whole.
NEAR = {
    MODEL: 1e-6,
    "result": 1e-6,
    "half.nc": 0.02,
    "paint.binary": 0.02,
    "paint.bsdf": 0.05,
    "paint.bin": 0.06,
    "paint.alta": 0.08,
    "paint.brdf": 0.08,
    "table.nc": 0.12,
    "tree.nc": 0.12,
}
# Those that the default run looks at; the others are made or read slowly.
QUICK = ("result", "paint.bin")
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


COMMANDS = {
    "synth": Command(synth, (MODEL,)),
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
            marks = () if kind in QUICK else pytest.mark.slow
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
