"""A photograph's light for the exact integral, shadows included."""

import jax.numpy as jnp

from jaxrender.geometry import Shape
from jaxrender.inverse import KnownLight
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.material_task import SHADOWED_ANGLE_PER_SIGMA
from jaxrender.lighting import LightNodes, PointSources
from jaxrender.reflection import (
    ExactForward,
    ForwardModel,
    NearForward,
    ShadowedForward,
    ShadowedModel,
)


def with_points(
    others: ForwardModel | ShadowedModel | None, points: PointSources, shape: Shape
) -> NearForward:
    """Add sources that have a place to the model of all other light."""
    return NearForward(points, others, None if shape.is_convex() else shape)


def exact_forward(
    light: KnownLight, width: float, shape: Shape, *, condensed: bool = False
) -> ForwardModel | ShadowedModel:
    """Make the point masses of a light that no photograph changes, for a lobe of some width.

    ``condensed`` says that cells of a quarter of the width will do where there are no shadows, too.
    """
    points = light.points_of(0)
    if points is not None:
        others = light.distant
        rest = others and exact_forward(others, width, shape, condensed=condensed)
        return with_points(rest, points, shape)
    convex = shape.is_convex()
    cells = None if convex and not condensed else SHADOWED_ANGLE_PER_SIGMA
    (nodes,) = exact_nodes(light, None, width, cells)
    assert isinstance(nodes, LightNodes)
    nodes = LightNodes(*(jnp.asarray(a) for a in nodes))
    return ExactForward(nodes) if convex else ShadowedForward(shape, nodes)
