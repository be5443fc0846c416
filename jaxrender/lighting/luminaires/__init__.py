"""Luminaires: radiance over the places and directions of a surface, as coefficient trees (L 5).

``surfaces`` ``curved_surfaces`` ``parametric_surface``
    rectangles and boxes; spheres and cylinders; any surface of two parameters
``luminaire``
    what they send out
``measured``
    the same measured by tracing a scene, and compressed
"""

from jaxrender.lighting.luminaires.curved_surfaces import CylinderSurface, SphereSurface
from jaxrender.lighting.luminaires.luminaire import Luminaire
from jaxrender.lighting.luminaires.measured import (
    compressed,
    measure_light_field,
    measure_luminaire,
)
from jaxrender.lighting.luminaires.parametric_surface import BilinearGrid, ParametricSurface
from jaxrender.lighting.luminaires.surfaces import EmittingSurface, Rectangle, box_faces

__all__ = [
    "BilinearGrid",
    "CylinderSurface",
    "EmittingSurface",
    "Luminaire",
    "ParametricSurface",
    "Rectangle",
    "SphereSurface",
    "box_faces",
    "compressed",
    "measure_light_field",
    "measure_luminaire",
]
