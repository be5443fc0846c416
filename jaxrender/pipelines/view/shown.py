"""What a page shows, seen by its camera and rendered by the exact integral."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, MetallicRoughness
from jaxrender.geometry import Orthographic, Shape, SurfaceView, look_at, observe
from jaxrender.lighting import LightNodes
from jaxrender.pipelines.tasks.texture.metallic import MetallicSubject
from jaxrender.pipelines.tasks.texture.subject import TexturedSubject
from jaxrender.pipelines.view.light import PageLight
from jaxrender.pipelines.view.material_table import MaterialTable, material_table, metal_table
from jaxrender.pipelines.view.surface import surface_document
from jaxrender.pipelines.view.texture import PageTexture
from jaxrender.reflection import ExactForward, render_view
from jaxrender.shapes import Float

# The picture reaches so far beyond the object, in its radii.
MARGIN = 1.08


class Shown(NamedTuple):
    """What a page shows: the material, its table, its light and the surface.

    ``others`` are other lights that it can be put in, by their names.
    """

    brdf: BRDF
    table: MaterialTable
    light: PageLight
    shape: Shape
    center: Float[np.ndarray, "3"]
    radius: float
    texture: PageTexture | None = None
    subject: TexturedSubject | MetallicSubject | None = None
    others: Mapping[str, PageLight] = {}


def shown_as(
    brdf: BRDF,
    width: float,
    light: PageLight,
    shape: Shape,
    texture: PageTexture | None = None,
    subject: TexturedSubject | MetallicSubject | None = None,
) -> Shown:
    """Tabulate a material, and find where the object lies; raises ``InputError`` as both do."""
    if texture is not None and texture.metal:
        assert isinstance(brdf, MetallicRoughness)
        table = metal_table(brdf)
    else:
        table = material_table(brdf, width)
    surface = surface_document(shape, texture is not None)
    center, radius = np.array(surface["center"], float), float(surface["radius"])
    return Shown(brdf, table, light, shape, center, radius, texture, subject)


def seen_from(shown: Shown, azimuth: float, elevation: float, size: int) -> SurfaceView:
    """Trace what the page's camera sees: a distant viewer, in radians, of so many pixels a side."""
    cosine = math.cos(elevation)
    towards = np.array(
        [cosine * math.cos(azimuth), cosine * math.sin(azimuth), math.sin(elevation)]
    )
    pose = look_at(
        shown.center + 4 * shown.radius * towards, shown.center, np.array([0.0, 0.0, 1.0])
    )
    scale = 2 * MARGIN * shown.radius / size
    return observe(Orthographic(size, size, pose, scale=scale), shown.shape)


def rendered(shown: Shown, view: SurfaceView) -> Float[np.ndarray, "row column 3"]:
    """Render what the page shows by the exact integral, as the page does: without shadows."""
    nodes = shown.light.nodes
    model = ExactForward(LightNodes(*(np.asarray(part) for part in nodes)))
    if shown.subject is not None:
        return shown.subject.image(view, model)
    return np.asarray(np.broadcast_to(render_view(shown.brdf, view, model), (*view.hit.shape, 3)))
