"""Spherical harmonic reflection maps: any light and any isotropic BRDF in real time (T 5).

``maps``
    the local and the global map: texels that are functions of the viewer
``prefilter``
    light and BRDF to a map in three steps, and the slow twin
``explicit``
    to and from twelve reflection maps, a three-dimensional texture, the whole light field
``principal``
    the map in its own best basis
``photographs``
    a map from photographs of a sphere
``columns``
    the same theory as a forward model for fits
"""

from jaxrender.reflection.shrm.columns import (
    ViewFilter,
    mirror_coefficients_of,
    mirror_light,
    reflect_mirror_light,
    specular_spectrum,
)
from jaxrender.reflection.shrm.explicit import (
    AzimuthalTexture,
    IcosahedralMaps,
    LightFieldTable,
    ViewerRule,
    blending_shares,
    icosahedron_vertices,
)
from jaxrender.reflection.shrm.maps import GlobalShrm, LocalShrm, Shrm, exit_cosine, least_rows
from jaxrender.reflection.shrm.photographs import SphereFit, ViewerGoal, shrm_from_photographs
from jaxrender.reflection.shrm.prefilter import (
    central_coefficients,
    global_shrm,
    local_from_global,
    local_shrm,
)
from jaxrender.reflection.shrm.principal import PrincipalMaps, principal_maps

__all__ = [
    "AzimuthalTexture",
    "GlobalShrm",
    "IcosahedralMaps",
    "LightFieldTable",
    "LocalShrm",
    "PrincipalMaps",
    "Shrm",
    "SphereFit",
    "ViewFilter",
    "ViewerGoal",
    "ViewerRule",
    "blending_shares",
    "central_coefficients",
    "exit_cosine",
    "global_shrm",
    "icosahedron_vertices",
    "least_rows",
    "local_from_global",
    "local_shrm",
    "mirror_coefficients_of",
    "mirror_light",
    "principal_maps",
    "reflect_mirror_light",
    "shrm_from_photographs",
    "specular_spectrum",
]
