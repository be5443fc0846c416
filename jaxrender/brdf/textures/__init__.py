"""Textures whose texels are BRDFs, and bump maps, filtered before they are looked at (L 7).

``texture``
    texels that name coefficient trees
``mip``
    where a place of a texture lies in the levels of a pyramid; colours, filtered as usual
``pyramid``
    trees filtered alike: averages of trees, or measured level by level
``bump``
    a BRDF under a perturbed normal; a map of normals as a texture
"""

from jaxrender.brdf.textures.bump import (
    QuantisedNormals,
    Tilted,
    bump_texture,
    normals_of_heights,
    normals_of_perturbations,
    quantised,
)
from jaxrender.brdf.textures.mip import ColourPyramid, MipShape, level_of
from jaxrender.brdf.textures.pyramid import BRDFPyramid
from jaxrender.brdf.textures.texture import BRDFTexture, tree_of

__all__ = [
    "BRDFPyramid",
    "BRDFTexture",
    "ColourPyramid",
    "MipShape",
    "QuantisedNormals",
    "Tilted",
    "bump_texture",
    "level_of",
    "normals_of_heights",
    "normals_of_perturbations",
    "quantised",
    "tree_of",
]
