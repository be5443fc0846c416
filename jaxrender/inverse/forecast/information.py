"""Fisher information of photographs about a material, a few numbers for each photograph.

To first order in kd, ks and the numbers of the lobe, each sample combines a few columns a channel.
They are D, S, and the derivatives of S by each number.  Their weighted inner products G_fc over the
samples of photograph f hold all of its information, whatever the number of samples.  They add up
over photographs:

I = sum_fc T_c' G_fc T_c,    T_c = d(kd_c, ks_c, ks_c number, ...) / d(unknowns)

So hundreds of candidate photographs are compared at once.  The inverse of I is the Cramer-Rao bound
of the covariance.  An unknown exposure of a photograph is projected off.  The twin, from all
samples, is ``inverse.uncertainty``.
"""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.forecast.situation import Foreseen, unknowns_at
from jaxrender.inverse.parameters import to_parameters
from jaxrender.inverse.uncertainty import prior_information
from jaxrender.programs import stored
from jaxrender.shapes import Array, Float


class Errors(NamedTuple):
    """Cramer-Rao bounds of relative errors by name, and log det I.

    Those of mu are relative to mu - 1, those of kd and ks of the worst channel.
    """

    relative: dict[str, Float[np.ndarray, "*candidate"]]
    log_determinant: Float[np.ndarray, "*candidate"]

    def criterion(self, aim: str) -> Float[np.ndarray, "*candidate"]:
        """The relative standard error of the parameter named, or that of the worst."""
        if aim == "worst":
            return np.asarray(np.max(np.stack(list(self.relative.values())), axis=0))
        return self.relative[aim]


class Reading(NamedTuple):
    """Turns information about columns into information about the unknowns of a material.

    ``unit`` is the step of each unknown that changes its parameter (``unknowns``) by that
    parameter's size above its origin.
    """

    by_unknown: Float[np.ndarray, "channel column unknown"]
    relative: Float[np.ndarray, "parameter unknown"]
    names: tuple[str, ...]
    amplitudes: Float[np.ndarray, "channel column"]
    prior: Float[np.ndarray, "unknown"]
    free_gains: bool
    unknowns: tuple[str, ...]
    unit: Float[np.ndarray, "unknown"]

    def information(
        self, grams: Float[np.ndarray, "*candidate frame channel column column"]
    ) -> Float[np.ndarray, "*candidate unknown unknown"]:
        """Add up the information of photographs, the first of them of known exposure."""
        half = np.einsum("...fcab,cbu->...fcau", grams, self.by_unknown)
        total = np.einsum("cau,...fcav->...uv", self.by_unknown, half)
        if self.free_gains:
            # The column of a photograph's gain is what the photograph shows.
            across = np.einsum("ca,...fcau->...fu", self.amplitudes, half)
            own = np.einsum("ca,...fcab,cb->...f", self.amplitudes, grams, self.amplitudes)
            across = across / np.sqrt(np.maximum(own, np.finfo(float).tiny))[..., None]
            total = total - np.einsum("...fu,...fv->...uv", across[..., 1:, :], across[..., 1:, :])
        return total

    def errors(self, information: Float[np.ndarray, "*candidate unknown unknown"]) -> Errors:
        """Invert the information, with a prior that counts only where there is none."""
        information = information + np.diag(self.prior)
        diagonal = np.diagonal(information, axis1=-2, axis2=-1)
        scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1))
        scaled = information * scale[..., :, None] * scale[..., None, :]
        values, vectors = np.linalg.eigh(scaled)
        values = np.maximum(values, np.finfo(float).eps * len(self.prior))
        spread = np.einsum("pu,...u,...uv->...pv", self.relative, scale, vectors)
        variances = np.sum(spread**2 / values[..., None, :], axis=-1)
        errors = {
            name: np.asarray(np.sqrt(np.max(variances[..., self._rows(name)], axis=-1)))
            for name in dict.fromkeys(self.names)
        }
        determinant = np.sum(np.log(values), axis=-1) - 2 * np.sum(np.log(scale), axis=-1)
        return Errors(errors, np.asarray(determinant))

    def _rows(self, name: str) -> list[int]:
        return [row for row, own in enumerate(self.names) if own == name]


def reading_of(problem: Problem, foreseen: Foreseen) -> Reading:
    """Prepare to compare photographs of a supposed material, without what is held at a bound."""
    brdf = foreseen.supposed.brdf
    unknowns = problem.unknowns
    # With known gains; those that are not are projected off photograph by photograph.
    known = replace(unknowns, free_gains=0)
    problem = Problem(known, problem.mix, problem.offset, problem.lower, problem.upper)
    point, eliminated = unknowns_at(problem, brdf)
    vector = jnp.asarray(np.concatenate([point, eliminated]))

    first, slopes, value, spread, prior = (np.array(part) for part in _slopes(problem, vector))
    at_bound = (eliminated <= np.asarray(problem.lower)) | (eliminated >= np.asarray(problem.upper))
    held = np.concatenate([known.at_bound(jnp.asarray(point)), at_bound])
    channels, lobes = len(slopes), len(known.amplitudes)
    numbers = [one.name for one in known.searched]
    names = [*np.repeat(known.amplitude_names, channels).tolist(), *numbers]
    value -= [known.origins.get(name, 0.0) for name in names]
    asked = np.any((spread != 0) & ~held[None], axis=1) & (value != 0)
    first[:, lobes:] = 0
    stands_for = np.array([*known.names, *_linear_names(problem)])
    steps = [
        value[names.index(name)] / spread[names.index(name), at]
        for at, name in enumerate(known.names)
    ]
    unit = np.concatenate([np.array(steps, float), eliminated])
    return Reading(
        slopes[..., ~held],
        spread[asked][:, ~held] / value[asked, None],
        tuple(name for name, kept in zip(names, asked) if kept),
        first,
        prior[~held],
        unknowns.free_gains > 0,
        tuple(map(str, stands_for[~held])),
        unit[~held],
    )


def _linear_names(problem: Problem) -> list[str]:
    """Name what each eliminated unknown multiplies: an amplitude, or all that is fixed of them."""
    known = problem.unknowns
    by_lobe = np.split(np.asarray(problem.mix) != 0, len(known.amplitudes))
    each = np.stack([lobe.any(axis=0) for lobe in by_lobe], axis=1)
    single = [np.flatnonzero(touched) for touched in each]
    return [known.amplitude_names[at[0]] if len(at) == 1 else "scale" for at in single]


@stored(effort="least")
def _slopes(problem: Problem, vector: Float[Array, "unknown"]) -> tuple:
    """Evaluate amplitudes and parameters at a point, each with its derivatives, and the prior."""
    known = problem.unknowns
    searched = len(known.names)

    def amplitudes(vector: Float[Array, "unknown"]) -> Float[Array, "channel column"]:
        numbers = known.unpack(vector[:searched]).numbers
        linear = problem.linear(vector[searched:])
        held = [jax.lax.stop_gradient(linear.amplitudes[at]) for at in known.shaped]
        by_number = [amount * numbers[one.name] for one in known.searched for amount in held]
        return jnp.stack([*linear.amplitudes, *by_number], axis=-1)

    def parameters(vector: Float[Array, "unknown"]) -> Float[Array, "parameter"]:
        found = to_parameters(problem, vector[:searched], vector[searched:])
        numbers = [found.numbers[one.name][None] for one in known.searched]
        return jnp.concatenate([*found.in_order(known.amplitude_names), *numbers])

    return (
        amplitudes(vector),
        jax.jacfwd(amplitudes)(vector),
        parameters(vector),
        jax.jacfwd(parameters)(vector),
        prior_information(problem, vector),
    )


def frame_grams(foreseen: Foreseen) -> Float[np.ndarray, "frame channel column column"]:
    """Add up the inner products of the columns over the samples of each photograph."""
    columns, data = columns_of(foreseen), foreseen.data
    return grams_by_frame(columns * np.asarray(data.weights)[..., None], np.asarray(data.frame))


def columns_of(foreseen: Foreseen) -> Float[np.ndarray, "sample channel column"]:
    """Lay out D, S, and the derivatives of S by each number of the supposed material."""
    gathered = foreseen.model.gathered(foreseen.supposed.brdf.numbers)
    return np.stack([np.asarray(column) for column in gathered], axis=-1)


def grams_by_frame(
    weighted: Float[np.ndarray, "*candidate sample channel column"], frame: np.ndarray
) -> Float[np.ndarray, "*candidate frame channel column column"]:
    """Add up the inner products of weighted columns, of several candidates at once."""
    of_frame = [weighted[..., frame == number, :, :] for number in range(int(frame.max()) + 1)]
    products = [np.einsum("...sca,...scb->...cab", part, part) for part in of_frame]
    return np.stack(products, axis=-4)
