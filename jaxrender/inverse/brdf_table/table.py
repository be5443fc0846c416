"""A tabulated isotropic BRDF in half-angle coordinates (Rusinkiewicz): means, counts, errors.

t_h is the angle between normal and half vector h, t_d that between h and either direction.  phi_d
is the azimuth of the incoming direction about h: 0 in the plane of h and the normal, on the far
side of h.  A highlight lies along t_h = 0 whatever the view, so cells are narrow there: t_h grows
as the square of its index.  A surface without handedness has the same value at -phi_d; exchanging
the directions adds pi to phi_d.  Each cell keeps the mean coordinates of its samples beside the
mean value.  So a model is evaluated where the value was measured.  Host, float64.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.shapes import AnyArray, Bool, Directions, Float, Int


class BRDFSamples(NamedTuple):
    """Values of a BRDF (1/sr) at pairs of local directions, and the noise of each."""

    incoming: Float[np.ndarray, "sample 3"]
    outgoing: Float[np.ndarray, "sample 3"]
    values: Float[np.ndarray, "sample channel"]
    deviation: Float[np.ndarray, "sample channel"]


class HalfAngleGrid(eqx.Module):
    """Numbers of cells in t_h, t_d and phi_d; hashable, all static.

    ``reciprocal`` lets both orders of a pair of directions share a cell: phi_d up to pi / 2 instead
    of pi.  Raises ``ValueError`` for fewer than one cell.
    """

    half: int = eqx.field(static=True, default=64)
    difference: int = eqx.field(static=True, default=24)
    azimuth: int = eqx.field(static=True, default=18)
    reciprocal: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        if min(self.shape) < 1:
            raise ValueError(f"{self.shape} cells: give one or more along each coordinate")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Cells along t_h, t_d and phi_d."""
        return (self.half, self.difference, self.azimuth)

    def coordinates(self, incoming: Directions, outgoing: Directions) -> Float[np.ndarray, "... 3"]:
        """Compute (t_h, t_d, phi_d), phi_d folded as the symmetries allow."""
        found = half_angle_coordinates(incoming, outgoing)
        found[..., 2] = np.abs(found[..., 2])
        if self.reciprocal:
            found[..., 2] = np.minimum(found[..., 2], np.pi - found[..., 2])
        return found

    def cells(self, coordinates: Float[np.ndarray, "... 3"]) -> tuple[Int[np.ndarray, "..."], ...]:
        """Index the cell of each triple of coordinates."""
        last = np.pi / 2 if self.reciprocal else np.pi
        scaled = (
            np.sqrt(np.maximum(coordinates[..., 0], 0) / (np.pi / 2)),
            coordinates[..., 1] / (np.pi / 2),
            coordinates[..., 2] / last,
        )
        return tuple(
            np.clip((s * size).astype(int), 0, size - 1) for s, size in zip(scaled, self.shape)
        )


class BRDFTable(NamedTuple):
    """By cell: mean value, its standard error, number of samples, and where those were.

    Cells without a sample hold NaN; so do the errors of cells with one, where scatter is the
    only measure of noise.
    """

    grid: HalfAngleGrid
    mean: Float[np.ndarray, "half difference azimuth channel"]
    standard_error: Float[np.ndarray, "half difference azimuth channel"]
    count: Int[np.ndarray, "half difference azimuth"]
    coordinates: Float[np.ndarray, "half difference azimuth 3"]
    covariance: Float[np.ndarray, "half difference azimuth 3 3"]

    @property
    def filled(self) -> Bool[np.ndarray, "half difference azimuth"]:
        """Which cells have been measured."""
        return self.count > 0

    def lookup(
        self, incoming: Float[AnyArray, "pair 3"], outgoing: Float[AnyArray, "pair 3"]
    ) -> Float[np.ndarray, "pair channel"]:
        """Return the mean of the cell of each pair; NaN where nothing was measured."""
        return self.mean[self.grid.cells(self.grid.coordinates(incoming, outgoing))]

    def nodes(
        self,
    ) -> tuple[Float[np.ndarray, "cell node 3"], Float[np.ndarray, "cell node 3"]]:
        """List, for each filled cell, six pairs of directions whose equal average is the cell's.

        Mean plus and minus sqrt(3) standard deviations along the three axes of the samples'
        coordinates: exact for functions that are quadratic in them.
        """
        there = self.filled
        variances, axes = np.linalg.eigh(self.covariance[there])
        steps = np.sqrt(3 * np.maximum(variances, 0))[:, None, :] * axes
        away = np.moveaxis(np.concatenate([steps, -steps], axis=-1), -1, 1)
        return directions_from_half_angles(self.coordinates[there][:, None, :] + away)


def tabulate(samples: BRDFSamples, grid: HalfAngleGrid, from_scatter: bool = False) -> BRDFTable:
    """Average samples cell by cell.

    The standard error is that of the samples' own deviations or, ``from_scatter``, of their
    scatter.  The slope of the BRDF within a cell adds to the scatter.
    """
    coordinates = grid.coordinates(samples.incoming, samples.outgoing)
    flat = np.ravel_multi_index(grid.cells(coordinates), grid.shape)
    size = int(np.prod(grid.shape))
    count = np.bincount(flat, minlength=size)

    def total(columns: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(flat, c, size) for c in columns.T], axis=-1)

    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total(samples.values) / count[:, None]
        where = total(coordinates) / count[:, None]
        off = coordinates - where[flat]
        products = (off[:, :, None] * off[:, None, :]).reshape(-1, 9)
        covariance = total(products) / count[:, None]
        if from_scatter:
            squares = total((samples.values - mean[flat]) ** 2)
            error = np.sqrt(squares / (count - 1)[:, None] / count[:, None])
        else:
            error = np.sqrt(total(samples.deviation**2)) / count[:, None]
    return BRDFTable(
        grid,
        mean.reshape(*grid.shape, -1),
        error.reshape(*grid.shape, -1),
        count.reshape(grid.shape),
        where.reshape(*grid.shape, 3),
        covariance.reshape(*grid.shape, 3, 3),
    )


def half_angle_coordinates(
    incoming: Directions, outgoing: Directions
) -> Float[np.ndarray, "... 3"]:
    """Compute (t_h, t_d, phi_d) of local unit directions, phi_d in (-pi, pi]."""
    incoming, outgoing = np.asarray(incoming, float), np.asarray(outgoing, float)
    half = incoming + outgoing
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    across = np.hypot(half[..., 0], half[..., 1])
    polar = np.arctan2(across, half[..., 2])
    upright = across < 1e-12
    safe = np.where(upright, 1, across)
    # The axes of h's frame: away from the normal in the plane of both, and across that plane.
    cosine = np.where(upright, 1, half[..., 0] / safe)
    sine = np.where(upright, 0, half[..., 1] / safe)
    level = cosine * incoming[..., 0] + sine * incoming[..., 1]
    x = level * half[..., 2] - incoming[..., 2] * across
    y = cosine * incoming[..., 1] - sine * incoming[..., 0]
    z = np.sum(half * incoming, axis=-1)
    difference = np.arctan2(np.hypot(x, y), z)
    return np.stack([polar, difference, np.arctan2(y, x)], axis=-1)


def directions_from_half_angles(
    coordinates: Float[np.ndarray, "... 3"],
) -> tuple[Float[np.ndarray, "... 3"], Float[np.ndarray, "... 3"]]:
    """Return incoming and outgoing directions with these coordinates, h at azimuth 0."""
    polar, difference, azimuth = np.moveaxis(np.asarray(coordinates, float), -1, 0)
    x, y, z = (
        np.sin(difference) * np.cos(azimuth),
        np.sin(difference) * np.sin(azimuth),
        np.cos(difference),
    )
    sine, cosine = np.sin(polar), np.cos(polar)
    incoming = np.stack([cosine * x + sine * z, y, cosine * z - sine * x], axis=-1)
    half = np.stack([sine, np.zeros_like(sine), cosine], axis=-1)
    return incoming, 2 * np.cos(difference)[..., None] * half - incoming
