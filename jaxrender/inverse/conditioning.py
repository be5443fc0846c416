"""What the photographs say about a lobe's width, and from where: spectrum or grazing angles.

The frequency model tells the width apart only by how it damps degrees above zero; under uniform
light it has no sensitivity at all (T 3.2.7, 6.4.4).  The exact model also sees the horizon cut the
lobe at grazing exit, which a little light of any kind reveals.  A standard error that rests on one
of the two deserves to be known as such: grazing pixels are trusted least in their geometry.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.elimination import Data, Fit, Problem
from jaxrender.inverse.models import DualModel, LinearisedModel
from jaxrender.programs import stored
from jaxrender.reflection import filled_up
from jaxrender.shapes import Array, Float

# Samples whose exit cosine is below this count as grazing (45 degrees).
GRAZING_COSINE = 0.7
# The evidence counts as resting on grazing angles when it is this many times weaker without them.
_MUCH_WEAKER = 4.0
# A relative standard error above this says that the evidence is no evidence.
_HARDLY = 0.15
# A relative standard error above this is reported as no information at all.
_HOPELESS = 10.0


class WidthEvidence(NamedTuple):
    """Relative standard errors of the width: of all samples, without grazing, from the spectrum.

    ``name`` is the model's own number for the width.  ``spectrum`` uses the thesis's Gaussian
    transfer, which knows nothing of the horizon.
    """

    all: float
    without_grazing: float
    spectrum: float
    name: str = "sigma"

    @property
    def rests_on_grazing(self) -> bool:
        """Whether the width would be lost, or nearly, without the grazing samples."""
        weakest = min(self.without_grazing, self.spectrum)
        return bool(np.isfinite(self.all) and weakest > _MUCH_WEAKER * self.all)

    def sentence(self) -> str:
        """Say it in words."""
        figures = (
            f"relative standard error of {self.name} {_percent(self.all)} from all samples, "
            f"{_percent(self.without_grazing)} without exit cosines below {GRAZING_COSINE:g}, "
            f"{_percent(self.spectrum)} from the light's spectrum alone"
        )
        if not self.all < _HARDLY:
            return f"nothing determines {self.name} well: {figures}"
        if self.rests_on_grazing:
            return f"{self.name} rests on grazing angles: {figures}"
        return f"{self.name} rests on the light's detail: {figures}"


def width_evidence(
    problem: Problem, model: LinearisedModel, spectral: DualModel, data: Data, fit: Fit
) -> WidthEvidence:
    """Weigh up where the width comes from at the end of a fit.

    ``model`` is the fitted one near there; ``spectral`` is the dual model of the same samples with
    the Gaussian transfer.
    """
    name = spectral.variant.shape.name
    if name not in problem.unknowns.names:
        return WidthEvidence(0.0, 0.0, 0.0, name)
    end = fit.solution.point, fit.linear.eliminated
    steep = np.asarray(spectral.samples.exit_cosines) >= GRAZING_COSINE
    without_grazing = data._replace(weights=np.asarray(data.weights) * steep[:, None])
    physical = problem.unknowns.unpack(fit.solution.point)
    light, shadows = filled_up(spectral.light, spectral.shadows)
    spectral = DualModel(spectral.variant, spectral.samples, light, shadows, spectral.transfer)
    spectrum = LinearisedModel.about(spectral, physical.numbers)
    return WidthEvidence(
        relative_standard_error(name, problem, model, data, *end),
        relative_standard_error(name, problem, model, without_grazing, *end),
        relative_standard_error(name, problem, spectrum, data, *end),
        name,
    )


def relative_standard_error(
    name: str,
    problem: Problem,
    model: LinearisedModel,
    data: Data,
    point: Float[Array, "unknown"],
    eliminated: Float[Array, "linear"],
) -> float:
    """Predict the standard error of a number's logarithm; infinite where the data say nothing."""
    if name not in problem.unknowns.names:
        return 0.0
    at = problem.unknowns.names.index(name)
    information = np.asarray(_information(problem, model, data, point, eliminated))
    if not information[at, at] > 0:
        return float("inf")
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    variance = np.sum(vectors[at] ** 2 / np.maximum(values, np.finfo(float).eps)) / scale[at] ** 2
    # The derivative by the search variable: the chain rule through the bounds' S-shaped curve.
    slope = float(np.asarray(_slopes_of_logarithm(problem, point, name))[at])
    error = float(np.sqrt(variance)) * abs(slope)
    return error if error < _HOPELESS else float("inf")


@eqx.filter_jit
def _slopes_of_logarithm(
    problem: Problem, point: Float[Array, "unknown"], name: str
) -> Float[Array, "unknown"]:
    return jax.grad(lambda x: jnp.log(problem.unknowns.unpack(x).numbers[name]))(point)


@stored(effort="least")
def _information(
    problem: Problem,
    model: LinearisedModel,
    data: Data,
    point: Float[Array, "unknown"],
    eliminated: Float[Array, "linear"],
) -> Float[Array, "all all"]:
    vector, split = jnp.concatenate([point, eliminated]), point.shape[0]

    def weighted(vector: Float[Array, "all"]) -> Float[Array, "residual"]:
        predicted = problem.predict(model, data, vector[:split], problem.linear(vector[split:]))
        return (jnp.asarray(data.weights) * predicted).ravel()

    jacobian = jax.jacfwd(weighted)(vector)
    return jnp.matmul(jacobian.T, jacobian, precision="highest")


def _percent(fraction: float) -> str:
    return "no information" if not np.isfinite(fraction) else f"{100 * fraction:.2g} %"
