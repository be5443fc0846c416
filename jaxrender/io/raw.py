"""Camera RAW files as linear radiance, through the extra ``raw`` (rawpy, which wraps LibRaw).

LibRaw makes three channels of the sensor's mosaic, subtracts the black level, and scales full scale
to 1.  No gamma, no automatic brightness, no white balance and no change of colours: red, green and
blue are the camera's own.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxrender.errors import InputError
from jaxrender.limits import PIXELS

RAW_SUFFIXES = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw")
_FULL = 65535


class RawPhotograph(NamedTuple):
    """Linear values of a sensor, 1 at full scale, and what its file states.

    ``camera_white`` are the factors by which the camera would balance red, green and blue, green
    being 1; they are not applied.  ``black_level`` and ``white_level`` are in the sensor's counts.
    """

    values: Float[np.ndarray, "row column channel"]
    camera_white: Float[np.ndarray, "3"]
    black_level: float
    white_level: float


class RawHeader(NamedTuple):
    """What the header of a RAW file states: the size of its picture, and as ``RawPhotograph``."""

    width: int
    height: int
    camera_white: Float[np.ndarray, "3"]
    black_level: float
    white_level: float

    @property
    def bits(self) -> int:
        """How many bits the counts between black and white fill."""
        return max(1, int(np.log2(max(self.white_level - self.black_level, 1) + 1)))


def is_raw(path: str | Path) -> bool:
    """Whether a file is named as camera RAW is."""
    return Path(path).suffix.lower() in RAW_SUFFIXES


def read_raw_header(path: str | Path) -> RawHeader:
    """Read the header of a RAW file; raises InputError as ``read_raw`` does."""
    with _opened(Path(path)) as raw:
        return _header(Path(path), raw)


def read_raw(path: str | Path) -> RawPhotograph:
    """Read a RAW file; raises InputError where rawpy is missing, or the file is not one."""
    with _opened(Path(path)) as raw:
        import rawpy  # pyright: ignore[reportMissingImports]

        header = _header(Path(path), raw)
        codes = raw.postprocess(
            gamma=(1, 1),
            no_auto_bright=True,
            output_bps=16,
            use_camera_wb=False,
            user_wb=[1.0, 1.0, 1.0, 1.0],
            output_color=rawpy.ColorSpace.raw,
            user_flip=0,
        )
    values = codes.astype(np.float64) / _FULL
    return RawPhotograph(values, header.camera_white, header.black_level, header.white_level)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    if not path.is_file():
        raise InputError(f"{path}: no such image file; mend the path")
    try:
        import rawpy  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise InputError(
            f"{path}: camera RAW needs the package rawpy: pip install 'jaxrender[raw]'"
        ) from None
    try:
        with rawpy.imread(str(path)) as raw:
            yield raw
    except InputError:
        raise
    except (rawpy.LibRawError, ValueError, OSError, MemoryError) as error:
        raise InputError(f"{path}: not a readable RAW file ({error}); save it as DNG") from None


def _header(path: Path, raw: Any) -> RawHeader:
    size = raw.sizes
    PIXELS.check(f"{path}: the header claims", size.width * size.height, "save it anew")
    white = np.asarray(raw.camera_whitebalance[:3], np.float64)
    balance = white / white[1] if white[1] > 0 else np.ones(3)
    black = float(np.mean(raw.black_level_per_channel))
    return RawHeader(size.width, size.height, balance, black, float(raw.white_level))
