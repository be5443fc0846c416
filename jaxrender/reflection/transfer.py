"""Transfer vectors: how much of each harmonic of distant light reaches a place (T 6.10).

    Y~_lm(x) = int V(x, w) Y_lm(w) max(n.w, 0) dw,    E(x) = sum_lm L_lm Y~_lm(x)

They are found once for a shape, by rays in low-discrepancy directions, and serve every light.  Of a
convex shape they are A_l Y_lm(n).  Host side; ``shadowed_irradiance`` is device side.

With f = Y_lm max(n.w, 0) the integral of V f is sought as A_l Y_lm(n) - int (1 - V) f: only what is
blocked is left to quadrature, so convex shapes are exact and open places nearly so.
``plain=True`` integrates V f itself, the twin.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import (
    Shape,
    SurfacePlaces,
    fibonacci_sphere,
    random_rotations,
    visible,
)
from jaxrender.harmonics import apply_transfer, band_limit_of, coefficient_count, real_basis
from jaxrender.shapes import AnyArray, Array, Float, Int, checked
from jaxrender.spectra.lambertian import lambertian_transfer

# Different rotations of the directions.  Places that share one err alike; the basis is evaluated
# once for each.
_ROTATIONS = 32
# Places that meet the directions of a rotation in one matrix product.
_PLACES_AT_ONCE = 512


class Quadrature(NamedTuple):
    """Directions over the whole sphere, half of which a place has above its horizon."""

    directions: int = 2048
    seed: int = 0
    plain: bool = False


class TransferVectors(NamedTuple):
    """Y~_lm(x), flat index l(l+1)+m, and the standard error of each place's coefficients (rms)."""

    values: Float[np.ndarray, "place coefficient"]
    errors: Float[np.ndarray, "place"]


@checked
def transfer_vectors(
    shape: Shape,
    places: SurfacePlaces,
    normals: Float[AnyArray, "place 3"],
    band_limit: int,
    quadrature: Quadrature | None = None,
) -> TransferVectors:
    """Integrate visibility, cosine and every harmonic to ``band_limit`` at each place.

    ``normals`` are those of shading.  Every place is served by two sets of directions, half of them
    each, rotated independently and at random; the result is the mean of two unbiased estimates, its
    standard error half their difference.  Memory holds no more than a few hundred places' rays.
    """
    quadrature = quadrature or Quadrature()
    if quadrature.directions < 2 or quadrature.directions % 2:
        raise ValueError(
            f"{quadrature.directions} directions: give an even number, for two halves to compare"
        )
    normals = np.asarray(normals, np.float64)
    count = coefficient_count(band_limit)
    unshadowed = np.zeros((len(normals), count))
    sign = 1
    if not quadrature.plain:
        unshadowed = _convex(normals, band_limit)
        if shape.is_convex():
            return TransferVectors(unshadowed, np.zeros(len(normals)))
        sign = -1
    halves = sign * _two_halves(shape, places, normals, count, quadrature)
    errors = np.sqrt(np.mean(((halves[0] - halves[1]) / 2) ** 2, axis=-1))
    return TransferVectors(unshadowed + halves.mean(axis=0), errors)


@checked
def interpolated(
    at_vertices: Float[AnyArray, "vertex *quantity"],
    faces: Int[np.ndarray, "face 3"],
    face: Int[np.ndarray, "place"],
    barycentric: Float[np.ndarray, "place 3"],
) -> Float[np.ndarray, "place *quantity"]:
    """Mix what is known at a mesh's vertices by the weights of the corners of each place's face."""
    if (np.asarray(face) < 0).any():
        raise ValueError(
            "a place has no face (-1): interpolate only where the view hit a mesh (view.hit)"
        )
    corners = np.asarray(at_vertices)[faces[face]]
    return np.einsum("pk,pk...->p...", barycentric, corners)


@checked
def shadowed_irradiance(
    coefficients: Float[AnyArray, "coefficient channel"],
    transfer: Float[AnyArray, "sample transfer_coefficient"],
) -> Float[Array, "sample channel"]:
    """Sum E(x) = sum_lm L_lm Y~_lm(x) over the degrees that light and transfer vectors share."""
    light, transfer = jnp.asarray(coefficients), jnp.asarray(transfer)
    shared = min(band_limit_of(light.shape[0]), band_limit_of(transfer.shape[1]))
    count = coefficient_count(shared)
    weights = transfer[:, :count].astype(light.dtype)
    return jnp.matmul(weights, light[:count], precision="highest")


def _convex(normals: np.ndarray, band_limit: int) -> np.ndarray:
    """A_l Y_lm(n)."""
    basis = np.asarray(real_basis(normals, band_limit), np.float64)
    transfer = lambertian_transfer(band_limit)
    return np.asarray(apply_transfer(basis.T, transfer), np.float64).T


def _two_halves(
    shape: Shape,
    places: SurfacePlaces,
    normals: np.ndarray,
    count: int,
    quadrature: Quadrature,
) -> Float[np.ndarray, "half place coefficient"]:
    """Integrate V f, or (1 - V) f unless plain, by each half of the directions."""
    half = quadrature.directions // 2
    still = fibonacci_sphere(half)
    group = np.random.default_rng(quadrature.seed).permutation(len(normals)) % _ROTATIONS
    rotations = random_rotations(2 * _ROTATIONS, quadrature.seed).reshape(2, _ROTATIONS, 3, 3)
    found = np.zeros((2, len(normals), count))
    for index in range(min(_ROTATIONS, len(normals))):
        turned = still @ np.swapaxes(rotations[:, index], -1, -2)
        directions = turned.reshape(-1, 3)
        basis = 4 * np.pi / half * np.asarray(real_basis(directions, band_limit_of(count)))
        members = np.flatnonzero(group == index)
        for first in range(0, len(members), _PLACES_AT_ONCE):
            chosen = members[first : first + _PLACES_AT_ONCE]
            some = SurfacePlaces(*(np.asarray(a)[chosen] for a in places))
            seen = visible(shape, some, directions)
            weights = normals[chosen] @ directions.T
            np.maximum(weights, 0, out=weights)
            weights *= seen if quadrature.plain else ~seen
            parts = weights.reshape(len(chosen), 2, half).swapaxes(0, 1)
            found[:, chosen] = parts @ basis.reshape(2, half, count)
    return found
