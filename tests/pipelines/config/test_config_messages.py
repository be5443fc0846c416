"""What is said back of a config that is wrong.

- Each message in full: file, line, column, key, value found, what is accepted, the nearest word.
- All errors of a file at once, sorted by place; the command line's after the file's.
"""

from pathlib import Path

import pytest
from config_texts import CAPTURE, GOOD, LIGHT, message, run_config

from jaxrender.errors import InputError
from jaxrender.pipelines.config import load_run_config
from jaxrender.pipelines.config.tasks import TASKS

*_FIRST, _LAST = map(repr, TASKS)
_TASKS = f"{', '.join(_FIRST)} or {_LAST}"
KEYS = "task, capture, lighting, captures, brdf, samples, solve, texture, spectrum, output"
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
    with pytest.raises(InputError, match=r"^nope\.yaml: no such file; mend the path$"):
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
    ("task", "brdff"): f"found 'brdff', accepted: {_TASKS}, did you mean 'brdf'?",
    ("capture.transforms", "12"): "found 12, accepted: a path",
    ("capture.geometry", "1"): "found 1, accepted: {sphere, mesh, scale, rotation, translation}",
    ("capture.geometry.sphere.radius", "0"): "found 0, accepted: a number above 0",
    ("capture.geometry.sphere.center", "[1, 2]"): "found [1, 2], accepted: three numbers",
    ("capture.response", "sRGB"): (
        "found 'sRGB', accepted: 'linear', 'srgb' or {curve}, did you mean 'srgb'?"
    ),
    ("capture.invalid", "no"): "found 'no', accepted: 'refuse' or 'mask'",
    ("capture.saturation", "0"): "found 0, accepted: 'auto' or a number above 0",
    ("capture.saturation", ".inf"): "found inf, accepted: 'auto' or a number above 0",
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
    ("capture.camera_axes", "opencw"): (
        "found 'opencw', accepted: 'opengl', 'opencv', 'pytorch3d', 'llff', 'ros', "
        "'opengl_inverted', 'opencv_inverted', 'pytorch3d_inverted', 'llff_inverted' or "
        "'ros_inverted', did you mean 'opencv'?"
    ),
    ("capture.mirrored", "1"): "found 1, accepted: true or false",
    ("capture.geometry.rotation", "90"): "found 90, accepted: three numbers",
    ("capture.geometry.translation", "[1, 2]"): "found [1, 2], accepted: three numbers",
    ("lighting.environment.yaw", ".nan"): "found nan, accepted: a number",
    ("lighting.environment.mirrored", "1"): "found 1, accepted: true or false",
    ("capture.allow_outside", "yes"): "found 'yes', accepted: true or false",
    ("lighting.environment", "probe.exr"): (
        "found 'probe.exr', accepted: {path, convention, mirrored, yaw, scale, height}"
    ),
    ("lighting.environment.convention", "zup"): (
        "found 'zup', accepted: 'z-up', 'y-up', 'angular', 'cross' or 'mirror-ball', "
        "did you mean 'z-up'?"
    ),
    ("lighting.environment.height", "0"): "found 0, accepted: a whole number of at least 1",
    ("lighting.directional", "{direction: [0, 0, 1]}"): (
        "found {direction: [0, 0, 1]}, accepted: a list of {direction, irradiance}"
    ),
    ("lighting.point", "{position: [0, 0, 1]}"): (
        "found {position: [0, 0, 1]}, accepted: a list of {position, intensity}"
    ),
    ("lighting.split", ".nan"): "found nan, accepted: 'off', 'auto' or a number from 0 to 1",
    ("samples.min_cosine", ".nan"): "found nan, accepted: a number between 0 and 1, both excluded",
    ("lighting.split", "1.5"): "found 1.5, accepted: 'off', 'auto' or a number from 0 to 1",
    ("brdf.model", "plastic"): (
        "found 'plastic', accepted: 'microfacet', 'ggx', 'beckmann', 'torrance-sparrow', "
        "'cook-torrance', 'ward', 'phong', 'blinn-phong', 'lafortune', 'he-torrance', "
        "'anisotropic-ward', 'anisotropic-ggx', 'kajiya-kay', 'poulin-fournier', 'oren-nayar', "
        "'lambertian', 'two-ggx', 'metallic-roughness', 'principled', 'openpbr', 'free' or 'bank'"
    ),
    ("brdf.kd", "fre"): (
        "found 'fre', accepted: 'free', a number, three numbers, {fixed}, or {bounds, start, prior}"
    ),
    ("brdf.kd", "[1, 2]"): (
        "found [1, 2], accepted: 'free', a number, three numbers, {fixed}, or {bounds, start, "
        "prior}"
    ),
    ("brdf.sigma", "true"): (
        "found true, accepted: 'free', a number above 0, {fixed}, or {bounds, start, prior}"
    ),
    ("brdf.mu", "non"): (
        "found 'non', accepted: 'free', 'none', a number above 1, {fixed}, or {bounds, start, "
        "prior}, "
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
        f"bad.yaml:1:1: missing key 'task', accepted: {_TASKS}"
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
        "bad.yaml:2:30: capture.images: found 'b', but a recipe has photographs of its own; "
        "remove it, or give capture.transforms"
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
    "task: brdf\ncapture: {transforms: a, geometry: {sphere: {}, rotation: [0, 0, 9]}}\n" + LIGHT: (
        "bad.yaml:2:26: capture.geometry: found rotation; only a mesh has a rotation, remove it"
    ),
    "task: brdf\ncapture: {recipe: a, camera_axes: opencv}\n": (
        "bad.yaml:2:35: capture.camera_axes: found 'opencv', but a recipe has cameras of its own; "
        "remove it, or give capture.transforms"
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
