"""A texture from a scene and its photographs, as an estimate.

- A checkered ball under sources: sigma within its interval, kd of every texel within its errors.
- The estimate prints what became of the texels and saves maps that read back.
- Its prediction is the photograph, to the noise.
- Colours of a picture are regions; a mesh without texture coordinates has vertices.
- Of diffuse paint under unknown light the texture is right up to what is said to be open.
- What a texture cannot honour is refused with a remedy.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Mesh, Pinhole, Sphere, SurfaceSamples, look_at, observe
from jaxrender.geometry.texels import sphere_coordinates, texel_coordinates
from jaxrender.inverse import AnyEstimate, Scene, load_capture, unknown
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.photographs import observations_of
from jaxrender.inverse.texture import (
    COLOR,
    LitTexture,
    RegionLobe,
    TextureSettings,
    UnknownLightSettings,
    estimate_texture,
    texture_columns,
)
from jaxrender.io import read_image, read_mesh, write_image
from jaxrender.lighting import DirectionalSources
from jaxrender.reflection import forward_of

BALL, NOISE, ROWS = Sphere(), 0.01, 8
KD = np.array([[0.2, 0.1, 0.05], [0.08, 0.15, 0.25]])
FACETS = Microfacet(np.ones(3), np.ones(3), 0.2, 1.5)
SOURCES = DirectionalSources(
    np.array([[0.5, 0.6, 0.62], [0.3, -0.7, 0.2], [0.9, 0.0, 0.9]]),
    np.array([[2.0, 1.8, 1.5], [1.2, 1.4, 1.8], [0.8, 0.8, 0.8]]),
)
QUICK = TextureSettings(starts=1, exact_samples=0)


def which(coordinates):
    """Number the paint of texture coordinates: a checkerboard whose cells are whole texels."""
    u, v = coordinates.T
    return (np.floor(8 * u % 8) + np.floor(4 * (1 - v) % 4)).astype(int) % 2


def capture(folder, ks, views=7):
    """Write photographs of the painted ball, and read them."""
    frames, rng = [], np.random.default_rng(0)
    for number in range(views):
        place = 10 * np.array([np.cos(number), np.sin(number), 0.4 * (-1) ** number])
        pose = look_at(place, np.zeros(3), np.array([0.0, 0.0, 1.0]))
        camera = Pinhole(32, 32, pose, fl_x=140.0)
        view = observe(camera, BALL)
        samples = SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])
        columns = texture_columns(FACETS, samples, forward_of(SOURCES, BALL))
        paint = which(sphere_coordinates(view.points[view.hit]))
        exact = KD[paint] * columns.diffuse + ks * columns.specular
        image = np.zeros((*view.hit.shape, 4))
        image[view.hit, :3] = exact * (1 + NOISE * rng.normal(size=exact.shape))
        image[..., 3] = view.hit
        write_image(folder / f"{number}.exr", image)
        frames.append({"file_path": f"{number}.exr", "transform_matrix": pose.tolist()})
    intrinsics = {"w": 32, "h": 32, "fl_x": 140.0}
    (folder / "transforms.json").write_text(json.dumps({**intrinsics, "frames": frames}))
    return load_capture(folder / "transforms.json")


@pytest.fixture(scope="module")
def glossy(tmp_path_factory):
    return capture(tmp_path_factory.mktemp("glossy"), 0.1)


@pytest.fixture(scope="module")
def diffuse(tmp_path_factory):
    return capture(tmp_path_factory.mktemp("diffuse"), 0.0)


@pytest.fixture(scope="module")
def found(glossy):
    scene = Scene(unknown("microfacet", sigma=(0.05, 0.6), mu=1.5), BALL, SOURCES)
    return estimate_texture(scene, glossy, QUICK, ROWS)


def off(estimate):
    """How far kd of the texels that can be trusted is off, in standard errors."""
    truth = KD[which(texel_coordinates((ROWS, 2 * ROWS)))]
    good = estimate.seen & ~estimate.texture.kd_marked
    assert good.sum() > 60
    return ((estimate.values["kd"] - truth) / estimate.standard_error["kd"])[good]


def test_an_interval_without_an_end_has_none():
    lobe = RegionLobe(0, "", 10, 0.2, 1.5, 0.01, 100.0, Outcome.NOT_IDENTIFIABLE, (0.005, 50.0))
    assert lobe.interval90("mu").tolist() == [1.0, np.inf]
    assert np.isfinite(lobe.interval90("sigma")).all()
    assert lobe.if_exact().sigma_error == 0.005


def test_a_checkered_ball(found):
    assert isinstance(found, AnyEstimate)
    assert found.identifiable == {"sigma": True}
    low, high = found.interval90["sigma"]
    assert low < found.values["sigma"] < high
    assert abs(found.values["sigma"] - 0.2) < 3.5 * found.standard_error["sigma"]
    assert found.values["mu"] == pytest.approx(1.5)
    assert 0.8 < np.sqrt(np.mean(off(found) ** 2)) < 1.3
    assert found.noise.relative == pytest.approx(NOISE, rel=0.15)
    assert found.interval90["kd"].shape == (2 * ROWS**2, 3, 2)


def test_it_is_printed_and_saved(found, tmp_path):
    words = str(found)
    assert words.startswith("texture of microfacet: the fit converged")
    assert "16 x 8 texels by latitude and longitude" in words
    assert "kd           median" in words
    assert "sigma        0.2" in words
    for _ in range(2):
        saved = json.loads((found.save(tmp_path / "ball") / "estimate.json").read_text())
    assert set(saved["values"]) == {"sigma", "mu"}
    assert saved["values"]["sigma"] == pytest.approx(float(found.values["sigma"]))
    kd = read_image(tmp_path / "ball" / saved["maps"]["kd"]).pixels.reshape(-1, 3)
    known = found.seen & np.isfinite(found.standard_error["kd"]).all(axis=1)
    np.testing.assert_allclose(kd[known], found.values["kd"][known], rtol=1e-5)


def test_a_coloured_ks_is_printed_saved_and_predicted(found, glossy, tmp_path):
    """As the found K_s is grey, giving it three channels changes no prediction."""
    texture, marks = found.texture, np.arange(2 * ROWS**2) % 3 == 0
    names = ("ks", "ks_error", "ks_exact_error")
    of_channels = {name: np.tile(getattr(texture, name)[:, None], 3) for name in names}
    coloured = replace(
        found, texture=texture._replace(**of_channels, ks_colour_marked=marks), maps=(COLOR,)
    )
    saved = json.loads((coloured.save(tmp_path / "ball") / "estimate.json").read_text())
    ks = read_image(tmp_path / "ball" / saved["maps"]["ks"]).pixels.reshape(-1, 3)
    known = found.seen & np.isfinite(texture.ks_error) & np.isfinite(texture.ks)
    np.testing.assert_allclose(ks[known], of_channels["ks"][known], rtol=1e-5)
    shown = read_image(tmp_path / "ball" / saved["maps"]["ks_colour_marked"]).pixels[..., 0] > 0.5
    np.testing.assert_array_equal(shown.ravel(), marks)
    assert coloured.interval90["ks"].shape == (2 * ROWS**2, 3, 2)
    (row,) = (row for row in str(coloured).split("\n") if row.startswith("  ks "))
    assert len(row.split("median")[1].split("its")[0].split()) == 3
    photographs = glossy.photographs(BALL)[:1]
    seen, light = observations_of(photographs), KnownLight.of(SOURCES)
    views = [one.view for one in photographs]
    grey, image = (
        LitTexture(one, seen, light, exact=False).predict(views)[0] for one in (found, coloured)
    )
    np.testing.assert_allclose(image, grey, rtol=1e-12)
    joined = coloured.texture.with_sites(marks, coloured.texture._replace(ks_colour_marked=~marks))
    np.testing.assert_array_equal(joined.ks_colour_marked, np.zeros(2 * ROWS**2, bool))


def test_it_predicts_the_photographs(found, glossy):
    photographs = glossy.photographs(BALL)
    lit = LitTexture(found, observations_of(photographs), KnownLight.of(SOURCES), exact=False)
    images = np.stack(lit.predict([one.view for one in photographs]))
    radiance = np.stack([one.radiance for one in photographs])
    usable, level = np.stack([one.selection.usable for one in photographs]), radiance.sum(axis=-1)
    bright = usable & (level > np.median(level[usable]))
    assert np.median(np.abs(images[bright] / radiance[bright] - 1)) < 1.5 * NOISE


@pytest.mark.slow
def test_lights_stay_with_their_photographs(glossy, found):
    """Sources that are said of every photograph are those that all share."""
    scene = Scene(found.material, BALL, per_frame=(SOURCES,) * 7)
    again = estimate_texture(scene, glossy, QUICK, ROWS)
    np.testing.assert_allclose(again.values["sigma"], found.values["sigma"], rtol=1e-4)
    with pytest.raises(ValueError, match="per_frame lights 2 photographs of 7"):
        estimate_texture(scene._replace(per_frame=(SOURCES,) * 2), glossy, QUICK, ROWS)


@pytest.mark.slow
def test_regions_of_diffuse_paint(diffuse, tmp_path):
    write_image(tmp_path / "halves.png", np.kron([[0.0], [1.0]], np.ones((4, 16, 3))))
    scene = Scene(unknown("lambertian"), BALL, SOURCES)
    found = estimate_texture(scene, diffuse, rows=ROWS, regions=tmp_path / "halves.png")
    assert [lobe.name for lobe in found.lobes] == ["#000000", "#ffffff"]
    assert set(found.values) == {"kd"}
    assert 0.8 < np.sqrt(np.mean(off(found) ** 2)) < 1.3


def test_a_mesh_without_coordinates_has_vertices(diffuse, tmp_path):
    scene = Scene(unknown("lambertian"), Mesh.icosphere(2), SOURCES)
    found = estimate_texture(scene, diffuse)
    assert "162 vertices" in str(found)
    found.save(tmp_path)
    assert len(read_mesh(tmp_path / "textures" / "vertices.ply").vertices) == 162
    with pytest.raises(ValueError, match="a picture of regions needs texture coordinates"):
        estimate_texture(scene, diffuse, regions=tmp_path / "halves.png")


def test_diffuse_paint_under_unknown_light(diffuse, tmp_path):
    found = estimate_texture(Scene(unknown("lambertian"), BALL), diffuse, rows=ROWS)
    assert "T 6.1.1, class 6" in found.ambiguity
    assert str(found).count("class 6") == 1
    truth = KD[which(texel_coordinates((ROWS, 2 * ROWS)))]
    good = (found.texture.seen > 3) & np.isfinite(found.values["kd"]).all(axis=1)
    ratio = found.values["kd"][good] / truth[good]
    assert np.median(np.abs(np.log(ratio / np.median(ratio, axis=0)))) < 0.1
    saved = json.loads((found.save(tmp_path) / "estimate.json").read_text())
    np.testing.assert_allclose(saved["light"][0]["coefficients"], found.light.coefficients)


@pytest.mark.parametrize(
    ("changed", "options", "fault"),
    [
        ({"free_scale": True}, {}, "leave free_exposure and free_scale out"),
        ({"light": None}, {"settings": QUICK}, "give UnknownLightSettings"),
        ({}, {"settings": UnknownLightSettings()}, "give TextureSettings"),
        ({"light": None}, {"control_points": 5}, "under unknown light the surface has one sigma"),
        (
            {"light": None},
            {"settings": UnknownLightSettings(exact=False)},
            "diffuse paint has no specular lobe to find",
        ),
        (
            {"light": None, "material": unknown("ggx")},
            {"settings": UnknownLightSettings(prior="variance")},
            "not by a prior",
        ),
        ({}, {"settings": QUICK}, "diffuse paint is found without a search"),
        ({}, {"control_points": 5}, "diffuse paint has no sigma that could vary"),
        ({"material": unknown("phong")}, {}, "phong: a texture fits facets"),
    ],
)
def test_what_a_texture_cannot_honour(diffuse, changed, options, fault):
    scene = Scene(unknown("lambertian"), BALL, SOURCES)._replace(**changed)
    with pytest.raises(ValueError, match=fault):
        estimate_texture(scene, diffuse, rows=ROWS, **options)
