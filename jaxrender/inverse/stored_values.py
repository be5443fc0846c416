"""Stored values of photographs: where they are clipped, their radiance, what rounding adds."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from jaxrender.errors import InputError
from jaxrender.imaging import Curve, Response, SensorNoise, rounding, saturation_levels
from jaxrender.io import Frame, Image
from jaxrender.shapes import Bool, Float

# Integer formats clip at their largest value: within half a step of it a pixel is saturated.
FULL_SCALE = 0.998


def saturation_of(
    images: list[Image], stated: float | Literal["auto"] | None
) -> list[Float[np.ndarray, "channel"]]:
    """Find the stored values from which each channel of each photograph is left out.

    ``auto``: where values pile up at the top, and at full scale of pictures of integers; None: the
    latter alone.  Infinite where nothing is left out.
    """
    if stated is not None and stated != "auto":
        return [np.full(3, float(stated)) for _ in images]
    full = [FULL_SCALE if image.metadata.get("is_integer") else np.inf for image in images]
    found = [np.full(3, np.inf)] * len(images)
    if stated == "auto":
        found = saturation_levels([image.pixels for image in images])
    return [np.minimum(levels, whole) for levels, whole in zip(found, full)]


def clipped_sentence(
    images: Sequence[Image], levels: Sequence[Float[np.ndarray, "channel"]]
) -> str:
    """Say where ``capture.saturation: auto`` found photographs to be clipped."""
    clipped = [
        own[own <= image.pixels.max(axis=(0, 1))].min(initial=np.inf)
        for image, own in zip(images, levels)
        if (image.pixels >= own).any()
    ]
    if not clipped:
        return "capture.saturation auto: no value piles up at the top, and nothing is left out"
    lowest, highest = min(clipped), max(clipped)
    at = f"{lowest:.4g}" if highest - lowest <= 1e-4 * highest else f"{lowest:.4g} to {highest:.4g}"
    return (
        f"capture.saturation auto: pixels from the value {at} on are left out, in "
        f"{len(clipped)} of {len(levels)} photographs"
    )


def linearised(
    response: Response, frame: Frame, image: Image, usable: Bool[np.ndarray, "row column"]
) -> Float[np.ndarray, "row column channel"]:
    """Undo the response; only what is measured must lie on a measured curve."""
    values = image.pixels
    if isinstance(response, Curve):
        low, high = response.values[0], response.values[-1]
        outside = usable & ((values < low) | (values > high)).any(axis=-1)
        if outside.any():
            row, column = np.argwhere(outside)[0]
            raise InputError(
                f"{frame.image_path}: pixel (row {row}, column {column}): the values "
                f"{values[row, column]} leave the response curve, which covers {low:g} to "
                f"{high:g}; {outside.sum()} of {usable.sum()} usable pixels do: extend the curve, "
                "or leave them out with capture.black_level and capture.saturation"
            )
        values = np.clip(values, low, high)
    return np.asarray(response.linearise(values), float)


def rounding_of(
    image: Image, response: Response | None, radiance: Float[np.ndarray, "pixel channel"]
) -> float:
    """Compute the standard deviation of radiance that rounding adds to a usual value.

    It is a step over sqrt(12) times the slope of the response there, 0 for floating point.
    """
    if not image.metadata.get("is_integer") or not radiance.size:
        return 0.0
    sensor = SensorNoise(0.0, 0.0, rounding(int(image.metadata["bit_depth"])))
    return float(np.sqrt(np.median(sensor.variance(radiance, response))))
