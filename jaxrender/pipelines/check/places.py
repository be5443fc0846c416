"""Where the object lies, found by its silhouettes where the config has it elsewhere."""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.geometry import Mesh, Placement
from jaxrender.inverse.alignment import align, sphere_of_silhouettes
from jaxrender.inverse.conventions import FoundFraming, Silhouettes
from jaxrender.pipelines.check.mend import Place
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.config.geometry import GeometryConfig
from jaxrender.pipelines.scene import shape_of

# Turns and lengths are written to so many digits.
_DIGITS = 9
# Pixels along the longest side by which a ball is looked for.
_PIXELS = 256


class FoundPlace(NamedTuple):
    """What the config should say of where the object lies, in words and as keys."""

    found: bool
    overlap: float
    changes: dict[Place, Any]
    sentence: str


def find_place(
    config: RunConfig, silhouettes: Silhouettes, framing: FoundFraming
) -> FoundPlace | None:
    """Look for the object, its cameras meant as they are told; None where it lies no better."""
    geometry = config.capture.geometry
    assert geometry is not None
    seen = silhouettes.meant(framing.told)
    found = _ball(seen) if geometry.sphere is not None else _mesh(geometry, seen)
    return found if not found.found or found.overlap > framing.overlap else None


def _ball(seen: Silhouettes) -> FoundPlace:
    small = seen.shrunk(_PIXELS)
    try:
        found = sphere_of_silhouettes(small.cameras, small.masks)
    except ValueError as error:
        return FoundPlace(False, 0.0, {}, f"the ball's place was not found: {error}")
    center = tuple(rounded(x) for x in found.sphere.center)
    radius = rounded(found.sphere.radius)
    overlap = float(small.overlaps(found.sphere).mean())
    changes: dict[Place, Any] = {
        ("capture", "geometry", "sphere", "center"): center,
        ("capture", "geometry", "sphere", "radius"): radius,
    }
    said = (
        f"the ball lies at [{', '.join(f'{x:.4g}' for x in center)}] (+- {found.centre_error:.1g}) "
        f"with radius {radius:.4g} (+- {found.radius_error:.1g}): overlap {overlap:.2f}"
    )
    return FoundPlace(True, overlap, changes, said)


def _mesh(geometry: GeometryConfig, seen: Silhouettes) -> FoundPlace:
    plain = geometry.model_copy(
        update={"scale": 1.0, "rotation": (0.0, 0.0, 0.0), "translation": (0.0, 0.0, 0.0)}
    )
    mesh = shape_of(plain)
    assert isinstance(mesh, Mesh)
    found = align(mesh, seen)
    if not found.found:
        return FoundPlace(False, found.overlap, {}, found.sentence())
    placement, here = found.placement, ("capture", "geometry")
    changes: dict[Place, Any] = {
        (*here, "scale"): rounded(placement.scale),
        (*here, "rotation"): tuple(rounded(x) for x in placement.degrees),
        (*here, "translation"): tuple(rounded(x) for x in placement.translation),
    }
    return FoundPlace(True, found.overlap, changes, found.sentence())


def placement_of(geometry: GeometryConfig) -> Placement:
    """Say where a config puts the shape that its file or its numbers describe."""
    if geometry.sphere is not None:
        return Placement()
    turn, shift = np.array(geometry.rotation, float), np.array(geometry.translation, float)
    return Placement.of_degrees(float(geometry.scale), turn, shift)


def rounded(value: float) -> float:
    """Round a number to the digits that a config should have."""
    return float(f"{value:.{_DIGITS}g}") + 0.0
