"""How well nuisances are known, what of it is in a fit's own errors, and what is not told."""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.calibration.equations import Columns, Pull, deviations_of, unit_columns
from jaxrender.inverse.calibration.search import NEAREST
from jaxrender.inverse.clusters import Clusters, widened
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.inverse.observations import Observations
from jaxrender.shapes import Float

# Two nuisances are alike where both together leave less than their priors say, of something that
# one alone would tell so many times as well (variances).
_ALIKE = 100.0


class Calibration(NamedTuple):
    """Corrections of a capture as it was ``told``, found together with a material.

    ``errors`` are the standard errors of what is ``free``.  ``shifts`` are how far the fit's
    parameters move for their sake: the products of its columns sum up to a covariance.
    ``sentences`` say what cannot be told apart or is at a bound.  ``absorbed`` is the part of
    chi-squared above the noise that they do away with.
    """

    told: Told
    corrections: Corrections
    free: tuple[str, ...]
    errors: dict[str, Float[np.ndarray, "number"]]
    shifts: Float[np.ndarray, "parameter nuisance"]
    settled: bool
    sentences: tuple[str, ...]
    absorbed: float = 0.0

    @property
    def light(self) -> KnownLight:
        """The light that was told, corrected."""
        return self.corrections.light(self.told)

    @property
    def observations(self) -> Observations:
        """The samples that were told, corrected."""
        return self.corrections.observations(self.told)


def calibration_of(
    told: Told,
    corrections: Corrections,
    columns: Columns,
    clusters: Clusters,
    settled: bool,
    *,
    found: str = "the material",
    relative: tuple[str, ...] = (),
) -> Calibration:
    """Say how well nuisances are known, and what of that goes into the fit's own errors.

    ``clusters`` are those of the samples that were differentiated.  ``found`` is what the fit finds
    itself, in words.  Of nuisances that are ``relative`` only differences count: what all
    photographs share, what is found makes as well.
    """
    known, each, names = columns
    free = tuple(dict.fromkeys(names.tolist()))
    size = np.linalg.norm(known.jacobian, axis=0)
    jacobian = unit_columns(known.jacobian)
    # How the fit's unknowns answer to each nuisance, and what of the nuisance they cannot make.
    answer = np.linalg.lstsq(jacobian, each, rcond=1e-9)[0]
    own = each - jacobian @ answer
    pull = Pull.of(corrections, *free)
    covariance = np.linalg.inv(own.T @ own + np.diag(pull.weights))
    left = known.left - own @ (covariance @ (own.T @ known.left))
    channels = known.weights.shape[1]
    scores = np.sum((left[:, None] * own).reshape(-1, channels, len(names)), axis=1)
    covariance = widened(covariance, clusters.covariance(scores @ covariance))
    answer = answer / np.where(size > 0, size, 1)[:, None]
    moves = np.stack([known.moved(-by, change) for by, change in zip(answer.T, own.T)], axis=1)
    errors = np.sqrt(np.diag(covariance))
    by_name = {name: errors[names == name] * deviations_of(name, names) for name in free}
    sentences = [*_alike(columns, own, found, relative), *_at_bound(corrections, free)]
    if not settled:
        sentences.append(f"the calibration of {' and '.join(free)} did not settle")
    shifts = moves @ np.linalg.cholesky(covariance)
    return Calibration(told, corrections, free, by_name, shifts, settled, tuple(sentences))


def _alike(
    columns: Columns,
    own: Float[np.ndarray, "value nuisance"],
    of_fit: str,
    relative: tuple[str, ...],
) -> list[str]:
    """Name what cannot be told apart: pairs of nuisances, and a nuisance and the fit's unknowns."""
    found, names = [], columns.names

    def of(name: str, every: Float[np.ndarray, "value nuisance"]) -> Float[np.ndarray, "value own"]:
        some = every[:, names == name]
        return some - some.mean(axis=1, keepdims=True) if name in relative else some

    apart = {name: of(name, own) for name in dict.fromkeys(names.tolist())}
    for at, (name, mine) in enumerate(apart.items()):
        if _lost(of(name, columns.columns), mine):
            found.append(
                f"{name} and {of_fit} cannot be told apart by these photographs alone: the "
                f"prior of {name} decides"
            )
        for other in list(apart)[at + 1 :]:
            theirs = apart[other]
            basis = np.linalg.svd(theirs, full_matrices=False)[0]
            if _lost(mine, mine - basis @ (basis.T @ mine)):
                found.append(
                    f"{name} and {other} cannot be told apart by these photographs: their priors "
                    "divide what both could be; free one of them, or know one better"
                )
    return found


def _lost(
    alone: Float[np.ndarray, "value nuisance"], together: Float[np.ndarray, "value nuisance"]
) -> bool:
    """Whether something is told well alone, and less than by its prior beside something else."""
    values, vectors = np.linalg.eigh(together.T @ together)
    told = np.sum((alone @ vectors) ** 2, axis=0)
    return bool(np.any((values < 1) & (told > _ALIKE)))


def _at_bound(corrections: Corrections, free: tuple[str, ...]) -> list[str]:
    """Say which sources are as far as they can be, or as near, and whether nothing is blurred."""
    found = []
    if "blur" in free and corrections.blur[0] <= 0:
        found.append("blur is at its bound 0: the photographs are as sharp as the model")
    if "nearness" not in free:
        return found
    for number, near in enumerate(corrections.nearness):
        if near <= 0:
            found.append(f"nearness of source {number + 1} is at its bound 0: it is infinitely far")
        elif near >= NEAREST:
            found.append(f"nearness of source {number + 1} is at its bound {NEAREST}")
    return found
