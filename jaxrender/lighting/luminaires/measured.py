"""Luminaires measured in a simulation, by following rays inwards from their boundary (L 5.4).

Any tracer will do: it is asked for the radiance seen from origins along unit directions, and what
is seen from x' along -w is what leaves there along w.  Samples are at the centres of size^4 cells
of (u, v, kappa, lambda).  Cells of (kappa, lambda) whose centre is no direction take the value of
the nearest one that is, so that grazing light is not mixed with darkness, and so that the wavelets
do not have to represent the edge of the disc.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.ndimage import distance_transform_edt

from jaxrender.geometry import NUSSELT
from jaxrender.lighting.luminaires.luminaire import Luminaire
from jaxrender.lighting.luminaires.surfaces import EmittingSurface
from jaxrender.shapes import AnyArray, Float
from jaxrender.wavelets.filters import Wavelet, haar
from jaxrender.wavelets.importance import most_important
from jaxrender.wavelets.transform import analyse_nonstandard
from jaxrender.wavelets.tree import CoefficientTree

Tracer = Callable[
    [Float[np.ndarray, "ray 3"], Float[np.ndarray, "ray 3"]], Float[AnyArray, "ray channel"]
]
Samples = Float[AnyArray, "u v kappa lambda channel"]

# Rays traced at once.
_RAYS_AT_ONCE = 1 << 18
# 64^4 samples of three channels in single precision are 200 MB.
_LARGEST = 64


def measure_light_field(
    tracer: Tracer, surface: EmittingSurface, size: int
) -> Float[np.ndarray, "u v kappa lambda channel"]:
    """Sample the radiance that leaves a surface, in single precision.

    Raises ``ValueError`` for a size that is no power of two or above 64, before a ray is traced,
    and for radiance that is not finite.
    """
    if size < 2 or size & (size - 1) or size > _LARGEST:
        raise ValueError(f"{size} samples along each axis; give a power of two, 2 to {_LARGEST}")
    covered = np.asarray(NUSSELT.covers(NUSSELT.centres((size, size))))
    local = NUSSELT.cell_directions((size, size))[covered]
    places = NUSSELT.centres((size, size)).reshape(-1, 2)
    on = surface.at(places)
    step = max(_RAYS_AT_ONCE // len(local), 1)
    found = []
    for first in range(0, len(places), step):
        part = slice(first, first + step)
        outwards = np.einsum("pij,dj->pdi", on.frames[part], local).reshape(-1, 3)
        origins = np.repeat(on.points[part], len(local), axis=0)
        values = np.asarray(tracer(origins, -outwards), np.float32)
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
            raise ValueError(
                f"the tracer sees {values[row]} from {origins[row]} along {-outwards[row]}; "
                "radiance must be finite"
            )
        found.append(values.reshape(-1, len(local), values.shape[-1]))
    seen = np.concatenate(found)
    samples = np.zeros((len(places), size, size, seen.shape[-1]), np.float32)
    samples[:, covered] = seen
    found = distance_transform_edt(~covered, return_distances=False, return_indices=True)
    row, column = np.asarray(found)
    samples = samples[:, row, column]
    return samples.reshape(size, size, size, size, -1)


def compressed(
    samples: Samples, keep: float = 1.0, wavelet: Wavelet | None = None
) -> CoefficientTree:
    """Make a tree of samples, of this fraction of the coefficients that are not zero.

    Channels share them, ranked by their norm, so that little light loses its colour.  Haar's
    wavelet by default.  Raises ``ValueError`` for a fraction not in (0, 1] and as the tree.
    """
    if not 0 < keep <= 1:
        raise ValueError(f"a fraction of {keep} to keep; give one above 0, at most 1")
    wavelet = haar() if wavelet is None else wavelet
    coefficients = np.asarray(analyse_nonstandard(wavelet, samples))
    tree = CoefficientTree.of_coefficients(wavelet, coefficients)
    if keep == 1:
        return tree
    return most_important(tree, max(round(keep * len(tree.values)), 1))


def measure_luminaire(
    tracer: Tracer,
    patches: Sequence[EmittingSurface],
    size: int = 32,
    *,
    keep: float = 1.0,
    wavelet: Wavelet | None = None,
    convex: bool | None = None,
) -> Luminaire:
    """Measure the light that leaves through all patches, and keep so much of it.

    Raises ``ValueError`` as ``measure_light_field``, ``compressed`` and ``Luminaire``.
    """
    trees = [
        compressed(measure_light_field(tracer, surface, size), keep, wavelet) for surface in patches
    ]
    return Luminaire(patches, trees, convex=convex)
