"""A concave object from its recipe to its result.

- Photographs of a sculpture are the integral over what brute-force rays see; recipes of convex
  shapes keep their place in the cache.
- A fit models the shadows, says that it leaves interreflections out and what they may amount to,
  and predicts the photographs with their shadows.
- Transfer vectors are kept by content, made again where that is damaged, and at vertices they are
  those of the places between.
"""

import numpy as np
import pytest
from small_captures import KD, KS, MU, SIGMA, jaxrender, read_result

from jaxrender.geometry import SurfacePlaces, SurfaceSamples, fibonacci_sphere, observe, sculpture
from jaxrender.inverse.transfer_field import TransferField
from jaxrender.io import read_capture, read_image
from jaxrender.lighting import LightNodes, SmoothLobes
from jaxrender.pipelines import caches, shadows
from jaxrender.pipelines.config import RecipeConfig, load_run_config, resolved_yaml
from jaxrender.pipelines.scene import shape_of, true_material
from jaxrender.pipelines.synth import purpose_of
from jaxrender.reflection import integral_columns, radiance

RECIPE = f"""\
geometry: {{sculpture: {{subdivisions: 3, seed: 1}}}}
brdf: {{model: microfacet, kd: {list(KD)}, ks: {KS}, sigma: {SIGMA}, mu: {MU}}}
lighting:
  area: [{{direction: [0.9, 0.5, 0.4], width_degrees: 20, radiance: [3.0, 2.9, 2.8]}}]
  directional: [{{direction: [-0.35, 0.8, 0.5], irradiance: [1.2, 1.15, 1.05]}}]
views: {{count: 2, step_degrees: 70, width: 40, height: 40, field_of_view_degrees: 13}}
noise: {{relative: 0.005}}
environment_height: 32
"""
RUN = """\
task: brdf
capture: {transforms: capture/transforms.json, geometry: {mesh: capture/shape.ply}}
lighting:
  environment: {path: capture/environment.exr, convention: z-up}
  directional: [{direction: [-0.35, 0.8, 0.5], irradiance: [1.2, 1.15, 1.05]}]
solve: {starts: 2, refine: off}
samples: {count: 700}
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A rendered and fitted recipe: the folder of both."""
    folder = tmp_path_factory.mktemp("concave")
    (folder / "recipe.yaml").write_text(RECIPE)
    (folder / "config.yaml").write_text(RUN)
    assert jaxrender("synth", folder / "recipe.yaml", "--out", folder / "capture") == 0
    fit(folder, "out")
    return folder


def fit(folder, name):
    given = (folder / "config.yaml", f"output={folder / name}")
    assert jaxrender("fit", *given, cache=folder / "cache") == 0


def test_photographs_are_the_integral_with_visibility(finished):
    shape = sculpture(3, seed=1)
    frame = read_capture(finished / "capture" / "transforms.json").frames[0]
    view, image = observe(frame.camera, shape), read_image(frame.image_path)
    rows, columns = (index[::60] for index in np.nonzero(view.hit))
    places = SurfacePlaces(view.points[rows, columns], view.geometric_normals[rows, columns])
    samples = SurfaceSamples(view.normals[rows, columns], view.outgoing[rows, columns])
    lobe = SmoothLobes(np.array([[0.9, 0.5, 0.4]]), np.radians([20.0]), np.array([[3.0, 2.9, 2.8]]))
    directions = fibonacci_sphere(4000)
    light = 4 * np.pi / 4000 * np.asarray(lobe.radiance(directions))
    lit = light.max(axis=1) > 1e-3 * light.max()
    source = np.array([-0.35, 0.8, 0.5]) / np.linalg.norm([-0.35, 0.8, 0.5])
    directions = np.concatenate([directions[lit], source[None]])
    light = np.concatenate([light[lit], [[1.2, 1.15, 1.05]]])
    seen = brute_force_sees(shape, places, directions)
    assert np.any(~seen & (samples.normals @ directions.T > 0.3))
    material = true_material(RecipeConfig.model_validate(recipe()).brdf)
    nodes = LightNodes(directions, light)
    expected = radiance(material, integral_columns(material, samples, nodes, seen))
    # Noise of .5 %, and edges of shadows between few directions.
    error = np.abs(image.pixels[rows, columns] - expected)
    assert np.all(error < 0.02 * expected.max())
    assert np.median(error / (np.asarray(expected) + 1e-3)) < 0.01


def brute_force_sees(shape, places, directions):
    """Test every triangle."""
    origins = places.points + 1e-4 * shape.diagonal() * places.geometric_normals
    seen = places.geometric_normals @ directions.T > 0
    place, direction = np.nonzero(seen)
    seen[seen] = ~shape.occluded_brute_force(origins[place], directions[direction])
    return seen


def recipe(**changes):
    return {
        "geometry": {"sculpture": {"subdivisions": 3, "seed": 1}},
        "brdf": {"kd": KD, "ks": KS, "sigma": SIGMA, "mu": MU},
        "lighting": {"directional": [{"direction": [0, 0, 1], "irradiance": [1, 1, 1]}]},
    } | changes


def test_recipes_of_convex_shapes_keep_their_place():
    given = [
        RecipeConfig.model_validate(recipe(geometry=g)) for g in ({"sphere": {}}, {"mesh": "m"})
    ]
    assert purpose_of(given[0]) == "synth"
    assert purpose_of(given[1]) != "synth"  # before, concave ones had no shadows
    # The digest hashes the config without what is absent: as when there was no sculpture.
    assert "sculpture" not in resolved_yaml(given[0])


def test_the_handed_over_shape_is_the_sculpture(finished):
    config = load_run_config(finished / "capture" / "config.yaml")
    assert config.capture.geometry is not None
    shape = shape_of(config.capture.geometry)
    assert not shape.is_convex()
    np.testing.assert_allclose(shape.bounds(), sculpture(3, seed=1).bounds(), atol=1e-6)


def test_a_fit_models_the_shadows(finished):
    result = read_result(finished / "out")
    truth = {"kd": np.array(KD), "ks": KS, "sigma": SIGMA, "mu": MU}
    for name, tolerance in {"kd": 0.01, "ks": 0.02, "sigma": 0.02, "mu": 0.04}.items():
        assert np.all(np.abs(np.array(result["brdf"][name]) / truth[name] - 1) < tolerance), name
    assert result["residual"]["relative_rms"] < 0.015  # noise .5 %, an image of 32 rows
    assert result["seconds"]["shadows"] > 0
    bounced = result["interreflection"]
    albedo = np.mean(np.pi * np.array(result["brdf"]["kd"]) + result["brdf"]["ks"])
    assert bounced["albedo"] == pytest.approx(albedo, rel=1e-6)
    assert 0.03 < bounced["hidden_fraction"] < 0.15
    assert bounced["estimate"] == pytest.approx(albedo * bounced["hidden_fraction"], rel=1e-6)
    assert "interreflections not" in bounced["sentence"]


def test_predictions_have_the_shadows(finished):
    measured = read_image(finished / "capture/images/view_000.exr")
    predicted = read_image(finished / "out/images/view_000_predicted.exr").pixels
    residual = measured.pixels - predicted
    assert measured.alpha is not None
    covered = measured.alpha > 0.5
    left = np.sqrt(np.mean(residual[covered] ** 2) / np.mean(measured.pixels[covered] ** 2))
    assert left < 0.04  # T 6.12 at every pixel; without shadows a tenth is left


def test_what_was_traced_is_traced_once(finished, monkeypatch):
    def refuse(*_):
        raise AssertionError("traced again")

    monkeypatch.setattr(shadows, "traced", refuse)
    fit(finished, "again")
    first, again = (read_result(finished / name)["brdf"] for name in ("out", "again"))
    assert first == again


def test_arrays_are_remembered_by_content(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = []

    def make():
        made.append(1)
        return np.arange(3.0) + len(made)

    key = [np.zeros(2), "degree 3"]
    first = caches.remembered("things", key, make)
    np.testing.assert_array_equal(caches.remembered("things", key, make), first)
    assert len(made) == 1
    for other in ([np.zeros(2), "degree 4"], [np.zeros((2, 1)), "degree 3"]):
        caches.remembered("things", other, make)
    assert len(made) == 3
    for path in (tmp_path / "jaxrender" / "things").iterdir():
        path.write_bytes(b"damaged")
    caches.remembered("things", key, make)
    assert len(made) == 4
    np.testing.assert_array_equal(caches.remembered("things", key, make), made_last(made))


def made_last(made):
    return np.arange(3.0) + len(made)


def test_vertices_stand_for_the_places_between():
    shape = sculpture(4, seed=1)
    rng = np.random.default_rng(0)
    face, weights = rng.integers(len(shape.faces), size=60), rng.dirichlet(np.ones(3), 60)
    places = SurfacePlaces.on_faces(shape, face, weights)
    normals = np.einsum("pk,pki->pi", weights, shape.normals[shape.faces[face]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    exact = TransferField.of(shape, 2, 60)
    assert exact.at_vertices is None
    field = TransferField.of(shape, 2, 10**6)
    assert field.at_vertices is not None
    found, expected = field.at(places, normals), exact.at(places, normals)
    # A face is a hundredth of the shape wide, and its faceted horizon as coarse.
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.02 * np.abs(expected).max()
    assert np.sqrt(np.mean((found - expected[::-1]) ** 2)) > 0.1 * np.abs(expected).max()
