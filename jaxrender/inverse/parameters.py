"""The unknowns of a fit in a material's own units, and derivatives by all of them."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.elimination import Data, Linear, Problem
from jaxrender.inverse.models import LinearisedModel
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Float


class Parameters(NamedTuple):
    """A material in its own units: amplitudes per channel, its other numbers, gains, scale.

    Amplitudes and numbers go by their names, whose alphabet is their order in a covariance.
    """

    amplitudes: Mapping[str, Float[AnyArray, "channel"]]
    numbers: Mapping[str, Float[AnyArray, ""]]
    gains: Float[AnyArray, "frame"]
    scale: Float[AnyArray, ""]

    def of(self, name: str) -> Float[AnyArray, "..."]:
        """Find an amplitude or one of the numbers by its name."""
        return {**self.amplitudes, **self.numbers}[name]

    @property
    def kd(self) -> Float[AnyArray, "channel"]:
        """The amplitude of the base; ``KeyError`` where the model has none."""
        return self.amplitudes["kd"]

    @property
    def ks(self) -> Float[AnyArray, "channel"]:
        """The amplitude of the lobe over it; ``KeyError`` where the model has none."""
        return self.amplitudes["ks"]

    @property
    def labels(self) -> list[str]:
        """Name every number, in the order of a covariance: ``kd[0]``, ``sigma``, ``scale``."""

        def named(name: str, value: Float[AnyArray, "..."]) -> list[str]:
            return [f"{name}[{k}]" for k in range(np.size(value))]

        amplitudes = [row for own in sorted(self.amplitudes.items()) for row in named(*own)]
        return [*amplitudes, *sorted(self.numbers), *named("gains", self.gains), "scale"]

    def in_order(self, names: Iterable[str]) -> list[Float[AnyArray, "channel"]]:
        """List the amplitudes in the order of a model's lobes."""
        return [self.amplitudes[name] for name in names]


@eqx.filter_jit
def to_parameters(
    problem: Problem, point: Float[Array, "unknown"], eliminated: Float[Array, "linear"]
) -> Parameters:
    """Put a search point and its linear part into a material's own units, gauge applied.

    With an unknown scale between light and photographs, the amplitudes are those of a material in
    which they add up to one in the mean, unless a fixed one says what the scale is.
    """
    physical = problem.unknowns.unpack(point)
    linear: Linear = problem.linear(eliminated)
    amplitudes = linear.amplitudes
    scale = jnp.ones((), amplitudes.dtype)
    if problem.unknowns.free_scale:
        fixed = not all(unknown.free for unknown in problem.unknowns.amplitudes)
        scale = eliminated[-1] if fixed else jnp.mean(jnp.sum(amplitudes, axis=0))
        amplitudes = amplitudes / scale
    by_name = dict(zip(problem.unknowns.amplitude_names, amplitudes))
    return Parameters(by_name, physical.numbers, physical.gains, scale)


@stored(effort="least")
def slopes_of_parameters(
    problem: Problem, point: Float[Array, "unknown"], eliminated: Float[Array, "linear"]
) -> Float[Array, "parameter all"]:
    """Differentiate the parameters, one after the other, by search variables and linear part."""
    split = point.shape[0]

    def parameters(vector: Float[Array, "all"]) -> Float[Array, "parameter"]:
        found = to_parameters(problem, vector[:split], vector[split:])
        return jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(found)])

    return jax.jacfwd(parameters)(jnp.concatenate([point, eliminated]))


@stored(effort="least")
def weighted_jacobian(
    problem: Problem,
    model: LinearisedModel,
    data: Data,
    point: Float[Array, "unknown"],
    eliminated: Float[Array, "linear"],
) -> Float[Array, "value all"]:
    """Differentiate the weighted prediction by search variables and linear part."""
    split = point.shape[0]

    def weighted(vector: Float[Array, "all"]) -> Float[Array, "value"]:
        predicted = problem.predict(model, data, vector[:split], problem.linear(vector[split:]))
        return (jnp.asarray(data.weights) * predicted).ravel()

    return jax.jacfwd(weighted)(jnp.concatenate([point, eliminated]))
