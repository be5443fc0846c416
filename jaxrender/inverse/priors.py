"""What is known of a material beforehand, laid out as the unknowns of a search are."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.stated import Prior, Unknown
from jaxrender.inverse.unknowns import Physical, Unknowns
from jaxrender.shapes import AnyArray, Array, Float


class Priors(eqx.Module):
    """Normal distributions of numbers (``names``) and of eliminated unknowns.

    ``precisions`` are 1 / standard deviation, of an eliminated unknown without a prior 0.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    means: Float[AnyArray, "number"]
    precisions: Float[AnyArray, "number"]
    linear_means: Float[AnyArray, "linear"]
    linear_precisions: Float[AnyArray, "linear"]

    def left(
        self, physical: Physical, eliminated: Float[Array, "linear"]
    ) -> Float[Array, "residual"]:
        """How far values are from their means, in standard deviations."""
        numbers = jnp.asarray([physical.numbers[name] for name in self.names], eliminated.dtype)
        return jnp.concatenate(
            [
                (numbers - self.means) * self.precisions,
                (eliminated - self.linear_means) * self.linear_precisions,
            ]
        )

    def information(self, unknowns: Unknowns, vector: Float[Array, "all"]) -> Float[Array, "all"]:
        """What they tell about each search variable, and each eliminated unknown, at a point."""
        searched = len(unknowns.names)

        def left(vector: Float[Array, "all"]) -> Float[Array, "residual"]:
            return self.left(unknowns.unpack(vector[:searched]), vector[searched:])

        # Each of them depends on one unknown alone.
        return jnp.sum(jax.jacfwd(left)(vector) ** 2, axis=0)

    def held_at(self, numbers: "Priors") -> "Priors":
        """Add normal distributions of numbers; of one that has two the product counts."""
        own = dict(zip(self.names, zip(self.means, self.precisions)))
        for name, mean, precision in zip(numbers.names, numbers.means, numbers.precisions):
            before, known = own.get(name, (mean, 0.0))
            both = known**2 + precision**2
            middle = known**2 * before + precision**2 * mean
            centre = jnp.where(both > 0, middle / jnp.where(both > 0, both, 1), mean)
            own[name] = centre, jnp.sqrt(both)
        means, precisions = (jnp.stack(list(map(jnp.asarray, part))) for part in zip(*own.values()))
        return dataclasses.replace(self, names=tuple(own), means=means, precisions=precisions)

    def times(self, factor: Float[Array, ""]) -> "Priors":
        """Count for more, or less, as data do whose weights are scaled."""
        own, linear = self.precisions * factor, self.linear_precisions * factor
        return Priors(self.names, self.means, own, self.linear_means, linear)


def priors_of(unknowns: Unknowns, linear: list[Unknown], dtype: type) -> Priors | None:
    """Line up what is known beforehand; None where nothing is."""
    names = tuple(unknowns.free_numbers)
    own, amounts = [unknowns[name].prior for name in names], [one.prior for one in linear]
    if not any((*own, *amounts)):
        return None
    # One without a prior has one of no precision: which have, is no reason to compile anew.
    anything = Prior(0.0, float("inf"))
    (means, deviations), (linear_means, spreads) = (
        np.array([prior or anything for prior in priors] or np.zeros((0, 2)), dtype).T
        for priors in (own, amounts)
    )
    return Priors(names, means, 1 / deviations, linear_means, 1 / spreads)
