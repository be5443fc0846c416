"""What a config file may say, what is said back when it is wrong, and what becomes of its paths.

- Every default and every shorthand of the schema; configs are immutable and import no numerics.
- Each message in full: file, line, column, key, value found, what is accepted, the nearest word.
- All errors of a file at once, sorted by place; the command line's after the file's.
- YAML 1.2: 1e-6 is a number, ``no`` and ``off`` are words.
- Paths resolve against the file that names them; ``output`` and typed paths against the working
  directory.
- A config written out in full is read back equal.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pydantic
import pytest

from jaxrender.errors import InputError
from jaxrender.pipelines.config import (
    BrdfConfig,
    CurveConfig,
    NoiseConfig,
    Parameter,
    RecipeConfig,
    RunConfig,
    json_schema,
    load_recipe,
    load_run_config,
    resolved_yaml,
)

CAPTURE = """\
task: brdf
capture:
  transforms: photos/transforms.json
  geometry: {sphere: {}}
"""
LIGHT = """\
lighting:
  environment: {path: probe.exr}
"""
GOOD = CAPTURE + LIGHT
RECIPE = """\
geometry: {sphere: {}}
brdf: {kd: 0.1, ks: 0.2, sigma: 0.1, mu: 1.5}
lighting:
  directional: [{direction: [0, 0, 1], irradiance: 3}]
"""
FULL = """\
task: brdf
capture:
  transforms: t.json
  images: photos
  geometry: {mesh: cat.ply, scale: 2}
  response: {curve: curve.txt}
  invalid: mask
  saturation: 0.98
  black_level: 1e-6
  erode: 0
  exposure: metadata
  allow_outside: true
lighting:
  environment: {path: probe.exr, convention: mirror-ball, scale: 3, height: 64}
  directional: [{direction: [0, 0.6, 0.8], irradiance: [1, 2, 3]}]
  per_frame: lights.json
  split: 0.5
  free_scale: true
brdf:
  kd: [0.1, 0.2, 0.3]
  ks: {bounds: [0, 1], start: [0.1, 0.2, 0.3]}
  sigma: {start: 0.2}
  mu: none
  ks_per_channel: true
  fresnel: half
  masking: smith
  gauge: metal
samples: {min_cosine: 0.2, count: 1e4, seed: 3}
solve:
  band_limit: 12
  transfer: gaussian
  refine: off
  refine_samples: 100
  method: simplex
  loss: cauchy
  noise: {relative: 0.01}
  starts: 2
  free_exposure: true
  most_sources: 3
  variants: false
output: runs/full
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Each test works in its own folder, so that messages start with the bare file name."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_config(text, *overrides):
    Path("bad.yaml").write_text(text, encoding="utf-8")
    return load_run_config("bad.yaml", overrides)


def recipe(text):
    Path("bad.yaml").write_text(text, encoding="utf-8")
    return load_recipe("bad.yaml")


def message(text, *overrides, load=run_config):
    with pytest.raises(InputError) as caught:
        load(text, *overrides)
    return str(caught.value)


def brdf_message(entries):
    """The message about one brdf section, without its place."""
    return message(GOOD + f"brdf: {entries}\n").split(": ", 1)[1]


# ---------------------------------------------------------------- what a config says


def test_defaults():
    config = run_config(GOOD)
    assert config.task == "brdf"
    assert config.output is None
    assert config.capture.model_dump(exclude={"transforms"}) == {
        "recipe": None,
        "images": None,
        "geometry": {
            "sphere": {"center": (0.0, 0.0, 0.0), "radius": 1.0},
            "mesh": None,
            "scale": 1.0,
        },
        "response": "linear",
        "invalid": "refuse",
        "saturation": None,
        "black_level": 0.0,
        "erode": 2,
        "exposure": "given",
        "allow_outside": False,
    }
    assert config.lighting.environment.model_dump(exclude={"path"}) == {
        "convention": "z-up",
        "scale": 1.0,
        "height": None,
    }
    assert config.lighting.model_dump(exclude={"environment"}) == {
        "directional": (),
        "per_frame": None,
        "split": "auto",
        "free_scale": False,
    }
    assert config.brdf.model_dump() == {
        "model": "microfacet",
        "compare": (),
        "kd": "free",
        "ks": "free",
        "sigma": "free",
        "roughness": "free",
        "roughness_y": "free",
        "exponent": "free",
        "c_z": 1.0,
        "deviation": 0.5,
        "spacing": 2.0,
        "height": 1.0,
        "mu": "free",
        "ks_per_channel": False,
        "fresnel": "exit",
        "masking": "none",
        "gauge": "per-channel",
    }
    assert config.samples.model_dump() == {"min_cosine": 0.15, "count": 12000, "seed": 0}
    assert config.solve.model_dump() == {
        "band_limit": "auto",
        "model": "dual",
        "view_degree": 4,
        "transfer": "exit-cosine",
        "refine": "exact",
        "refine_samples": 2000,
        "method": "variable-projection",
        "loss": "auto",
        "noise": "estimate",
        "starts": 8,
        "free_exposure": False,
        "most_sources": 48,
        "variants": True,
        "held_out": 0.2,
        "interreflection": False,
    }


def test_every_key_is_read():
    config = run_config(FULL)
    assert config.capture.response == CurveConfig(curve=Path("curve.txt").absolute())
    assert config.capture.saturation == 0.98
    assert config.capture.black_level == 1e-6
    assert config.lighting.environment.height == 64
    assert config.lighting.directional[0].irradiance == (1.0, 2.0, 3.0)
    assert config.lighting.split == 0.5
    assert config.brdf.kd == Parameter(fixed=(0.1, 0.2, 0.3))
    assert config.brdf.ks == Parameter(bounds=(0.0, 1.0), start=(0.1, 0.2, 0.3))
    assert config.brdf.sigma == Parameter(start=0.2)
    assert config.brdf.mu == "none"
    assert config.samples.count == 10000
    assert config.solve.refine == "off"
    assert config.solve.noise == NoiseConfig(relative=0.01, floor=0.0)
    assert config.solve.variants is False
    assert (config.brdf.gauge, config.solve.most_sources) == ("metal", 3)


LIGHT_TASKS = {
    "task: factorize\n": None,
    "task: factorize\nlighting: {directional: [{direction: [0, 0, 1], irradiance: 1}]}\n": (
        "task factorize recovers the light; remove lighting, or choose task: brdf"
    ),
    "task: factorize\nbrdf: {model: lambertian}\n": None,
    "task: lighting\nbrdf: {model: lambertian, kd: 0.2}\n": None,
    "task: lighting\nbrdf: {model: lambertian}\n": (
        "task lighting needs a known material; fix kd, or choose task: factorize"
    ),
    "task: factorize\nbrdf: {model: lambertian, kd: 0.2}\n": (
        "of a matt body under unknown light the product of light and kd shows, not kd; leave kd "
        "free, or choose task: lighting"
    ),
    "task: factorize\nbrdf: {ks: 0.1}\n": (
        "under unknown light only the ratio of kd and ks means anything; fix both or none"
    ),
    "task: factorize\nsolve: {free_exposure: true}\n": (
        "task factorize needs known exposures; remove solve.free_exposure"
    ),
    "task: lighting\nbrdf: {kd: 0.1, sigma: 0.1}\n": (
        "task lighting needs a known material; fix ks, mu, or choose task: factorize"
    ),
    "task: lighting\nbrdf: {kd: 0.1, ks: 0.2, sigma: 0.1, mu: none}\n": None,
}


@pytest.mark.parametrize("text", LIGHT_TASKS)
def test_tasks_whose_light_is_unknown(text):
    text += "capture: {transforms: a.json, geometry: {sphere: {}}}\n"
    message = LIGHT_TASKS[text.rsplit("capture", 1)[0]]
    if message is None:
        assert run_config(text).task in ("factorize", "lighting")
        return
    with pytest.raises(InputError, match=re.escape(message)):
        run_config(text)


def test_recipe_defaults():
    config = recipe(RECIPE)
    assert config.views.model_dump() == {
        "count": 60,
        "step_degrees": 3.0,
        "start_degrees": 0.0,
        "axis": (0.0, 0.0, 1.0),
        "elevation_degrees": 0.0,
        "distance": 12.0,
        "field_of_view_degrees": 12.0,
        "width": 96,
        "height": 96,
    }
    assert config.noise.model_dump() == {"relative": 0.01, "floor": 0.0}
    assert (config.environment_height, config.seed) == (128, 0)
    assert config.brdf.kd == (0.1, 0.1, 0.1)
    assert config.lighting.directional[0].irradiance == (3.0, 3.0, 3.0)
    ellipsoid = recipe(RECIPE.replace("{sphere: {}}", "{ellipsoid: {radii: [1, 2, 3]}}")).geometry
    assert ellipsoid.ellipsoid.radii == (1.0, 2.0, 3.0)
    assert ellipsoid.ellipsoid.subdivisions == 5


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("free", Parameter()),
        ("0.3", Parameter(fixed=0.3)),
        ("1", Parameter(fixed=1.0)),
        ("[1, 2, 3]", Parameter(fixed=(1.0, 2.0, 3.0))),
        ("{fixed: 0.3}", Parameter(fixed=0.3)),
        ("{fixed: [1, 2, 3]}", Parameter(fixed=(1.0, 2.0, 3.0))),
        ("{bounds: [0.1, 2]}", Parameter(bounds=(0.1, 2.0))),
        ("{start: 0.3}", Parameter(start=0.3)),
        ("{bounds: [0.1, 2], start: 0.3}", Parameter(bounds=(0.1, 2.0), start=0.3)),
    ],
)
def test_parameter_shorthands(text, expected):
    parameter = run_config(GOOD + f"brdf: {{kd: {text}}}\n").brdf.kd
    assert parameter == expected
    assert parameter.free == (expected.fixed is None)


def test_python_takes_the_same_shorthands():
    config = BrdfConfig.model_validate({"kd": (0.1, 0.2, 0.3), "mu": "none", "sigma": 0.1})
    assert config.kd.fixed == (0.1, 0.2, 0.3)
    assert config.sigma == Parameter(fixed=0.1)
    assert config.mu == "none"


def test_configs_are_immutable_and_hashable():
    config = run_config(FULL)
    with pytest.raises(pydantic.ValidationError, match="frozen"):
        config.samples.count = 3
    assert hash(config) == hash(run_config(FULL))


def test_configs_import_no_numerics():
    code = (
        "import sys, jaxrender.pipelines.config;"
        "print([m for m in ('jax', 'numpy', 'equinox', 'scipy') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_recipe_needs_neither_geometry_nor_light():
    config = run_config("task: brdf\ncapture: {recipe: teflon.yaml}\n")
    assert config.capture.geometry is None
    assert not config.lighting.given
    assert run_config(GOOD).lighting.given


def test_an_empty_section_counts_as_left_out():
    assert run_config(GOOD + "brdf:\n  # kd: free\nsolve:\n") == run_config(GOOD)


# ---------------------------------------------------------------- YAML


def test_yaml_1_2_scalars():
    config = run_config(GOOD.replace("probe.exr", "no"), "capture.black_level=1e-6", "output=012a")
    assert config.lighting.environment.path.name == "no"
    assert config.capture.black_level == 1e-6
    assert run_config(GOOD, "output=2024-01-01").output.name == "2024-01-01"
    assert run_config(GOOD, "lighting.split=off").lighting.split == "off"


def test_anchors_are_allowed():
    config = run_config(
        CAPTURE + "lighting:\n  directional: [&a {direction: [0, 0, 1], irradiance: 1}, *a]"
    )
    assert config.lighting.directional[0] == config.lighting.directional[1]


KEYS = "task, capture, lighting, brdf, samples, solve, texture, spectrum, output"
SYNTAX = {
    "": f"bad.yaml:1:1: the file is empty; keys are {KEYS}",
    "# nothing\n": f"bad.yaml:1:1: the file is empty; keys are {KEYS}",
    "\n- 1\n": f"bad.yaml:2:1: found a list, accepted: a mapping with the keys {KEYS}",
    "word": f"bad.yaml:1:1: found 'word', accepted: a mapping with the keys {KEYS}",
    "a:\n\tb: 1\n": "bad.yaml:2:1: found a tab; indent with spaces",
    "a: 1\n---\nb: 1\n": (
        "bad.yaml:2:1: found a second document; a config is one document, remove '---'"
    ),
    "a:\n  b: \x07\n": "bad.yaml:2:6: character '\\x07' is not allowed in YAML",
    "a: [1,\nb: 2": (
        "bad.yaml:2:5: not valid YAML: while parsing a flow sequence (which starts at line 1): "
        "expected ',' or ']', but got '<stream end>'"
    ),
    "a: *b": "bad.yaml:1:4: not valid YAML: found undefined alias 'b'",
    "a: @b": (
        "bad.yaml:1:4: not valid YAML: while scanning for the next token: "
        "found character '@' that cannot start any token"
    ),
}


@pytest.mark.parametrize("text", SYNTAX)
def test_text_that_is_no_config(text):
    assert message(text) == SYNTAX[text]


STRUCTURE = {
    "brdf: {}\nbrdf: {}\n": "bad.yaml:8:1: duplicate key 'brdf', first given at line 7",
    "brdf: {kd: &x [1, *x]}\n": (
        "bad.yaml:7:12: an alias inside the value that it names; write the value out"
    ),
    "brdf: {kd: !foo 3}\n": "bad.yaml:7:12: tags such as !foo are not accepted; remove it",
    "brdf: {kd: !foo [3]}\n": "bad.yaml:7:12: tags such as !foo are not accepted; remove it",
    "brdf: {kd: !!int x}\n": "bad.yaml:7:12: 'x' is not a value of !!int",
    "brdf: {<<: {kd: 1}}\n": "bad.yaml:7:8: merge keys '<<' are not accepted; write the keys out",
    "? [1]\n: 2\n": "bad.yaml:7:3: a key must be a plain word",
}


@pytest.mark.parametrize("text", STRUCTURE)
def test_yaml_that_a_config_does_not_use(text):
    assert message(GOOD + text) == STRUCTURE[text]


def test_files_that_cannot_be_read(folder):
    with pytest.raises(InputError, match=r"^nope\.yaml: no such file$"):
        load_run_config("nope.yaml")
    with pytest.raises(InputError, match="a folder; give the config file inside it"):
        load_run_config(folder)
    Path("latin.yaml").write_bytes(b"task: brdf\ncapture: {recipe: caf\xe9.yaml}\n")
    with pytest.raises(
        InputError, match=r"^latin\.yaml:2: not UTF-8 text; save the file as UTF-8$"
    ):
        load_run_config("latin.yaml")


def test_a_byte_order_mark_is_harmless():
    Path("bom.yaml").write_bytes(b"\xef\xbb\xbf" + GOOD.encode())
    assert load_run_config("bom.yaml") == run_config(GOOD)


# ---------------------------------------------------------------- messages


def test_unknown_key_names_place_and_nearest_word():
    text = CAPTURE + "  erode: 1\n  invalis: mask\n"
    assert message(text + LIGHT) == "bad.yaml:6:3: unknown key 'invalis', did you mean 'invalid'?"
    text = CAPTURE + "ligting:\n  environment: {path: probe.exr}\n"
    assert message(text) == "bad.yaml:5:1: unknown key 'ligting', did you mean 'lighting'?"


def test_unknown_key_without_a_near_one_lists_those_known():
    expected = "bad.yaml:7:11: unknown key 'wibble'; known here: min_cosine, count, seed"
    assert message(GOOD + "samples: {wibble: 1}\n") == expected


@pytest.mark.parametrize("key", ["Lighting", "LIGHTING"])
def test_case_matters_but_is_guessed(key):
    text = CAPTURE + LIGHT.replace("lighting", key)
    assert message(text) == f"bad.yaml:5:1: unknown key {key!r}, did you mean 'lighting'?"


VALUES = {
    (
        "task",
        "brdff",
    ): (
        "found 'brdff', accepted: 'brdf', 'lighting', 'factorize', 'texture' or 'brdf-spectrum', "
        "did you mean 'brdf'?"
    ),
    ("capture.transforms", "12"): "found 12, accepted: a path",
    ("capture.geometry", "1"): "found 1, accepted: {sphere, mesh, scale}",
    ("capture.geometry.sphere.radius", "0"): "found 0, accepted: a number above 0",
    ("capture.geometry.sphere.center", "[1, 2]"): "found [1, 2], accepted: three numbers",
    ("capture.response", "sRGB"): (
        "found 'sRGB', accepted: 'linear', 'srgb' or {curve}, did you mean 'srgb'?"
    ),
    ("capture.invalid", "no"): "found 'no', accepted: 'refuse' or 'mask'",
    ("capture.saturation", "0"): "found 0, accepted: a number above 0",
    ("capture.saturation", ".inf"): "found inf, accepted: a number above 0",
    ("capture.black_level", "-1"): "found -1, accepted: a number of at least 0",
    ("capture.black_level", ".nan"): "found nan, accepted: a number of at least 0",
    ("capture.black_level", "true"): "found true, accepted: a number of at least 0",
    ("capture.erode", "two"): "found 'two', accepted: a whole number of at least 0",
    ("capture.erode", "2.5"): "found 2.5, accepted: a whole number of at least 0",
    ("capture.erode", "-1"): "found -1, accepted: a whole number of at least 0",
    ("capture.erode", "'2'"): "found '2', accepted: a whole number of at least 0",
    ("capture.erode", "true"): "found true, accepted: a whole number of at least 0",
    ("capture.erode", ""): "found nothing, accepted: a whole number of at least 0",
    ("capture.exposure", "meta"): (
        "found 'meta', accepted: 'given' or 'metadata', did you mean 'metadata'?"
    ),
    ("capture.allow_outside", "yes"): "found 'yes', accepted: true or false",
    ("lighting.environment", "probe.exr"): (
        "found 'probe.exr', accepted: {path, convention, scale, height}"
    ),
    ("lighting.environment.convention", "zup"): (
        "found 'zup', accepted: 'z-up', 'y-up', 'angular', 'cross' or 'mirror-ball', "
        "did you mean 'z-up'?"
    ),
    ("lighting.environment.height", "0"): "found 0, accepted: a whole number of at least 1",
    ("lighting.directional", "{direction: [0, 0, 1]}"): (
        "found {direction: [0, 0, 1]}, accepted: a list of {direction, irradiance}"
    ),
    ("lighting.split", ".nan"): "found nan, accepted: 'off', 'auto' or a number from 0 to 1",
    ("samples.min_cosine", ".nan"): "found nan, accepted: a number between 0 and 1, both excluded",
    ("lighting.split", "1.5"): "found 1.5, accepted: 'off', 'auto' or a number from 0 to 1",
    ("brdf.model", "plastic"): (
        "found 'plastic', accepted: 'microfacet', 'ggx', 'beckmann', 'torrance-sparrow', "
        "'cook-torrance', 'ward', 'phong', 'blinn-phong', 'lafortune', 'he-torrance', "
        "'anisotropic-ward', 'kajiya-kay', 'poulin-fournier', 'oren-nayar' or 'lambertian'"
    ),
    ("brdf.kd", "fre"): (
        "found 'fre', accepted: 'free', a number, three numbers, {fixed}, or {bounds, start}"
    ),
    ("brdf.kd", "[1, 2]"): (
        "found [1, 2], accepted: 'free', a number, three numbers, {fixed}, or {bounds, start}"
    ),
    ("brdf.sigma", "true"): (
        "found true, accepted: 'free', a number above 0, {fixed}, or {bounds, start}"
    ),
    ("brdf.mu", "non"): (
        "found 'non', accepted: 'free', 'none', a number above 1, {fixed}, or {bounds, start}, "
        "did you mean 'none'?"
    ),
    ("samples.min_cosine", "1"): ("found 1, accepted: a number between 0 and 1, both excluded"),
    ("samples.count", "0"): "found 0, accepted: a whole number of at least 1",
    ("solve.band_limit", "-1"): "found -1, accepted: 'auto' or a whole number of at least 0",
    ("solve.noise", "guess"): "found 'guess', accepted: 'estimate' or {relative, floor}",
    ("solve.loss", "hubber"): (
        "found 'hubber', accepted: 'auto', 'squares', 'huber' or 'cauchy', did you mean 'huber'?"
    ),
    ("solve.refine", "0"): "found 0, accepted: 'exact' or 'off'",
    ("output", "3"): "found 3, accepted: a path",
}


@pytest.mark.parametrize(("key", "text"), VALUES)
def test_wrong_value_on_the_command_line(key, text):
    expected = f"command line: {key}={text}: {key}: {VALUES[key, text]}"
    assert message(GOOD, f"{key}={text}") == expected


def test_wrong_value_in_the_file():
    text = CAPTURE + "  erode: two\n" + LIGHT
    expected = "bad.yaml:5:10: capture.erode: found 'two', accepted: a whole number of at least 0"
    assert message(text) == expected


def test_wrong_entry_of_a_list_of_sections():
    text = CAPTURE + "lighting:\n  directional:\n  - {direction: [0, 0, 1], irradiance: 1}\n"
    at = "bad.yaml:8:5: lighting.directional[1]"
    assert message(text + "  - 3\n") == f"{at}: found 3, accepted: {{direction, irradiance}}"
    found = message(text + "  - {direction: [0, 0, 0], irradiance: 1}\n")
    assert found == (
        "bad.yaml:8:17: lighting.directional[1].direction: "
        "found [0, 0, 0], which has no direction; accepted: three numbers, not all 0"
    )
    found = message(text + "  - {direction: [0, 0, 1], irradiance: [1, 2]}\n")
    assert found == (
        "bad.yaml:8:40: lighting.directional[1].irradiance: found [1, 2], "
        "accepted: a number of at least 0, or three of them (red, green, blue)"
    )
    found = message(text + "  - {direction: [0, 0, 1]}\n")
    assert found == (
        "bad.yaml:8:5: missing key 'lighting.directional[1].irradiance', "
        "accepted: a number of at least 0, or three of them (red, green, blue)"
    )


def test_missing_keys():
    assert message("capture: {recipe: a.yaml}\n") == (
        "bad.yaml:1:1: missing key 'task', accepted: 'brdf', 'lighting', 'factorize', 'texture' "
        "or 'brdf-spectrum'"
    )
    text = CAPTURE + "lighting:\n  environment: {scale: 2}\n"
    assert (
        message(text) == "bad.yaml:6:3: missing key 'lighting.environment.path', accepted: a path"
    )


def test_a_misspelt_key_is_not_also_missing():
    text = CAPTURE + "lighting:\n  environment: {pat: probe.exr}\n"
    assert message(text) == "bad.yaml:6:17: unknown key 'pat', did you mean 'path'?"


def test_unknown_key_inside_an_alternative():
    assert message(GOOD, "solve.noise={relativ: 1}") == (
        "command line: solve.noise={relativ: 1}: unknown key 'relativ', did you mean 'relative'?"
    )
    assert message(GOOD + "brdf: {mu: {bnds: [1, 2]}}\n") == (
        "bad.yaml:7:13: unknown key 'bnds', did you mean 'bounds'?"
    )


def test_a_long_value_is_shortened():
    found = message(GOOD, "solve.loss=" + "x" * 100).rsplit("found ", 1)[1]
    assert found == f"'{'x' * 55} ..., accepted: 'auto', 'squares', 'huber' or 'cauchy'"


MATERIALS = {
    "{kd: -1}": "brdf.kd: found -1; every value here must be at least 0",
    "{ks: {bounds: [-1, 1]}}": "brdf.ks: found -1; every value here must be at least 0",
    "{kd: {start: [1, 1, -2]}}": "brdf.kd: found -2; every value here must be at least 0",
    "{sigma: 0}": "brdf.sigma: found 0; every value here must be above 0",
    "{sigma: {bounds: [0, 1]}}": "brdf.sigma: found 0; every value here must be above 0",
    "{mu: 1}": "brdf.mu: found 1; every value here must be above 1",
    "{mu: {bounds: [1, 2]}}": "brdf.mu: found 1; every value here must be above 1",
    "{mu: {start: 0.5}}": "brdf.mu: found 0.5; every value here must be above 1",
    "{mu: [2, 2, 2]}": (
        "brdf.mu: found fixed [2, 2, 2]; this parameter is one number for all channels"
    ),
    "{sigma: {start: [2, 2, 2]}}": (
        "brdf.sigma: found start [2, 2, 2]; this parameter is one number for all channels"
    ),
    "{kd: {fixed: 1, bounds: [0, 2]}}": (
        "brdf.kd: a fixed value needs no bounds and no start; remove them, or 'fixed'"
    ),
    "{kd: {fixed: 1, start: 1}}": (
        "brdf.kd: a fixed value needs no bounds and no start; remove them, or 'fixed'"
    ),
    "{kd: {bounds: [2, 1]}}": ("brdf.kd: found bounds [2, 1]; the first must be the smaller one"),
    "{kd: {bounds: [1, 1]}}": ("brdf.kd: found bounds [1, 1]; the first must be the smaller one"),
    "{kd: {bounds: [1, 2], start: 3}}": "brdf.kd: start 3 lies outside the bounds [1, 2]",
    "{ks: [1, 2, 3]}": (
        "brdf: ks has three values; add 'ks_per_channel: true', or give one number"
    ),
    "{model: ggx, sigma: {bounds: [0.1, 2]}}": (
        "brdf: found sigma 2.0 with model ggx, whose roughness is at most 1; "
        "give less or choose model microfacet"
    ),
    "{model: lambertian, ks: 1, mu: none}": (
        "brdf: found ks, mu with model lambertian, which has only kd; "
        "remove the key or choose model microfacet, ggx or beckmann"
    ),
}


@pytest.mark.parametrize("entries", MATERIALS)
def test_materials_that_contradict_themselves(entries):
    assert brdf_message(entries) == MATERIALS[entries]


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        ("model: microfacet", ("exit", "none")),
        ("model: ggx", ("half", "smith")),
        ("model: beckmann", ("half", "smith")),
        ("model: ggx, masking: none", ("half", "none")),
        ("fresnel: exit, model: ggx", ("exit", "smith")),
    ],
)
def test_models_of_physics_have_their_own_defaults(entries, expected):
    config = run_config(GOOD + f"brdf: {{{entries}}}\n")
    stated = recipe(RECIPE.replace("mu: 1.5", f"mu: 1.5, {entries}"))
    for brdf in (config.brdf, stated.brdf):
        assert (brdf.fresnel, brdf.masking) == expected
    again = resolved_yaml(config)
    Path("again.yaml").write_text(again)
    assert load_run_config("again.yaml") == config


def test_a_model_named_on_the_command_line_has_its_defaults_too():
    brdf = run_config(GOOD, "brdf.model=ggx").brdf
    assert (brdf.model, brdf.fresnel, brdf.masking) == ("ggx", "half", "smith")


def test_a_lambertian_needs_no_more_than_kd():
    assert run_config(GOOD + "brdf: {model: lambertian, kd: 0.2}\n").brdf.kd.fixed == 0.2


SECTIONS = {
    "task: brdf\ncapture: {erode: 1}\n" + LIGHT: (
        "bad.yaml:2:1: capture: found neither; give exactly one of transforms, recipe"
    ),
    "task: brdf\ncapture: {transforms: a, recipe: b, geometry: {sphere: {}}}\n" + LIGHT: (
        "bad.yaml:2:1: capture: found both; give exactly one of transforms, recipe"
    ),
    "task: brdf\ncapture: {transforms: a}\n" + LIGHT: (
        "bad.yaml:2:1: capture: missing key 'geometry'; "
        "photographs need {sphere: ...} or {mesh: ...}"
    ),
    "task: brdf\ncapture: {recipe: a, images: b}\n": (
        "bad.yaml:2:1: capture: found images with a recipe; "
        "only transforms names photographs, remove it"
    ),
    "task: brdf\ncapture: {transforms: a, geometry: {sphere: {}, mesh: b}}\n" + LIGHT: (
        "bad.yaml:2:26: capture.geometry: found sphere and mesh; give exactly one of sphere, mesh"
    ),
    "task: brdf\ncapture: {transforms: a, geometry: {}}\n" + LIGHT: (
        "bad.yaml:2:26: capture.geometry: found none; give exactly one of sphere, mesh"
    ),
    "task: brdf\ncapture: {transforms: a, geometry: {sphere: {}, scale: 2}}\n" + LIGHT: (
        "bad.yaml:2:26: capture.geometry: found scale 2; only a mesh has a scale, remove it"
    ),
    CAPTURE: (
        "bad.yaml:1:1: no light given; lighting needs one of environment, directional, per_frame"
    ),
    CAPTURE + "lighting: {split: off}\n": (
        "bad.yaml:1:1: no light given; lighting needs one of environment, directional, per_frame"
    ),
    GOOD + "solve: {noise: {}}\n": (
        "bad.yaml:7:9: solve.noise: relative and floor are both 0; "
        "give one above 0, or noise: estimate"
    ),
}


@pytest.mark.parametrize("text", SECTIONS)
def test_sections_that_contradict_themselves(text):
    assert message(text) == SECTIONS[text]


RECIPES = {
    ("geometry: {sphere: {}}", "geometry: {}"): (
        "bad.yaml:1:1: geometry: found none; give exactly one of sphere, mesh, ellipsoid, sculpture"
    ),
    ("geometry: {sphere: {}}", "geometry: {ellipsoid: {radii: [1, 2, 0]}}"): (
        "bad.yaml:1:31: geometry.ellipsoid.radii: found [1, 2, 0], accepted: three numbers above 0"
    ),
    (", ks: 0.2, sigma: 0.1", ""): (
        "bad.yaml:2:1: brdf: a microfacet recipe states its whole truth; missing: ks, sigma"
    ),
    ("kd: 0.1, ", ""): (
        "bad.yaml:2:1: missing key 'brdf.kd', "
        "accepted: a number of at least 0, or three of them (red, green, blue)"
    ),
    ("mu: 1.5", "mu: 1"): "bad.yaml:2:42: brdf.mu: found 1, accepted: 'none' or a number above 1",
    ("kd: 0.1, ks: 0.2", "model: ggx, kd: 0.1"): (
        "bad.yaml:2:1: brdf: a ggx recipe states its whole truth; missing: ks"
    ),
    ("sigma: 0.1", "model: beckmann, sigma: 1.1"): (
        "bad.yaml:2:1: brdf: found sigma 1.1 with model beckmann, whose roughness is at most 1; "
        "give less or choose model microfacet"
    ),
    ("kd: 0.1, ks: 0.2", "model: lambertian, kd: 0.1, ks: 0.2"): (
        "bad.yaml:2:1: brdf: found ks with model lambertian, which has only kd; "
        "remove the key or choose model microfacet, ggx or beckmann"
    ),
    ("directional: [{direction: [0, 0, 1], irradiance: 3}]", "area: []"): (
        "bad.yaml:3:1: lighting: no light given; "
        "give at least one of area, environment, directional"
    ),
    (
        "directional: [{direction: [0, 0, 1], irradiance: 3}]",
        "area: [{direction: [0, 0, 1], width_degrees: 0, radiance: 1}]",
    ): (
        "bad.yaml:4:48: lighting.area[0].width_degrees: found 0, "
        "accepted: an angle in degrees above 0 and up to 180"
    ),
    ("geometry: {sphere: {}}", "geometry: {sphere: {}}\nviews: {field_of_view_degrees: 180}"): (
        "bad.yaml:2:32: views.field_of_view_degrees: found 180, "
        "accepted: an angle in degrees between 0 and 180"
    ),
    ("geometry: {sphere: {}}", "geometry: {sphere: {}}\nviews: {elevation_degrees: 91}"): (
        "bad.yaml:2:28: views.elevation_degrees: found 91, "
        "accepted: an angle in degrees from -90 to 90"
    ),
}


@pytest.mark.parametrize(("old", "new"), RECIPES)
def test_wrong_recipes(old, new):
    assert old in RECIPE
    assert message(RECIPE.replace(old, new), load=recipe) == RECIPES[old, new]


def test_all_errors_at_once_in_the_order_of_their_places():
    text = (
        "task: brdf\ncapture:\n  recipe: a.yaml\n  erode: x\n  invalis: mask\nsamples: {count: 0}\n"
        "solve: {loss: l}\nsamples: {}\nbrdf: {sigma: -1}\n"
    )
    found = message(text, "solve.starts=0", "brdf.m=2").split("\n")
    assert [line.split(": ")[0] for line in found] == [
        "bad.yaml:4:10",
        "bad.yaml:5:3",
        "bad.yaml:6:18",
        "bad.yaml:7:15",
        "bad.yaml:8:1",
        "bad.yaml:9:15",
        "command line",
        "command line",
    ]
    assert found[6].startswith("command line: solve.starts=0: ")
    assert found[7] == "command line: brdf.m=2: unknown key 'm', did you mean 'mu'?"


def test_lines_sort_as_numbers():
    text = GOOD + "\n" * 3 + "brdf: {sigma: -1}\nsolve: {loss: l}\n"
    assert [line.split(":")[1] for line in message(text).split("\n")] == ["10", "11"]
    assert message("c: 1\n" + "\n" * 9 + "b: 1\n").split("\n")[-1].startswith("bad.yaml:11:1")


# ---------------------------------------------------------------- overrides


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


# ---------------------------------------------------------------- paths


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


# ---------------------------------------------------------------- written out


@pytest.mark.parametrize("text", [GOOD, FULL, "task: brdf\ncapture: {recipe: 'a: b.yaml'}\n"])
def test_a_run_config_written_out_is_read_back_equal(text):
    config = run_config(text)
    again = resolved_yaml(config)
    (Path("elsewhere")).mkdir()
    Path("elsewhere/again.yaml").write_text(again)
    assert load_run_config("elsewhere/again.yaml") == config
    assert resolved_yaml(load_run_config("elsewhere/again.yaml")) == again


def test_a_recipe_written_out_is_read_back_equal():
    config = recipe(RECIPE + "  area: [{direction: [1, 0, 0], width_degrees: 9, radiance: 1e-7}]\n")
    assert recipe(resolved_yaml(config)) == config


def test_defaults_are_written_out():
    text = resolved_yaml(run_config(GOOD))
    assert "min_cosine: 0.15" in text
    assert "center: [0.0, 0.0, 0.0]" in text
    assert f"transforms: {os.getcwd()}/photos/transforms.json" in text


@pytest.mark.parametrize("root", [RunConfig, RecipeConfig])
def test_schema_names_every_key_with_a_description(root):
    schema = json.loads(json.dumps(json_schema(root)))
    assert schema["additionalProperties"] is False
    assert list(schema["properties"]) == list(root.model_fields)
    for name, section in {"root": schema, **schema["$defs"]}.items():
        for key, entry in section.get("properties", {}).items():
            assert entry.get("description"), (name, key)


def test_schema_knows_the_shorthands():
    schema = json_schema()
    forms = schema["$defs"]["Parameter"]["anyOf"]
    assert {"const": "free"} in forms
    assert {"type": "number"} in forms
    irradiance = schema["$defs"]["DirectionalConfig"]["properties"]["irradiance"]
    assert {entry["type"] for entry in irradiance["anyOf"]} == {"number", "array"}
