"""A material's covariance, kept with a result and carried into what is rendered from it.

To first order an image's variance is J C J', with J its derivatives by all that was fitted: K_d and
K_s of a channel, sigma, mu, the photograph's gain and the scale of the light.  Errors of a light
that was recovered along with the material are not in it.
"""

from pathlib import Path
from typing import NamedTuple

import h5netcdf
import numpy as np

from jaxrender.inverse.uncertainty import Parameters, Uncertain
from jaxrender.shapes import Float

_GROUP = "covariance"


class MaterialCovariance(NamedTuple):
    """The covariance of kd and ks by channel, sigma, mu, the gains by photograph, and the scale."""

    matrix: Float[np.ndarray, "number number"]
    channels: int

    def of_frame(self, frame: int | None) -> Float[np.ndarray, "channel 6 6"]:
        """Pick for each channel kd, ks, sigma, mu, gain and scale; None: a view without a gain."""
        count = self.channels
        gains = len(self.matrix) - 2 * count - 3
        has_gain = frame is not None and frame < gains
        blocks = []
        for channel in range(count):
            gain = 2 * count + 2 + (frame if has_gain and frame is not None else 0)
            rows = [channel, count + channel, 2 * count, 2 * count + 1, gain, -1]
            block = self.matrix[np.ix_(rows, rows)].copy()
            if not has_gain:
                block[4], block[:, 4] = 0, 0
            blocks.append(block)
        return np.stack(blocks)


def image_deviation(
    covariance: Float[np.ndarray, "channel 6 6"],
    slopes: Float[np.ndarray, "pixel 4 channel"],
    radiance: Float[np.ndarray, "pixel channel"],
    factors: tuple[float, float],
) -> Float[np.ndarray, "pixel channel"]:
    """Carry a covariance into the standard deviation of gain x scale x radiance.

    ``slopes`` are those of the radiance by K_d, K_s, sigma and mu, ``factors`` gain and scale.
    """
    gain, scale = factors
    by_factor = np.stack([scale * radiance, gain * radiance], axis=1)
    every = np.concatenate([gain * scale * slopes, by_factor], axis=1)
    variance = np.einsum("pic,cij,pjc->pc", every, covariance, every)
    return np.sqrt(np.maximum(variance, 0))


def write_covariance(file: h5netcdf.File, parameters: Uncertain) -> None:
    """Write the covariance with what its rows are, where it is known."""
    if parameters.covariance is None:
        return
    group = file.create_group(_GROUP)
    matrix = np.asarray(parameters.covariance)
    group.dimensions = {"number": len(matrix), "other_number": len(matrix)}
    group.attrs["channels"] = len(parameters.value.kd)
    group.attrs["numbers"] = " ".join(_names(parameters.value))
    group.create_variable("matrix", ("number", "other_number"), data=matrix)


def read_covariance(path: Path) -> MaterialCovariance | None:
    """Read the covariance of a result; None where it has none."""
    if not path.is_file():
        return None
    with h5netcdf.File(path, "r") as file:
        if _GROUP not in file.groups:
            return None
        group = file[_GROUP]
        channels = int(np.asarray(group.attrs["channels"]).item())
        return MaterialCovariance(np.asarray(group["matrix"][:]), channels)


def _names(parameters: Parameters) -> list[str]:
    """Name every number of the parameters, in order."""
    names = []
    for name, value in parameters._asdict().items():
        size = np.size(value)
        names += [name] if np.ndim(value) == 0 else [f"{name}[{k}]" for k in range(size)]
    return names
