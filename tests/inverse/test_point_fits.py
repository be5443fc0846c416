"""Fits under sources that have a place, which photographs share or have for themselves.

- Samples see them where they stand: directions and irradiance of every place, by hand.
- One photograph, some, and captures put together keep the places; far sources are told apart.
- Material and texture are found from photographs under a flash; taken as far away, they are not.
- Freed lamps turn at their distance; nearness is not free, and no cause.
- Sources within the object, and settings that know no places, are refused.
"""

import numpy as np
import pytest

import jaxrender as jr
from jaxrender.geometry import SurfacePlaces, SurfaceSamples, fibonacci_sphere
from jaxrender.inverse import FitSettings, KnownLight, Observations
from jaxrender.inverse.light_nodes import exact_nodes, own_sources
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.lighting import DirectionalSources, PointSources

BALL = jr.Sphere(np.array([1.0, 2.0, 3.0]), 0.5)
SUN = DirectionalSources(np.array([[0.0, 0.6, 0.8]]), np.array([[0.5, 0.6, 0.7]]))
LAMPS = PointSources(
    np.array([[3.0, 2.0, 4.0], [1.0, -1.0, 3.5]]), np.array([[5.0, 4, 3], [2, 2, 2]])
)
FLASHES = tuple(
    PointSources(np.asarray(BALL.center) + (2.0 + 0.1 * k) * away[None], np.full((1, 3), 3.0))
    for k, away in enumerate(np.asarray(fibonacci_sphere(6), float))
)
TRUTH = jr.material("ggx", kd=np.array([0.12, 0.17, 0.21]), ks=np.full(3, 0.1), sigma=0.2, mu=1.5)
NOISE = 0.01
# A flash at the camera meets every facet head on: mu cannot be told.
MATERIAL = jr.unknown("ggx", mu=1.5)


def ball_seen(eyes, count=350, seed=0):
    """Look at the ball from places: samples, places and photographs of them."""
    rng = np.random.default_rng(seed)
    normals, outgoing, frame = [], [], []
    for number, eye in enumerate(eyes):
        towards = np.asarray(eye, float) - np.asarray(BALL.center)
        found = rng.normal(size=(8 * count, 3))
        found /= np.linalg.norm(found, axis=1, keepdims=True)
        away = towards - 0.5 * found
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        kept = np.flatnonzero(np.sum(found * away, axis=1) > 0.2)[:count]
        normals.append(found[kept])
        outgoing.append(away[kept])
        frame.append(np.full(len(kept), number))
    normals, outgoing = np.concatenate(normals), np.concatenate(outgoing)
    points = np.asarray(BALL.center) + 0.5 * normals
    places = SurfacePlaces(points, normals)
    return SurfaceSamples(normals, outgoing), places, np.concatenate(frame)


def lit_by(samples, places, frame, shared, own):
    """Add up what every source sends, source by source."""
    normals, outgoing = (np.asarray(part) for part in samples)
    found = np.zeros((len(frame), 3))
    every = np.arange(len(frame))
    lit = [(source, every) for source in shared]
    lit += [(source, np.flatnonzero(frame == number)) for number, source in enumerate(own)]
    for source, rows in lit:
        for place, intensity in zip(np.asarray(source.positions), np.asarray(source.intensity)):
            arrow = place - places.points[rows]
            distance = np.linalg.norm(arrow, axis=1)[:, None]
            incoming, normal = arrow / distance, normals[rows]
            cosine = np.maximum(np.sum(normal * incoming, axis=1), 0)[:, None]
            value = np.asarray(TRUTH.evaluate(*_local(normal, incoming, outgoing[rows])))
            found[rows] += np.where(cosine > 0, value * intensity * cosine / distance**2, 0)
    return found


def _local(normal, incoming, outgoing):
    """Turn directions so that the normals are up."""
    aside = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    frame = np.stack([aside, np.cross(normal, aside), normal], axis=1)
    return tuple(np.einsum("nij,nj->ni", frame, part) for part in (incoming, outgoing))


@pytest.fixture(scope="module")
def photographs():
    eyes = [np.asarray(flash.positions)[0] for flash in FLASHES]
    samples, places, frame = ball_seen(eyes)
    exact = lit_by(samples, places, frame, (), FLASHES)
    noise = np.random.default_rng(1).normal(size=exact.shape)
    return Observations(samples, exact * (1 + NOISE * noise), frame, places, eyes=np.array(eyes))


def both_lights():
    return KnownLight.of(SUN + LAMPS, FLASHES, shape=BALL)


def test_samples_see_sources_where_they_stand(photographs):
    light, some = both_lights(), photographs.take(np.arange(0, photographs.count, 97))
    points, found = np.asarray(some.places.points), own_sources(light, some)
    energies = np.sum(np.asarray(found.irradiance)[found.frame_of_sample], axis=2)
    for row, point in enumerate(points):
        at = int(some.frame[row])
        expected = [(np.asarray(SUN.directions)[0], np.asarray(SUN.irradiance)[0])]
        for source in (LAMPS, FLASHES[at]):
            for place, intensity in zip(np.asarray(source.positions), np.asarray(source.intensity)):
                arrow = place - point
                square = float(arrow @ arrow)
                expected.append((arrow / np.sqrt(square), intensity / square))
        towards = np.asarray(found.directions)[row]
        assert len(towards) == len(expected) == len(energies[row])
        for k, (direction, energy) in enumerate(expected):
            np.testing.assert_allclose(towards[k], direction, atol=1e-9)
            np.testing.assert_allclose(np.asarray(found.irradiance)[row, k], energy, rtol=1e-9)
    # The exact integral has the same.
    whole = [np.asarray(part.irradiance).sum() for part in exact_nodes(light, some, 0.2)]
    np.testing.assert_allclose(sum(whole), np.asarray(found.irradiance).sum(), rtol=1e-12)
    with pytest.raises(ValueError, match="give places"):
        exact_nodes(light, some._replace(places=None), 0.2)


def test_parts_of_photographs_keep_their_places():
    light = both_lights()
    for number, flash in enumerate(FLASHES):
        for one, at in ((light, number), (light.of_frame(number), 0)):
            points = one.points_of(at)
            expected = [np.concatenate([getattr(LAMPS, k), getattr(flash, k)]) for k in _NAMES]
            for name, value in zip(_NAMES, expected):
                np.testing.assert_allclose(getattr(points, name), value, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(one.far_of(at).irradiance, SUN.irradiance)
    some = light.of_frames([4, 1])
    np.testing.assert_allclose(some.points_of(0).positions[2], FLASHES[4].positions[0])
    again = KnownLight.joined([light.of_frames([0, 1]), KnownLight.of(SUN)], [2, 3])
    np.testing.assert_allclose(again.points_of(1).positions[2], FLASHES[1].positions[0])
    assert again.points_of(2) is None
    np.testing.assert_allclose(again.far_of(4).irradiance, SUN.irradiance)
    assert light.distant.near is None
    np.testing.assert_allclose(light.distant.sources_of(3).directions, SUN.directions)
    assert KnownLight.of(LAMPS, shape=BALL).distant is None


_NAMES = ("positions", "intensity")


def test_a_material_is_found_under_a_flash(photographs):
    scene = jr.Scene(MATERIAL, BALL, per_frame=FLASHES)
    found = jr.fit(scene, photographs, FitSettings(), count=2000)
    assert found.outcome.value == "converged"
    for name in ("kd", "ks", "sigma"):
        truth = np.asarray(getattr(TRUTH, name))[..., :1] if name == "ks" else getattr(TRUTH, name)
        off = np.abs(np.asarray(found.values[name]) - truth) / found.standard_error[name]
        assert np.all(off < 4), (name, off)
        assert np.all(np.asarray(found.standard_error[name]) < 0.05 * np.asarray(truth))


@pytest.mark.slow
def test_taken_as_far_away_it_is_not(photographs):
    center = np.asarray(BALL.center)
    far = tuple(flash.seen_from(center) for flash in FLASHES)
    scene = jr.Scene(MATERIAL, BALL, per_frame=far)
    found = jr.fit(scene, photographs, FitSettings(), count=2000)
    assert np.all(np.abs(np.asarray(found.values["kd"]) / TRUTH.kd - 1) > 0.1)


def test_lamps_turn_at_their_distance(photographs):
    light = both_lights()
    told = Told(photographs, light, BALL)
    none = Corrections.none(told)
    lamps = np.zeros_like(none.lamps)
    lamps[1, 2] = np.pi / 2
    turned = none.moved("lamps", lamps.ravel()).light(told)
    center = np.asarray(BALL.center)
    arrow = np.asarray(LAMPS.positions)[0] - center
    expected = center + np.array([-arrow[1], arrow[0], arrow[2]])
    np.testing.assert_allclose(turned.points_of(0).positions[0], expected, atol=1e-9)
    # Nothing moves where nothing is to.
    kept = none.light(told)
    np.testing.assert_allclose(kept.points_of(2).positions, light.points_of(2).positions)


@pytest.mark.slow
def test_nearness_is_given(photographs):
    scene = jr.Scene(MATERIAL, BALL, per_frame=FLASHES)
    with pytest.raises(ValueError, match=r"nearness cannot be freed: .* places of the sources"):
        jr.fit(scene, photographs, FitSettings(free=("nearness",)), count=1000)


def test_sources_within_the_object_are_refused():
    inside = PointSources(np.asarray(BALL.center)[None] + 0.3, np.ones((1, 3)))
    with pytest.raises(ValueError, match=r"a source lies 0\.346\d* from the object's centre"):
        KnownLight.of(PointSources(np.array([[1.2, 2.2, 3.2]]), np.ones((1, 3))), shape=BALL)
    with pytest.raises(ValueError, match="give its shape"):
        KnownLight.of(inside)
