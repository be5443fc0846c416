"""The light alone, for other programs: pictures, cube faces and harmonics.

- Panoramas are what who stands within sees; faces are those that OpenGL names (checked by a light
  that is brightest towards one axis, and brighter to its right than to its left).
- JSON, C and GLSL hold the same coefficients; the GLSL, run as Python, is our radiance and our
  irradiance to degree 2.
"""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import jaxrender as jr
from jaxrender.harmonics import evaluate
from jaxrender.io import read_image
from jaxrender.io.exports import (
    Contents,
    cube_faces,
    environment_losses,
    write_environment_pictures,
    write_harmonics,
)
from jaxrender.reflection import irradiance

ROWS = 16
GRID = jr.Environment(np.zeros((ROWS, 2 * ROWS, 3))).grid
COEFFICIENTS = np.random.default_rng(4).normal(size=(16, 3))
# The world's direction in the middle of each face, and to its right.
MIDDLES = {
    "px": ((1, 0, 0), (0, 1, 0)),
    "nx": ((-1, 0, 0), (0, -1, 0)),
    "py": ((0, 0, 1), (1, 0, 0)),
    "ny": ((0, 0, -1), (1, 0, 0)),
    "pz": ((0, -1, 0), (1, 0, 0)),
    "nz": ((0, 1, 0), (-1, 0, 0)),
}


def light_towards(direction):
    values = 1.5 + np.asarray(GRID.directions()) @ np.array(direction, float)
    return jr.Environment(np.repeat(values[..., None], 3, axis=-1))


@pytest.mark.parametrize("name", MIDDLES)
def test_faces_are_those_of_opengl(name):
    middle, right = MIDDLES[name]
    sums = {face: image.sum() for face, image in cube_faces(light_towards(middle)).items()}
    assert max(sums, key=sums.__getitem__) == name
    face = cube_faces(light_towards(right))[name]
    assert face.shape == (ROWS // 2, ROWS // 2, 3)
    assert (face[:, 1:] > face[:, :-1]).all()


def test_faces_beside_the_horizon_are_upright():
    for name in ("px", "nx", "pz", "nz"):
        face = cube_faces(light_towards((0, 0, 1)))[name]
        assert (face[1:] < face[:-1]).all()


def test_pictures_are_written_and_read(tmp_path):
    light = light_towards((0.3, 0.5, 0.8))
    contents = Contents("x", environment=light)
    parts = write_environment_pictures(contents, tmp_path)
    assert {part.file for part in parts} == {p.name for p in tmp_path.iterdir()}
    # +x in the middle, azimuth to the left.
    expected = np.asarray(light.radiance)[:, (ROWS - 1 - np.arange(2 * ROWS)) % (2 * ROWS)]
    found = read_image(tmp_path / "environment.exr").pixels
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    coarse = read_image(tmp_path / "environment.hdr").pixels
    np.testing.assert_allclose(coarse, expected, rtol=0.01)
    lamp = jr.DirectionalSources(np.array([[0.0, 0, 1]]), np.ones((1, 3)))
    assert environment_losses(contents) == ()
    lost = environment_losses(contents._replace(sources=lamp))[0]
    assert "sources: a picture has no room" in lost
    with pytest.raises(ValueError, match="no environment"):
        write_environment_pictures(Contents("x"), tmp_path)


def test_harmonics_are_the_same_in_every_file(tmp_path):
    write_harmonics(COEFFICIENTS, tmp_path)
    stated = json.loads((tmp_path / "light.json").read_text())
    np.testing.assert_array_equal(stated["coefficients"], COEFFICIENTS)
    assert stated["band_limit"] == 3
    header = (tmp_path / "light.h").read_text()
    numbers = re.findall(r"(-?[\d.e+-]+)f\b", header.split("= {")[1])
    assert "jaxrender_light[16][3]" in header
    np.testing.assert_allclose(np.reshape(numbers, (16, 3)).astype(float), COEFFICIENTS, rtol=1e-8)
    for text in (header, (tmp_path / "light.glsl").read_text(), json.dumps(stated)):
        assert "no Condon-Shortley sign" in text
        assert "z up" in text


def test_the_shader_is_our_radiance_and_irradiance(tmp_path):
    write_harmonics(COEFFICIENTS, tmp_path)
    shader = (tmp_path / "light.glsl").read_text()
    normal = np.array([0.36, 0.48, 0.8])
    place = type("vec3", (), dict(zip("xyz", normal)))()
    found = {}
    for name, body in re.findall(r"vec3 (\w+)\(vec3 n\) \{\s+return(.*?);", shader, re.DOTALL):
        words = {"n": place, "vec3": lambda *parts: np.array(parts)}
        found[name] = eval(body.strip().replace("\n", " "), words)
    nine = COEFFICIENTS[:9]
    np.testing.assert_allclose(found["radiance"], evaluate(nine, normal), rtol=1e-6)
    np.testing.assert_allclose(found["irradiance"], irradiance(nine, normal), rtol=1e-6)
    assert math.isfinite(found["radiance"].sum())


def test_too_few_coefficients_are_refused():
    with pytest.raises(ValueError, match="give nine"):
        write_harmonics(np.zeros((4, 3)), Path())
