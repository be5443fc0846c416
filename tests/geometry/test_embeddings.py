"""The hemisphere on the unit square.

- Round trips from either side, to rounding; places of known directions by hand.
- The measure integrates to pi over the hemisphere, and a cosine to 2 pi / 3.
- ``projected_solid_angle`` is |d(x, y)/d(place)|, by finite differences.
- Outside the disc there is the nearest horizon; derivatives are finite everywhere.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.geometry import EMBEDDINGS, NUSSELT, POLAR, Embedding

ALL = pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=list(EMBEDDINGS))


@ALL
def test_round_trips(embedding: Embedding):
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 1, (2000, 2))
    places = places[np.asarray(embedding.covers(places))]
    directions = embedding.direction_from_square(places)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-15)
    np.testing.assert_allclose(embedding.square_from_direction(directions), places, atol=1e-14)


def test_known_places():
    x, y, z = np.eye(3)
    np.testing.assert_allclose(NUSSELT.square_from_direction(x), [1, 0.5])
    np.testing.assert_allclose(NUSSELT.square_from_direction(-y), [0.5, 0])
    np.testing.assert_allclose(NUSSELT.square_from_direction(z), [0.5, 0.5])
    np.testing.assert_allclose(POLAR.square_from_direction(y), [1, 0.25])
    np.testing.assert_allclose(POLAR.square_from_direction(z), [0, 0])
    np.testing.assert_allclose(POLAR.square_from_direction(np.array([1, -1e-20, 0.0])), [1, 0])


@ALL
def test_measure_integrates(embedding: Embedding):
    places = embedding.centres((512, 512)).reshape(-1, 2)
    measure = np.asarray(embedding.projected_solid_angle(places)) / len(places)
    cosine = np.asarray(embedding.direction_from_square(places))[:, 2]
    np.testing.assert_allclose(measure.sum(), np.pi, rtol=1e-4)
    np.testing.assert_allclose(measure @ cosine, 2 * np.pi / 3, rtol=1e-4)


@ALL
def test_measure_is_the_jacobian(embedding: Embedding):
    place = np.array([0.4, 0.7])
    jacobian = jax.jacobian(lambda p: embedding.direction_from_square(p)[:2])(jnp.asarray(place))
    expected = abs(np.linalg.det(np.asarray(jacobian)))
    np.testing.assert_allclose(embedding.projected_solid_angle(place), expected, rtol=1e-12)


def test_outside_the_disc():
    corner = np.array([1.0, 1.0])
    assert not NUSSELT.covers(corner)
    np.testing.assert_allclose(
        NUSSELT.direction_from_square(corner), [np.sqrt(0.5), np.sqrt(0.5), 0], atol=1e-15
    )
    assert NUSSELT.projected_solid_angle(corner) == 0
    for place in (corner, np.array([1.0, 0.5]), np.array([0.5, 0.5])):
        assert np.isfinite(jax.jacobian(NUSSELT.direction_from_square)(place)).all()


@ALL
def test_derivatives_at_the_pole_are_finite(embedding: Embedding):
    assert np.isfinite(jax.jacobian(embedding.square_from_direction)(np.array([0, 0, 1.0]))).all()


def test_float32_stays_float32():
    for embedding in EMBEDDINGS.values():
        place = np.full((3, 2), 0.3, np.float32)
        direction = embedding.direction_from_square(place)
        assert direction.dtype == np.float32
        assert embedding.square_from_direction(direction).dtype == np.float32
        assert embedding.projected_solid_angle(place).dtype == np.float32


def test_empty_tables_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        NUSSELT.centres((0, 4))
