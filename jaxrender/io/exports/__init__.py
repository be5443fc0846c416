"""What was recovered, for other programs: one module for each format.

``contents``
    what leaves, and what a written file is
``atlas``
    a texture of vertices as one of texels, on a mesh that gets texture coordinates
``mitsuba`` ``mitsuba_materials``
    a scene of Mitsuba 3, its materials, and RGL's tables for all that Mitsuba lacks
``mitsuba_textures`` ``texel_frames``
    textures as bitmaps over tables; the frames that maps of normals are relative to
``gltf`` ``gltf_material``
    glTF 2.0 and GLB, and what they hold of a material, as a BRDF
``anisotropy``
    brushed surfaces: widths, tangents, and what Mitsuba makes of them
``environments`` ``ktx`` ``harmonics``
    the light alone, as pictures, as one texture, and as coefficients
``materialx``
    OpenPBR's material, and glTF's, as MaterialX has them
``usd``
    a stage of USD with UsdPreviewSurface
``blend`` ``blender`` ``blender_scene``
    a scene of Blender; Blender as another process, and the script that it runs
``blender_surfaces`` ``blender_material``
    materials as shader nodes, and what Blender makes of a Principled BSDF

Each writer says by ``..._losses`` what its format cannot hold, before anything is written.
"""

from jaxrender.io.exports.anisotropy import Brushed, SeparatelyMasked
from jaxrender.io.exports.atlas import Atlas
from jaxrender.io.exports.blend import blend_losses, write_blend
from jaxrender.io.exports.blender import blender_command, run_in_blender
from jaxrender.io.exports.blender_material import BlenderMaterial
from jaxrender.io.exports.blender_surfaces import (
    own_surface,
    own_textured,
    principled,
    principled_losses,
    with_normals,
)
from jaxrender.io.exports.contents import (
    Contents,
    MaterialMaps,
    MetallicMaps,
    Part,
    mesh_of,
    plain_name,
)
from jaxrender.io.exports.environments import (
    cube_faces,
    environment_losses,
    write_environment_pictures,
)
from jaxrender.io.exports.gltf import (
    GltfTextures,
    facing_panorama,
    gltf_losses,
    srgb,
    write_gltf,
)
from jaxrender.io.exports.gltf_material import GltfMaterial
from jaxrender.io.exports.harmonics import write_harmonics
from jaxrender.io.exports.materialx import materialx_library, openpbr_losses, write_materialx
from jaxrender.io.exports.mitsuba import mitsuba_losses, mitsuba_panorama, write_mitsuba
from jaxrender.io.exports.mitsuba_textures import spread_over_faces, table_widths
from jaxrender.io.exports.usd import usd_library, usd_losses, write_usd

__all__ = [
    "Atlas",
    "BlenderMaterial",
    "Brushed",
    "SeparatelyMasked",
    "Contents",
    "GltfMaterial",
    "GltfTextures",
    "MaterialMaps",
    "MetallicMaps",
    "Part",
    "blend_losses",
    "blender_command",
    "cube_faces",
    "environment_losses",
    "facing_panorama",
    "gltf_losses",
    "materialx_library",
    "mesh_of",
    "mitsuba_losses",
    "mitsuba_panorama",
    "openpbr_losses",
    "own_surface",
    "own_textured",
    "plain_name",
    "principled",
    "principled_losses",
    "run_in_blender",
    "spread_over_faces",
    "srgb",
    "table_widths",
    "usd_library",
    "usd_losses",
    "with_normals",
    "write_blend",
    "write_environment_pictures",
    "write_gltf",
    "write_harmonics",
    "write_materialx",
    "write_mitsuba",
    "write_usd",
]
