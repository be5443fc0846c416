"""Reflected radiance from two coefficient trees, light and BRDF, without sampling either (L 6.3).

``overlaps``
    integrals of products of two trees' functions along one axis, exact
``traversal``
    the nested traversal of L fig. 6.1, a pixel at a time: the slow twin
``slices`` ``projections``
    a tree with two of its axes held; the BRDF from a direction over all of the light's functions
``shading``
    many pixels at once
``plane``
    a plane with a BRDF or a texture of BRDFs, as an image
"""

from jaxrender.reflection.wavelet_shading.plane import Plane, PlaneView, shade_plane
from jaxrender.reflection.wavelet_shading.shading import reflected_cells, reflected_radiance
from jaxrender.reflection.wavelet_shading.traversal import Traversed, traverse

__all__ = [
    "Plane",
    "PlaneView",
    "Traversed",
    "reflected_cells",
    "reflected_radiance",
    "shade_plane",
    "traverse",
]
