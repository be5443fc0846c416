"""Usable pixels as measurements of radiance, with what is known of where they lie, and subsets."""

from typing import NamedTuple

import numpy as np

from jaxrender.geometry import SurfacePlaces, SurfaceSamples
from jaxrender.shapes import AnyArray, Float, Int, checked

_EXIT_COSINE_STRATA = 10
_BRIGHTNESS_STRATA = 4


class Observations(NamedTuple):
    """Radiance of samples of a surface, and which photograph each is from.

    Shadows of a concave shape are traced from ``places``; ``transfer`` are the vectors of T 6.10
    there, where they are known already.  ``stands_for`` tells how many pixels each sample of a
    draw stands for; None: one each.  ``pixel`` is the row and column of each in its photograph,
    and ``eyes`` are where the photographs' cameras stand, where that is known.  ``rounding`` is the
    standard deviation that the rounding of stored values adds, the least floor of the noise.
    """

    samples: SurfaceSamples
    radiance: Float[AnyArray, "sample channel"]
    frame: Int[AnyArray, "sample"]
    places: SurfacePlaces | None = None
    transfer: Float[AnyArray, "sample coefficient"] | None = None
    stands_for: Float[AnyArray, "sample"] | None = None
    pixel: Int[AnyArray, "sample 2"] | None = None
    eyes: Float[AnyArray, "frame 3"] | None = None
    rounding: float = 0.0

    @checked
    def take(self, index: Int[np.ndarray, "kept"]) -> "Observations":
        """Keep the samples of the given indices."""
        samples = SurfaceSamples(*(np.asarray(a)[index] for a in self.samples))
        radiance, frame = np.asarray(self.radiance)[index], np.asarray(self.frame)[index]
        places, transfer = self.places, self.transfer
        if places is not None:
            places = SurfacePlaces(*(np.asarray(a)[index] for a in places))
        if transfer is not None:
            transfer = np.asarray(transfer)[index]
        stands_for = self.stands_for
        if stands_for is not None:
            stands_for = np.asarray(stands_for)[index]
        pixel = None if self.pixel is None else np.asarray(self.pixel)[index]
        return Observations(
            samples, radiance, frame, places, transfer, stands_for, pixel, self.eyes, self.rounding
        )

    @property
    def pixels(self) -> Float[np.ndarray, "sample"]:
        """How many pixels each sample stands for."""
        return np.ones(self.count) if self.stands_for is None else np.asarray(self.stands_for)

    @property
    def shares(self) -> Float[np.ndarray, "sample"]:
        """The same relative to their mean: what the square of a sample's weight is times."""
        return self.pixels / np.mean(self.pixels) if self.count else self.pixels

    @property
    def frames(self) -> int:
        """The number of photographs: those whose cameras are known, or up to the last sample's."""
        if self.eyes is not None:
            return len(self.eyes)
        return int(np.max(np.asarray(self.frame), initial=-1)) + 1

    @property
    def count(self) -> int:
        """The number of samples."""
        return self.radiance.shape[0]


def as_pixels(observations: Observations) -> Int[np.ndarray, "sample"]:
    """List samples as often as they stand for pixels: as many in all, an even picture of all
    pixels.

    What is no sum over samples, such as a median, is taken of these.
    """
    if observations.stands_for is None:
        return np.arange(observations.count)
    passed = np.floor(np.cumsum(observations.shares) + 0.5).astype(int)
    return np.repeat(np.arange(observations.count), np.diff(passed, prepend=0))


def random_subset(observations: Observations, count: int, seed: int) -> Observations:
    """Draw at most ``count`` samples, every one as likely as any other (as T 6.4.2 does)."""
    if observations.count <= count:
        return observations
    chosen = np.random.default_rng(seed).choice(observations.count, count, replace=False)
    return observations.take(np.sort(chosen))


def stratified_subset(
    observations: Observations, predicted: Float[AnyArray, "sample channel"], count: int, seed: int
) -> tuple[Observations, Float[np.ndarray, "kept channel"]]:
    """Draw at most ``count`` samples spread evenly over exit cosine, and over brightness within it.

    Grazing views and highlights, which say most about sigma and mu, are few among the pixels; so
    they are drawn as often as the rest.  Brightness is that of a model's prediction: choosing by
    the measurement would choose its noise, and bias the fit.  Returned along with the samples.
    """
    if observations.count <= count:
        return observations, np.asarray(predicted)
    cosines = np.asarray(observations.samples.exit_cosines)
    intensity = np.asarray(predicted).mean(axis=1)
    rng = np.random.default_rng(seed)
    stratum = _ranks(cosines, _EXIT_COSINE_STRATA)
    for level in range(_EXIT_COSINE_STRATA):
        inside = np.flatnonzero(stratum == level)
        stratum[inside] += _EXIT_COSINE_STRATA * _brightness_strata(intensity[inside])
    # Visit the strata in turn, each in random order, until there are enough.
    order = rng.permutation(observations.count)
    turn = np.empty(observations.count, int)
    for level in np.unique(stratum):
        inside = order[stratum[order] == level]
        turn[inside] = np.arange(len(inside))
    chosen = np.sort(np.lexsort((rng.random(observations.count), turn))[:count])
    return observations.take(chosen), np.asarray(predicted)[chosen]


def _ranks(values: Float[np.ndarray, "sample"], strata: int) -> Int[np.ndarray, "sample"]:
    """Number equally populated strata of ascending values."""
    ranks = np.argsort(np.argsort(values, kind="stable"), kind="stable")
    return ranks * strata // max(len(values), 1)


def _brightness_strata(intensity: Float[np.ndarray, "sample"]) -> Int[np.ndarray, "sample"]:
    """Number strata by equal steps of brightness, so that highlights make up one of their own."""
    low, high = intensity.min(), intensity.max()
    if high <= low:
        return np.zeros(len(intensity), int)
    level = (intensity - low) / (high - low) * _BRIGHTNESS_STRATA
    return np.minimum(level.astype(int), _BRIGHTNESS_STRATA - 1)
