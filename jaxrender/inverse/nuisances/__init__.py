"""What may be a little wrong with a capture, as numbers that a fit can free.

``corrections`` holds the numbers and applies them to samples and light, ``nuisances`` says of each
what it is, in which unit a person knows it and how well it is known beforehand.  ``sources`` says
which sources turn together, ``bumps`` how a smooth displacement turns normals.
"""

from jaxrender.inverse.nuisances.bumps import BUMPS, bumps
from jaxrender.inverse.nuisances.corrections import Corrections, Softening, Told, rotation
from jaxrender.inverse.nuisances.nuisances import NUISANCES, Nuisance
from jaxrender.inverse.nuisances.sources import source_groups

__all__ = [
    "BUMPS",
    "NUISANCES",
    "Corrections",
    "Nuisance",
    "Softening",
    "Told",
    "bumps",
    "rotation",
    "source_groups",
]
