"""A photograph's light for the exact integral, shadows included."""

import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import Shape
from jaxrender.inverse import KnownLight
from jaxrender.inverse.known_light import exact_nodes
from jaxrender.inverse.material_task import SHADOWED_ANGLE_PER_SIGMA
from jaxrender.lighting import LightNodes
from jaxrender.reflection import ExactForward, ForwardModel, ShadowedForward, ShadowedModel


def exact_forward(
    light: KnownLight, width: float, shape: Shape, *, condensed: bool = False
) -> ForwardModel | ShadowedModel:
    """Make the point masses of a light that no photograph changes, for a lobe of some width.

    ``condensed`` says that cells of a quarter of the width will do where there are no shadows, too.
    """
    convex = shape.is_convex()
    cells = None if convex and not condensed else SHADOWED_ANGLE_PER_SIGMA
    (nodes,) = exact_nodes(light, np.zeros(0, int), width, cells)
    assert isinstance(nodes, LightNodes)
    nodes = LightNodes(*(jnp.asarray(a) for a in nodes))
    return ExactForward(nodes) if convex else ShadowedForward(shape, nodes)
