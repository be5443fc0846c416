"""Camera RAW files as linear radiance, through the extra ``raw`` (rawpy, which wraps LibRaw).

LibRaw makes three channels of the sensor's mosaic, subtracts the black level, and scales full scale
to 1.  No gamma, no automatic brightness, no white balance and no change of colours: red, green and
blue are the camera's own.
"""

from pathlib import Path
from typing import NamedTuple

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


def read_raw(path: str | Path) -> RawPhotograph:
    """Read a RAW file; raises InputError where rawpy is missing, or the file is not one."""
    path = Path(path)
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
            size = raw.sizes
            PIXELS.check(f"{path}: the header claims", size.width * size.height, "save it anew")
            white = np.asarray(raw.camera_whitebalance[:3], np.float64)
            black = float(np.mean(raw.black_level_per_channel))
            level = float(raw.white_level)
            codes = raw.postprocess(
                gamma=(1, 1),
                no_auto_bright=True,
                output_bps=16,
                use_camera_wb=False,
                user_wb=[1.0, 1.0, 1.0, 1.0],
                output_color=rawpy.ColorSpace.raw,
                user_flip=0,
            )
    except (rawpy.LibRawError, ValueError, OSError, MemoryError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not a readable RAW file ({error}); save it as DNG") from None
    balance = white / white[1] if white[1] > 0 else np.ones(3)
    return RawPhotograph(codes.astype(np.float64) / _FULL, balance, black, level)
