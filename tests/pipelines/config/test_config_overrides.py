"""What the command line writes over a config, and what becomes of a config's paths.

- Overrides reach into shorthands and lists, and may remove what is optional; wrong ones are named.
- Paths resolve against the file that names them; ``output`` and typed paths against the working
  directory.
"""

from pathlib import Path

import pytest
from config_texts import CAPTURE, FULL, GOOD, RECIPE, message, run_config

from jaxrender.pipelines.config import (
    Parameter,
    load_recipe,
    load_run_config,
)


def test_overrides_write_over_the_file():
    config = run_config(
        GOOD, "brdf.mu=1.5", "samples.count=5", "lighting.split=0.2", "samples.count=7"
    )
    assert config.brdf.mu == Parameter(fixed=1.5)
    assert config.samples.count == 7
    assert config.lighting.split == 0.2


def test_overrides_reach_into_shorthands_and_lists():
    text = (
        CAPTURE
        + "lighting:\n  directional: [{direction: [0, 0, 1], irradiance: 1}]\nbrdf: {mu: free}\n"
    )
    config = run_config(text, "brdf.mu.fixed=1.5", "lighting.directional.0.irradiance=2")
    assert config.brdf.mu == Parameter(fixed=1.5)
    assert config.lighting.directional[0].irradiance == (2.0, 2.0, 2.0)


def test_overrides_may_remove_an_optional_value():
    config = run_config(GOOD, "capture.transforms=null", "capture.recipe=a.yaml")
    assert config.capture.transforms is None


OVERRIDES = {
    "foo": "expected key=value, such as brdf.mu=1.5",
    "=3": "the key before '=' must be words joined by dots, such as brdf.mu",
    "a b=3": "the key before '=' must be words joined by dots, such as brdf.mu",
    "brdf..mu=3": "the key before '=' must be words joined by dots, such as brdf.mu",
    "lighting.directional.1.irradiance=3": (
        "lighting.directional has no entry '1'; it is a list of one entry, counted from 0"
    ),
    "lighting.directional.x=3": (
        "lighting.directional has no entry 'x'; it is a list of one entry, counted from 0"
    ),
    "ligting.split=off": "unknown key 'ligting', did you mean 'lighting'?",
    "brdf.m=2": "unknown key 'm', did you mean 'mu'?",
    "brdf.kd=!foo 3": "tags such as !foo are not accepted; remove it",
    "brdf.mu={": (
        "the value is not understood: not valid YAML: while parsing a flow node "
        "(which starts at line 1): expected the node content, but found '<stream end>'"
    ),
}


@pytest.mark.parametrize("argument", OVERRIDES)
def test_wrong_overrides(argument):
    text = CAPTURE + "lighting:\n  directional: [{direction: [0, 0, 1], irradiance: 1}]\n"
    assert message(text, argument) == f"command line: {argument}: {OVERRIDES[argument]}"


def test_paths_resolve_against_the_file_that_names_them(folder):
    (folder / "deep").mkdir()
    config = folder / "deep" / "full.yaml"
    config.write_text(FULL.replace("t.json", "../t.json"))
    loaded = load_run_config(Path("deep/full.yaml"), ["lighting.per_frame=mine.json"])
    deep = config.parent
    assert loaded.capture.transforms == folder / "t.json"
    assert loaded.capture.images == deep / "photos"
    assert loaded.capture.geometry.mesh == deep / "cat.ply"
    assert loaded.capture.response.curve == deep / "curve.txt"
    assert loaded.lighting.environment.path == deep / "probe.exr"
    assert loaded.lighting.per_frame == folder / "mine.json"
    assert loaded.output == folder / "runs" / "full"


def test_a_typed_section_resolves_against_the_working_directory(folder):
    (folder / "deep").mkdir()
    (folder / "deep" / "a.yaml").write_text(GOOD)
    loaded = load_run_config("deep/a.yaml", ["lighting.environment={path: x.exr}"])
    assert loaded.lighting.environment.path == folder / "x.exr"
    assert loaded.capture.transforms == folder / "deep" / "photos" / "transforms.json"


def test_recipe_paths(folder):
    (folder / "deep").mkdir()
    text = RECIPE.replace("{sphere: {}}", "{mesh: a.ply}") + "  environment: {path: /p.exr}\n"
    (folder / "deep" / "r.yaml").write_text(text)
    loaded = load_recipe("deep/r.yaml")
    assert loaded.geometry.mesh == folder / "deep" / "a.ply"
    assert loaded.lighting.environment.path == Path("/p.exr")


def test_home_is_expanded(monkeypatch, folder):
    monkeypatch.setenv("HOME", str(folder / "me"))
    assert run_config(GOOD, "output=~/runs").output == folder / "me" / "runs"
