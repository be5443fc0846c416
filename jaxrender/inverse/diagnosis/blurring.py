"""What a blur does to a photograph, by places around each pixel.

A blur of some variance, in pixels squared, is a mean over places with a Gaussian's weights: over
those of its quadrature by three places along rows and along columns, and by five where it is wide.
Places are at least a pixel apart, as pixels are.
"""

import numpy as np
from numpy.polynomial.hermite_e import hermegauss

from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse.diagnosis.grounds import Grounds, same_part
from jaxrender.inverse.diagnosis.turning import lobes_under
from jaxrender.inverse.nuisances import Softening
from jaxrender.inverse.rays import Rays
from jaxrender.shapes import Float

# Blurs of a larger variance take five places.
_WIDE = 0.3
# Places that count less than this are left out.
_LEAST_WEIGHT = 1e-6
# Rays of a photograph are linear in row and column, if so many tell how.
_FEWEST = 6


def softening(grounds: Grounds, variance: float = 0.0) -> Softening | None:
    """Say what a blur of some variance adds; None where nobody knows of pixels or places.

    Of photographs with a few samples alone nobody knows how far pixels are apart.
    """
    if not grounds.placed or grounds.observations.pixel is None:
        return None
    assert grounds.shape is not None
    steps = _pixel_steps(grounds)
    known = np.any(steps, axis=(0, 2))
    if not known.any():
        return None
    before = grounds.rays.meet(grounds.shape)
    added, same = np.zeros_like(grounds.predicted), before.hit & known
    places = _places(variance)
    centre = -sum(weight for *_, weight in places) * _seen(grounds, grounds.samples)
    for row, column, weight in places:
        rays = _stepped(grounds.rays, row * steps[0] + column * steps[1])
        hits = rays.meet(grounds.shape)
        beside = same_part(before, hits)
        # Normals may have been mended since they were traced: what counts is how they change.
        change = np.where(beside[:, None], hits.normals - before.normals, 0)
        normals = grounds.normals + change
        turned = SurfaceSamples(
            normals / np.linalg.norm(normals, axis=1, keepdims=True),
            np.where(beside[:, None], -rays.directions, grounds.outgoing),
        )
        added = added + weight * _seen(grounds, turned)
        same = same & beside
    return Softening(np.where(same[:, None], added + centre, 0.0), same)


def _places(variance: float) -> list[tuple[float, float, float]]:
    """List places around a pixel: row, column, weight per variance."""
    variance = max(variance, _LEAST_WEIGHT)
    if variance > _WIDE:
        at, weights = hermegauss(5)
        at, weights = np.sqrt(variance) * at, weights / weights.sum()
    else:
        far = max(1.0, float(np.sqrt(3 * variance)))
        part = variance / (2 * far**2)
        at, weights = far * np.array([-1.0, 0.0, 1.0]), np.array([part, 1 - 2 * part, part])
    return [
        (row, column, by_row * by_column / variance)
        for row, by_row in zip(at, weights)
        for column, by_column in zip(at, weights)
        if (row or column) and by_row * by_column / variance > _LEAST_WEIGHT
    ]


def _seen(grounds: Grounds, samples: SurfaceSamples) -> Float[np.ndarray, "sample channel"]:
    """Evaluate the material as other pixels see it, under the whole light."""
    amplitudes = np.stack([np.asarray(part, float) for part in grounds.material.amplitudes])
    found = np.zeros_like(grounds.predicted)
    for nodes, seen in grounds.whole:
        lobes = np.asarray(lobes_under(grounds.material, samples, nodes, seen))
        found = found + np.einsum("slc,lc->sc", lobes, amplitudes)
    return grounds.gain * found


def _pixel_steps(grounds: Grounds) -> Float[np.ndarray, "axis sample 6"]:
    """Say how rays change from row to row and from column to column: origins, then directions.

    Zero where too few samples tell.
    """
    pixel, every = np.asarray(grounds.observations.pixel, float), _flat(grounds.rays)
    steps = np.zeros((2, *every.shape))
    for frame in np.unique(grounds.frame):
        own = np.flatnonzero(grounds.frame == frame)
        centred = pixel[own] - pixel[own].mean(axis=0)
        if len(own) >= _FEWEST and np.linalg.matrix_rank(centred) == 2:
            slopes = np.linalg.lstsq(centred, every[own] - every[own].mean(axis=0), rcond=None)[0]
            steps[:, own] = slopes[:, None]
    return steps


def _stepped(rays: Rays, by: Float[np.ndarray, "sample 6"]) -> Rays:
    """Move rays by a step of origins and directions."""
    origins, directions = np.split(_flat(rays) + by, 2, axis=1)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return rays._replace(origins=origins, directions=directions)


def _flat(rays: Rays) -> Float[np.ndarray, "sample 6"]:
    return np.concatenate([rays.origins, rays.directions], axis=1)
