"""What a folder of another program says: the photographs, and what else stands beside them."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxrender.imaging.response import Curve
from jaxrender.io.captures.capture import Capture


class StatedSource(NamedTuple):
    """A directional source: where light comes from, and its irradiance in each channel."""

    direction: tuple[float, ...]
    irradiance: tuple[float, ...]


class StatedPoint(NamedTuple):
    """A source with a place, and the irradiance in each channel on a plane facing it at 1."""

    position: tuple[float, ...]
    intensity: tuple[float, ...]


class StatedEnvironment(NamedTuple):
    """A panorama, its convention, and the factor from its values to radiance.

    ``turn`` takes directions of the panorama's world to those of the capture; None where they are
    the same.  ``at_poles``: its first and last rows lie at the poles.  One that is ``mirrored`` is
    read from right to left, and then turned by the ``yaw``.
    """

    path: Path
    convention: str
    scale: float = 1.0
    turn: Float[np.ndarray, "3 3"] | None = None
    mirrored: bool = False
    yaw: float = 0.0
    at_poles: bool = False


class StatedLight(NamedTuple):
    """The light of the photographs; ``per_frame`` has the sources of each, in their order.

    ``environments`` are panoramas of each, where it has one of its own.
    """

    environment: StatedEnvironment | None = None
    directional: tuple[StatedSource, ...] = ()
    point: tuple[StatedPoint, ...] = ()
    per_frame: tuple[tuple[StatedSource | StatedPoint, ...], ...] | None = None
    environments: tuple[StatedEnvironment, ...] | None = None

    @property
    def given(self) -> bool:
        """Whether there is any light."""
        shared = self.environment or self.directional or self.point
        return bool(shared or self.per_frame or self.environments)


class StatedSphere(NamedTuple):
    """A sphere in world units."""

    center: tuple[float, ...]
    radius: float


class StatedSquare(NamedTuple):
    """A flat square about the origin, z = 0, with its front towards +z."""

    side: float


class Contents(NamedTuple):
    """A capture as another program has it.

    ``mesh``, ``sphere`` or ``square`` is the shape, where the format brings one; ``mesh_placed``
    takes it to the world (a rotation, a shift and one scale; None: it is there).  ``response`` is
    what it says of the pixels (linear, srgb), and ``curve`` their response where it is another.
    ``head_on`` says that the only light stands at the camera.  ``files`` are those that were read.
    ``found`` and ``assumed`` are sentences for whoever reads the capture: what the folder says, and
    what it leaves open.
    """

    capture: Capture
    files: tuple[Path, ...]
    mesh: Path | None = None
    mesh_placed: Float[np.ndarray, "4 4"] | None = None
    sphere: StatedSphere | None = None
    square: StatedSquare | None = None
    light: StatedLight = StatedLight()
    response: str | None = None
    curve: Curve | None = None
    head_on: bool = False
    found: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
