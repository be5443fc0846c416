"""Per-photograph lights from files.

Pinned down: order and count of the photographs, by position and by name; both forms of irradiance;
directions normalised; and messages that name line, entry and source.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.io.lights import read_per_frame_lights
from jaxrender.lighting import PointSources

LIGHTS_TXT = Path(__file__).parents[3] / "shared" / "data" / "photos" / "lights.txt"

UP = {"direction": [0, 0, 2], "irradiance": 1}
SIDE = {"direction": [3, 0, 4], "irradiance": [1, 2.5, 3]}
ROUNDING = 1e-15


def write(tmp_path: Path, content: object, name: str = "lights.json") -> Path:
    text = content if isinstance(content, str) else json.dumps(content)
    (tmp_path / name).write_text(text)
    return tmp_path / name


def check(lights) -> None:
    """The lights of photograph a are none, those of b are UP and SIDE."""
    assert [len(sources.directions) for sources in lights] == [0, 2]
    np.testing.assert_allclose(lights[1].directions, [[0, 0, 1], [0.6, 0, 0.8]], atol=ROUNDING)
    np.testing.assert_allclose(lights[1].irradiance, [[1, 1, 1], [1, 2.5, 3]], atol=ROUNDING)


def test_json_by_position(tmp_path):
    check(read_per_frame_lights(write(tmp_path, [[], [UP, SIDE]]), ["a", "b"]))


def test_sources_with_a_place(tmp_path):
    near = {"position": [0, 0, 2], "intensity": [4, 5, 6]}
    alone, mixed = read_per_frame_lights(write(tmp_path, [[near], [near, UP, near]]), ["a", "b"])
    assert isinstance(alone, PointSources)
    np.testing.assert_array_equal(alone.positions, [[0, 0, 2]])
    np.testing.assert_array_equal(alone.intensity, [[4, 5, 6]])
    far, close = mixed.parts
    np.testing.assert_array_equal(far.directions, [[0, 0, 1]])
    assert len(close.positions) == 2


def test_json_by_name(tmp_path):
    check(read_per_frame_lights(write(tmp_path, {"b": [UP, SIDE], "a": []}), ["a", "b"]))


def test_text(tmp_path):
    lights = read_per_frame_lights(write(tmp_path, "2\n0 0 5\n\n3 0 4\n", "l.txt"), ["a", "b"])
    found = np.concatenate([sources.directions for sources in lights])
    np.testing.assert_allclose(found, [[0, 0, 1], [0.6, 0, 0.8]], atol=ROUNDING)
    for sources in lights:
        np.testing.assert_array_equal(sources.irradiance, np.ones((1, 3)))


@pytest.mark.skipif(not LIGHTS_TXT.exists(), reason="the real photographs are not on this machine")
def test_the_lights_of_real_photographs():
    lights = read_per_frame_lights(LIGHTS_TXT, [str(i) for i in range(12)])
    # Six digits in the file.
    np.testing.assert_allclose(
        lights[2].directions, [[-0.0654826, 0.180077, 0.98147]], rtol=0, atol=2e-6
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([[UP]], r"lights for 1 photographs, but the capture has 2"),
        ({"a": [UP]}, r"no lights are given for 'b'; the photographs are a, b"),
        ({"a": [], "b": [], "c": []}, r"no photograph is named 'c'; the photographs are a, b"),
        ("3", r"wanted a list with one entry for each photograph"),
        ("[[],\n[}]", r":2:2: "),
        ([[], UP], r"entry 1 \(b\): wanted a list of sources"),
        ([[], [UP, 3]], r"entry 1 \(b\), source 1: wanted the keys direction and irradiance"),
        ([[], [{"direction": [0, 0, 1]}]], r"wanted the keys direction and irradiance"),
        ([[], [{"position": [0, 0, 1], "irradiance": 1}]], r"or position and intensity; found"),
        ([[], [{"position": [0, 1], "intensity": 1}]], r"`position` is \[0, 1\]; wanted three"),
        ([[], [{"position": [0, 1, 0], "intensity": -1}]], r"the intensity \[-1\.0.* is negative"),
        ([[], [{**UP, "colour": 1}]], r"wanted the keys direction and irradiance"),
        ([[], [{**UP, "direction": [0, 0, 0]}]], r"source 0: the direction is zero"),
        ([[], [{**UP, "direction": [0, 1]}]], r"`direction` is \[0, 1\]; wanted three finite"),
        ([[], [{**UP, "direction": [0, 0, "1"]}]], r"`direction` is .* wanted three finite"),
        ([[], [{**UP, "irradiance": [1, 2]}]], r"`irradiance` is \[1, 2\]; wanted three finite"),
        (
            [[], [{**UP, "irradiance": float("nan")}]],
            r"`irradiance` is \[nan, nan, nan\]; wanted three finite",
        ),
        ([[], [{**UP, "irradiance": -1}]], r"the irradiance \[-1\.0, -1\.0, -1\.0\] is negative"),
    ],
)
def test_mistakes_in_json_are_named(tmp_path, content, message):
    with pytest.raises(InputError, match=r"lights\.json.*" + message):
        read_per_frame_lights(write(tmp_path, content), ["a", "b"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"l\.txt:1: the file is empty; wanted one direction a line"),
        ("0 0 1\n", r"lights for 1 photographs, but the capture has 2"),
        ("2\n0 0 1\n", r"l\.txt:1: 2 directions announced, but 1 follow"),
        ("1\n0 0 1\n", r"lights for 1 photographs, but the capture has 2"),
        ("2\n0 0 1\n\n0 0\n", r"l\.txt:4: wanted a direction as three finite numbers"),
        ("2\n0 0 1\n0 0 up\n", r"l\.txt:3: .*found '0 0 up'"),
        ("2\n0 0 0\n0 0 1\n", r"l\.txt:2: .*not all zero"),
        ("2\nnan 0 1\n0 0 1\n", r"l\.txt:2: .*found 'nan 0 1'"),
    ],
)
def test_mistakes_in_text_are_named(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_per_frame_lights(write(tmp_path, text, "l.txt"), ["a", "b"])


def test_directions_with_an_irradiance_each(tmp_path):
    directions = write(tmp_path, "0 0 5\n3 0 4\n", "l.txt")
    energy = write(tmp_path, "1 2.5 3\n2\n", "e.txt")
    lights = read_per_frame_lights(directions, ["a", "b"], energy)
    found = np.concatenate([sources.directions for sources in lights])
    np.testing.assert_allclose(found, [[0, 0, 1], [0.6, 0, 0.8]], atol=ROUNDING)
    np.testing.assert_array_equal(lights[0].irradiance, [[1, 2.5, 3]])
    np.testing.assert_array_equal(lights[1].irradiance, [[2, 2, 2]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1\n", r"e\.txt: lights for 1 photographs, but the capture has 2"),
        ("1\n-1\n", r"e\.txt:2: wanted an irradiance .* 0 or more; found '-1'"),
        ("1 2\n1\n", r"e\.txt:1: wanted an irradiance as one or three numbers"),
    ],
)
def test_mistakes_in_an_irradiance_are_named(tmp_path, text, message):
    directions, energy = write(tmp_path, "0 0 1\n1 0 0\n", "l.txt"), write(tmp_path, text, "e.txt")
    with pytest.raises(InputError, match=message):
        read_per_frame_lights(directions, ["a", "b"], energy)


def test_json_has_its_own_irradiance(tmp_path):
    energy = write(tmp_path, "1\n1\n", "e.txt")
    with pytest.raises(InputError, match="JSON states its own irradiance"):
        read_per_frame_lights(write(tmp_path, [[], [UP]]), ["a", "b"], energy)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"gone\.json: no such file"):
        read_per_frame_lights(tmp_path / "gone.json", ["a"])
