"""Materials as plugins of Mitsuba 3.

``diffuse``
    Lambert's surface
``principled``
    Disney's material without clear coat, and metals of glTF's
``measured``
    all others that are isotropic, as a table in RGL's format beside the scene

Where the definition of a plugin differs from ours, the table is taken.  Mitsuba's rough conductors
have no diffuse base, and its rough plastics scatter below the interface; its clear coat is another.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, Lambertian, MetallicRoughness, Principled, tabulate_rgl
from jaxrender.io.exports.contents import Part
from jaxrender.io.rgl import write_rgl
from jaxrender.shapes import Float

TABLE = "material.bsdf"
_ABOUT_TABLE = (
    "the material as a table for Mitsuba's plugin `measured` (RGL's format): BRDF times cosine, "
    "linear RGB, looked up by the direction to the camera first"
)
# What a colour of a plugin may be.
_WHITE = 1.0


class MitsubaMaterial(NamedTuple):
    """A plugin as its dictionary; the table that it reads, if any, was written beside the scene."""

    plugin: dict[str, Any]
    parts: tuple[Part, ...] = ()


def rgb(values: Float[np.ndarray, "3"] | list[float]) -> dict[str, Any]:
    """Make a colour of linear RGB (Mitsuba's `rgb` is linear, with sRGB's primaries)."""
    return {"type": "rgb", "value": [float(one) for one in np.asarray(values)]}


def mitsuba_material(brdf: BRDF, folder: Path) -> MitsubaMaterial:
    """Choose the plugin of an isotropic BRDF of three channels, and write what it reads."""
    plugin = own_plugin(brdf)
    if plugin is not None:
        return MitsubaMaterial(plugin)
    write_rgl(folder / TABLE, tabulate_rgl(brdf, "outgoing"), "exported by jaxrender")
    return MitsubaMaterial({"type": "measured", "filename": TABLE}, (Part(TABLE, _ABOUT_TABLE),))


def own_plugin(brdf: BRDF) -> dict[str, Any] | None:
    """Find a plugin whose definition is that of the BRDF; None where there is none."""
    if isinstance(brdf, Lambertian):
        albedo = np.pi * np.asarray(brdf.kd, float)
        return {"type": "diffuse", "reflectance": rgb(albedo)} if _is_colour(albedo) else None
    if not isinstance(brdf, Principled | MetallicRoughness):
        return None
    color = np.asarray(brdf.base_color, float)
    if not (_is_colour(color) and np.allclose(np.asarray(brdf.interface), 1)):
        return None
    found = {
        "type": "principled",
        "base_color": rgb(color),
        "metallic": float(brdf.metallic),
        "roughness": float(brdf.roughness),
    }
    if isinstance(brdf, MetallicRoughness):
        # Of a dielectric glTF's base is another: it loses what the interface reflects.
        return found if float(brdf.metallic) == 1 else None
    sheen = np.asarray(brdf.sheen, float)
    if np.any(brdf.clearcoat) or np.ptp(sheen) > 0 or sheen[0] > 1:
        return None
    return found | {"specular": float(brdf.specular), "sheen": float(sheen[0])}


def _is_colour(values: Float[np.ndarray, "channel"]) -> bool:
    return bool(values.shape == (3,) and np.all(values >= 0) and np.all(values <= _WHITE))
