"""Light with a place: each sample sees point sources in directions of its own."""

import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.geometry import Shape, SurfacePlaces, SurfaceSamples
from jaxrender.lighting import PointSources
from jaxrender.reflection.integral import FrameNodes, integral_columns_by_frame, visible_nodes
from jaxrender.reflection.render import ForwardModel, ShadowedModel, is_traced
from jaxrender.shapes import AnyArray, Array, Bool, Float


class NearForward(ShadowedModel):
    """The integral over point sources, beside the model of all other light.

    ``shape`` is given where it is concave, and hides sources from itself.
    """

    sources: PointSources
    others: ForwardModel | ShadowedModel | None = None
    shape: Shape | None = None

    def at(self, places: SurfacePlaces, samples: SurfaceSamples) -> ForwardModel:
        """Look at the sources from these places, and trace their shadows.

        Raises ``ValueError`` for traced sources of a concave shape: rays are traced on the host.
        """
        count = len(np.asarray(places.points))
        nodes = FrameNodes(*self.sources.at(np.asarray(places.points)), np.arange(count))
        seen = None
        if self.shape is not None:
            if is_traced(self.sources):
                raise ValueError(
                    "shadows of point sources are traced on the host: give the sources as NumPy "
                    "arrays, or a convex shape"
                )
            seen = visible_nodes(self.shape, places, nodes)
        others = self.others
        if isinstance(others, ShadowedModel):
            others = others.at(places, samples)
        return _SeenFromPlaces(nodes, seen, others)

    @property
    def rays(self) -> int:
        """One a source, and those of all other light."""
        others = self.others.rays if isinstance(self.others, ShadowedModel) else 0
        return others + len(self.sources.positions)


class _SeenFromPlaces(ForwardModel):
    """The sum over the sources as each of certain samples sees them."""

    nodes: FrameNodes
    seen: Bool[AnyArray, "sample node"] | None
    others: ForwardModel | None

    def columns(self, brdf: BRDF, samples: SurfaceSamples) -> Float[Array, "sample lobe channel"]:
        """Sum over the sources, and add what the other model makes."""
        near = integral_columns_by_frame(brdf, samples, self.nodes, self.seen)
        return near if self.others is None else near + self.others.columns(brdf, samples)
