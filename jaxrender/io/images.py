"""Image files to and from arrays of pixel values, through OpenImageIO; camera RAW through ``raw``.

Contract: row 0 is the top of the picture, channels are red, green, blue, values are those that the
file stores.  Integer formats are scaled to 0..1 and *not* linearised: what a value means is the
business of ``imaging.response``.  Alpha stays apart and colours are never multiplied by it.

OpenImageIO lets several kinds of damage pass in silence (broken pixels, partial data, other
orientations, clipped values on writing); every one of them is an ``InputError`` here.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

# Its types are quoted in annotations: a class of equinox keeps all functions that its module names
# until after the interpreter's end, when the binding reports what they still hold as leaked.
import OpenImageIO as oiio
from jaxtyping import Bool, Float

from jaxrender.errors import InputError
from jaxrender.io.atomic import replacing
from jaxrender.io.encodings import LINEAR, stated_encoding
from jaxrender.io.raw import is_raw, read_raw, read_raw_header
from jaxrender.limits import PIXELS, check_packing
from jaxrender.shapes import AnyArray

INVALID_RULES = ("refuse", "mask")
_ANEW = "save the picture anew"
_MEND_OR_MASK = "mend the picture, or leave such pixels out with `invalid: mask`"
# For pictures that are needed whole.
MEND = "mend the picture"

# How each format stores what write_image is given.  EXR in full float: half precision would turn
# everything above 65504, such as the sun, into infinity without a word.
_STORED_AS = {
    ".exr": "float",
    ".hdr": "float",
    ".pfm": "float",
    ".tif": "float",
    ".tiff": "float",
    ".png": "uint8",
    ".jpg": "uint8",
    ".jpeg": "uint8",
    ".tga": "uint8",
}
_WITHOUT_ALPHA = (".hdr", ".pfm", ".jpg", ".jpeg")


class Image(NamedTuple):
    """One picture: RGB values, coverage where the file has any, and which pixels are broken.

    ``metadata`` has ``is_integer`` and ``bit_depth``, and where the file states them
    ``exposure_time`` in seconds and ``radiance_exposure``, the factor by which the writer of a
    Radiance file multiplied its values (it is not undone).  Of camera RAW it has ``white_red`` and
    ``white_blue``, by which the camera would balance white; that is not done.  ``invalid`` can be
    True only where the caller asked for broken pixels to be masked; such pixels are 0.
    ``encoding`` is what the file itself states about its values (``encodings``), None where it
    states nothing.
    """

    pixels: Float[np.ndarray, "row column channel"]
    alpha: Float[np.ndarray, "row column"] | None
    metadata: dict[str, bool | int | float]
    invalid: Bool[np.ndarray, "row column"]
    encoding: str | None = None


def read_image(path: str | Path, invalid: str = "refuse", remedy: str = _MEND_OR_MASK) -> Image:
    """Read one picture, grey repeated to three channels.

    ``invalid``: what happens to pixels that are not finite or negative, "refuse" or "mask";
    ``remedy`` is what the user is told to do about those that are refused.
    Raises InputError when the file is missing, damaged, turned, cropped, too large, or has pixels
    that are refused.
    """
    if invalid not in INVALID_RULES:
        raise ValueError(f"invalid={invalid!r}: choose one of {', '.join(INVALID_RULES)}")
    if is_raw(path):
        return _of_raw(path)
    with _damage(Path(path)):
        file, spec = _open(Path(path))
        values = _values(Path(path), file, spec)
        colours, alpha = _split_channels(Path(path), spec, values)
        metadata, encoding = _metadata(spec), stated_encoding(spec)
    broken, complaint = _invalid_pixels(Path(path), colours, alpha)
    if complaint and invalid == "refuse":
        raise InputError(f"{complaint}: {remedy}")
    colours[broken] = 0
    if alpha is not None:
        alpha[broken] = 0
    pixels = np.repeat(colours, 3 // colours.shape[-1], -1)
    return Image(pixels, alpha, metadata, broken, encoding)


def image_size(path: str | Path) -> tuple[int, int]:
    """Read width and height in pixels from a picture's header."""
    if is_raw(path):
        header = read_raw_header(path)
        return header.width, header.height
    with _damage(Path(path)):
        _, spec = _open(Path(path))
    return spec.width, spec.height


def write_image(path: str | Path, pixels: Float[AnyArray, "row column channel"]) -> None:
    """Write 1 (grey), 3 (RGB) or 4 (RGB, alpha) channels; the suffix chooses the format.

    EXR, HDR, PFM and TIFF hold float values, PNG, JPEG and TGA 8 bits of 0..1.  The file appears
    whole or not at all.  Raises InputError for values that the format cannot hold.
    """
    path = Path(path)
    values = _writable(path, np.asarray(pixels))
    with replacing(path) as aside:
        _write(path, aside, values)


def _of_raw(path: str | Path) -> Image:
    """Read camera RAW, which is linear, has whole numbers, and nothing that is broken."""
    found = read_raw(path)
    bits = read_raw_header(path).bits
    red, _, blue = (float(one) for one in found.camera_white)
    metadata = {"is_integer": True, "bit_depth": bits, "white_red": red, "white_blue": blue}
    return Image(found.values, None, metadata, np.zeros(found.values.shape[:2], bool), LINEAR)


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Say that a picture is damaged where the library's own words or names are no text."""
    try:
        yield
    except (UnicodeDecodeError, MemoryError, RuntimeError, OverflowError) as error:
        said = str(error)
        if isinstance(error, UnicodeDecodeError):
            # What the library tried to say, damaged bytes and all.
            said = error.object.decode("utf-8", "replace")
        raise InputError(f"{path}: a damaged image ({_one_line(said)}); {_ANEW}") from None


def _open(path: Path) -> "tuple[oiio.ImageInput, oiio.ImageSpec]":
    """Open a picture and refuse the headers that the rest of this module cannot honour."""
    if not path.is_file():
        raise InputError(f"{path}: no such image file; mend the path")
    # Alpha is coverage here, a mask: colours must not be multiplied by it.
    wish = oiio.ImageSpec()
    wish.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(str(path), wish)
    if file is None:
        raise InputError(f"{path}: not a readable image ({_one_line(oiio.geterror())}); {_ANEW}")
    spec = file.spec()
    _check_header(path, spec)
    return file, spec


def _check_header(path: Path, spec: "oiio.ImageSpec") -> None:
    pixels = spec.width * spec.height
    said = f"{path}: the header claims {spec.width} x {spec.height} and {spec.nchannels} channels"
    PIXELS.check(said, pixels * -(-spec.nchannels // 4), _ANEW)
    numbers = pixels * spec.nchannels
    check_packing(said, numbers, numbers * spec.format.size(), path.stat().st_size)
    if spec.deep or spec.depth > 1:
        raise InputError(f"{path}: a deep or volume image; save it as a flat one")
    orientation = spec.get_int_attribute("Orientation", 1)
    if orientation != 1:
        raise InputError(
            f"{path}: the Orientation tag is {orientation}, so the stored rows and columns are not "
            "those of the camera; save the picture upright, with Orientation 1"
        )
    window = (spec.x, spec.y, spec.width, spec.height)
    display = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    if window != display:
        raise InputError(
            f"{path}: data window {window} differs from display window {display} "
            "(x, y, width, height); save the whole picture"
        )


def _values(path: Path, file: "oiio.ImageInput", spec: "oiio.ImageSpec") -> np.ndarray:
    """Read all channels as float64, integers divided by their largest value."""
    integer = _is_integer(spec)
    values = file.read_image(spec.format if integer else "double")
    # A damaged JPEG comes back grey from the damage on, with an error that must be asked for.
    trouble = file.geterror() if file.has_error else ""
    if values is None or trouble:
        raise InputError(
            f"{path}: the pixels cannot be read, is the file cut short? ({_one_line(trouble)}); "
            f"{_ANEW}"
        )
    values = values.reshape(spec.height, spec.width, spec.nchannels)
    return values / np.iinfo(values.dtype).max if integer else values.astype(np.float64)


def _split_channels(
    path: Path, spec: "oiio.ImageSpec", values: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None]:
    """Pick the RGB or grey channels by name, and alpha."""
    names = list(spec.channelnames)
    alpha = values[..., spec.alpha_channel].copy() if spec.alpha_channel >= 0 else None
    if {"R", "G", "B"} <= set(names):
        chosen = [names.index(name) for name in "RGB"]
    else:
        chosen = [i for i in range(len(names)) if i not in (spec.alpha_channel, spec.z_channel)]
    if len(chosen) not in (1, 3):
        raise InputError(
            f"{path}: channels {', '.join(names)}; wanted R, G, B or one grey channel, "
            "with or without alpha"
        )
    return values[..., chosen], alpha


def _invalid_pixels(
    path: Path, colours: np.ndarray, alpha: np.ndarray | None
) -> tuple[np.ndarray, str]:
    """Find the pixels with a value that is not finite or negative, and say where the first is."""
    channels = dict(zip("RGB" if colours.shape[-1] == 3 else "Y", np.moveaxis(colours, -1, 0)))
    if alpha is not None:
        channels["alpha"] = alpha
    broken = {name: ~(np.isfinite(values) & (values >= 0)) for name, values in channels.items()}
    anywhere = np.logical_or.reduce(list(broken.values()))
    if not anywhere.any():
        return anywhere, ""
    row, column = np.argwhere(anywhere)[0]
    name = next(name for name, where in broken.items() if where[row, column])
    return anywhere, (
        f"{path}: channel {name}, pixel (row {row}, column {column}): the value is "
        f"{channels[name][row, column]:g}; {anywhere.sum()} of {anywhere.size} pixels are negative "
        "or not finite"
    )


def _metadata(spec: "oiio.ImageSpec") -> dict[str, bool | int | float]:
    known: dict[str, bool | int | float] = {
        "is_integer": _is_integer(spec),
        "bit_depth": spec.get_int_attribute("oiio:BitsPerSample", spec.format.size() * 8),
    }
    for key, attribute in (
        ("exposure_time", "ExposureTime"),
        ("radiance_exposure", "hdr:exposure"),
    ):
        value = spec.get_float_attribute(attribute, -1)
        if value > 0:
            known[key] = value
    return known


def _writable(path: Path, pixels: np.ndarray) -> np.ndarray:
    """Check that the format can hold the values, and make them contiguous float32."""
    suffix = path.suffix.lower()
    if suffix not in _STORED_AS:
        raise InputError(f"{path}: unknown image format {suffix!r}; use {', '.join(_STORED_AS)}")
    channels = (1, 3) if suffix in _WITHOUT_ALPHA else (1, 3, 4)
    if pixels.shape[-1] not in channels or pixels.size == 0:
        raise InputError(
            f"{path}: cannot write shape {pixels.shape}; wanted [row, column, channel], not empty, "
            f"with {' or '.join(map(str, channels))} channels"
        )
    with np.errstate(over="ignore"):
        values = np.ascontiguousarray(pixels, dtype=np.float32)
    if _STORED_AS[suffix] == "uint8":
        _check_range(path, values, 0.0, 1.0, "8 bits hold 0 to 1")
    elif suffix == ".hdr":
        _check_range(path, values, 0.0, np.inf, "Radiance files hold no negative values")
    else:
        _check_range(path, values, -np.inf, np.inf, "only finite values can be read again")
    return values


def _check_range(path: Path, values: np.ndarray, low: float, high: float, reason: str) -> None:
    bad = ~(np.isfinite(values) & (values >= low) & (values <= high))
    if bad.any():
        row, column, channel = np.argwhere(bad)[0]
        raise InputError(
            f"{path}: channel {channel}, pixel (row {row}, column {column}): cannot write "
            f"{values[row, column, channel]:g}; {reason}"
        )


def _write(path: Path, aside: Path, values: np.ndarray) -> None:
    output = oiio.ImageOutput.create(str(aside))
    if output is None:
        raise InputError(f"{path}: cannot be written ({_one_line(oiio.geterror())})")
    suffix = path.suffix.lower()
    rows, columns, channels = values.shape
    spec = oiio.ImageSpec(columns, rows, channels, _STORED_AS[suffix])
    spec.attribute("oiio:UnassociatedAlpha", 1)
    # Without the time of writing equal pictures are equal files, and runs on them the same run.
    spec.attribute("DateTime", "")
    if suffix == ".exr":
        # Named, because `scene_linear` means ACEScg to OpenImageIO.
        spec.attribute("oiio:ColorSpace", "lin_rec709")
    for step in (
        lambda: output.open(str(aside), spec),
        lambda: output.write_image(values),
        output.close,
    ):
        if not step():
            raise InputError(f"{path}: cannot be written ({_one_line(output.geterror())})")


def _is_integer(spec: "oiio.ImageSpec") -> bool:
    return spec.format.basetype not in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)


def _one_line(text: str) -> str:
    return "; ".join(text.split("\n"))
