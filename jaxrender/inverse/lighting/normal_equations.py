"""The normal equations of a light, streamed: memory does not grow with the samples.

For each channel, with weights w (1 / standard deviation of the noise) and rows a of the operator,

gram = sum w^2 a a',   moment = sum w^2 a B,   energy = sum w^2 B^2

A capture larger than the memory is added up block by block and ``joined``.  Any cut-off, penalty or
constraint needs these numbers only.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import cholesky, solve_triangular

from jaxrender.harmonics import band_limit_of, coefficient_count
from jaxrender.inverse.lighting.operator import (
    LightOperator,
    LightRows,
    degree_slices,
    in_chunks,
    sizes_by_degree,
)
from jaxrender.inverse.posedness import RECOVERABLE
from jaxrender.shapes import AnyArray, Array, Float

# Information below this part of the strongest counts as none: what rounding leaves of it.
NO_INFORMATION = 1e-13


class ChannelEquations(NamedTuple):
    """The normal equations of one channel."""

    gram: Float[np.ndarray, "coefficient coefficient"]
    moment: Float[np.ndarray, "coefficient"]
    energy: float
    measured: float

    def squares(self, light: Float[np.ndarray, "coefficient"]) -> float:
        """Compute chi^2; rounding may leave that of exact data slightly below 0."""
        return max(
            float(self.energy - 2 * self.moment @ light + light @ self.gram @ light),
            0.0,
        )


class NormalEquations(NamedTuple):
    """Sums over samples, and ``measured``, the number of samples of weight above 0."""

    gram: Float[AnyArray, "channel coefficient coefficient"]
    moment: Float[AnyArray, "channel coefficient"]
    energy: Float[AnyArray, "channel"]
    measured: Float[AnyArray, "channel"]

    @property
    def band_limit(self) -> int:
        """The highest degree of the light."""
        return band_limit_of(self.moment.shape[1])

    def channels(self) -> list[ChannelEquations]:
        """Take the channels apart."""
        return [ChannelEquations(*one) for one in zip(*self)]

    def joined(self, other: "NormalEquations") -> "NormalEquations":
        """Add the equations of other samples of the same light."""
        return NormalEquations(*(np.asarray(a) + np.asarray(b) for a, b in zip(self, other)))

    def cut(self, band_limit: int) -> "NormalEquations":
        """Leave out the degrees above ``band_limit``."""
        kept = coefficient_count(band_limit)
        gram, moment = self.gram[:, :kept, :kept], self.moment[:, :kept]
        return NormalEquations(gram, moment, self.energy, self.measured)


class DegreeReport(NamedTuple):
    """The evidence of the photographs for each degree, all lower ones being unknown too.

    ``singular_values`` are those of the weighted columns of each degree with the lower degrees
    projected off, per coefficient, descending within a degree.  ``size`` is the root mean square
    of the coefficients of a degree, recovered with the cut-off there; ``noise`` that of their
    standard errors.  A degree is recoverable when noise / size is below 1/4.
    """

    singular_values: Float[np.ndarray, "channel coefficient"]
    size: Float[np.ndarray, "degree"]
    noise: Float[np.ndarray, "degree"]
    unexplained: float

    @property
    def relative_error(self) -> Float[np.ndarray, "degree"]:
        """The noise of each degree over its size; infinite where nothing was found."""
        found = self.size > 0
        with np.errstate(over="ignore"):
            return np.where(found, self.noise / np.where(found, self.size, 1), np.inf)

    @property
    def recoverable_degree(self) -> int:
        """The highest recoverable degree; 0 where none is."""
        good = np.flatnonzero(self.relative_error < RECOVERABLE)
        return int(good[-1]) if good.size else 0


def normal_equations(
    operator: LightOperator,
    radiance: Float[AnyArray, "sample channel"],
    weights: Float[AnyArray, "sample channel"] | None = None,
) -> NormalEquations:
    """Add up the normal equations of measured radiance, a chunk of samples at a time.

    Raises ``ValueError`` for radiance or weights that are not finite where they count.
    """
    weights = np.ones(radiance.shape) if weights is None else np.asarray(weights)
    if not np.isfinite(weights).all() or (weights < 0).any():
        raise ValueError("weights must be finite and not negative: give 0 to leave a sample out")
    used = np.where(weights > 0, np.asarray(radiance), 0)
    if not np.isfinite(used).all():
        raise ValueError("the radiance is not finite somewhere: give such samples the weight 0")
    dtype = operator.rows.passed.dtype
    sums = _sums(operator, jnp.asarray(used, dtype), jnp.asarray(weights, dtype))
    return NormalEquations(*(np.asarray(part) for part in sums))


def dense_normal_equations(
    matrix: Float[np.ndarray, "channel sample coefficient"],
    radiance: Float[np.ndarray, "sample channel"],
    weights: Float[np.ndarray, "sample channel"],
) -> NormalEquations:
    """Add up those of a matrix that is at hand, a part of few samples."""
    weighted = weights.T[:, :, None] * matrix
    scaled = (weights * radiance).T
    transposed = weighted.transpose(0, 2, 1)
    return NormalEquations(
        transposed @ weighted,
        (transposed @ scaled[:, :, None])[:, :, 0],
        np.sum(scaled**2, axis=1),
        np.count_nonzero(weights, axis=0).astype(float),
    )


def degree_report(
    equations: NormalEquations, penalty: Float[np.ndarray, "coefficient"], noise_known: bool
) -> DegreeReport:
    """Weigh every cut-off at once, by one Cholesky factorisation in the order of the degrees.

    The diagonal block of the factor that belongs to a degree is that of its columns with all lower
    degrees projected off.
    """
    band_limit = equations.band_limit
    slices = degree_slices(band_limit)
    spectra, sizes, variances, unexplained = [], [], [], []
    for gram, moment, energy, measured in equations.channels():
        floor = NO_INFORMATION * max(np.trace(gram), np.finfo(float).tiny)
        factor = cholesky(gram + np.diag(penalty + floor))
        seen = solve_triangular(factor, moment, trans=1)
        blocks = [factor[s, s] for s in slices]
        spectra.append(np.concatenate([np.linalg.svd(b, compute_uv=False) for b in blocks]))
        inverses = [solve_triangular(b, np.eye(len(b))) for b in blocks]
        sizes.append(np.concatenate([b @ seen[s] for b, s in zip(inverses, slices)]))
        variances.append([np.mean(np.sum(b**2, axis=1)) for b in inverses])
        left = max(energy - seen @ seen, 0.0)
        unexplained.append(noise_variance(left, measured - len(moment), noise_known))
    scale = np.array(unexplained)[:, None]
    return DegreeReport(
        np.array(spectra),
        sizes_by_degree(np.array(sizes).T),
        np.sqrt(np.mean(np.array(variances) * scale, axis=0)),
        float(np.mean(unexplained)),
    )


def noise_variance(squares: float, freedom: float, noise_known: bool) -> float:
    """Compute by how much the variance of a measurement exceeds 1 / w^2.

    Where the noise was given, not less than 1: what the model leaves unexplained counts as noise.
    """
    variance = float(squares) / max(float(freedom), 1.0)
    return max(variance, 1.0) if noise_known else variance


@eqx.filter_jit
def _sums(
    operator: LightOperator,
    radiance: Float[Array, "sample channel"],
    weights: Float[Array, "sample channel"],
) -> NormalEquations:
    channels, count = radiance.shape[1], coefficient_count(operator.band_limit)
    dtype = radiance.dtype
    kd, ks = (jnp.asarray(a, dtype) for a in (operator.kd, operator.ks))
    product = partial(jnp.matmul, precision="highest")

    def add(sums: NormalEquations, chunk: tuple) -> tuple[NormalEquations, None]:
        rows: LightRows = chunk[0]
        diffuse, specular = operator.columns(rows)

        def of_channel(inputs: tuple) -> tuple:
            kd, ks, values, weight = inputs
            matrix = (kd * diffuse + ks * specular) * weight[:, None]
            right = values * weight
            counted = jnp.sum(weight > 0).astype(dtype)
            return (
                product(matrix.T, matrix),
                product(matrix.T, right),
                jnp.sum(right**2),
                counted,
            )

        more = jax.lax.map(of_channel, (kd, ks, chunk[1].T, chunk[2].T))
        return NormalEquations(*(a + b for a, b in zip(sums, more))), None

    start = NormalEquations(
        jnp.zeros((channels, count, count), dtype),
        jnp.zeros((channels, count), dtype),
        jnp.zeros(channels, dtype),
        jnp.zeros(channels, dtype),
    )
    chunks = in_chunks((operator.rows, radiance, weights), operator.samples_per_chunk)
    return jax.lax.scan(add, start, chunks)[0]
