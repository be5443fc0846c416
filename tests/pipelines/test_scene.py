"""Configuration into objects: shapes, unknowns, settings and lights are what the config says.

- Misuse in a class is bad input of the key that named it.
- The files that a fingerprint hashes are those that exist and that the config names.
"""

import numpy as np
import pytest
from small_captures import CONFIG

from jaxrender.brdf import material_named
from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Sphere
from jaxrender.io import write_mesh
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.config import (
    LightingConfig,
    RecipeBrdfConfig,
    RecipeGeometryConfig,
    RunConfig,
    load_run_config,
)
from jaxrender.pipelines.scene import (
    fault_of,
    input_files,
    known_light,
    lobe_of,
    settings_of,
    shape_of,
    true_material,
    unknowns_of,
)

UP = {"direction": [0, 0, 2], "irradiance": [1, 2, 3]}
TO_X = {"direction": [1, 0, 0], "irradiance": 0.5}


def config_of(**sections):
    capture = {"transforms": "transforms.json", "geometry": {"sphere": {}}}
    lighting = {"directional": [UP]} | sections.pop("lighting", {})
    return RunConfig.model_validate(
        {"task": "brdf", "capture": capture, "lighting": lighting, **sections}
    )


def test_shapes(tmp_path):
    sphere = shape_of(RecipeGeometryConfig(sphere={"center": [1, 2, 3], "radius": 2}))
    assert isinstance(sphere, Sphere)
    np.testing.assert_array_equal(sphere.bounds(), [[-1, 0, 1], [3, 4, 5]])
    ellipsoid = shape_of(RecipeGeometryConfig(ellipsoid={"radii": [1, 2, 3], "subdivisions": 2}))
    assert isinstance(ellipsoid, Mesh)
    on_it = np.sum((ellipsoid.vertices / [1, 2, 3]) ** 2, axis=1)
    np.testing.assert_allclose(on_it, 1)
    write_mesh(tmp_path / "m.ply", ellipsoid)
    twice = shape_of(RecipeGeometryConfig(mesh=tmp_path / "m.ply", scale=2.0))
    np.testing.assert_allclose(twice.bounds(), 2 * np.array(ellipsoid.bounds()), rtol=1e-6)


def test_unknowns_follow_the_config():
    brdf = {
        "kd": [0.1, 0.2, 0.3],
        "ks": {"bounds": [0, 0.5]},
        "ks_per_channel": True,
        "sigma": {"bounds": [0.1, 0.3], "start": 0.2},
        "mu": {"prior": [1.5, 0.1]},
    }
    found = unknowns_of(config_of(brdf=brdf, solve={"free_exposure": True}), photographs=7)
    assert found["kd"].fixed == (0.1, 0.2, 0.3)
    ks = found["ks"]
    assert (ks.free, ks.start, ks.upper) == (True, None, 0.5)
    assert (found["sigma"].lower, found["sigma"].upper, found["sigma"].start) == (0.1, 0.3, 0.2)
    assert found["mu"].prior == (1.5, 0.1)
    assert (found.coloured, found.free_gains) == (("kd", "ks"), 7)
    assert not found.free_scale
    free = unknowns_of(config_of(lighting={"free_scale": True}), photographs=7)
    assert (free.free_gains, free.free_scale) == (0, True)
    assert all(free[name].free for name in ("kd", "ks", "sigma", "mu"))


def test_metals_and_diffuse_materials_have_no_index():
    assert "mu" not in unknowns_of(config_of(brdf={"mu": "none"}), 1)
    assert lobe_of(config_of(brdf={"mu": "none"}).brdf).mu is None
    diffuse = unknowns_of(config_of(brdf={"model": "lambertian"}), 1)
    assert diffuse.names == ()
    assert diffuse["ks"].fixed == (0.0,)
    variant = lobe_of(config_of(brdf={"fresnel": "half", "masking": "smith"}).brdf)
    assert (variant.fresnel, variant.masking, variant.mu is None) == ("half", "smith", False)


@pytest.mark.parametrize(
    ("model", "distribution", "fresnel", "masking"),
    [
        ("microfacet", "gaussian", "exit", "none"),
        ("ggx", "ggx", "half", "smith"),
        ("beckmann", "beckmann", "half", "smith"),
    ],
)
def test_models_name_their_distribution(model, distribution, fresnel, masking):
    amounts = {"kd": [0.1, 0.2, 0.3], "ks": 0.2, "sigma": 0.3, "mu": 1.5}
    stated = true_material(RecipeBrdfConfig.model_validate({"model": model, **amounts}))
    written = amounts | {"model": model, "fresnel": fresnel, "masking": masking}
    for brdf in (
        lobe_of(config_of(brdf={"model": model}).brdf),
        stated,
        material_named(model, written),
    ):
        assert (brdf.distribution, brdf.fresnel, brdf.masking) == (distribution, fresnel, masking)


def test_settings_follow_the_config():
    solve = {
        "refine": "off",
        "noise": {"relative": 0.02, "floor": 0.1},
        "loss": "huber",
        "method": "simplex",
        "transfer": "gaussian",
        "band_limit": 9,
        "starts": 3,
    }
    lighting = {"environment": {"path": "probe.exr"}, "split": 0.4}
    found = settings_of(config_of(solve=solve, samples={"seed": 5}, lighting=lighting))
    assert (found.refine, found.starts) == (False, 3)
    assert (found.noise.relative, found.noise.floor) == (0.02, 0.1)
    assert (found.loss, found.method, found.transfer) == ("huber", "simplex", "gaussian")
    assert (found.band_limit, found.seed, found.split) == (9, 5, 0.4)
    default = settings_of(config_of())
    assert (default.refine, default.noise, default.band_limit) == (True, None, None)
    assert default.split == "auto"
    assert settings_of(config_of(solve={"refine_samples": 77})).refine_samples == 77


def test_misuse_is_the_fault_of_its_key():
    with pytest.raises(InputError, match=r"^brdf\.sigma: start 2\.0 is outside \[0\.01, 1\.0\]"):
        unknowns_of(config_of(brdf={"sigma": {"start": 2.0}}), 1)
    with pytest.raises(InputError, match=r"^brdf\.mu: start 9\.0 is outside"):
        unknowns_of(config_of(brdf={"mu": {"start": 9.0}}), 1)
    with pytest.raises(InputError, match=r"^here: wrong"), fault_of("here"):
        raise ValueError("wrong")
    with pytest.raises(InputError, match=r"^as it is$"), fault_of("here"):
        raise InputError("as it is")


def test_true_materials():
    stated = RecipeBrdfConfig(kd=[0.1, 0.2, 0.3], ks=0.2, sigma=0.3, mu="none", masking="smith")
    found = true_material(stated)
    assert (found.mu, found.sigma, found.masking) == (None, 0.3, "smith")
    np.testing.assert_array_equal(found.ks, [0.2] * 3)
    diffuse = true_material(RecipeBrdfConfig(model="lambertian", kd=0.1))
    np.testing.assert_array_equal(diffuse.ks, 0)


def test_sources_of_photographs_are_added_to_the_shared_ones(tmp_path):
    (tmp_path / "lights.txt").write_text("2\n1 0 0\n0 2 0\n")
    lighting = LightingConfig.model_validate(
        {"directional": [UP], "per_frame": tmp_path / "lights.txt"}
    )
    light = known_light(lighting, ["a", "b"], Sphere())
    sources = light.sources_of(1)
    np.testing.assert_array_equal(sources.directions, [[0, 0, 1], [0, 1, 0]])
    np.testing.assert_array_equal(sources.irradiance, [[1, 2, 3], [1, 1, 1]])
    shared = known_light(
        LightingConfig.model_validate({"directional": [UP, TO_X]}), ["a"], Sphere()
    )
    np.testing.assert_array_equal(shared.sources_of(0).directions, shared.directional.directions)
    # A photograph in the dark is no mistake.
    dark = light.__class__(None, DirectionalSources.none(), (DirectionalSources.none(), sources))
    assert dark.sources_of(0).directions.shape == (0, 3)


def test_input_files_are_those_that_exist(tmp_path):
    (tmp_path / "config.yaml").write_text(CONFIG)
    (tmp_path / "lights.json").write_text("[]")
    config = load_run_config(tmp_path / "config.yaml", [f"output={tmp_path / 'lights.json'}"])
    assert input_files(config) == [tmp_path / "lights.json"]
    (tmp_path / "transforms.json").write_text("{}")
    assert set(input_files(config)) == {tmp_path / "lights.json", tmp_path / "transforms.json"}
