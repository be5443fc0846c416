"""What a blur does to a photograph, to first order, by the four neighbours of each pixel.

A blur of standard deviation w, in pixels, adds w^2 / 2 times the Laplacian of the photograph.
"""

from collections.abc import Iterator

import numpy as np

from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse.diagnosis.grounds import Grounds, same_part
from jaxrender.inverse.diagnosis.turning import lobes_under
from jaxrender.inverse.rays import Rays
from jaxrender.shapes import Float

# Rays of a photograph are linear in row and column, if so many tell how.
_FEWEST = 6


def laplacian(grounds: Grounds) -> Float[np.ndarray, "sample channel"] | None:
    """Sum up the four neighbours of each pixel, less four times the pixel; per pixel squared.

    A pixel beside the rim of the object, or of a part of it, counts as smooth.  None where nobody
    knows of pixels or places.
    """
    if not grounds.placed or grounds.observations.pixel is None:
        return None
    assert grounds.shape is not None
    before = grounds.rays.meet(grounds.shape)
    whole, same = -4 * _seen(grounds, grounds.samples), before.hit
    for rays in _neighbours(grounds):
        hits = rays.meet(grounds.shape)
        beside = same_part(before, hits)
        # Normals may have been mended since they were traced: what counts is how they change.
        change = np.where(beside[:, None], hits.normals - before.normals, 0)
        normals = grounds.normals + change
        turned = SurfaceSamples(
            normals / np.linalg.norm(normals, axis=1, keepdims=True),
            np.where(beside[:, None], -rays.directions, grounds.outgoing),
        )
        whole = whole + _seen(grounds, turned)
        same = same & beside
    return np.where(same[:, None], whole, 0.0)


def _seen(grounds: Grounds, samples: SurfaceSamples) -> Float[np.ndarray, "sample channel"]:
    """Evaluate the material as other pixels see it, under the whole light."""
    amplitudes = np.stack([np.asarray(part, float) for part in grounds.material.amplitudes])
    found = np.zeros_like(grounds.predicted)
    for nodes, seen in grounds.whole:
        lobes = np.asarray(lobes_under(grounds.material, samples, nodes, seen))
        found = found + np.einsum("slc,lc->sc", lobes, amplitudes)
    return grounds.gain * found


def _neighbours(grounds: Grounds) -> Iterator[Rays]:
    """Move the rays by a pixel up, down, left and right."""
    rays, pixel = grounds.rays, np.asarray(grounds.observations.pixel, float)
    both = np.concatenate([rays.origins, rays.directions], axis=1)
    steps = np.zeros((2, *both.shape))
    for frame in np.unique(grounds.frame):
        own = np.flatnonzero(grounds.frame == frame)
        centred = pixel[own] - pixel[own].mean(axis=0)
        if len(own) >= _FEWEST and np.linalg.matrix_rank(centred) == 2:
            slopes = np.linalg.lstsq(centred, both[own] - both[own].mean(axis=0), rcond=None)[0]
            steps[:, own] = slopes[:, None]
    for step in (*steps, *-steps):
        origins, directions = np.split(both + step, 2, axis=1)
        directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        yield rays._replace(origins=origins, directions=directions)
