"""Luminaires: radiance looked up, seen along rays, power; measured by tracing inwards.

- A tree's sample comes back at its own place and direction, in the patch's own frame, on every
  face of a box and whatever the wavelet; nothing leaves inwards; the back is dark.
- Power of uniform radiance is pi L A, exactly on flat and curved patches; the disc's shares are
  those of a fine raster.
- A window reproduces the scene behind it: exactly along the rays it was measured by, and about
  everywhere else; directions and not their mirror images.
- Compression keeps the mean and costs the sum of squares left out.
- Bad trees, sizes and tracers are refused.
"""

import numpy as np
import pytest

from jaxrender.geometry import NUSSELT
from jaxrender.lighting.luminaires.curved_surfaces import SphereSurface
from jaxrender.lighting.luminaires.luminaire import Luminaire, disc_shares
from jaxrender.lighting.luminaires.measured import (
    compressed,
    measure_light_field,
    measure_luminaire,
)
from jaxrender.lighting.luminaires.surfaces import Rectangle, box_faces
from jaxrender.wavelets.filters import daubechies, haar
from jaxrender.wavelets.transform import analyse_nonstandard
from jaxrender.wavelets.tree import CoefficientTree

RNG = np.random.default_rng(0)
WINDOW = Rectangle(np.array([1.0, 0, 0]), np.array([0, 2.0, 0]), np.array([0, 0, 1.0]))


def scene(origins, directions):
    """A ball with stripes in front of a sky; smooth enough for 8 samples, without symmetry."""
    sky = 1 + 0.5 * directions @ np.array([0.3, 0.6, -0.4])
    along = -np.einsum("ri,ri->r", origins - [-3.0, 1, 0.5], directions)
    closest = origins + along[:, None] * directions - [-3.0, 1, 0.5]
    ball = np.exp(-np.einsum("ri,ri->r", closest, closest) / 2)
    return np.stack([sky + ball, 0.5 * sky], axis=-1)


@pytest.mark.parametrize("wavelet", [haar(), daubechies(2)], ids=lambda w: w.name)
def test_samples_come_back_on_every_face_of_a_box(wavelet):
    size = 4
    samples = RNG.uniform(size=(6, size, size, size, size, 2))
    faces = box_faces(np.array([1.0, 2, 3]), np.array([2.0, 4, 6]))
    box = Luminaire(faces, [compressed(s, 1.0, wavelet) for s in samples], convex=True)
    assert (box.forest is not None) == (wavelet.name == "haar")
    index = np.stack(np.meshgrid(*[np.arange(size)] * 4, indexing="ij"), axis=-1).reshape(-1, 4)
    index = index[np.asarray(NUSSELT.covers((index[:, 2:] + 0.5) / size))]
    local = np.asarray(NUSSELT.direction_from_square((index[:, 2:] + 0.5) / size))
    for number, face in enumerate(faces):
        world = local @ face.frame.T
        places = (index[:, :2] + 0.5) / size
        patch = np.full(len(places), number)
        found = box.radiance(places, world, patch)
        np.testing.assert_allclose(found, samples[number][tuple(index.T)], atol=1e-12)
        assert not np.asarray(box.radiance(places, -world, patch)).any()
        origins = face.at(places).points + 2 * world
        seen = box.radiance_along(origins, -world)
        np.testing.assert_allclose(seen.radiance, samples[number][tuple(index.T)], atol=1e-9)
        np.testing.assert_allclose(seen.distance, 2)


def test_the_back_is_dark_and_what_misses_sees_nothing():
    luminaire = Luminaire.uniform([WINDOW], np.array([2.0]))
    origins = np.array([[3.0, 1, 0.5], [-3.0, 1, 0.5], [3.0, 1, 0.5]])
    seen = luminaire.radiance_along(origins, np.array([[-1.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]]))
    np.testing.assert_allclose(np.asarray(seen.radiance)[:, 0], [2, 0, 0])
    np.testing.assert_allclose(seen.distance, [2, 4, np.inf])


def test_power_of_uniform_radiance():
    radiance = np.array([3.0, 0.5])
    ball = Luminaire.uniform([SphereSurface(np.ones(3), 0.7)], radiance)
    area = 4 * np.pi * 0.7**2
    # Cell areas by 3 x 3 nodes of half a sine each.
    np.testing.assert_allclose(ball.power(), np.pi * radiance * area, rtol=1e-4)
    flat = Luminaire.uniform([WINDOW], radiance)
    np.testing.assert_allclose(flat.power(), np.pi * radiance * 2, rtol=1e-12)


@pytest.mark.parametrize("size", [1, 2, 8])
def test_disc_shares_are_those_of_a_fine_raster(size):
    line = (np.arange(1024) + 0.5) / 1024
    inside = (line[:, None] - 0.5) ** 2 + (line - 0.5) ** 2 < 0.25
    raster = inside.reshape(size, 1024 // size, size, -1).mean(axis=(1, 3)) / size**2
    np.testing.assert_allclose(disc_shares(size), raster, atol=1e-4)
    assert disc_shares(size).sum() == pytest.approx(np.pi / 4, rel=1e-12)


def test_a_window_reproduces_the_scene_behind_it():
    size = 8
    window = measure_luminaire(scene, [WINDOW], size)
    places = (RNG.integers(0, size, (500, 2)) + 0.5) / size
    square = (RNG.integers(1, size - 1, (500, 2)) + 0.5) / size
    square = square[np.asarray(NUSSELT.covers(square))]
    places = places[: len(square)]
    outwards = np.asarray(NUSSELT.direction_from_square(square)) @ WINDOW.frame.T
    origins = WINDOW.at(places).points + 3 * outwards
    seen = np.asarray(window.radiance_along(origins, -outwards).radiance)
    np.testing.assert_allclose(seen, scene(origins, -outwards), rtol=2e-6)
    # Anywhere: as well as cells allow, and coarser ones worse; the mirrored scene is off by .2.
    coarser = measure_luminaire(scene, [WINDOW], size // 2)
    origins = np.array([4.0, 1.2, 0.3]) + RNG.uniform(-1, 1, (2000, 3))
    towards = WINDOW.at(RNG.uniform(size=(2000, 2))).points - origins
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    truth = scene(origins, towards)
    errors = []
    for measured in (coarser, window):
        error = np.asarray(measured.radiance_along(origins, towards).radiance) - truth
        errors.append(np.sqrt((error**2).mean()))
    assert errors[1] < 0.65 * errors[0]
    assert errors[1] < 0.1
    mirrored = scene(origins, towards * [1, -1, 1])
    assert np.sqrt(((mirrored - truth) ** 2).mean()) > 0.2


def test_compression_costs_what_is_predicted():
    samples = measure_light_field(scene, WINDOW, 8).astype(float)
    whole = np.asarray(analyse_nonstandard(haar(), samples)).reshape(-1, 2)
    squares = np.sort((whole[1:] ** 2).sum(axis=1))
    dropped = np.count_nonzero(squares) - round(0.1 * np.count_nonzero(squares))
    missing = np.sort(squares[squares > 0])[:dropped].sum() / 8**4
    tree = compressed(samples, 0.1)
    error = np.asarray(tree.samples()) - samples
    assert (error**2).sum(axis=-1).mean() == pytest.approx(missing, rel=1e-9)
    mean = samples.mean(axis=(0, 1, 2, 3))
    np.testing.assert_allclose(np.asarray(tree.root), mean, rtol=1e-6)


def test_corners_hold_the_nearest_direction():
    samples = measure_light_field(lambda o, d: np.full((len(d), 1), 0.5), WINDOW, 4)
    assert (samples == 0.5).all()
    assert samples.dtype == np.float32


def test_single_precision_stays():
    luminaire = measure_luminaire(scene, [WINDOW], 4)
    found = luminaire.radiance(np.full((3, 2), 0.3), np.tile([1.0, 0, 0], (3, 1)))
    assert found.dtype == np.float32
    assert luminaire.power().dtype == np.float32


def test_bad_luminaires_are_refused():
    tree = compressed(np.ones((2, 2, 2, 2, 1)))
    with pytest.raises(ValueError, match="one for each"):
        Luminaire([WINDOW], [tree, tree])
    flat = CoefficientTree.of_coefficients(haar(), np.ones((2, 2, 1)))
    with pytest.raises(ValueError, match="2 axes"):
        Luminaire([WINDOW], [flat])
    with pytest.raises(ValueError, match="power of two"):
        measure_light_field(scene, WINDOW, 12)
    with pytest.raises(ValueError, match="2 to 64"):
        measure_light_field(scene, WINDOW, 128)
    with pytest.raises(ValueError, match="at most 1"):
        compressed(np.ones((2, 2, 2, 2, 1)), 0.0)
    with pytest.raises(ValueError, match="must be finite"):
        measure_light_field(lambda o, d: np.full((len(d), 1), np.nan), WINDOW, 2)
