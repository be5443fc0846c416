"""Drawing places of luminaires for Monte Carlo, and how densely they are drawn (L 8.6).

A luminaire's tree cannot be searched as a BRDF's can: the direction towards a point changes with
(u, v), and the integrals of L 8.20 do not separate.  So places are drawn by geometry alone:

- a patch by the solid angle that it fills, exactly for rectangles, so that of a box only the faces
  that can be seen are drawn (at most three);
- within it evenly over the area of a rectangle and over what can be seen of a cylinder, within the
  cone that a sphere fills, evenly in (u, v) on any other surface.

The density per steradian of a direction is p(patch) p(place per area) r^2 / cos t_e, and its
integral is 1; less for surfaces that are drawn on their dark side too.  Half of a draw may come
from the BRDF: ``balance_weight`` is the share of each (Veach and Guibas 1995).  Host side.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.geometry import Shape
from jaxrender.lighting.luminaires.luminaire import Luminaire
from jaxrender.lighting.luminaires.surfaces import Places, Points
from jaxrender.reflection.tracing.luminaires import (
    ShadedPoints,
    padded,
    padded_length,
    reflected,
    unobstructed,
)
from jaxrender.shapes import Array, Float, Int


class LuminaireSamples(NamedTuple):
    """A place drawn for each point; where none could be, density and radiance are zero."""

    directions: Float[np.ndarray, "point 3"]
    distance: Float[np.ndarray, "point"]
    radiance: Float[Array, "point channel"]
    """That leaves the place towards the point; what stands in between is not known here."""
    density: Float[np.ndarray, "point"]
    """Per steradian."""


class LuminaireSampler:
    """Draws places of one luminaire, seen from points."""

    def __init__(self, luminaire: Luminaire):
        self.luminaire = luminaire

    def draw(self, points: Points, uniforms: Places) -> LuminaireSamples:
        """Draw by two uniform numbers in [0, 1) a point; the first one also chooses the patch."""
        shares = self._shares(points)
        edges = np.cumsum(shares, axis=1)
        chosen = (uniforms[:, :1] >= edges[:, :-1]).sum(axis=1)
        share = np.take_along_axis(shares, chosen[:, None], axis=1)[:, 0]
        start = np.take_along_axis(edges, chosen[:, None], axis=1)[:, 0] - share
        rest = (uniforms[:, 0] - start) / np.where(share > 0, share, 1)
        rest = np.clip(rest, 0, np.nextafter(1, 0))
        places = np.zeros((len(points), 2))
        own = np.stack([rest, uniforms[:, 1]], axis=1)
        for patch, row in self._rows(chosen):
            places[row] = self.luminaire.patches[patch].drawn(points[row], own[row])
        towards = self.luminaire.at(chosen, places).points - points
        distance = np.linalg.norm(towards, axis=1)
        directions = towards / np.where(distance > 0, distance, 1)[:, None]
        density = self._density_at(points, chosen, places)
        radiance = self.luminaire.radiance(places, -directions, chosen)
        radiance = jnp.where(jnp.asarray(density[:, None] > 0), radiance, 0)
        if not self.luminaire.convex:
            met = self.luminaire.crossings(points, directions).distance
            hidden = met < (1 - 1e-5) * distance
            radiance = jnp.where(jnp.asarray(hidden[:, None]), 0, radiance)
        return LuminaireSamples(directions, distance, radiance, density)

    def density(
        self, points: Points, directions: Float[np.ndarray, "point 3"]
    ) -> Float[np.ndarray, "point"]:
        """Evaluate the density with which ``draw`` has what is seen first in unit directions."""
        crossings = self.luminaire.crossings(points, directions)
        found = np.zeros(len(points))
        row = np.flatnonzero(crossings.patch >= 0)
        patch, places = crossings.patch[row], crossings.places[row]
        found[row] = self._density_at(points[row], patch, places)
        return found

    def _density_at(
        self, points: Points, patch: Int[np.ndarray, "point"], places: Places
    ) -> Float[np.ndarray, "point"]:
        density = np.take_along_axis(self._shares(points), patch[:, None], axis=1)[:, 0]
        for index, row in self._rows(patch):
            density[row] *= self.luminaire.patches[index].density(points[row], places[row])
        return density

    def _shares(self, points: Points) -> Float[np.ndarray, "point patch"]:
        """Return each patch's chance; zero for all where none can be seen."""
        each = [surface.importance(points) for surface in self.luminaire.patches]
        importance = np.stack(each, axis=1)
        total = importance.sum(axis=1, keepdims=True)
        return importance / np.where(total > 0, total, 1)

    def _rows(self, patch: Int[np.ndarray, "point"]) -> list[tuple[int, np.ndarray]]:
        rows = [np.flatnonzero(patch == i) for i in range(len(self.luminaire.patches))]
        return [(index, row) for index, row in enumerate(rows) if len(row)]


def balance_weight(
    density: Float[np.ndarray, "*batch"], other: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch"]:
    """Return p / (p + q), the share of a sample drawn with density p where q also draws."""
    total = density + other
    return np.where(total > 0, density / np.where(total > 0, total, 1), 0)


def sampled_light(
    shaded: ShadedPoints,
    brdf: BRDF,
    sampler: LuminaireSampler,
    uniforms: Float[np.ndarray, "point sample 2"],
    occluder: Shape | None = None,
) -> Float[Array, "point sample channel"]:
    """Estimate the direct light, f_r cos t_i L_e g / p once a sample; their mean is the estimate.

    ``direct_light`` is the twin that integrates.
    """
    count, each = uniforms.shape[:2]
    point = np.repeat(np.arange(count), each)
    rows = ShadedPoints(*(np.asarray(part, float)[point] for part in shaded))
    drawn = sampler.draw(np.asarray(rows.points), uniforms.reshape(-1, 2))
    facing = np.einsum("pi,pi->p", drawn.directions, np.asarray(rows.frames)[:, :, 2]) > 0
    useful = facing & (drawn.density > 0)
    if occluder is not None:
        row = np.flatnonzero(useful)
        goals = np.asarray(rows.points)[row] + drawn.distance[row, None] * drawn.directions[row]
        useful[row] = unobstructed(occluder, ShadedPoints(*(p[row] for p in rows)), goals)
    weights = np.where(useful, 1 / np.where(useful, drawn.density, 1), 0)
    some = ShadedPoints(*(jnp.asarray(part) for part in shaded))
    dtype, wanted = np.dtype(some.points.dtype), padded_length(len(point))
    directions = padded(drawn.directions, wanted, dtype)
    points = padded(point, wanted, np.dtype(np.int32))
    values = reflected(brdf, some, directions, points)[: len(point)]
    light = drawn.radiance.astype(dtype) * jnp.asarray(weights, dtype)[:, None]
    return (values * light).reshape(count, each, -1)
