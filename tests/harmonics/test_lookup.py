"""Look-ups that the compiler sees against the host's neighbours, and their derivatives at poles.

The interpolant has no derivative at a pole, so there the smooth function that the image samples is
the oracle: the error must fall as a texel's size does.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.harmonics import (
    CubeGrid,
    LatLongGrid,
    evaluate,
    looked_up,
    looked_up_on_cube,
    over_poles,
    synthesise,
)

RNG = np.random.default_rng(2)
POLES = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [-0.0, 0.0, 1.0], [1e-9, -1e-9, -1.0]])


@pytest.mark.parametrize("side", [1, 2, 5, 16])
def test_the_cube_is_looked_up_as_its_neighbours_say(side):
    grid = CubeGrid(side)
    image = RNG.normal(size=(*grid.shape, 2))
    directions = RNG.normal(size=(600, 3))
    # Edges and corners of the faces, and their centres.
    directions[:40] = RNG.choice([-1.0, 1.0], size=(40, 3))
    directions[:20, 0] = RNG.uniform(-1, 1, 20)
    directions[40:46] = [*np.eye(3), *-np.eye(3)]
    index, share = grid.neighbours(directions)
    expected = np.einsum("pk,pkc->pc", share, image.reshape(-1, 2)[index])
    np.testing.assert_allclose(looked_up_on_cube(grid, image, directions), expected, atol=1e-12)


def test_derivatives_at_the_poles_near_those_of_the_function_as_texels_shrink():
    coefficients = RNG.normal(size=(16, 1))
    weight = jnp.asarray(RNG.normal(size=len(POLES)))

    def total(function):
        return jax.grad(lambda at: jnp.sum(weight * function(at)[:, 0]))

    exact = np.asarray(total(lambda at: evaluate(coefficients, at))(jnp.asarray(POLES)))[:, :2]
    errors = []
    for rows in (40, 80):
        image = over_poles(synthesise(LatLongGrid(rows, 2 * rows), coefficients))
        found = np.asarray(total(lambda at, image=image: looked_up(image, at))(jnp.asarray(POLES)))
        assert np.all(np.isfinite(found))
        errors.append(np.abs(found[:, :2] - exact).max())
    assert errors[0] < 0.2 * np.abs(exact).max()
    assert errors[1] < 0.6 * errors[0], errors


def test_derivatives_by_the_image_at_the_poles_are_the_shares():
    grid = LatLongGrid(4, 8)
    image, move = RNG.normal(size=(2, *grid.shape, 1))
    at = jnp.asarray(POLES)
    _, moved = jax.jvp(lambda texels: looked_up(over_poles(texels), at), (image,), (move,))
    np.testing.assert_allclose(moved, looked_up(over_poles(move), at), atol=1e-14)
