"""Light carried along paths: what rays see of a surface, its reflections in itself included.

At each vertex of a path the outgoing radiance is L_r = int L_i f cos t dw, of which one direction
w of density p (per steradian) is taken:

    L_r ~ L_i f cos t / p,    in the Nusselt square 4 L_i f / q                  (L 8.4, ERRATA 74)

an estimate whose expectation is the integral; the mean of N of them is only about equal to it
(L 8.1, ERRATA 73).  Every vertex draws from each emitter and looks for it, and goes on in a
direction drawn by its material's sampler; where that ray meets an emitter, both ways count by the
balance heuristic, p_light / (p_light + p_brdf) and the rest (Veach and Guibas 1995).

Rays are worked off in chunks with generators of their own, so the result depends on the seed alone.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxrender.reflection.tracing.emitters import Emitter
from jaxrender.reflection.tracing.scattering import (
    Scene,
    Vertices,
    continued,
    density_of,
    reflected,
    trace,
)
from jaxrender.shapes import Float

# Paths traced at once.
_CHUNK = 2**14
# The least chance to survive Russian roulette: weights grow by no more than its inverse.
_LEAST_CHANCE = 0.05


class PathSettings(NamedTuple):
    """How paths are followed."""

    samples: int = 64
    """Paths for each ray."""
    bounces: int = 4
    """The most reflections: 1 is direct light only."""
    roulette: int | None = None
    """Reflections after which paths end at random, more likely the less they carry."""
    seed: int = 0

    def check(self) -> None:
        """Raise ``ValueError`` for fewer than two samples or one bounce."""
        if self.samples < 2 or self.bounces < 1 or (self.roulette or 0) < 0:
            raise ValueError(
                f"samples {self.samples}, bounces {self.bounces}, roulette {self.roulette}: give "
                "at least 2 samples, for an error, 1 bounce, and roulette from 0 or None"
            )


class Estimate(NamedTuple):
    """Radiance with the standard error of its mean, from the scatter of the samples."""

    radiance: Float[np.ndarray, "ray channel"]
    standard_error: Float[np.ndarray, "ray channel"]


def path_radiance(
    scene: Scene,
    emitters: Sequence[Emitter],
    origins: Float[np.ndarray, "ray 3"],
    directions: Float[np.ndarray, "ray 3"],
    settings: PathSettings | None = None,
) -> Estimate:
    """Estimate the radiance that comes back along rays; emitters that a ray meets are seen.

    Raises ``ValueError`` for settings out of range and for emitters of other channels.
    """
    settings = settings or PathSettings()
    settings.check()
    for emitter in emitters:
        if emitter.channels != scene.channels:
            raise ValueError(
                f"{type(emitter).__name__} has {emitter.channels} channels and the BRDFs "
                f"{scene.channels}: give them the same"
            )
    directions = np.asarray(directions, float)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    origins = np.asarray(origins, float)
    total = np.zeros((len(directions), scene.channels))
    square = np.zeros_like(total)
    step = max(1, _CHUNK // settings.samples)
    for chunk, first in enumerate(range(0, len(directions), step)):
        part = slice(first, first + step)
        starts, towards = (
            np.repeat(array[part], settings.samples, axis=0) for array in (origins, directions)
        )
        rng = np.random.default_rng([settings.seed, chunk])
        values = _traced(scene, emitters, starts, towards, settings, rng)
        values = values.reshape(-1, settings.samples, scene.channels)
        total[part] = values.mean(axis=1)
        square[part] = values.var(axis=1, ddof=1)
    return Estimate(total, np.sqrt(square / settings.samples))


def _traced(
    scene: Scene,
    emitters: Sequence[Emitter],
    origins: np.ndarray,
    directions: np.ndarray,
    settings: PathSettings,
    rng: np.random.Generator,
) -> Float[np.ndarray, "ray channel"]:
    """Follow one path for each ray."""
    total = np.zeros((len(origins), scene.channels))
    path, carried = np.arange(len(origins)), np.ones_like(total)
    # Rays of the camera are the only way to see an emitter directly.
    density = np.full(len(origins), np.inf)
    for bounce in range(settings.bounces + 1):
        vertices, reach = trace(scene, origins, directions)
        total[path] += carried * _met(emitters, origins, directions, reach, density)
        if bounce == settings.bounces or not len(vertices.ray):
            break
        path, carried = path[vertices.ray], carried[vertices.ray]
        total[path] += carried * _connected(scene, emitters, vertices, rng)
        if bounce + 1 == settings.bounces and not any(e.is_met for e in emitters):
            break
        incoming, density = continued(scene, vertices, rng.random((len(path), 2)))
        weight = reflected(scene, vertices, incoming)
        weight /= np.where(density > 0, density, np.inf)[:, None]
        carried = carried * weight
        on = (carried != 0).max(axis=1)
        if settings.roulette is not None and bounce >= settings.roulette:
            chance = np.clip(carried.max(axis=1), _LEAST_CHANCE, 1)
            on = on & (rng.random(len(path)) < chance)
            carried = carried / chance[:, None]
        kept = vertices.take(on)
        origins, directions = kept.points, kept.to_world(incoming[on])
        path, carried, density = path[on], carried[on], density[on]
        if not len(path):
            break
    return total


def _met(
    emitters: Sequence[Emitter],
    origins: np.ndarray,
    directions: np.ndarray,
    reach: np.ndarray,
    density: np.ndarray,
) -> Float[np.ndarray, "ray channel"] | float:
    """Radiance of the emitters that rays of this density ran into, weighted."""
    total: np.ndarray | float = 0.0
    for emitter in emitters:
        if emitter.is_met:
            sure = np.isinf(density)
            own = np.where(sure, 1, density)
            weight = np.where(sure, 1, own / (own + emitter.density(origins, directions)))
            total = total + weight[:, None] * emitter.radiance(origins, directions, reach)
    return total


def _connected(
    scene: Scene, emitters: Sequence[Emitter], vertices: Vertices, rng: np.random.Generator
) -> Float[np.ndarray, "vertex channel"]:
    """Radiance that vertices reflect of light drawn from each emitter, weighted."""
    total = np.zeros((len(vertices.ray), scene.channels))
    for emitter in emitters:
        drawn = emitter.draw(vertices.points, rng.random((len(vertices.ray), 2)))
        incoming = vertices.to_local(drawn.directions)
        row = np.flatnonzero((incoming[:, 2] > 0) & drawn.irradiance.any(axis=1))
        row = row[~_hidden(scene, vertices.points[row], drawn.directions[row], drawn.distance[row])]
        lit, from_light = vertices.take(row), drawn.density[row]
        value = reflected(scene, lit, incoming[row]) * drawn.irradiance[row]
        if emitter.is_met:
            own = density_of(scene, lit, incoming[row])
            share = from_light / np.where(np.isinf(from_light), 1, from_light + own)
            value *= np.where(np.isinf(from_light), 1, share)[:, None]
        total[row] += value
    return total


def _hidden(
    scene: Scene, points: np.ndarray, directions: np.ndarray, distance: np.ndarray
) -> np.ndarray:
    """Whether the surface lies between places and the light at a distance."""
    hidden = np.zeros(len(points), bool)
    endless = np.isinf(distance)
    hidden[endless] = scene.shape.occluded(points[endless], directions[endless])
    near = ~endless
    if near.any():
        first = scene.shape.first_hits(points[near], directions[near]).distance
        hidden[near] = first < distance[near] * (1 - 1e-6)
    return hidden
