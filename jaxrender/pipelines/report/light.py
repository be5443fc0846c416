"""The light: the environment, its slow part, and sources as circles (area: energy).

The environment is drawn as a latitude-longitude map of one unit a degree.  Sources without an
environment are drawn on two discs: the upper and the lower half of the sphere of directions, both
from above, in an equal-area projection.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse import KnownLight
from jaxrender.inverse.prepared_light import PreparedLight
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.report.display import data_uri, shrunk, tone_key, tone_mapped
from jaxrender.shapes import AnyArray, Float

_LONGEST_SIDE = 400
# Radius of the strongest source: degrees on the map, and in parts of the disc's radius.
_LARGEST_ON_MAP, _LARGEST_ON_DISC = 8.0, 0.11
# More sources than this go without numbers.
_NUMBERED = 40


class Circle(NamedTuple):
    """A source as it is drawn; ``label`` is the number of its photograph, if it has its own."""

    x: float
    y: float
    radius: float
    label: str = ""


class Map(NamedTuple):
    """The environment and its slow part as data URIs, with the sources taken out and the given."""

    environment: str
    slow: str | None
    taken: tuple[Circle, ...]
    given: tuple[Circle, ...]


class Surrounding(NamedTuple):
    """The environment of some photographs as a data URI, and the numbers of these in words."""

    picture: str
    photographs: str


class Disc(NamedTuple):
    """One half of the sphere of directions."""

    name: str
    circles: tuple[Circle, ...]


def environment_map(light: KnownLight, prepared: PreparedLight) -> Map | None:
    """Draw the environment, both parts with the same tone curve; None where there is none."""
    if light.environment is None:
        return None
    radiance = np.asarray(light.environment.radiance, float)
    key = tone_key(radiance)
    split = prepared.split
    taken = DirectionalSources.none() if split is None else split.sources
    slow = None
    if split is not None and taken.directions.shape[0]:
        slow = _picture(np.asarray(split.slow.radiance, float), key)
    strongest = max(_strongest(taken), _strongest(light.directional))
    return Map(
        _picture(radiance, key),
        slow,
        _on_map(taken, strongest),
        _on_map(light.directional, strongest),
    )


def surroundings(light: KnownLight) -> tuple[Surrounding, ...]:
    """Draw the environments of single photographs, each once."""
    return tuple(
        Surrounding(
            _picture(radiance, tone_key(radiance)),
            _numbers([at for at, own in enumerate(light.environments or (), 1) if own is image]),
        )
        for image in (light.images if light.environments is not None else ())
        for radiance in [np.asarray(image.radiance, float)]
    )


def _numbers(found: list[int]) -> str:
    """List numbers of photographs; a row of them by its ends."""
    if len(found) > 2 and found == list(range(found[0], found[-1] + 1)):
        return f"{found[0]} to {found[-1]}"
    return ", ".join(map(str, found))


def direction_discs(light: KnownLight) -> tuple[Disc, ...]:
    """Draw the sources that no map shows: all without an environment, and those of one frame."""
    groups = [("", light.directional)] if light.environment is None else []
    groups += _sources_by_photographs(light)
    groups = [(label, group) for label, group in groups if group.directions.shape[0]]
    if not groups:
        return ()
    directions = np.concatenate([np.asarray(group.directions, float) for _, group in groups])
    energy = np.concatenate([_energy(group.irradiance) for _, group in groups])
    labels = np.repeat(
        [label for label, _ in groups], [group.directions.shape[0] for _, group in groups]
    )
    if len(labels) > _NUMBERED:
        labels = np.full(len(labels), "")
    radius = _LARGEST_ON_DISC * np.sqrt(energy / max(energy.max(), 1e-300))
    rows = np.column_stack([_equal_area(directions), radius]).round(4).tolist()
    circles = [Circle(x, y, size, str(label)) for (x, y, size), label in zip(rows, labels)]
    upper = directions[:, 2] >= 0
    halves = (("upper half (light from above)", upper), ("lower half (light from below)", ~upper))
    return tuple(
        Disc(name, tuple(circles[k] for k in np.flatnonzero(half)))
        for name, half in halves
        if half.any()
    )


def _sources_by_photographs(light: KnownLight) -> list[tuple[str, DirectionalSources]]:
    """List the sources of single photographs; those of several alike, as of a capture, once."""
    found: dict[bytes, tuple[list[int], DirectionalSources]] = {}
    for number, own in enumerate(light.per_frame or (), 1):
        key = b"".join(np.asarray(part, float).tobytes() for part in own.nodes())
        found.setdefault(key, ([], own))[0].append(number)
    return [(_numbers(numbers), own) for numbers, own in found.values()]


def circles_on_map(sources: DirectionalSources) -> tuple[Circle, ...]:
    """Draw sources as circles on a map of one unit a degree."""
    return _on_map(sources, _strongest(sources))


def _picture(radiance: Float[np.ndarray, "row column channel"], key: float) -> str:
    return data_uri(tone_mapped(shrunk(radiance, _LONGEST_SIDE), key))


def _energy(irradiance: AnyArray) -> Float[np.ndarray, "source"]:
    return np.maximum(np.asarray(irradiance, float).mean(axis=-1), 0)


def _strongest(sources: DirectionalSources) -> float:
    return float(_energy(sources.irradiance).max(initial=0.0))


def _on_map(sources: DirectionalSources, strongest: float) -> tuple[Circle, ...]:
    x, y, z = np.asarray(sources.directions, float).T
    azimuth = np.degrees(np.arctan2(y, x)) % 360
    polar = np.degrees(np.arccos(np.clip(z, -1, 1)))
    share = _energy(sources.irradiance) / (strongest if strongest > 0 else 1.0)
    rows = np.stack([azimuth, polar, _LARGEST_ON_MAP * np.sqrt(share)], axis=1).round(2)
    return tuple(Circle(*row) for row in rows.tolist())


def _equal_area(directions: Float[np.ndarray, "source 3"]) -> Float[np.ndarray, "source 2"]:
    """Project each half of the sphere to the unit disc, +X right and +Y up (y grows down)."""
    x, y, z = directions.T
    along = np.hypot(x, y)
    stretch = np.sqrt(1 - np.abs(z).clip(0, 1)) / np.where(along > 0, along, 1)
    return np.stack([x * stretch, -y * stretch], axis=1)
