"""Transfer vectors anywhere on a concave shape (T 6.10): where many are asked for, interpolated."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxrender.geometry import Mesh, Shape, SurfacePlaces
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import places_of
from jaxrender.reflection import interpolated, transfer_vectors
from jaxrender.shapes import Float

# Rays that look a place's face up start this far above it, as part of the diagonal.
_ABOVE = 1e-3

# Finds the transfer vectors of places with these normals, to a degree: [place, coefficient].
Trace = Callable[[Shape, SurfacePlaces, np.ndarray, int], np.ndarray]


def traced(
    shape: Shape, places: SurfacePlaces, normals: Float[np.ndarray, "place 3"], band_limit: int
) -> Float[np.ndarray, "place coefficient"]:
    """Trace the transfer vectors of places."""
    return transfer_vectors(shape, places, normals, band_limit).values


def with_field(observations: Observations, shape: Shape, band_limit: int) -> Observations:
    """Give observations their transfer vectors by a field, unless they have them already."""
    if observations.transfer is not None:
        return observations
    return TransferField.of(shape, band_limit, observations.count).of_observations(observations)


class TransferField(NamedTuple):
    """Transfer vectors anywhere on a shape, to the degree ``band_limit``.

    Where ``at_vertices`` is there, they are interpolated between the vertices of a mesh; else
    ``trace`` finds them place by place.
    """

    shape: Shape
    band_limit: int
    at_vertices: Float[np.ndarray, "vertex coefficient"] | None
    trace: Trace = traced

    @classmethod
    def of(
        cls, shape: Shape, band_limit: int, places: int, trace: Trace = traced
    ) -> "TransferField":
        """Trace the vertices of a mesh if they are fewer than the places that will be asked for."""
        if not isinstance(shape, Mesh) or places <= len(shape.vertices):
            return cls(shape, band_limit, None, trace)
        vertices = SurfacePlaces.of_vertices(shape)
        return cls(shape, band_limit, trace(shape, vertices, shape.normals, band_limit), trace)

    def at(
        self, places: SurfacePlaces, normals: Float[np.ndarray, "place 3"]
    ) -> Float[np.ndarray, "place coefficient"]:
        """Find the transfer vectors of places on the surface, with their normals of shading."""
        if self.at_vertices is None:
            return self.trace(self.shape, places, normals, self.band_limit)
        assert isinstance(self.shape, Mesh)
        above = places.points + _ABOVE * self.shape.diagonal() * places.geometric_normals
        hits = self.shape.first_hits(above, -places.geometric_normals)
        found = interpolated(
            self.at_vertices, self.shape.faces, np.maximum(hits.face, 0), hits.barycentric
        )
        lost = ~hits.hit
        if lost.any():
            rest = SurfacePlaces(places.points[lost], places.geometric_normals[lost])
            found[lost] = self.trace(self.shape, rest, normals[lost], self.band_limit)
        return found

    def of_observations(self, observations: Observations) -> Observations:
        """Give observations their vectors; ``ValueError`` where nobody said where they lie."""
        vectors = self.at(places_of(observations), np.asarray(observations.samples.normals))
        return observations._replace(transfer=vectors)
