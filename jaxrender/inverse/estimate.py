"""What a fit in Python found: printed, shown as a ball, and saved for other programs."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, Parametric
from jaxrender.geometry import Orthographic, Sphere, look_at
from jaxrender.imaging import NoiseModel
from jaxrender.imaging.display import exposed, exposure_for, png_of
from jaxrender.inverse.any_estimate import AnyEstimate
from jaxrender.inverse.brdf import BRDFFit
from jaxrender.inverse.brdf_table import Correction
from jaxrender.inverse.factorization import Factorization
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.own_words import plain
from jaxrender.io import write_environment
from jaxrender.io.atomic import replacing
from jaxrender.lighting import DirectionalSources, Environment, HarmonicLight, Light
from jaxrender.reflection import render_lit
from jaxrender.shapes import Float

# The ball is seen from a little above, so that light from the zenith and the horizon both show.
_SIDE, _EYE = 192, np.array([2.0, -3.0, 1.2])
# Rows of a picture of light that has no picture of its own.
_ROWS = 128


class _Fields(NamedTuple):
    """What an estimate of a material holds, in this order."""

    model: str
    material: Parametric
    light: Light
    values: dict[str, Float[np.ndarray, "..."]]
    standard_error: dict[str, Float[np.ndarray, "..."]]
    interval90: dict[str, Float[np.ndarray, "..."]]
    identifiable: dict[str, bool]
    outcome: Outcome
    reasons: tuple[str, ...]
    noise: NoiseModel
    relative_rms: float
    details: BRDFFit | Factorization
    correction: Correction | None = None


class Estimate(_Fields, AnyEstimate):
    """What a fit found, by the material's own numbers, and how well it is known.

    ``values``, ``standard_error`` and ``interval90`` have kd and ks for each channel; the last axis
    of an interval is lowest and highest.  ``light`` is that of the scene, of several captures that
    of the first.  Where it was unknown it is what was found, in units in which kd + ks is one in
    each channel unless both were known.  ``details`` is the fit itself.

    ``correction`` is the table that corrects the material, where one was asked for, and ``brdf``
    the material with it: what ``render`` shows best.
    """

    @property
    def title(self) -> str:
        """Name the model."""
        return self.model or type(self.material).__name__

    @property
    def brdf(self) -> BRDF:
        """The material, corrected by its table where it has one."""
        return self.material if self.correction is None else self.correction.brdf

    def _rows(self) -> list[str]:
        """List the numbers, and what a table has changed."""
        rows = super()._rows()
        return rows if self.correction is None else [*rows, f"  {self.correction.sentence}"]

    @property
    def shown_in(self) -> Light:
        """The light, or a source beside a camera where it is dark, as that of single photographs.

        The camera is that of ``ball``.
        """
        if np.any(np.asarray(self.light.nodes().irradiance)):
            return self.light
        white = np.ones((1, self.material.amplitudes.shape[1]))
        towards = np.array([[1.0, -3.0, 2.5]])
        return DirectionalSources(towards / np.linalg.norm(towards), white)

    def ball(self, side: int = _SIDE) -> Float[np.ndarray, "row column channel"]:
        """Render a ball of the material in the light, seen from a little above; [side, side, C].

        Where the light is dark a source beside the camera lights it.
        """
        pose = look_at(_EYE, np.zeros(3), np.eye(3)[2])
        camera = Orthographic(side, side, pose, scale=2.1 / side)
        return np.asarray(render_lit(self.brdf, self.shown_in, Sphere(np.zeros(3), 1.0), camera))

    def _repr_png_(self) -> bytes:
        """Show the ball in a notebook."""
        ball = self.ball()
        return png_of(exposed(ball, exposure_for(ball[ball.sum(axis=-1) > 0])))

    def _write(self, folder: Path) -> dict[str, Any]:
        """Write ``ball.png`` and panoramas of the light (z-up EXR); lay out the light.

        Sources and coefficients are numbers, the rest the names of the panoramas.  A material of
        three channels that a table corrects is written as ``table.binary``, as the MERL database
        has it.
        """
        lights = [_light(part, folder, k) for k, part in enumerate(self.light.parts)]
        with replacing(folder / "ball.png") as aside:
            aside.write_bytes(self._repr_png_())
        if self.correction is None:
            return {"light": lights}
        merl = self.correction.write_merl(folder)
        return {"light": lights, "table": {"merl": merl, "sentence": self.correction.sentence}}


def _light(part: Light, folder: Path, number: int) -> dict[str, Any]:
    """Lay out one light as numbers, or write its panorama and name the file."""
    if isinstance(part, HarmonicLight):
        return {"coefficients": plain(part.coefficients)}
    to_environment = getattr(part, "to_environment", None)
    environment = part if isinstance(part, Environment) else None
    if environment is None and to_environment is not None:
        environment = to_environment(_ROWS)
    if environment is None:
        directions, irradiance = part.nodes()
        return {"directions": plain(directions), "irradiance": plain(irradiance)}
    name = f"light_{number}.exr"
    write_environment(folder / name, environment)
    return {"environment": name}
