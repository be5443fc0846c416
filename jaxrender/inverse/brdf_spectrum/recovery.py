"""A BRDF as coefficients, from photographs under known light (T 6.4.2, figure 6.2).

B is linear in rho_lpq, so the coefficients solve a linear system.  Its normal equations have the
size of the coefficients, whatever the number of pixels.  The surface needs no model, but much stays
open.  Nothing is seen below the horizon, where a truncated series is free.  Light without a degree
says nothing about that degree.  A weak prior settles this: coefficients have the size of the first
one, and nothing is below the horizon.  ``resolution`` tells the prior's part from the data's, and
the posterior covariance counts both.

Truncation makes ringing (T figure 6.2).  ``attenuated`` damps it, as softer light would.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import NoiseModel, estimate_noise
from jaxrender.inverse.brdf_spectrum.basis import SpectrumBasis
from jaxrender.inverse.brdf_spectrum.left_out import without_each
from jaxrender.inverse.clusters import Clusters, widened
from jaxrender.inverse.observations import Observations
from jaxrender.shapes import AnyArray, Array, Coefficients, Float

# Samples worked on at once: at order 12 their rows take 20 MB.
_CHUNK = 1024
# Noise is never taken to be less than this part of the mean radiance: exact data have none.
_LEAST_NOISE = 1e-6
# What the fit begins with where no noise is given; the residual then says what it is.
_FIRST_RELATIVE, _FIRST_FLOOR = 0.02, 0.01


class Prior(NamedTuple):
    """What the fit expects of the coefficients, relative to the first one.

    ``size`` is the standard deviation of every coefficient.  ``horizon`` is that of the function's
    component below either horizon.  Infinite values expect nothing.
    """

    size: float = 1.0
    horizon: float = 0.1

    def precision(self, basis: SpectrumBasis, first: float) -> Float[np.ndarray, "unknown unknown"]:
        """Return the inverse covariance of the unknowns; ``first`` is rho_000 or a guess at it."""
        norms = np.diag(basis.norms())
        hidden = norms - basis.visible_overlap()
        return norms / (self.size * first) ** 2 + hidden / (self.horizon * first) ** 2


DEFAULT_PRIOR, NO_PRIOR = Prior(), Prior(np.inf, np.inf)


class NormalEquations(NamedTuple):
    """Sums over samples: A' W A, A' W B, B' W B, for each channel, and how many samples.

    Those of two sets of samples add up to those of both.
    """

    matrix: Float[np.ndarray, "channel unknown unknown"]
    vector: Float[np.ndarray, "channel unknown"]
    squares: Float[np.ndarray, "channel"]
    count: int

    def joined(self, other: "NormalEquations") -> "NormalEquations":
        """Return the normal equations of both sets of samples."""
        return NormalEquations(
            self.matrix + other.matrix,
            self.vector + other.vector,
            self.squares + other.squares,
            self.count + other.count,
        )

    def first_coefficient(self) -> Float[np.ndarray, "channel"]:
        """Return what rho_000 would be if it were alone: the size of things."""
        return np.abs(self.vector[:, 0]) / self.matrix[:, 0, 0]


class LobeValues(NamedTuple):
    """rho cos t_i of pairs of directions, with its standard error."""

    values: Float[np.ndarray, "pair channel"]
    standard_error: Float[np.ndarray, "pair channel"]


class BRDFSpectrum(NamedTuple):
    """Recovered coefficients with the covariance of their errors.

    ``resolution`` is, for each unknown, the part that the data have in it (0: all prior, 1: none);
    its sum is the number of coefficients that the photographs determine.  The covariance knows of
    misfit where the samples' clusters were counted; ``exact_covariance`` is that of a model that is
    exact.
    """

    basis: SpectrumBasis
    values: Float[np.ndarray, "unknown channel"]
    covariance: Float[np.ndarray, "channel unknown unknown"]
    resolution: Float[np.ndarray, "unknown channel"]
    noise: NoiseModel | None = None
    relative_rms: float = float("nan")
    exact_covariance: Float[np.ndarray, "channel unknown unknown"] | None = None

    def if_exact(self) -> "BRDFSpectrum":
        """Take the model to be exact."""
        exact = self.exact_covariance
        return self if exact is None else self._replace(covariance=exact, exact_covariance=None)

    @property
    def coefficients(self) -> Float[np.ndarray, "degree outgoing_degree order channel"]:
        """rho_lpq of rho^, or rho~_lpq where reciprocal, for q = 0 ... (T 2.53)."""
        return self.basis.spread(self.values)

    @property
    def standard_error(self) -> Float[np.ndarray, "unknown channel"]:
        """The standard error of each unknown."""
        return np.sqrt(np.einsum("cuu->uc", self.covariance))

    def transfer(
        self, incoming: Float[AnyArray, "pair 3"], outgoing: Float[AnyArray, "pair 3"]
    ) -> LobeValues:
        """Evaluate rho cos t_i for local directions above the horizon, and its standard error."""
        rows = np.asarray(self.basis.pair_rows(incoming, outgoing))
        variance = np.einsum("su,cuv,sv->sc", rows, self.covariance, rows, optimize=True)
        return LobeValues(rows @ self.values, np.sqrt(np.maximum(variance, 0)))

    def radiance(
        self, light: Coefficients, samples: SurfaceSamples
    ) -> Float[np.ndarray, "sample channel"]:
        """Render samples under light given by coefficients: the convolution (T 2.55)."""
        values = jnp.asarray(self.values)
        parts = [
            np.asarray(_render(self.basis, jnp.asarray(light), chunk, values))[:size]
            for chunk, size in _chunks(samples)
        ]
        return np.concatenate(parts)

    def attenuated(self, transfer: Float[np.ndarray, "degree"]) -> "BRDFSpectrum":
        """Multiply degree l (in the reciprocal form p too) by ``transfer``: less ringing.

        In the plain form that is the reflection of light so filtered (T 6.4.2).
        Raises ``ValueError`` unless there is a factor for each degree.
        """
        transfer = np.asarray(transfer, float)
        if transfer.shape != (self.basis.band_limit + 1,):
            raise ValueError(
                f"{transfer.shape[0]} factors for degrees 0 to {self.basis.band_limit}: give "
                f"{self.basis.band_limit + 1}"
            )
        degree, outgoing, _ = self.basis.indices
        factor = transfer[degree] * (transfer[outgoing] if self.basis.reciprocal else 1)
        both, exact = np.outer(factor, factor)[None], self.exact_covariance
        return self._replace(
            values=self.values * factor[:, None],
            covariance=self.covariance * both,
            exact_covariance=None if exact is None else exact * both,
        )


def normal_equations(
    basis: SpectrumBasis,
    light: Coefficients,
    observations: Observations,
    deviation: Float[AnyArray, "sample channel"],
) -> NormalEquations:
    """Sum up the normal equations of samples with given standard deviations of their noise."""
    channels = observations.radiance.shape[1]
    total = NormalEquations(
        np.zeros((channels, basis.count, basis.count)),
        np.zeros((channels, basis.count)),
        np.zeros(channels),
        0,
    )
    weights = 1 / np.asarray(deviation)
    target = np.asarray(observations.radiance) * weights
    first = 0
    for chunk, size in _chunks(observations.samples):
        last, short = first + size, ((0, _CHUNK - size), (0, 0))
        parts = _sums(
            basis,
            jnp.asarray(light),
            chunk,
            np.pad(weights[first:last], short),
            np.pad(target[first:last], short),
        )
        matrix, vector, squares = (np.asarray(part) for part in parts)
        total = total.joined(NormalEquations(matrix, vector, squares, size))
        first = last
    return total


def solve_spectrum(
    basis: SpectrumBasis, equations: NormalEquations, prior: Prior = DEFAULT_PRIOR
) -> BRDFSpectrum:
    """Solve for the coefficients under a prior, with their posterior covariance."""
    values, covariances, resolutions = [], [], []
    firsts = equations.first_coefficient()
    for matrix, vector, first in zip(equations.matrix, equations.vector, firsts):
        covariance = _inverse(matrix + prior.precision(basis, float(first)))
        values.append(covariance @ vector)
        covariances.append(covariance)
        resolutions.append(np.einsum("uv,vu->u", covariance, matrix))
    return BRDFSpectrum(
        basis, np.stack(values, -1), np.stack(covariances), np.stack(resolutions, -1)
    )


def fit_brdf_spectrum(
    observations: Observations,
    light: Coefficients,
    basis: SpectrumBasis,
    noise: NoiseModel | None = None,
    prior: Prior = DEFAULT_PRIOR,
    know_misfit: bool = True,
) -> BRDFSpectrum:
    """Recover rho_lpq from samples under light given by its coefficients (T 6.4.2).

    Samples are weighed by the noise.  Where none is given, it is estimated from the residuals, and
    then includes what the order leaves out.  The errors know of misfit (:mod:`.left_out`) unless
    ``know_misfit`` is False.  Raises ``ValueError`` for no samples, and for light
    that is zero at degree 0.
    """
    radiance = np.asarray(observations.radiance)
    if not len(radiance):
        raise ValueError("no samples: nothing was measured")
    if not np.all(np.asarray(light)[0]):
        raise ValueError("the light's coefficient of degree 0 is zero: give coefficients of light")
    level = np.sqrt(np.mean(radiance**2))
    given, model = (
        noise is not None,
        noise or NoiseModel(_FIRST_RELATIVE, _FIRST_FLOOR * float(level)),
    )
    predicted = np.abs(radiance)
    for _ in range(1 if given else 3):
        deviation = np.asarray(model.standard_deviation(np.maximum(predicted, 0)))
        deviation = np.hypot(deviation, _LEAST_NOISE * level)
        equations = normal_equations(basis, light, observations, deviation)
        found = solve_spectrum(basis, equations, prior)
        predicted = found.radiance(light, observations.samples)
        if not given:
            model = estimate_noise(radiance - predicted, predicted, observations.rounding)
    left = radiance - predicted
    found = found._replace(
        noise=model,
        relative_rms=float(np.sqrt(np.sum(left**2) / np.sum(radiance**2))),
        exact_covariance=found.covariance,
    )
    if not know_misfit:
        return found
    rows, clusters = _rows_of(basis, light, observations), Clusters.of(observations)
    firsts = equations.first_coefficient()
    return found._replace(
        covariance=np.stack(
            [
                widened(
                    own,
                    without_each(
                        rows[:, :, channel] / deviation[:, channel, None],
                        radiance[:, channel] / deviation[:, channel],
                        prior.precision(basis, float(firsts[channel])),
                        clusters,
                    ),
                )
                for channel, own in enumerate(found.covariance)
            ]
        )
    )


def _rows_of(
    basis: SpectrumBasis, light: Coefficients, observations: Observations
) -> Float[np.ndarray, "sample unknown channel"]:
    """Evaluate what each coefficient sends to the camera, for every sample."""
    parts = [
        np.asarray(_rows(basis, jnp.asarray(light), chunk))[:size]
        for chunk, size in _chunks(observations.samples)
    ]
    return np.concatenate(parts)


@jax.jit(static_argnames="basis")
def _sums(
    basis: SpectrumBasis, light: Array, samples: SurfaceSamples, weights: Array, target: Array
) -> tuple[Array, Array, Array]:
    rows = basis.rows(light, samples) * weights[:, None, :]
    with jax.default_matmul_precision("highest"):
        matrix = jnp.einsum("suc,svc->cuv", rows, rows)
        vector = jnp.einsum("suc,sc->cu", rows, target)
    return matrix, vector, jnp.sum(target**2, axis=0)


@jax.jit(static_argnames="basis")
def _rows(basis: SpectrumBasis, light: Array, samples: SurfaceSamples) -> Array:
    return basis.rows(light, samples)


@jax.jit(static_argnames="basis")
def _render(basis: SpectrumBasis, light: Array, samples: SurfaceSamples, values: Array) -> Array:
    rows = basis.rows(light, samples)
    return jnp.einsum("suc,uc->sc", rows, values, precision="highest")


def _chunks(samples: SurfaceSamples) -> Iterator[tuple[SurfaceSamples, int]]:
    """Cut samples into pieces of one size, the last filled up, with how many of each count."""
    arrays = [np.asarray(a) for a in samples]
    for first in range(0, len(arrays[0]), _CHUNK):
        parts = [a[first : first + _CHUNK] for a in arrays]
        size = len(parts[0])
        short = ((0, _CHUNK - size), (0, 0))
        yield SurfaceSamples(*(np.pad(part, short, mode="edge") for part in parts)), size


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Invert a symmetric matrix; what has no information at all gets a huge variance."""
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(matrix * scale[:, None] * scale[None, :])
    values = np.maximum(values, np.finfo(float).eps * len(matrix))
    return (vectors / values[None, :]) @ vectors.T * scale[:, None] * scale[None, :]
