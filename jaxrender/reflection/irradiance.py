"""Irradiance as a sum of harmonics of the normal (T 4.10): the frequency view of diffuse light.

Nine coefficients suffice for most purposes.  They make a quadratic polynomial of the normal
(T 4.16), which is also a symmetric 4 x 4 matrix for each channel, E(n) = N' M N with
N = (x, y, z, 1) (T 4.14, 4.15).  ``irradiance`` is the sum to any degree and their twin.

Coefficients are those of the light in radiance; irradiance is in radiance times steradian, and the
radiance that leaves a Lambertian surface is kd E.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import apply_transfer, band_limit_of, evaluate
from jaxrender.lighting import Light
from jaxrender.shapes import AnyArray, Array, Coefficients, Directions, Float, checked
from jaxrender.spectra.lambertian import lambertian_transfer
from jaxrender.spectra.light import coefficients_of

_QUADRATIC = 9
# Gauss-Legendre nodes on each hemisphere, for the mean of an absolute value with a few kinks.
_ERROR_NODES = 2000


@checked
def irradiance(
    coefficients: Float[AnyArray, "coefficient channel"], normals: Directions
) -> Float[Array, "*batch channel"]:
    """Compute E(n) = sum_lm A_l L_lm Y_lm(n) (T 4.10) of all degrees that are given.

    Exact for light of no more degrees than its coefficients, to rounding (T 4.11 as corrected by
    ERRATA 19); ``irradiance_error`` bounds what the missing degrees of other light are worth.
    """
    light = jnp.asarray(coefficients)
    transfer = lambertian_transfer(band_limit_of(light.shape[0]))
    filtered = apply_transfer(light, jnp.asarray(transfer, light.dtype))
    return evaluate(filtered, jnp.asarray(normals))


@checked
def irradiance_matrix(
    coefficients: Coefficients | Light,
) -> Float[Array, "channel 4 4"]:
    """Arrange the light's first nine coefficients as the matrices M of T 4.15, one a channel.

    The constants c1 to c5 are computed from A_l and the harmonics' norms; two of those printed are
    off in the last digit (ERRATA 29).  Light of fewer than nine coefficients has zeros for the
    rest; of more, only nine are used.
    """
    light = _nine(coefficients_of(coefficients, 2))
    c1, c2, c3, c4, c5 = (jnp.asarray(c, light.dtype) for c in quadratic_constants())
    l00, l1m1, l10, l11, l2m2, l2m1, l20, l21, l22 = light
    rows = (
        (c1 * l22, c1 * l2m2, c1 * l21, c2 * l11),
        (c1 * l2m2, -c1 * l22, c1 * l2m1, c2 * l1m1),
        (c1 * l21, c1 * l2m1, c3 * l20, c2 * l10),
        (c2 * l11, c2 * l1m1, c2 * l10, c4 * l00 - c5 * l20),
    )
    return jnp.moveaxis(jnp.asarray(rows), -1, 0)


def quadratic_constants() -> tuple[float, float, float, float, float]:
    """Compute c1 to c5 of T 4.15: A_l times the norms of T 4.5."""
    a0, a1, a2 = lambertian_transfer(2).tolist()
    c1 = a2 * np.sqrt(15 / (4 * np.pi)) / 2
    c2 = a1 * np.sqrt(3 / (4 * np.pi)) / 2
    c4 = a0 * np.sqrt(1 / (4 * np.pi))
    c5 = a2 * np.sqrt(5 / (16 * np.pi))
    return float(c1), float(c2), float(3 * c5), float(c4), float(c5)


@checked
def matrix_irradiance(
    matrix: Float[AnyArray, "channel 4 4"], normals: Directions
) -> Float[Array, "*batch channel"]:
    """Evaluate E(n) = N' M N of T 4.14 as it is written: the twin of ``quadratic_irradiance``."""
    normals = jnp.asarray(normals)
    extended = jnp.concatenate([normals, jnp.ones_like(normals[..., :1])], axis=-1)
    return jnp.einsum("...i,cij,...j->...c", extended, matrix, extended, precision="highest")


@jax.custom_jvp
@checked
def quadratic_irradiance(
    matrix: Float[Array, "channel 4 4"], normals: Float[Array, "*batch 3"]
) -> Float[Array, "*batch channel"]:
    """Evaluate the polynomial of T 4.16 for unit normals: the degrees up to 2 of ``irradiance``.

    Written in the normals' components, which one pass over a million normals takes; with its
    derivative 2 M N spelled out, a gradient is another such pass.
    """
    x, y, z = normals[..., 0], normals[..., 1], normals[..., 2]
    channels = [
        x * (m[0, 0] * x + 2 * (m[0, 1] * y + m[0, 2] * z + m[0, 3]))
        + y * (m[1, 1] * y + 2 * (m[1, 2] * z + m[1, 3]))
        + z * (m[2, 2] * z + 2 * m[2, 3])
        + m[3, 3]
        for m in matrix
    ]
    return jnp.stack(channels, axis=-1)


@quadratic_irradiance.defjvp
def _quadratic_irradiance_jvp(primals, tangents):
    (matrix, normals), (matrix_moves, normals_move) = primals, tangents
    x, y, z = normals[..., 0], normals[..., 1], normals[..., 2]
    moved = [
        2 * (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) * normals_move[..., 0]
        + 2 * (m[0, 1] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) * normals_move[..., 1]
        + 2 * (m[0, 2] * x + m[1, 2] * y + m[2, 2] * z + m[2, 3]) * normals_move[..., 2]
        for m in matrix
    ]
    # Linear in the matrix, so its own derivative there is the same expression.
    by_matrix = quadratic_irradiance(matrix_moves, normals)
    return quadratic_irradiance(matrix, normals), jnp.stack(moved, axis=-1) + by_matrix


class IrradianceError(NamedTuple):
    """How far irradiance up to some degree can be off, as a part of the light's total intensity.

    The total intensity is the integral of radiance over the sphere.  ``worst`` is the largest
    error at any normal, ``mean`` the largest mean error over all normals, under any light.
    """

    worst: float
    mean: float


def irradiance_error(band_limit: int) -> IrradianceError:
    """Bound the error of leaving out the degrees above ``band_limit`` (T 4.3.1).

    Under one directional source the error is the part of the clamped cosine that is left out; any
    other light is a mixture of such, and cannot do worse.  Degree 2: 9.4 % and 3.1 %.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_ERROR_NODES)
    cosines = np.concatenate([(nodes - 1) / 2, [-1.0, 0.0, 1.0], (nodes + 1) / 2])
    weights = np.concatenate([weights / 4, np.zeros(3), weights / 4])
    degrees = np.arange(band_limit + 1)
    series = lambertian_transfer(band_limit) * (2 * degrees + 1) / (4 * np.pi)
    left_out = np.polynomial.legendre.legval(cosines, series) - np.maximum(cosines, 0)
    return IrradianceError(float(np.abs(left_out).max()), float(weights @ np.abs(left_out)))


def _nine(coefficients: Float[AnyArray, "coefficient channel"]) -> Float[Array, "9 channel"]:
    band_limit_of(coefficients.shape[0])
    kept = jnp.asarray(coefficients)[:_QUADRATIC]
    return jnp.pad(kept, ((0, _QUADRATIC - kept.shape[0]), (0, 0)))
