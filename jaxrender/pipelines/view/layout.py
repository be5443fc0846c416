"""What is shown and what is known of it, laid out for the templates and the scripts."""

import math
from typing import Any, NamedTuple

import numpy as np

from jaxrender.imaging.display import exposed, exposure_for
from jaxrender.pipelines.report.display import data_uri, with_alpha
from jaxrender.pipelines.view.light import DEGREE
from jaxrender.pipelines.view.material_table import FLOOR, MIDDLE, NODES, MaterialTable
from jaxrender.pipelines.view.packing import packed
from jaxrender.pipelines.view.pictures import Gallery, false_bar, false_colours
from jaxrender.pipelines.view.shown import MARGIN, Shown, rendered, seen_from
from jaxrender.pipelines.view.sliders import sliders_of
from jaxrender.pipelines.view.surface import surface_document
from jaxrender.pipelines.view.texture import PageTexture

# Half the side of the still picture is this many pixels.
_STILL = 96
# Where the page looks from at first, where no photograph says.
_AZIMUTH, _ELEVATION = math.radians(40), math.radians(20)


class Facts(NamedTuple):
    """What a page says beside what it shows; ``digest`` tells which result it is of."""

    title: str
    digest: str
    summary: dict[str, Any]
    recovered: bool
    gallery: Gallery | None


def values_of(shown: Shown, facts: Facts) -> dict[str, Any]:
    """Lay out what the templates ask for.

    ``scene`` is what the scripts read, with arrays as text; ``still`` a picture for browsers that
    cannot draw.
    """
    view = seen_from(shown, _AZIMUTH, _ELEVATION, 2 * _STILL)
    picture = rendered(shown, view)
    exposure = exposure_for(picture[view.hit])
    still = data_uri(with_alpha(exposed(picture, exposure), view.hit.astype(float)))
    sliders = sliders_of(shown.brdf, shown.table, facts.summary)
    gallery = facts.gallery
    scene: dict[str, Any] = {
        "surface": surface_document(shown.shape, shown.texture is not None),
        "material": _material_document(shown.table, shown.texture),
        "texture": None if shown.texture is None else shown.texture.document(),
        "false_colours": packed(false_colours()),
        "lights": {
            name: light.document()
            for name, light in {"result": shown.light, **shown.others}.items()
        },
        "sliders": [slider._asdict() for slider in sliders],
        "exposure": exposure,
        "view": [_AZIMUTH, _ELEVATION],
        "margin": MARGIN,
        "photographs": [] if gallery is None else list(gallery.frames),
    }
    return {
        **{key: str(facts.summary.get(key, "")) for key in ("outcome", "meaning")},
        "title": facts.title,
        "digest": facts.digest,
        "scene": scene,
        "still": still,
        "sliders": sliders,
        "gallery": gallery,
        "recovered": facts.recovered,
        "texture": shown.texture,
        "false_bar": false_bar(),
        "model": str(facts.summary.get("brdf", {}).get("model", "")),
        "is_convex": shown.shape.is_convex(),
        "error": shown.table.error,
        "others": list(shown.others),
        "harmonics": [(d, m) for d in range(DEGREE + 1) for m in range(-d, d + 1)],
    }


def _material_document(table: MaterialTable, texture: PageTexture | None) -> dict[str, Any]:
    """Lay the table out as text: of a lobe without a colour one channel is enough."""
    values = table.logarithms
    grey = bool(np.all(values[..., :3] == values[..., :1]))
    kept = values[..., [0, 3]] if grey else values
    if table.head_on is not None:
        kept = values[..., [0, 1, 3]]
    return {
        "logarithms": packed(kept.astype(np.float16)),
        "parts": kept.shape[-1],
        "nodes": list(NODES),
        "middle": MIDDLE,
        "floor": FLOOR,
        "widths": table.widths.tolist(),
        "fitted": table.fitted,
        "ratios": [1.0] if texture is None else texture.ratios.tolist(),
        "weighted": table.weighted,
        "base": table.base.tolist(),
        "lobe": table.lobe.tolist(),
        "head_on": table.head_on or 0.0,
    }
