"""What the header of a photograph tells of its camera: size, focal length, exposure (EXIF)."""

from pathlib import Path
from typing import NamedTuple

import OpenImageIO as oiio

from jaxrender.io.images import image_size
from jaxrender.io.raw import RawHeader, is_raw, read_raw_header

# The longer side of a film of 35 mm.
_FILM = 36.0


class PhotoHeader(NamedTuple):
    """A photograph's size in pixels, and what it says of how it was taken; None where nothing.

    ``focal_length`` is in pixels.  ``exposure`` is seconds times ISO / 100 over the f-number
    squared; what it does not state of these counts as 1.  ``raw`` is what camera RAW states.
    """

    width: int
    height: int
    is_integer: bool
    bits: int
    focal_length: float | None
    exposure: float | None
    raw: RawHeader | None = None


def read_photo_header(path: Path) -> PhotoHeader:
    """Read a header; raises InputError for what is no picture."""
    if is_raw(path):
        raw = read_raw_header(path)
        return PhotoHeader(raw.width, raw.height, True, raw.bits, None, None, raw)
    width, height = image_size(path)
    file = oiio.ImageInput.open(str(path))
    spec = oiio.ImageSpec() if file is None else file.spec()

    def stated(*names: str) -> float | None:
        values = (spec.get_float_attribute(name, 0.0) for name in names)
        return next((value for value in values if value > 0), None)

    film = stated("Exif:FocalLengthIn35mmFilm")
    seconds = stated("ExposureTime", "Exif:ExposureTime")
    exposure = None
    if seconds is not None:
        sensitivity = stated("Exif:ISOSpeedRatings", "Exif:PhotographicSensitivity") or 100.0
        exposure = seconds * sensitivity / 100 / (stated("FNumber", "Exif:FNumber") or 1.0) ** 2
    return PhotoHeader(
        width,
        height,
        spec.format.basetype not in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE),
        spec.get_int_attribute("oiio:BitsPerSample", spec.format.size() * 8),
        None if film is None else film / _FILM * max(width, height),
        exposure,
    )
