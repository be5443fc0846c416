"""Shadows of a concave object in a run: transfer vectors that are kept between runs, and words."""

from typing import Any

import numpy as np

from jaxrender.geometry import Mesh, Shape, SurfacePlaces
from jaxrender.inverse import BRDFFit
from jaxrender.inverse.interreflection import possible_bounces
from jaxrender.inverse.transfer_field import TransferField, traced
from jaxrender.pipelines.caches import remembered
from jaxrender.reflection import Quadrature
from jaxrender.shapes import Float

# Interreflections are mentioned when they may add more than this part to the light.
_WORTH_MENTIONING = 0.02


def transfer_field(shape: Shape, band_limit: int, places: int) -> TransferField:
    """Make a field for so many places, of vectors that an earlier run may have traced."""
    return TransferField.of(shape, band_limit, places, _remembered)


def interreflection(fit: BRDFFit) -> dict[str, Any]:
    """Lay out the light that bounces between parts of the object, or may; {} if it is little."""
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
    possible = possible_bounces(fit.brdf, transfer)
    if possible.estimate < _WORTH_MENTIONING:
        return {}
    return {"estimate": possible.estimate, **possible._asdict()}


def sentence_on(bounced: dict[str, Any]) -> str:
    """Say what of a concave shape is modelled and what is not."""
    if "part" in bounced:
        end = "" if bounced["settled"] else ", which did not settle"
        return (
            "the shape is not convex: its shadows on itself are modelled, and "
            f"interreflections, which add {100 * bounced['part']:.1f} % to the light "
            f"({bounced['rounds']} rounds of the fit{end})"
        )
    sentence = "the shape is not convex: its shadows on itself are modelled, interreflections not"
    if not bounced:
        return sentence
    return (
        f"{sentence}; they may add {100 * bounced['estimate']:.1f} % to the light "
        f"(mean albedo {bounced['albedo']:.2f} x hidden fraction {bounced['hidden_fraction']:.2f}; "
        "solve.interreflection models them)"
    )


def _remembered(
    shape: Shape, places: SurfacePlaces, normals: Float[np.ndarray, "place 3"], band_limit: int
) -> Float[np.ndarray, "place coefficient"]:
    """Trace transfer vectors, or find them in the cache."""
    if not isinstance(shape, Mesh):
        return traced(shape, places, normals, band_limit)
    # Shadows change with the shape only: one quadrature for all runs, so that they share the cache.
    key = [shape.vertices, shape.faces, *places, normals, f"{band_limit} {Quadrature()}"]
    return remembered("transfer", key, lambda: traced(shape, places, normals, band_limit))
