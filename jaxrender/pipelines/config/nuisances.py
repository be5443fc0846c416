"""Nuisances by name: those that a fit frees, and those that a recipe plants."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from jaxrender.pipelines.config.values import NonNegative, Section, auto_or_several

NuisanceName = Literal[
    "exposure",
    "camera",
    "object",
    "scale",
    "environment",
    "lamps",
    "nearness",
    "black",
    "response",
    "normals",
    "blur",
]


if TYPE_CHECKING:
    Free = Literal["auto"] | tuple[NuisanceName, ...]
else:
    Free = auto_or_several(NuisanceName)


class FaultsConfig(Section):
    """What is wrong with a capture: photographs are taken so, and its files do not tell."""

    exposure: NonNegative = 0.0
    """Standard deviation of the photographs' gains, percent."""
    camera: NonNegative = 0.0
    """Standard deviation of each camera's rotation about each axis, degrees."""
    object: NonNegative = 0.0
    """Standard deviation of the object's shift along each axis, percent of its size."""
    scale: NonNegative = 0.0
    """Standard deviation of the object's enlargement, percent."""
    environment: NonNegative = 0.0
    """Standard deviation of the environment's rotation about each axis, degrees."""
    lamps: NonNegative = 0.0
    """Standard deviation of each source's rotation, degrees; its brightness by ten times as many
    percent."""
    nearness: NonNegative = 0.0
    """The object's size over the distance of its sources; 0 is infinitely far."""
    black: NonNegative = 0.0
    """Standard deviation of each channel's black level, percent of a radiance of 1."""
    response: NonNegative = 0.0
    """Standard deviation of the response's exponent, percent."""
    normals: NonNegative = 0.0
    """Smooth bumps that turn normals by so many degrees (rms)."""
    blur: NonNegative = 0.0
    """Variance of a blur, pixels squared."""
