"""Which samples say most about a material, and draws that prefer them without a bias.

The leverage of a sample is J (J' J)^-1 J', with J the derivatives of its radiance by kd, ks, log
sigma and mu.  The specular part shows near the mirror direction of each source, within a distance
that the unknown width sets; mu shows at grazing exit.  So the leverage is the mean over lobes from
the narrowest to the widest that a fit may find.  It needs the light and the geometry alone: neither
the measured radiance nor a fit, which may have found no specular part.

The lobe is the GGX distribution of the half vector times the Fresnel ratio at the exit angle.  It
stands for every glossy model, since all of them shine about the mirror direction.

Where the light is unknown, the radiance itself shows the specular part: light of few degrees leaves
it unexplained.

A sample of a draw stands for 1 / chance pixels (Horvitz and Thompson 1952).  So sums over a draw
are in the mean those over all pixels, whatever the chances depend on.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.brdf import INDEX_BOUNDS, WIDTH_BOUNDS, Parametric
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import coefficient_count, real_basis
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.light_nodes import environment_nodes, frame_nodes
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.lighting import condensed
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import Float, Int

# Widths of the lobes over the range of a fit.
_WIDTHS = 6
# The light is the brightest of its cells, this wide (radians); at most this many, and this many
# terms of samples, widths and cells in all.
_CELL, _MOST_SOURCES, _MOST_TERMS = 0.2, 16, 3e7
# Samples worked on at once.
_BLOCK = 2**15
# This part of a draw is uniform: it bounds how many pixels a sample may stand for.
_UNIFORM = 0.5
# The Fresnel ratio's slope in log(mu - 1) is all but that of Schlick's (1 - cos)^5 for any index.
_SCHLICK = 5
# The widths of lobes about a fixed width, as a factor.
_ABOUT = 1.5
# Degrees of smooth light that the diffuse part shows (it shows no more), and that a mirror shows.
_BY_NORMAL, _BY_MIRROR = 2, 4


def width_range(unknowns: Unknowns, variant: Parametric) -> tuple[float, float]:
    """Find the narrowest and the widest lobe of a fit, or widths about a fixed one."""
    if variant.shape.name not in unknowns:
        # Lobes of set shapes, of which any may be there.
        return float(variant.sigma), WIDTH_BOUNDS[1]
    unknown, width_of = unknowns[variant.shape.name], variant.shape.width_of
    if unknown.free:
        low, high = sorted(width_of(bound) for bound in (unknown.lower, unknown.upper))
        return low, high
    width = width_of(unknown.first(0.0))
    return width / _ABOUT, width * _ABOUT


def index_range(unknowns: Unknowns, variant: Parametric) -> tuple[float, float]:
    """Find the lowest and the highest index of a fit; where it is known, it is both."""
    index = variant.index
    if index.name not in unknowns:
        return INDEX_BOUNDS
    unknown = unknowns[index.name]
    if not unknown.free:
        known = index.index_of(unknown.first(0.0))
        return known, known
    low, high = sorted(index.index_of(bound) for bound in (unknown.lower, unknown.upper))
    return low, high


class Draw(NamedTuple):
    """Samples drawn, which say how many pixels they stand for, and their indices, ascending."""

    observations: Observations
    index: Int[np.ndarray, "kept"]


class _Source(NamedTuple):
    """A direction and its energy: of all photographs, or with one more axis of each."""

    towards: Float[np.ndarray, "*frame 3"]
    energy: Float[np.ndarray, "*frame"]


def leverage(
    observations: Observations,
    light: KnownLight,
    widths: tuple[float, float] = WIDTH_BOUNDS,
) -> Float[np.ndarray, "sample"]:
    """Compute each sample's leverage on kd, ks, sigma and mu; all of them add up to one.

    The mean over lobes whose widths lie between ``widths``.
    """
    tried = np.geomspace(*widths, _WIDTHS)
    shared, own = _sources(light, observations.count)
    blocks = []
    for first in range(0, observations.count, _BLOCK):
        index = np.arange(first, min(first + _BLOCK, observations.count))
        frame = np.asarray(observations.frame)[index]
        sources = [*shared, *(_Source(one.towards[frame], one.energy[frame]) for one in own)]
        blocks.append(_columns(observations.take(index), sources, tried))
    diffuse, lobes = (np.concatenate(parts, axis=-1) for parts in zip(*blocks))
    by_index = (1 - np.clip(np.asarray(observations.samples.exit_cosines, float), 0, 1)) ** _SCHLICK
    found = np.zeros(observations.count)
    for lobe, by_width in zip(lobes, np.gradient(lobes, axis=0)):
        found += _of_columns(np.stack([diffuse, lobe, by_width, lobe * by_index], axis=1))
    return _to_one(found)


def sharpness(observations: Observations) -> Float[np.ndarray, "sample"]:
    """Compute what smooth light leaves of each sample, squared; all of it adds up to one.

    Smooth light is least squares of harmonics of few degrees, of the normal and of the reflected
    direction.  This is the leverage on the specular part where the light is unknown.
    """
    samples, radiance = observations.samples, np.asarray(observations.radiance, float)
    blocks = [
        np.arange(first, min(first + _BLOCK, observations.count))
        for first in range(0, observations.count, _BLOCK)
    ]
    size = coefficient_count(_BY_NORMAL) + coefficient_count(_BY_MIRROR)
    gram, moments = np.zeros((size, size)), np.zeros((size, radiance.shape[1]))
    for index in blocks:
        columns = _smooth_columns(samples, index)
        gram += columns.T @ columns
        moments += columns.T @ radiance[index]
    smooth = np.linalg.pinv(gram, 1e-8, hermitian=True) @ moments
    left = [radiance[index] - _smooth_columns(samples, index) @ smooth for index in blocks]
    scale = np.mean(radiance**2, axis=0) if observations.count else np.ones(radiance.shape[1])
    found = np.concatenate([np.zeros((0, radiance.shape[1])), *left]) ** 2
    return _to_one(np.mean(found / np.where(scale > 0, scale, 1), axis=1))


def draw(
    observations: Observations, leverage: Float[np.ndarray, "sample"], count: int, seed: int
) -> Draw:
    """Draw at most ``count`` samples, half of the chance by leverage and half alike for all."""
    if observations.count <= count:
        return Draw(observations, np.arange(observations.count))
    chance = _chances(leverage, count)
    # Systematic sampling along a random order takes exactly as many as the chances add up to.
    rng = np.random.default_rng(seed)
    order = rng.permutation(observations.count)
    passed = np.floor(np.cumsum(chance[order]) + rng.uniform())
    index = np.sort(order[np.diff(passed, prepend=0.0) > 0])
    some = observations.take(index)
    return Draw(some._replace(stands_for=some.pixels / chance[index]), index)


def _chances(leverage: Float[np.ndarray, "sample"], count: int) -> Float[np.ndarray, "sample"]:
    """Compute with what probability a draw takes each sample; they add up to ``count``."""
    wanted = (1 - _UNIFORM) * leverage / leverage.sum() + _UNIFORM / len(leverage)
    certain = np.zeros(len(wanted), bool)
    while True:
        rest = np.where(certain, 0, wanted)
        chance = np.where(certain, 1, (count - certain.sum()) * rest / rest.sum())
        if np.all(chance <= 1):
            return chance
        certain |= chance > 1


def _smooth_columns(
    samples: SurfaceSamples, index: Int[np.ndarray, "kept"]
) -> Float[np.ndarray, "kept column"]:
    """Evaluate harmonics of the normal and of the reflected direction; one shape for all blocks."""
    padded = np.resize(index, _BLOCK)
    some = SurfaceSamples(*(np.asarray(part, float)[padded] for part in samples))
    # One program serves both: the normal's harmonics, too, are evaluated to the mirror's degree.
    normal, mirror = (np.asarray(real_basis(d, _BY_MIRROR)) for d in (some.normals, some.reflected))
    return np.hstack([normal[:, : coefficient_count(_BY_NORMAL)], mirror])[: len(index)]


def _to_one(found: Float[np.ndarray, "sample"]) -> Float[np.ndarray, "sample"]:
    """Let leverages add up to one; alike for all samples where none has any."""
    return found / found.sum() if found.any() else np.full(len(found), 1 / max(len(found), 1))


def _sources(light: KnownLight, samples: int) -> tuple[list[_Source], list[_Source]]:
    """List the brightest sources: those of all photographs, and those of each."""
    most = int(np.clip(_MOST_TERMS / (_WIDTHS * max(samples, 1)), 1, _MOST_SOURCES))
    parts = [light.directional.nodes()]
    if light.environment is not None:
        parts.append(condensed(light.environment, _CELL))
    directions = np.concatenate([np.asarray(part.directions, float) for part in parts])
    energy = np.concatenate([np.asarray(part.irradiance, float).mean(axis=1) for part in parts])
    kept = np.argsort(-energy)[:most]
    shared = [_Source(directions[k], energy[k]) for k in kept if energy[k] > 0]
    nowhere = np.zeros(0, int)
    found = (frame_nodes(light, nowhere), environment_nodes(light, 1.0, _CELL, nowhere))
    own = [part for part in found if isinstance(part, FrameNodes)]
    if not own:
        return shared, []
    towards, energy = (
        np.concatenate([np.asarray(part[at], float) for part in own], axis=1) for at in (0, 1)
    )
    energy = energy.mean(axis=-1)
    order = np.argsort(-energy, axis=1)[:, :most]
    rows = np.arange(len(order))
    return shared, [_Source(towards[rows, k], energy[rows, k]) for k in order.T]


def _columns(
    some: Observations, sources: list[_Source], widths: Float[np.ndarray, "width"]
) -> tuple[Float[np.ndarray, "sample"], Float[np.ndarray, "width sample"]]:
    """Add up the diffuse column and a lobe of every width, source by source."""
    normals, outgoing = (np.asarray(part, float) for part in some.samples)
    exits = np.sum(normals * outgoing, axis=1)
    diffuse, lobes = np.zeros(some.count), np.zeros((len(widths), some.count))
    for towards, energy in sources:
        entry = np.sum(normals * towards, axis=1)
        between = np.sum(outgoing * towards, axis=1)
        lit = np.where(entry > 0, energy, 0)
        # The square of the half vector's cosine to the normal, and of its tangent.
        squared = np.clip((entry + exits) ** 2 / np.maximum(2 + 2 * between, 1e-12), 1e-12, 1)
        tangent = (1 - squared) / squared
        diffuse += lit * entry
        for lobe, width in zip(lobes, widths):
            lobe += lit / (width * squared * (1 + tangent / width**2)) ** 2
    return diffuse, lobes / np.maximum(exits, 0.02)


def _of_columns(columns: Float[np.ndarray, "sample 4"]) -> Float[np.ndarray, "sample"]:
    """Compute x (X' X)^-1 x' for every row; columns that depend on the others count nothing."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(size > 0, size, 1)
    return np.einsum(
        "si,ij,sj->s", columns, np.linalg.pinv(columns.T @ columns, 1e-8, hermitian=True), columns
    )
