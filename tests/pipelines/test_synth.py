"""Photographs from recipes: their light, material, cameras and noise are what the recipe states.

- Under sources alone they are T 6.2 in NumPy; under a lobe they agree with a fine sum over the
  sphere; noise has the stated deviation and is the seed's.
- Cameras stand on the stated circle and look at the object.
- A capture has all its files; its config loads and names the recipe's choices; the environment that
  is handed over keeps the energy of a finer one.
- An identical capture is left alone, another one replaced by force only, a broken one leaves
  nothing.
"""

import itertools
import json

import numpy as np
import pytest
from small_captures import KD, KS, MU, SIGMA, jaxrender, reflected, write_json

from jaxrender.errors import InputError
from jaxrender.geometry import SurfaceSamples, observe
from jaxrender.harmonics import LatLongGrid
from jaxrender.io import read_capture, read_environment, read_image, read_mesh, write_environment
from jaxrender.lighting import Environment, SmoothLobes
from jaxrender.pipelines.caches import capture_folder, is_whole
from jaxrender.pipelines.config import RecipeConfig, ViewsConfig, load_run_config
from jaxrender.pipelines.scene import shape_of, true_material
from jaxrender.pipelines.synth import cameras_of, synthesise, written_files
from jaxrender.reflection import integral_columns, radiance

SUN = ((0.35, 0.8, 0.5), (1.2, 1.15, 1.05))
BRDF = {"kd": KD, "ks": KS, "sigma": SIGMA, "mu": MU}
SMALL = {"count": 2, "step_degrees": 40.0, "width": 16, "height": 12}
LOBE = {"direction": [0.9, 0.5, 0.4], "width_degrees": 35.0, "radiance": [1.0, 0.9, 0.8]}
# EXR holds float32.
FLOAT32 = 1e-6


def recipe_of(**given):
    sections = {
        "geometry": {"sphere": {}},
        "brdf": BRDF,
        "lighting": {"directional": [{"direction": SUN[0], "irradiance": SUN[1]}]},
        "views": SMALL,
        "noise": {"relative": 0.0},
    }
    return RecipeConfig.model_validate(sections | given)


def make(recipe, folder, **options):
    return synthesise(recipe, folder.parent / "recipe.yaml", folder, **options)


def views_of(recipe, folder):
    """Every photograph with what its camera sees."""
    shape = shape_of(recipe.geometry)
    for frame in read_capture(folder / "transforms.json").frames:
        yield read_image(frame.image_path), observe(frame.camera, shape)


# ---------------------------------------------------------------- photographs


def test_under_sources_they_are_the_formula(tmp_path):
    recipe = recipe_of()
    make(recipe, tmp_path / "capture")
    for photograph, view in views_of(recipe, tmp_path / "capture"):
        np.testing.assert_array_equal(photograph.alpha > 0.5, view.hit)
        expected = reflected(view.normals[view.hit], view.outgoing[view.hit], [SUN])
        np.testing.assert_allclose(photograph.pixels[view.hit], expected, atol=FLOAT32)
        np.testing.assert_array_equal(photograph.pixels[~view.hit], 0)


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [0.25, 0.05])
def test_under_lobes_they_are_the_integral(tmp_path, sigma):
    """Against the sum over a sphere of 256 rows, good to 1e-3 (its horizon)."""
    recipe = recipe_of(lighting={"area": [LOBE]}, brdf={**BRDF, "sigma": sigma, "kd": 0.0})
    make(recipe, tmp_path / "capture")
    lobes = SmoothLobes(
        np.array([LOBE["direction"]]),
        np.radians([LOBE["width_degrees"]]),
        np.array([LOBE["radiance"]]),
    )
    nodes = lobes.to_environment(256).nodes()
    photograph, view = next(views_of(recipe, tmp_path / "capture"))
    rows, columns = np.nonzero(view.hit & (view.exit_cosines > 0.3))
    chosen = np.argsort(-photograph.pixels[rows, columns, 0])[:6]
    rows, columns = rows[chosen], columns[chosen]
    samples = SurfaceSamples(view.normals[rows, columns], view.outgoing[rows, columns])
    material = true_material(recipe.brdf)
    expected = radiance(material, integral_columns(material, samples, nodes))
    np.testing.assert_allclose(photograph.pixels[rows, columns], expected, rtol=2e-3)


def test_noise_is_what_is_stated(tmp_path):
    views = {**SMALL, "count": 3, "width": 48, "height": 48}
    clean, noisy = (
        recipe_of(views=views),
        recipe_of(views=views, noise={"relative": 0.05, "floor": 0.02}, seed=3),
    )
    for name, recipe in (("clean", clean), ("noisy", noisy)):
        make(recipe, tmp_path / name)
    pairs = list(zip(views_of(clean, tmp_path / "clean"), views_of(noisy, tmp_path / "noisy")))
    exact, found = (
        np.concatenate([pair[which][0].pixels[pair[0][1].hit] for pair in pairs])
        for which in (0, 1)
    )
    # Where noise does not reach below zero, and so is not clipped.
    lit = exact > 0.12
    deviations = ((found - exact) / np.hypot(0.05 * exact, 0.02))[lit]
    count = deviations.size
    assert count > 1000
    assert abs(deviations.mean()) < 3.5 / np.sqrt(count)
    assert abs(deviations.std() - 1) < 3.5 / np.sqrt(2 * count)
    assert found.min() >= 0
    # Every photograph has noise of its own, and the seed decides it.
    make(noisy, tmp_path / "again")
    make(noisy.model_copy(update={"seed": 4}), tmp_path / "other")
    first, again, other = (
        read_image(tmp_path / name / "images/view_000.exr").pixels
        for name in ("noisy", "again", "other")
    )
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)


def test_cameras_stand_on_their_circle():
    centre, axis = np.array([1.0, 2.0, 3.0]), np.array([1.0, 1.0, 1.0])
    views = ViewsConfig(
        count=5, step_degrees=20.0, start_degrees=10.0, axis=axis, elevation_degrees=30.0,
        distance=7.0, field_of_view_degrees=40.0, width=20, height=10,
    )  # fmt: skip
    cameras = cameras_of(views, centre)
    assert len(cameras) == 5
    axis = axis / np.linalg.norm(axis)
    offsets = np.array([camera.position for camera in cameras]) - centre
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 7)
    np.testing.assert_allclose(offsets @ axis, 7 * np.sin(np.radians(30)))
    level = offsets - (offsets @ axis)[:, None] * axis
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    for one, other in itertools.pairwise(level):
        np.testing.assert_allclose(one @ other, np.cos(np.radians(20)))
        # Anticlockwise seen from the axis.
        assert np.cross(one, other) @ axis > 0
    for camera, offset in zip(cameras, offsets):
        np.testing.assert_allclose(camera.project(centre[None]), [[10, 5]], atol=1e-9)
        # The border of the picture lies half the field of view off.
        np.testing.assert_allclose(camera.fl_x * np.tan(np.radians(20)), 10)
        up = camera.world_from_camera[:3, 1]
        assert up @ axis > 0.5
        np.testing.assert_allclose(camera.world_from_camera[:3, 2], offset / 7)


# ---------------------------------------------------------------- the folder


def test_a_capture_has_all_its_files(tmp_path):
    recipe = recipe_of(
        geometry={"ellipsoid": {"radii": [1.0, 0.8, 0.6], "subdivisions": 2}},
        lighting={"area": [LOBE], "directional": [{"direction": SUN[0], "irradiance": SUN[1]}]},
        brdf={**BRDF, "mu": "none", "ks": [0.1, 0.2, 0.3], "masking": "smith"},
        environment_height=8,
    )
    folder = make(recipe, tmp_path / "capture")
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert files == {*written_files(recipe), "run.json"}
    assert is_whole(recipe, folder)
    truth = json.loads((folder / "truth.json").read_text())
    assert RecipeConfig.model_validate(truth) == recipe
    config = load_run_config(folder / "config.yaml")
    assert config.capture.geometry.mesh == folder / "shape.ply"
    assert config.lighting.environment.path == folder / "environment.exr"
    assert config.lighting.directional == recipe.lighting.directional
    assert (config.brdf.mu, config.brdf.ks_per_channel) == ("none", True)
    assert (config.brdf.masking, config.brdf.fresnel) == ("smith", "exit")
    assert read_environment(folder / "environment.exr").grid.shape == (8, 16)
    on_it = np.sum((read_mesh(folder / "shape.ply").vertices / [1, 0.8, 0.6]) ** 2, axis=1)
    np.testing.assert_allclose(on_it, 1, atol=1e-5)
    (folder / "environment.exr").unlink()
    assert not is_whole(recipe, folder)


@pytest.mark.parametrize("rows", [16, 20, 8])
def test_the_environment_that_is_handed_over_keeps_its_energy(tmp_path, rows):
    """Coarser by a whole factor, by a broken one, and not at all."""
    grid = LatLongGrid(rows, 2 * rows)
    directions = grid.directions()
    light = np.exp(4 * (directions @ [0.6, 0.0, 0.8] - 1))[..., None] * [1.0, 0.5, 0.2]
    write_environment(tmp_path / "fine.exr", Environment(light))
    recipe = recipe_of(
        lighting={"environment": {"path": tmp_path / "fine.exr"}}, environment_height=8
    )
    folder = make(recipe, tmp_path / "capture")
    coarse = read_environment(folder / "environment.exr")
    assert coarse.grid.shape == (8, 16)
    fine, found = (np.asarray(e).sum(axis=0) for e in (
        Environment(light).nodes().irradiance, coarse.nodes().irradiance))  # fmt: skip
    # Averages over texels: Fejer's weights are their areas to a per cent or two at 8 rows.
    np.testing.assert_allclose(found, fine, rtol=0.02)
    photograph, view = next(views_of(recipe, folder))
    assert photograph.pixels[view.hit].max() > 0


def test_an_identical_capture_is_left_alone(tmp_path, capsys):
    write_json(tmp_path / "recipe.json", recipe_of().written_out())
    command = ["synth", tmp_path / "recipe.json", "--out", tmp_path / "capture"]
    assert jaxrender(*command) == 0
    before = (tmp_path / "capture/transforms.json").stat().st_mtime_ns
    capsys.readouterr()
    assert jaxrender(*command) == 0
    assert "photographs of recipe.json: rendered before" in capsys.readouterr().err
    assert (tmp_path / "capture/transforms.json").stat().st_mtime_ns == before
    other = recipe_of(brdf={**BRDF, "mu": 1.4})
    write_json(tmp_path / "recipe.json", other.written_out())
    assert jaxrender(*command) == 2
    assert "holds the result of another run" in capsys.readouterr().err
    assert jaxrender(*command, "--force") == 0
    assert json.loads((tmp_path / "capture/truth.json").read_text())["brdf"]["mu"] == 1.4


def test_a_capture_that_breaks_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxrender.pipelines.synth._write_config", interrupted)
    with pytest.raises(KeyboardInterrupt):
        make(recipe_of(), tmp_path / "capture")
    assert list(tmp_path.iterdir()) == []


def test_a_phong_ball_is_photographed(tmp_path):
    """ks (s + 1) / (2 pi) (R.w)^s cos-weighted light of one source, in NumPy."""
    brdf = {"model": "phong", "kd": KD, "ks": KS, "exponent": 20.0}
    direction, irradiance = SUN
    source = {"direction": direction, "irradiance": irradiance}
    recipe = recipe_of(brdf=brdf, lighting={"directional": [source]}, noise={"relative": 0.0})
    folder = make(recipe, tmp_path / "capture")
    assert load_run_config(folder / "config.yaml", []).brdf.model == "phong"
    view = observe(cameras_of(recipe.views, np.zeros(3))[0], shape_of(recipe.geometry))
    normals, outgoing = view.normals[view.hit], view.outgoing[view.hit]
    towards = np.asarray(direction) / np.linalg.norm(direction)
    mirrored = 2 * np.sum(normals * outgoing, axis=1)[:, None] * normals - outgoing
    cosine, along = normals @ towards, np.clip(mirrored @ towards, 0, 1)
    lobe = KS * 21 / (2 * np.pi) * along**20
    exact = np.where(cosine > 0, 1, 0)[:, None] * np.asarray(irradiance)
    exact = exact * (np.asarray(KD) * cosine[:, None] + lobe[:, None])
    image = read_image(folder / "images/view_000.exr").pixels[..., :3][view.hit]
    np.testing.assert_allclose(image, exact, rtol=1e-5, atol=1e-6)


def test_sigma_may_vary_with_height(tmp_path, monkeypatch):
    """From brdf.sigma at the bottom to sigma_above at the top, evenly in its logarithm; T 6.2."""
    paint = {"kd": KD, "ks": KS, "sigma_above": 2 * SIGMA}
    recipe = recipe_of(texture=paint)
    make(recipe, tmp_path / "capture")
    for photograph, view in views_of(recipe, tmp_path / "capture"):
        height = view.points[view.hit][:, 2]
        monkeypatch.setattr("small_captures.SIGMA", SIGMA * 2 ** ((1 + height) / 2))
        expected = reflected(view.normals[view.hit], view.outgoing[view.hit], [SUN])
        # The lobe is interpolated between widths that are 5 % apart.
        np.testing.assert_allclose(photograph.pixels[view.hit], expected, rtol=3e-3)


def test_a_recipe_without_sigma_has_none_that_varies():
    brdf = {"model": "phong", "kd": KD, "ks": KS, "exponent": 20.0}
    with pytest.raises(ValueError, match="sigma_above with model phong, which has no sigma"):
        recipe_of(brdf=brdf, texture={"kd": KD, "ks": KS, "sigma_above": 0.3})


def test_recipes_that_cannot_be_rendered(tmp_path):
    for views, message in (
        ({"elevation_degrees": -90.0}, r"recipe\.yaml: views\.elevation_degrees -90: looking from"),
        ({"distance": 0.9}, r"recipe\.yaml: views: no camera sees the object; change distance"),
    ):
        with pytest.raises(InputError, match=message):
            make(recipe_of(views={**SMALL, **views}), tmp_path / "capture")
    dark = {"area": [{**LOBE, "radiance": 0.0}]}
    with pytest.raises(InputError, match=r"recipe\.yaml: lighting: the light is zero; give"):
        make(recipe_of(lighting=dark), tmp_path / "capture")
    assert list(tmp_path.iterdir()) == []


def test_the_cache_goes_by_content(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = capture_folder(recipe_of(), tmp_path / "a.yaml")
    assert first.parent == tmp_path / "jaxrender" / "captures"
    assert first == capture_folder(recipe_of(), tmp_path / "elsewhere" / "a.yaml")
    assert first != capture_folder(recipe_of(seed=1), tmp_path / "a.yaml")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert capture_folder(recipe_of(), tmp_path / "a.yaml").is_relative_to(tmp_path / "home/.cache")
