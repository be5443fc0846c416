"""Rectified photographs of a flat sample, with the places of camera and flash.

- The ray of every pixel meets the sample where the rectified picture shows it.
- Photographs come in the order of their numbers, each with its light.
- What is wrong in the file is named with its key.
"""

import json

import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.io import write_image
from jaxrender.io.captures import read_contents, recognise
from jaxrender.io.captures.paths import Looking

SIDE, ROWS, COLUMNS = 6.0, 4, 8
EYES = [[1.0, 0.5, 16.0], [-2.0, 1.0, 15.0]]
LAMPS = [[1.5, 0.5, 16.0], [-2.0, 1.5, 15.0]]
STATED = {
    "image_size": SIDE,
    "idx": [3, 1],
    "camera_pos": EYES,
    "light_pos": LAMPS,
    "light_pow": [1500, 1400, 1300],
}


def written(folder, names=("01.png", "03.png"), **changes):
    """Write a folder, with keys changed, or left out where None is given."""
    folder.mkdir(parents=True, exist_ok=True)
    stated = {key: value for key, value in (STATED | changes).items() if value is not None}
    (folder / "parameters.json").write_text(json.dumps(stated))
    for number, name in enumerate(names):
        (folder / name).parent.mkdir(exist_ok=True)
        write_image(folder / name, np.full((ROWS, COLUMNS, 3), 0.2 + 0.1 * number))
    return folder


def read(folder):
    return read_contents(recognise(folder), Looking(folder))


def test_rays_meet_the_sample_where_the_picture_shows_it(tmp_path):
    contents = read(written(tmp_path))
    for frame, eye in zip(contents.capture.frames, EYES, strict=True):
        origins, directions = (np.asarray(part) for part in frame.camera.rays())
        places = origins - directions * (origins[..., 2:] / directions[..., 2:])
        x = (np.arange(COLUMNS) + 0.5) / COLUMNS * SIDE - SIDE / 2
        y = SIDE / 2 - (np.arange(ROWS) + 0.5) / ROWS * SIDE
        np.testing.assert_allclose(places[..., 0], np.tile(x, (ROWS, 1)), atol=1e-12)
        np.testing.assert_allclose(places[..., 1], np.tile(y[:, None], COLUMNS), atol=1e-12)
        np.testing.assert_allclose(places[..., 2], 0, atol=1e-12)
        np.testing.assert_allclose(origins.reshape(-1, 3)[0], eye)
    assert contents.square.side == SIDE


def test_photographs_come_by_their_numbers_with_their_light(tmp_path):
    contents = read(written(tmp_path))
    assert [frame.name for frame in contents.capture.frames] == ["03", "01"]
    assert [sources[0].position for sources in contents.light.per_frame] == [*map(tuple, LAMPS)]
    assert contents.light.per_frame[0][0].intensity == (1500, 1400, 1300)
    assert "one flash a photograph, with its place" in contents.found
    inside = written(tmp_path / "two", ("images/01.png", "images/03.png"), images_dir="images")
    assert [f.image_path.parent.name for f in read(inside).capture.frames] == ["images"] * 2
    # Without numbers they are counted from 0, and a flash may be the camera's own.
    plain = written(tmp_path / "three", ("00.png", "01.png"), idx=None, light_pos=EYES)
    assert [frame.name for frame in read(plain).capture.frames] == ["00", "01"]
    assert "one flash a photograph, where the camera stands" in read(plain).found


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"light_pos": None}, r"parameters\.json: the key `light_pos` is missing"),
        ({"image_size": 0}, "`image_size` is 0; give the side"),
        ({"image_size": "wide"}, "`image_size` is wide; wanted a number"),
        ({"camera_pos": []}, r"`camera_pos` is \[\]; wanted a list of places"),
        ({"camera_pos": [[1, 2, -3], [1, 1, 1]]}, "`camera_pos` 0 lies below the sample"),
        ({"light_pos": [[1, 1, 1]]}, "`light_pos` is .* one for every photograph"),
        ({"light_pos": [[1, 1, 1], [0, 0, None]]}, "`light_pos` is .* wanted a list of places"),
        ({"light_pow": [1, 2]}, r"`light_pow` is \[1, 2\]; wanted three numbers"),
        ({"light_pow": [1, 2, -1]}, r"`light_pow` \[1\.0, 2\.0, -1\.0\] is negative"),
        ({"idx": [1]}, r"`idx` is \[1\]; wanted 2 whole numbers"),
        ({"idx": [1, 2.5]}, r"`idx` is \[1, 2\.5\]; wanted 2 whole numbers"),
        ({"idx": [1, 7]}, r"photograph 7 \(`idx`\) is not in "),
        ({"images_dir": 3}, "`images_dir` is 3; wanted the name of a folder"),
    ],
)
def test_mistakes_are_named(tmp_path, changes, message):
    folder = written(tmp_path)
    stated = json.loads((folder / "parameters.json").read_text()) | changes
    stated = {key: value for key, value in stated.items() if value is not None}
    (folder / "parameters.json").write_text(json.dumps(stated))
    with pytest.raises(InputError, match=message):
        read(folder)


def test_a_list_is_no_capture(tmp_path):
    (tmp_path / "parameters.json").write_text("[1, 2]")
    with pytest.raises(InputError, match="wanted an object with the keys image_size"):
        read(tmp_path)
