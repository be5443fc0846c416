"""Light that a config states by numbers, each kind of the catalogue tried by itself.

- The section makes the class that the catalogue names, from every key and in the stated units.
- Fit and recipe take the same section; a fit gets sources as they are, other light as an image.
- Kinds add up.
- Photographs of a diffuse ball are closed forms: the irradiance of light of degree 1, and 7 pi / 9
  of the zenith below the overcast sky.
- What a class refuses is reported with the section.
"""

import numpy as np
import pytest
from pydantic import ValidationError

from jaxrender.catalogue import LIGHTS
from jaxrender.errors import InputError
from jaxrender.geometry import Sphere, observe
from jaxrender.harmonics import explicit_basis
from jaxrender.io import read_capture, read_environment, read_image
from jaxrender.lighting import ClearSky, DirectionalSources, PointSources, SmoothLobes, light_of
from jaxrender.pipelines.config import (
    LightingConfig,
    RecipeConfig,
    RecipeLightingConfig,
    load_run_config,
)
from jaxrender.pipelines.scene import known_light, light_for_fit, lights_of, shape_of
from jaxrender.pipelines.synth import synthesise

BALL = Sphere()
TYPICAL = {
    "direction": [0.3, -0.2, 0.9],
    "position": [1.5, -2.0, 3.0],
    "colour": [0.9, 1.0, 1.1],
    "colours": [3.0, 0.2, [0.3, 0.4, 0.5], -0.1],
    "angle": 40.0,
}


def section_of(name):
    """Write the section of a kind of light with typical values."""
    entry = {
        key.name: key.words[-1] if key.kind == "word" else TYPICAL[key.kind]
        for key in LIGHTS[name].keys
    }
    return [entry, entry] if LIGHTS[name].many else entry


def total(light):
    """Sum the irradiance of a light's point masses, of each channel, as the origin sees them."""
    if isinstance(light, PointSources):
        light = light.seen_from(np.zeros(3))
    return np.asarray(light.nodes().irradiance).sum(axis=0)


def recipe_of(lighting, **given):
    sections = {
        "geometry": {"sphere": {}},
        "brdf": {"model": "lambertian", "kd": [0.1, 0.2, 0.3]},
        "lighting": lighting,
        "views": {"count": 2, "step_degrees": 90, "elevation_degrees": 50, "width": 16}
        | {"height": 16},
        "noise": {"relative": 0.0},
        "environment_height": 32,
    }
    stated = {key: value for key, value in (sections | given).items() if value is not None}
    return RecipeConfig.model_validate(stated)


@pytest.mark.parametrize("name", LIGHTS)
def test_a_section_makes_the_class_of_the_catalogue(name):
    kind, section = LIGHTS[name], section_of(name)
    lighting = LightingConfig.model_validate({name: section})
    (light,) = lights_of(lighting)
    assert type(light).__name__ == kind.home.rpartition(".")[2]
    assert np.all(np.isfinite(total(light)))
    assert lighting.given
    assert lighting.has_image == kind.is_image
    (true,) = lights_of(RecipeLightingConfig.model_validate({name: section}))
    np.testing.assert_array_equal(total(light), total(true))
    known = known_light(lighting, [], BALL)
    assert (known.environment is not None) == kind.is_image
    assert (known.directional.directions.shape[0] > 0) == (not kind.is_image)
    if kind.many:
        (one,) = lights_of(LightingConfig.model_validate({name: section[:1]}))
        np.testing.assert_allclose(total(light), 2 * total(one), rtol=1e-6)


@pytest.mark.parametrize("name", LIGHTS)
def test_every_key_that_has_no_default_is_needed(name):
    for key in LIGHTS[name].keys:
        entry = section_of(name)
        entry = dict(entry[0] if LIGHTS[name].many else entry)
        del entry[key.name]
        section = {name: [entry] if LIGHTS[name].many else entry}
        if key.kind == "word":
            (light,) = lights_of(LightingConfig.model_validate(section))
            first = light_of(name, [entry | {key.name: key.words[0]}])
            np.testing.assert_array_equal(total(light), total(first))
            continue
        with pytest.raises(ValidationError, match=key.name):
            LightingConfig.model_validate(section)


def test_values_and_units():
    area = {"direction": [0, 3, 4], "width_degrees": 90, "radiance": [1, 2, 3]}
    found = light_of("area", [area])
    assert isinstance(found, SmoothLobes)
    # 90 degrees aside it has fallen to 1/e.
    at = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(found.radiance(at), [[1, 2, 3], np.exp(-1) * np.arange(1, 4)])
    source = light_of("directional", [{"direction": [0, 0, 2], "irradiance": [1, 2, 3]}])
    assert isinstance(source, DirectionalSources)
    np.testing.assert_array_equal(source.irradiance, [[1, 2, 3]])
    sky = light_of("clear_sky", [{"sun": [0, 1, 1], "zenith": [1, 1, 1], "air": "polluted"}])
    assert sky.distribution == ClearSky(np.ones(3), np.ones(3), "polluted").distribution


def test_kinds_add_up():
    both = ("overcast_sky", "harmonic", "directional")
    lighting = LightingConfig.model_validate({name: section_of(name) for name in both})
    known, alone = known_light(lighting, [], BALL), {}
    for name in both:
        alone[name] = known_light(LightingConfig.model_validate({name: section_of(name)}), [], BALL)
    images = [np.asarray(alone[name].environment.radiance) for name in both[:2]]
    np.testing.assert_allclose(known.environment.radiance, sum(images), rtol=1e-6)
    sources = alone["directional"].directional
    np.testing.assert_array_equal(known.directional.irradiance, sources.irradiance)


def photographs(recipe, folder):
    """Give every lit pixel's normal and value, of all photographs."""
    synthesise(recipe, folder.parent / "recipe.yaml", folder)
    shape, normals, values = shape_of(recipe.geometry), [], []
    for frame in read_capture(folder / "transforms.json").frames:
        view = observe(frame.camera, shape)
        normals.append(np.asarray(view.normals)[view.hit])
        values.append(read_image(frame.image_path).pixels[view.hit])
    return np.concatenate(normals), np.concatenate(values)


def test_photographs_under_light_of_degree_1(tmp_path):
    coefficients = np.array([3.0, 0.5, -0.4, 0.8])
    recipe = recipe_of({"harmonic": {"coefficients": coefficients.tolist()}})
    normals, values = photographs(recipe, tmp_path / "made")
    harmonics = np.asarray(explicit_basis(normals))[:, :4]
    irradiance = harmonics @ (coefficients * [np.pi, *[2 * np.pi / 3] * 3])
    np.testing.assert_allclose(values, irradiance[:, None] * [0.1, 0.2, 0.3], rtol=2e-3)
    image = read_environment(tmp_path / "made" / "environment.exr")
    np.testing.assert_allclose(
        image.radiance, light_for_fit(recipe, BALL).environment.radiance, 1e-6
    )
    assert image.grid.shape[0] == 32


def test_photographs_under_the_overcast_sky(tmp_path):
    recipe = recipe_of({"overcast_sky": {"zenith": [1.0, 2.0, 3.0]}})
    normals, values = photographs(recipe, tmp_path / "made")
    top = np.argmax(normals[:, 2])
    assert normals[top, 2] > 0.98
    expected = 7 * np.pi / 9 * np.array([0.1, 0.4, 0.9])
    np.testing.assert_allclose(values[top], expected, rtol=0.02)
    # It lights nothing that faces the ground.
    assert np.all(values[normals[:, 2] < -0.99] < 0.02 * expected)


def test_photographs_under_a_lamp_that_is_near(tmp_path):
    place, intensity = np.array([2.0, 1.0, 1.5]), np.array([3.0, 2.0, 1.0])
    lamp = {"position": place.tolist(), "intensity": intensity.tolist()}
    recipe = recipe_of({"point": [lamp]}, environment_height=None)
    normals, values = photographs(recipe, tmp_path / "made")
    # The ball has the radius 1 about the origin.
    arrow = place - normals
    distance = np.linalg.norm(arrow, axis=1)
    cosine = np.maximum(np.sum(normals * arrow, axis=1) / distance, 0)
    expected = [0.1, 0.2, 0.3] * intensity * (cosine / distance**2)[:, None]
    np.testing.assert_allclose(values, expected, rtol=2e-3, atol=1e-5)
    config = load_run_config(tmp_path / "made/config.yaml")
    assert config.lighting.stated()["point"] == ({k: tuple(v) for k, v in lamp.items()},)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"point": [{"position": [0.5, 0, 0], "intensity": 1}]}, r"lighting: a source lies 0\.5 "),
        ({"clear_sky": {"sun": [0, 0, -1], "zenith": 1}}, r"lighting.clear_sky: sun="),
        ({"harmonic": {"coefficients": [1, 2, 3]}}, r"lighting.harmonic: 3 .*coefficients"),
        ({"harmonic": {"coefficients": [1, 5, 0, 0]}}, r"lighting: .*negative"),
        ({"overcast_sky": {"zenith": 0}}, r"lighting: the light is zero"),
    ],
)
def test_what_a_class_refuses_is_reported_with_the_section(section, message):
    with pytest.raises(InputError, match=message):
        known_light(LightingConfig.model_validate(section), [], BALL)


def test_no_sky_has_that_name():
    with pytest.raises(ValueError, match="clear or polluted"):
        ClearSky(np.array([0.0, 0.0, 1.0]), np.ones(3), "foggy")
