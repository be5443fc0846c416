"""Maps of glTF's metal as plugins of Mitsuba 3.

A metal of glTF's is Mitsuba's ``principled`` with textures.  Its dielectric is not: Mitsuba's base
is another.  With P = (1 - w_i . h)^5 and the facets' lobe S it is, for base colour c,

    rho = (1 - F_0) c (1 - P) / pi + (F_0 + (1 - F_0) P) S:

tables for ``measured``, one for each channel of the base, and some widths of S, a place lying
between two of them.  ``blendbsdf`` puts metal over dielectric by metalness.
"""

from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.io.exports.contents import MetallicMaps
from jaxrender.io.exports.mitsuba_textures import (
    MappedLobe,
    Store,
    TexturedPlugin,
    shares,
    table_widths,
)

# Tables leave a little of each place to what is black below them.
_BELOW = 1.01
_BLACK = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.0, 0.0, 0.0]}}


def metallic_plugin(maps: MetallicMaps, folder: Path) -> TexturedPlugin:
    """Write the bitmaps and tables of maps of metal, and the plugin that joins them."""
    store = Store(folder, {}, [])
    lobes = dielectric_lobes(maps)
    brightness = _BELOW * float(sum(one.amount for one in lobes).max())
    found: dict[str, Any] = store.over(_BLACK, lobes, brightness)
    if np.any(maps.metallic):
        found = {
            "type": "blendbsdf",
            "weight": store.texture("metal", maps.metallic[..., None]),
            "bsdf_0": found,
            "bsdf_1": {
                "type": "principled",
                "metallic": 1.0,
                "base_color": store.texture("base_color", maps.base_color),
                "roughness": store.texture("roughness", maps.roughness[..., None]),
            },
        }
    return TexturedPlugin(found, store.columns, tuple(store.parts))


def dielectric_lobes(maps: MetallicMaps) -> tuple[MappedLobe, ...]:
    """Take the dielectric apart: amounts times bases, and times interfaces of some widths."""
    plastic, none = maps.mean.with_numbers({"metallic": np.zeros(())}), np.zeros(3)
    found = [
        MappedLobe(plastic.with_amplitudes(axis, none), maps.base_color[..., k])
        for k, axis in enumerate(np.eye(3))
        if np.any(maps.base_color[..., k])
    ]
    alpha = maps.roughness**2
    widths = table_widths(alpha[maps.seen])
    clear = plastic.with_amplitudes(none, np.ones(3))
    for width, share in zip(widths, np.moveaxis(shares(alpha, widths), -1, 0)):
        if np.any(share * maps.seen):
            found.append(MappedLobe(clear.with_roughness(float(width)), share * maps.seen))
    return tuple(found)
