"""Shadows of a concave object in a run: its transfer vectors (T 6.10), traced once and kept."""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.geometry import Mesh, Shape, SurfacePlaces, SurfaceView
from jaxrender.inverse import BRDFFit
from jaxrender.inverse.shadowing import hidden_fraction
from jaxrender.pipelines.caches import remembered
from jaxrender.reflection import Quadrature, interpolated, transfer_vectors
from jaxrender.shapes import Float

# Shadows change with the shape only: one quadrature for all runs, so that they share the cache.
_QUADRATURE = Quadrature()
# Rays that look a place's face up start this far above it, as part of the diagonal.
_ABOVE = 1e-3
# Interreflections are mentioned when they may add more than this part to the light.
_WORTH_MENTIONING = 0.02


class TransferField(NamedTuple):
    """Transfer vectors anywhere on a shape: at its vertices and interpolated, or place by place."""

    shape: Shape
    band_limit: int
    at_vertices: Float[np.ndarray, "vertex coefficient"] | None

    @classmethod
    def of(cls, shape: Shape, band_limit: int, places: int) -> "TransferField":
        """Choose by how many places there will be: vertices are traced where they are fewer."""
        if not isinstance(shape, Mesh) or places <= len(shape.vertices):
            return cls(shape, band_limit, None)
        vertices = SurfacePlaces.of_vertices(shape)
        return cls(shape, band_limit, _traced(shape, vertices, shape.normals, band_limit))

    def at(
        self, places: SurfacePlaces, normals: Float[np.ndarray, "place 3"]
    ) -> Float[np.ndarray, "place coefficient"]:
        """Find the transfer vectors of places on the surface."""
        if self.at_vertices is None:
            return _traced(self.shape, places, normals, self.band_limit)
        assert isinstance(self.shape, Mesh)
        above = places.points + _ABOVE * self.shape.diagonal() * places.geometric_normals
        hits = self.shape.first_hits(above, -places.geometric_normals)
        found = interpolated(
            self.at_vertices, self.shape.faces, np.maximum(hits.face, 0), hits.barycentric
        )
        lost = ~hits.hit
        if lost.any():
            rest = SurfacePlaces(places.points[lost], places.geometric_normals[lost])
            found[lost] = _traced(self.shape, rest, normals[lost], self.band_limit)
        return found


def interreflection(fit: BRDFFit) -> dict[str, Any]:
    """Say how much light bounces between parts of the object, or estimate it; {} if it is little.

    What a place does not see of the light it sees of the object, which is about as bright as its
    albedo: ``estimate`` = albedo x hidden fraction, both averages.
    """
    if fit.bounced is not None:
        bounced = fit.bounced
        return {
            "part": bounced.part,
            "rounds": bounced.rounds,
            "settled": bounced.settled,
            "kd_without": np.asarray(bounced.kd_without).tolist(),
        }
    transfer = fit.frequency.observations.transfer
    if transfer is None:
        return {}
    hidden = hidden_fraction(transfer)
    gloss = np.asarray(fit.brdf.ks) * float(fit.brdf.energy)
    albedo = float(np.clip(np.mean(np.pi * np.asarray(fit.brdf.kd) + gloss), 0, 1))
    if albedo * hidden < _WORTH_MENTIONING:
        return {}
    return {"estimate": albedo * hidden, "albedo": albedo, "hidden_fraction": hidden}


def with_bounces(
    image: Float[np.ndarray, "row column channel"],
    fit: BRDFFit,
    seen: tuple[SurfaceView, Mesh, int],
) -> Float[np.ndarray, "row column channel"]:
    """Add to a predicted view what bounced light adds; the last of ``seen`` is its photograph."""
    if fit.bounced is None:
        return image
    view, mesh, number = seen
    fields = fit.bounced.at_vertices
    field = fields[number if len(fields) > 1 else 0]
    places = view.face[view.hit], view.barycentric[view.hit]
    more = np.asarray(fit.brdf.kd) * interpolated(field, mesh.faces, *places)
    image = np.array(image)
    image[view.hit] += more
    return image


def sentence_on(bounced: dict[str, Any]) -> str:
    """Say what of a concave shape is modelled and what is not."""
    if "part" in bounced:
        end = "" if bounced["settled"] else ", which did not settle"
        return (
            "the shape is not convex: its shadows on itself are modelled, and diffuse "
            f"interreflections, which add {100 * bounced['part']:.1f} % to the light "
            f"({bounced['rounds']} rounds of the fit{end})"
        )
    sentence = "the shape is not convex: its shadows on itself are modelled, interreflections not"
    if not bounced:
        return sentence
    return (
        f"{sentence}; they may add {100 * bounced['estimate']:.1f} % to the light "
        f"(mean albedo {bounced['albedo']:.2f} x hidden fraction {bounced['hidden_fraction']:.2f}; "
        "solve.interreflection models those of a diffuse object)"
    )


def _traced(
    shape: Shape, places: SurfacePlaces, normals: Float[np.ndarray, "place 3"], band_limit: int
) -> Float[np.ndarray, "place coefficient"]:
    """Trace transfer vectors, or find them in the cache."""

    def trace() -> np.ndarray:
        return transfer_vectors(shape, places, normals, band_limit, _QUADRATURE).values

    if not isinstance(shape, Mesh):
        return trace()
    key = [shape.vertices, shape.faces, *places, normals, f"{band_limit} {_QUADRATURE}"]
    return remembered("transfer", key, trace)
