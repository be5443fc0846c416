"""Point masses of a known light as samples see it: for the exact integral, and for the dual model.

A sample sees the environment and the sources of its photograph.  Where sources have a place, each
sample sees them in directions of its own.
"""

from collections.abc import Sequence

import numpy as np

from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.near_light import near_nodes
from jaxrender.inverse.observations import Observations
from jaxrender.lighting import Environment, LightNodes, condensed
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import AnyArray, Float, Int, checked

# Environments above this size are condensed for the exact integral, to cells this narrow.
_MOST_NODES = 2**15
_NODE_ANGLE_PER_SIGMA = 1 / 6


def exact_nodes(
    light: KnownLight,
    seen_by: Observations | Int[np.ndarray, "sample"] | None,
    sigma: float,
    angle_per_sigma: float | None = None,
) -> tuple[LightNodes | FrameNodes, ...]:
    """List the light's point masses: every texel with light in it, and every source.

    Environments of more than 32,768 texels are condensed to cells of sigma / 6, and any to cells
    of ``angle_per_sigma`` times sigma where that is given.  The photographs of samples alone will
    do where no source is near; None: the object's centre sees the light.  Raises ``ValueError`` for
    sources that are near, and samples that do not say where they lie.
    """
    frame = np.zeros(0, int) if seen_by is None else seen_by
    if isinstance(frame, Observations):
        frame = np.asarray(frame.frame)
    near = seen_by is not None and light.near is not None
    parts: list[LightNodes | FrameNodes] = []
    shared = [] if near else [light.directional.nodes()]
    surrounding = environment_nodes(light, sigma, angle_per_sigma, frame)
    if isinstance(surrounding, LightNodes):
        shared.append(surrounding)
    if shared:
        directions, irradiance = (np.concatenate(arrays) for arrays in zip(*shared))
        if len(directions):
            parts.append(LightNodes(directions, irradiance))
    if isinstance(surrounding, FrameNodes):
        parts.append(surrounding)
    if near:
        return (*parts, *_near_parts(light, frame, _points_of(seen_by)))
    frames = frame_nodes(light, frame)
    return tuple(parts) if frames is None else (*parts, frames)


def own_sources(light: KnownLight, observations: Observations) -> FrameNodes | None:
    """Stack the sources that samples see in directions of their own; None where all see the same.

    Without a place, sources of single photographs are such; with one, all are.
    """
    frame = np.asarray(observations.frame)
    if light.near is None:
        return frame_nodes(light, frame)
    parts = _near_parts(light, frame, _points_of(observations))
    directions, irradiance = (
        np.concatenate([np.asarray(part[at]) for part in parts], axis=1) for at in (0, 1)
    )
    return FrameNodes(directions, irradiance, np.arange(len(frame)))


def _points_of(
    seen_by: Observations | Int[np.ndarray, "sample"] | None,
) -> Float[np.ndarray, "sample 3"]:
    """Where samples lie.  Raises ``ValueError`` where nobody says so."""
    if not isinstance(seen_by, Observations) or seen_by.places is None:
        raise ValueError("sources that are near need to know where the samples lie: give places")
    return np.asarray(seen_by.places.points, float)


@checked
def frame_nodes(light: KnownLight, frame_of_sample: Int[np.ndarray, "sample"]) -> FrameNodes | None:
    """Stack the sources of all photographs, with dark ones where a photograph has fewer."""
    if light.per_frame is None:
        return None
    return stacked([source.nodes() for source in light.per_frame], np.asarray(frame_of_sample))


@checked
def environment_nodes(
    light: KnownLight,
    sigma: float,
    angle_per_sigma: float | None,
    frame_of_sample: Int[np.ndarray, "sample"],
) -> LightNodes | FrameNodes | None:
    """List the point masses of what surrounds the object, for ``exact_nodes``."""
    found = [_nodes_of(image, sigma, angle_per_sigma) for image in light.images]
    if light.environment is not None:
        return found[0] if light.turn is None else _turned(found[0], light.turn)
    if light.environments is None:
        return None
    channels = light.directional.irradiance.shape[1]
    dark = LightNodes(np.zeros((0, 3)), np.zeros((0, channels)))
    own = [dark if at < 0 else found[at] for at in light.image_of_frame.tolist()]
    if light.turns is not None:
        own = [_turned(nodes, turn) for nodes, turn in zip(own, light.turns)]
    return stacked(own, np.asarray(frame_of_sample))


def _near_parts(
    light: KnownLight,
    frame_of_sample: Int[np.ndarray, "sample"],
    points: Float[np.ndarray, "sample 3"],
) -> list[FrameNodes]:
    """List near sources as each sample sees them: those of all photographs, and its own."""
    if light.near is None:
        return []
    points, found = light.near.relative(points), []
    directions, irradiance = (np.asarray(a, float) for a in light.directional.nodes())
    if len(directions):
        every = np.broadcast_to(irradiance, (len(points), *irradiance.shape))
        towards = np.broadcast_to(directions, (len(points), *directions.shape))
        found.append(near_nodes(points, towards, every, np.asarray(light.near.of_sources)))
    frames = frame_nodes(light, frame_of_sample)
    if frames is not None:
        at, each = frame_of_sample, np.asarray(light.near.of_frames)
        own = np.asarray(frames.directions)[at], np.asarray(frames.irradiance)[at]
        found.append(near_nodes(points, *own, each[at] if len(each) > 1 else each))
    return found


def _nodes_of(image: Environment, sigma: float, angle_per_sigma: float | None) -> LightNodes:
    """List the texels of an image with light in them, or its cells."""
    nodes = image.nodes()
    if angle_per_sigma is not None or nodes.directions.shape[0] > _MOST_NODES:
        nodes = condensed(image, (angle_per_sigma or _NODE_ANGLE_PER_SIGMA) * sigma)
    lit = np.any(np.asarray(nodes.irradiance) > 0, axis=1)
    return LightNodes(np.asarray(nodes.directions)[lit], np.asarray(nodes.irradiance)[lit])


def _turned(nodes: LightNodes, turn: Float[AnyArray, "3 3"]) -> LightNodes:
    return nodes._replace(directions=np.asarray(nodes.directions) @ np.asarray(turn).T)


def stacked(nodes: Sequence[LightNodes], frame_of_sample: Int[np.ndarray, "sample"]) -> FrameNodes:
    """Stack the nodes of all photographs, with dark ones where a photograph has fewer."""
    most = max(len(own.directions) for own in nodes)
    channels = nodes[0].irradiance.shape[1]
    directions = np.tile([0.0, 0.0, 1.0], (len(nodes), most, 1))
    irradiance = np.zeros((len(nodes), most, channels))
    for frame, own in enumerate(nodes):
        directions[frame, : len(own.directions)] = own.directions
        irradiance[frame, : len(own.directions)] = own.irradiance
    return FrameNodes(directions, irradiance, frame_of_sample)
