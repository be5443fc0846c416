"""A material's covariance, kept with a result and carried into what is rendered from it.

To first order the variance of an image is J C J'.  J are its derivatives by all fitted numbers: K_d
and K_s of a channel, the lobe's numbers, the photograph's gain and the scale of the light.  The
errors of a recovered light are not included.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.inverse.intervals import Uncertain
from jaxrender.inverse.parameters import Parameters
from jaxrender.io.netcdf import Group, Variable, opened
from jaxrender.pipelines.result import ARRAYS_FORMAT
from jaxrender.shapes import Float

_GROUP, _MATRIX = "covariance", ("number", "other_number")


class MaterialCovariance(NamedTuple):
    """The covariance of kd and ks by channel, the lobe's numbers, the gains, and the scale.

    ``names`` say what each row is: ``kd[0]``, ``sigma``, ``gains[2]``, ``scale``.
    """

    matrix: Float[np.ndarray, "row row"]
    channels: int
    names: tuple[str, ...]

    def of_frame(
        self, frame: int | None, amplitudes: Iterable[str], numbers: Iterable[str]
    ) -> Float[np.ndarray, "channel part part"]:
        """Pick for each channel amplitudes, numbers, gain, scale; None: a view without a gain."""
        has_gain = frame is not None and f"gains[{frame}]" in self.names
        gain = f"gains[{frame if has_gain else 0}]"
        blocks = []
        for channel in range(self.channels):
            own = (*(f"{name}[{channel}]" for name in amplitudes), *numbers)
            rows = [self.names.index(name) for name in (*own, gain, "scale")]
            block = self.matrix[np.ix_(rows, rows)].copy()
            if not has_gain:
                block[-2], block[:, -2] = 0, 0
            blocks.append(block)
        return np.stack(blocks)


def image_deviation(
    covariance: Float[np.ndarray, "channel part part"],
    slopes: Float[np.ndarray, "pixel number channel"],
    radiance: Float[np.ndarray, "pixel channel"],
    gain: float,
    scale: float,
) -> Float[np.ndarray, "pixel channel"]:
    """Carry a covariance into the standard deviation of gain x scale x radiance.

    ``slopes`` are the derivatives of the radiance by amplitudes and numbers.
    """
    by_factor = np.stack([scale * radiance, gain * radiance], axis=1)
    every = np.concatenate([gain * scale * slopes, by_factor], axis=1)
    variance = np.einsum("pic,cij,pjc->pc", every, covariance, every)
    return np.sqrt(np.maximum(variance, 0))


def covariance_groups(parameters: Uncertain) -> dict[str, Group]:
    """Lay out the covariance with what its rows are; no group where it is not known."""
    if parameters.covariance is None:
        return {}
    matrix = Variable(_MATRIX, parameters.covariance, "", "covariance of `numbers`")
    names = " ".join(parameters.value.labels)
    attributes = {"channels": _channels(parameters.value), "numbers": names}
    return {_GROUP: Group({"matrix": matrix}, attributes)}


def read_covariance(path: Path) -> MaterialCovariance | None:
    """Read the covariance of a result; None where it has none.

    Raises ``InputError`` where the file has gone or is damaged.
    """
    with opened(path, ARRAYS_FORMAT) as file:
        if _GROUP not in file:
            return None
        group = file.group(_GROUP)
        matrix, channels = group.array("matrix", _MATRIX), group.attribute("channels", int)
        return MaterialCovariance(matrix, channels, tuple(group.attribute("numbers", str).split()))


def _channels(parameters: Parameters) -> int:
    return len(next(iter(parameters.amplitudes.values())))
