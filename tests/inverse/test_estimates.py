"""From a scene with unknowns to an estimate.

- Under any known light, a sky and a source here, the material comes back within its errors, by the
  numbers of its own model; what is fixed stays, bounds are kept.
- With the light unknown the ratios come back; with all of a material known, the light in its units.
- One light for each photograph, also where one is skipped, and photographs of unknown exposure.
- What is stated wrongly is refused by its name.
"""

import json

import numpy as np
import pytest

from jaxrender.brdf import brdf_named
from jaxrender.geometry import Pinhole, Sphere, SurfaceSamples, look_at, observe
from jaxrender.inverse import (
    FactorSettings,
    FitSettings,
    Observations,
    Scene,
    Stated,
    fit,
    load_capture,
    unknown,
)
from jaxrender.inverse.known_light import KnownLight
from jaxrender.io import write_image
from jaxrender.lighting import (
    DirectionalSources,
    Environment,
    HarmonicLight,
    Light,
    OvercastSky,
    SmoothLobes,
)
from jaxrender.reflection import forward_of, render, render_samples

BALL = Sphere()
KD, KS = np.array([0.2, 0.1, 0.15]), np.full(3, 0.12)
PHONG = brdf_named("phong", kd=KD, ks=KS, exponent=30.0)
SOURCES = DirectionalSources(
    np.array([[0.2, 0.6, 0.8], [0.9, -0.5, 0.3]]), np.array([[1.0, 0.9, 0.8], [0.5, 0.6, 0.7]])
)
SKY = OvercastSky(np.array([0.3, 0.3, 0.4]))
QUICK = FitSettings(starts=2, refine=False)


def photographs(material, lights, noise=0.005, views=3, gains=(1.0, 1.0, 1.0)):
    """Pixels of a ball from several sides, each photograph under its light."""
    rng, rows = np.random.default_rng(0), []
    for number in range(views):
        place = 10 * np.array([np.cos(number), np.sin(number), 0.3])
        pose = look_at(place, np.zeros(3), np.array([0.0, 0.0, 1.0]))
        view = observe(Pinhole(28, 28, pose, fl_x=110.0), BALL)
        seen = view.hit & (view.exit_cosines > 0.15)
        samples = SurfaceSamples(view.normals[seen], view.outgoing[seen])
        model = forward_of(lights[number % len(lights)], BALL)
        radiance = gains[number] * np.asarray(render_samples(material, samples, model))
        radiance *= 1 + noise * rng.normal(size=radiance.shape)
        rows.append((*samples, radiance, np.full(len(radiance), number)))
    normals, outgoing, radiance, frame = (np.concatenate(part) for part in zip(*rows))
    return Observations(SurfaceSamples(normals, outgoing), radiance, frame)


def off(estimate, name, truth):
    return np.max(np.abs(estimate.values[name] - truth) / estimate.standard_error[name])


@pytest.mark.slow
def test_a_sky_and_a_source_light_a_fit():
    seen = photographs(PHONG, [SKY + SOURCES])
    scene = Scene(unknown("phong", exponent=(5, 200)), BALL, SKY + SOURCES)
    found = fit(scene, seen, QUICK)
    assert set(found.values) == {"kd", "ks", "exponent"} == set(found.identifiable)
    np.testing.assert_allclose(found.values["kd"], KD, rtol=0.03)
    assert found.values["exponent"] == pytest.approx(30, rel=0.05)
    low, high = found.interval90["exponent"]
    assert low < found.values["exponent"] < high
    assert found.material.exponent == pytest.approx(found.values["exponent"])
    assert found.light is scene.light
    # The residual is the noise that was put in.
    assert found.relative_rms == pytest.approx(0.005, rel=0.1)
    assert "exponent" in str(found)
    assert "90 %" in str(found)


def test_what_is_stated_stays():
    seen = photographs(PHONG, [SOURCES])
    stated = {"kd": tuple(KD), "exponent": Stated(bounds=(40, 90), start=50)}
    found = fit(Scene(unknown("phong", **stated), BALL, SOURCES), seen, QUICK)
    np.testing.assert_array_equal(found.values["kd"], KD)
    assert found.outcome.value == "at_bound"
    assert found.values["exponent"] == pytest.approx(40, rel=0.01)


def test_a_material_of_a_class_of_ones_own():
    seen = photographs(PHONG, [SOURCES])
    found = fit(Scene(unknown(PHONG, exponent=(5, 200)), BALL, SOURCES), seen, QUICK)
    assert off(found, "exponent", 30) < 4
    assert str(found).startswith("Phong")


@pytest.mark.slow
def test_lights_of_single_photographs_and_unknown_exposures():
    lights = tuple(
        DirectionalSources(np.array([[np.cos(a), np.sin(a), 0.5]]), np.full((1, 3), 2.0))
        for a in (0.3, 1.3, 2.3)
    )
    seen = photographs(PHONG, lights, gains=(1.0, 1.3, 0.8))
    scene = Scene(unknown("phong"), BALL, per_frame=lights, free_exposure=True)
    found = fit(scene, seen, QUICK)
    np.testing.assert_allclose(found.details.parameters.value.gains, [1, 1.3, 0.8], rtol=0.01)
    with pytest.raises(ValueError, match="per_frame lights 1 photographs of 3"):
        fit(Scene(unknown("phong"), BALL, per_frame=lights[:1]), seen, QUICK)


@pytest.mark.slow
def test_light_and_material_are_found_together():
    seen = photographs(PHONG, [SmoothLobes(np.eye(3), np.full(3, 0.6), np.eye(3) + 0.2) + SOURCES])
    quick = FactorSettings(band_limit=6, most_sources=4)
    found = fit(Scene(unknown("phong"), BALL), seen, quick)
    np.testing.assert_allclose(found.values["ks"], KS / (KD + KS), atol=0.02)
    assert found.values["exponent"] == pytest.approx(30, rel=0.1)
    assert isinstance(found.light, Light)
    known = unknown("phong", kd=tuple(KD), ks=KS[0], exponent=30.0)
    lit = fit(Scene(known, BALL), seen, quick)
    np.testing.assert_array_equal(lit.values["kd"], KD)
    # The light is in the material's own units now.
    ratio = np.asarray(lit.light.nodes().irradiance).sum(0)
    ratio /= np.asarray(found.light.nodes().irradiance).sum(0)
    np.testing.assert_allclose(ratio, 1 / (KD + KS), rtol=0.05)


@pytest.mark.parametrize(
    ("model", "numbers", "fault"),
    [
        ("phnog", {}, "did you mean 'phong'"),
        ("phong", {"sigma": 0.2}, "sigma: the model has kd, ks, exponent"),
        ("phong", {"exponent": None}, "exponent=None: only an index may be left out"),
        ("phong", {"exponent": (90, 40)}, "exponent has the bounds"),
        ("phong", {"exponent": (1, 2, 3, 4)}, "exponent has 4 values"),
        ("phong", {"exponent": Stated(bounds=(5, 9), start=20)}, "exponent: start"),
        ("phong", {"exponent": (5, 10, 20)}, "exponent is one number for all channels; give one$"),
        ("phong", {"ks": (0.1, 0.2, 0.3)}, "give one, or ks_per_channel=True"),
        ("ggx", {"sigma": (0.5, 2)}, "sigma=2: it must be above 0 and at most 1"),
        ("ggx", {"mu": 0.9}, "mu=0.9: it must be above 1"),
        ("ggx", {"sigma": Stated(bounds=(0, 1))}, "sigma=0: it must be above 0"),
        ("ggx", {"masking": "v"}, "masking='v': choose one of none, smith"),
        ("ggx", {"kd": Stated(start=0.2)}, "kd is solved for outright, from no start"),
    ],
)
def test_what_is_stated_wrongly(model, numbers, fault):
    with pytest.raises(ValueError, match=fault):
        unknown(model, **numbers)


def test_what_an_unknown_light_leaves_no_room_for():
    seen = photographs(PHONG, [SOURCES], views=1)
    with pytest.raises(ValueError, match="leave out free_exposure"):
        fit(Scene(unknown("phong"), BALL, free_scale=True), seen)
    with pytest.raises(ValueError, match="FitSettings are for a known light"):
        fit(Scene(unknown("phong"), BALL), seen, QUICK)
    with pytest.raises(ValueError, match="FactorSettings are for an unknown light"):
        fit(Scene(unknown("phong"), BALL, SOURCES), seen, FactorSettings())
    for stated, fault in (
        ({"kd": (0.1, 0.2)}, "kd has bounds; under unknown light only the ratio"),
        ({"ks": 0.1}, "only the ratio of kd and ks means anything; give both or none"),
        ({"ks_per_channel": True}, "each channel has its own ks anyway"),
    ):
        with pytest.raises(ValueError, match=fault):
            fit(Scene(unknown("phong", **stated), BALL), seen)


def test_metals_and_choices():
    metal = unknown("ggx", mu=None, masking="none")
    assert metal.lobe.mu is None
    assert metal.lobe.masking == "none"
    assert unknown("lafortune", c_z=0.9).lobe.c_z == pytest.approx(0.9)
    assert unknown("oren-nayar", kd=0.2).unknowns()["kd"].fixed == (0.2,)
    assert unknown("lambertian").unknowns().names == ()


def test_any_light_is_sorted_into_image_and_sources():
    probe = Environment(np.ones((16, 32, 3)))
    known = KnownLight.of(probe + SOURCES + SKY + SOURCES)
    assert known.directional.directions.shape == (4, 3)
    expected = 1 + np.asarray(SKY.to_environment(16).radiance)
    np.testing.assert_allclose(known.environment.radiance, expected, rtol=1e-6)
    assert KnownLight.of(SOURCES).environment is None
    assert KnownLight.of(SKY, height=32).environment.grid.shape == (32, 64)
    slow = HarmonicLight(np.array([[4.0]] + [[0.5]] * 3))
    assert KnownLight.of(slow).environment.grid.shape == (128, 256)
    with pytest.raises(ValueError, match="images of 8 and 16 rows"):
        KnownLight.of(probe + Environment(np.ones((8, 16, 3))))

    class Odd(Light):
        def nodes(self):
            return SOURCES.nodes()

    with pytest.raises(ValueError, match="a light of the kind Odd; give"):
        KnownLight.of(Odd())


def test_what_all_photographs_share_is_one_light():
    """An environment stands as it was turned; sources of single photographs are left out."""
    up = np.zeros((16, 32, 3))
    up[:4] = 1
    over = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    known = KnownLight(Environment(up), SOURCES, (SOURCES,) * 2, over)
    parts = known.shared.parts
    assert parts[1] is SOURCES
    direction, irradiance = parts[0].nodes()
    mean = np.asarray(irradiance)[:, 0] @ np.asarray(direction)
    np.testing.assert_allclose(mean / np.linalg.norm(mean), over[:, 2], atol=1e-3)
    assert KnownLight(None, SOURCES).shared is SOURCES


@pytest.mark.slow
@pytest.mark.parametrize("free", ["lamps", "black"])
def test_the_light_of_an_estimate_is_mended_where_it_was_freed(free, tmp_path):
    """A lamp told 2 degrees beside is found; where nothing of the light is freed, it stays."""
    told = np.array(SOURCES.directions)
    told[0] += 0.035 * np.array([1.0, 0, 0])
    told /= np.linalg.norm(told, axis=1, keepdims=True)
    light = DirectionalSources(told, SOURCES.irradiance)
    scene = Scene(unknown("phong"), BALL, light)
    estimate = fit(scene, ball_files(tmp_path, [SOURCES] * 3), QUICK._replace(free=(free,)))
    if free == "black":
        assert estimate.light is light
        return
    true = SOURCES.directions / np.linalg.norm(SOURCES.directions, axis=1, keepdims=True)
    off = np.arccos(np.clip(np.sum(estimate.light.directions * true, axis=1), -1, 1))
    assert np.all(np.degrees(off) < 0.2)


def ball_files(folder, lights, looks_away=None):
    """Write the photographs of a ball, one light each; one camera may look away from it."""
    frames, rng = [], np.random.default_rng(0)
    for number, light in enumerate(lights):
        place = 10 * np.array([np.cos(number), np.sin(number), 0.3])
        pose = look_at(place, np.zeros(3), np.array([0.0, 0.0, 1.0]))
        camera = Pinhole(28, 28, pose, fl_x=110.0)
        image = np.asarray(render(PHONG, camera, BALL, forward_of(light, BALL)))
        image *= 1 + 0.005 * rng.normal(size=image.shape)
        write_image(folder / f"{number}.exr", image)
        if number == looks_away:
            pose = look_at(place, 2 * place, np.array([0.0, 0.0, 1.0]))
        frames.append({"file_path": f"{number}.exr", "transform_matrix": pose.tolist()})
    intrinsics = {"w": 28, "h": 28, "fl_x": 110.0}
    (folder / "transforms.json").write_text(json.dumps({**intrinsics, "frames": frames}))
    return load_capture(folder / "transforms.json")


def test_lights_stay_with_their_photographs(tmp_path):
    """Where the first one is skipped, the others still have their own lights."""
    lights = tuple(
        DirectionalSources(np.array([[np.cos(a), np.sin(a), 0.5]]), np.full((1, 3), 2.0))
        for a in (2.5, 1.3, 2.3)
    )
    capture = ball_files(tmp_path, lights, looks_away=0)
    scene = Scene(unknown("phong"), BALL, per_frame=lights)
    found = fit(scene, capture, QUICK)
    assert found.values["exponent"] == pytest.approx(30, rel=0.05)
    assert found.relative_rms < 0.01
    assert "0.exr: warning: its camera does not see the object; skipped" in found.reasons[-1]
    with pytest.raises(ValueError, match="per_frame lights 2 photographs of 3"):
        fit(scene._replace(per_frame=lights[1:]), capture, QUICK)


@pytest.mark.slow
def test_each_capture_has_its_light(tmp_path):
    """Under a sky and under sources, where a photograph of the first capture is skipped."""
    lights = (SKY, SOURCES)
    captures = []
    for light, away in zip(lights, (0, None)):
        folder = tmp_path / type(light).__name__
        folder.mkdir()
        captures.append(ball_files(folder, (light,) * 3, looks_away=away))
    scene = Scene(unknown("phong"), BALL, lights)
    found = fit(scene, captures, FitSettings(starts=2, diagnose=False, refine_samples=400))
    assert found.values["exponent"] == pytest.approx(30, rel=0.05)
    np.testing.assert_allclose(found.values["kd"], KD, rtol=0.02)
    assert found.relative_rms < 0.01
    assert found.details.final.observations.frames == 5
    assert found.light is SKY
    with pytest.raises(ValueError, match="2 captures under unknown light; one light is found"):
        fit(scene._replace(light=None), captures)
    with pytest.raises(ValueError, match="2 lights for 1 captures"):
        fit(scene, captures[0])
