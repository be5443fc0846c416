"""A BRDF as a tree of wavelet coefficients: the one way in which trees are made (L 4.4).

``compressed``
    a tree over one of the embeddings, with its errors and its energy
``squares``
    over two Nusselt squares: cell means transformed and thresholded
``isotropic``
    over half and difference angles, of a value transform
``energy``
    the white furnace of a tree, and materials scaled until they create no light
``judged_pairs``
    pairs of directions at which a tree is compared with its BRDF
"""

from jaxrender.brdf.compression.compressed import EMBEDDINGS, Compressed, compressed
from jaxrender.brdf.compression.energy import Conserving, Dimmed, Energy, conserving
from jaxrender.brdf.compression.squares import Goal

__all__ = [
    "EMBEDDINGS",
    "Compressed",
    "Conserving",
    "Dimmed",
    "Energy",
    "Goal",
    "compressed",
    "conserving",
]
