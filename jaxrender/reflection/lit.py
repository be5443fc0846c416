"""A material under any light: the forward model that a light asks for, and pictures by it."""

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.brdf import BRDF
from jaxrender.geometry import Camera, Shape, observe
from jaxrender.lighting import Light, LightNodes, LightSum, PointSources, SmoothLobes
from jaxrender.reflection.near import NearForward
from jaxrender.reflection.render import (
    ExactForward,
    ForwardModel,
    ShadowedForward,
    ShadowedModel,
    render_view,
)
from jaxrender.shapes import AnyArray, Float


def forward_of(light: Light, shape: Shape) -> ForwardModel | ShadowedModel:
    """Choose how a light is reflected exactly: its point masses summed, smooth lobes integrated.

    A concave shape hides parts of the light from itself; the lobes are then point masses, too.
    Point sources are seen from each place.
    """
    points = [part for part in light.parts if isinstance(part, PointSources)]
    if points:
        others = tuple(part for part in light.parts if not isinstance(part, PointSources))
        sources = PointSources(
            jnp.concatenate([part.positions for part in points]),
            jnp.concatenate([part.intensity for part in points]),
        )
        rest = forward_of(LightSum(others), shape) if others else None
        return NearForward(sources, rest, None if shape.is_convex() else shape)
    if not shape.is_convex():
        return ShadowedForward(shape, _lit(light.nodes()))
    lobes = [part for part in light.parts if isinstance(part, SmoothLobes)]
    rest = tuple(part for part in light.parts if not isinstance(part, SmoothLobes))
    if not lobes:
        return ExactForward(_lit(light.nodes()))
    joined = SmoothLobes(
        *(
            jnp.concatenate([jnp.asarray(getattr(lobe, name)) for lobe in lobes])
            for name in ("directions", "widths", "middle")
        )
    )
    channels = joined.middle.shape[1]
    dark = LightNodes(np.zeros((0, 3)), np.zeros((0, channels)))
    return ExactForward(_lit(LightSum(rest).nodes()) if rest else dark, joined)


def render_lit(
    material: BRDF, light: Light, shape: Shape, camera: Camera
) -> Float[AnyArray, "row column channel"]:
    """Render a shape under any light, sums too, by the exact integral; zero where a ray missed.

    May be compiled, and differentiated by the material and the light; what the camera sees, and
    where shadows fall, stays as it is traced.
    """
    return render_view(material, observe(camera, shape), forward_of(light, shape))


def _lit(nodes: LightNodes) -> LightNodes:
    """Leave out the nodes that are dark, where their numbers are known."""
    if isinstance(nodes.irradiance, Tracer) or isinstance(nodes.directions, Tracer):
        return nodes
    lit = np.any(np.asarray(nodes.irradiance) != 0, axis=1)
    return LightNodes(np.asarray(nodes.directions)[lit], np.asarray(nodes.irradiance)[lit])
