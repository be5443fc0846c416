"""The cube around the object as one file that engines load as it is: KTX 2.0, not compressed.

Khronos KTX File Format 2.0: a header, a data format descriptor (Khronos Data Format 1.3), pairs of
keys and values, and the texels of the six faces, +x -x +y -y +z -z, row by row from the top.
Numbers are half floats with an alpha of 1, as graphics processors filter them.  Light that half
floats cannot hold is written in single precision.
"""

import struct
from collections.abc import Mapping

import numpy as np

from jaxrender.shapes import Float

# In the order in which a file holds them.
_FACES = ("px", "nx", "py", "ny", "pz", "nz")
_IDENTIFIER = bytes([0xAB]) + b"KTX 20" + bytes([0xBB]) + b"\r\n\x1a\n"
# VK_FORMAT_R16G16B16A16_SFLOAT and VK_FORMAT_R32G32B32A32_SFLOAT.
_FORMATS = {np.dtype("<f2"): 97, np.dtype("<f4"): 109}
_LARGEST_HALF = float(np.finfo(np.float16).max)
_RGB, _BT709, _LINEAR = 1, 1, 1
_RED_GREEN_BLUE_ALPHA, _SIGNED_FLOAT = (0, 1, 2, 15), 0xC0
# The bytes of the header with its index, and of the index of one level.
_HEADER, _LEVEL = 80, 24


def ktx_of_faces(faces: Mapping[str, Float[np.ndarray, "row row channel"]]) -> bytes:
    """Lay out the faces ``px`` to ``nz`` of a cube, of three channels or of one, as a file.

    Raises ``ValueError`` for radiance that is not finite.
    """
    in_order = [np.asarray(faces[name]) for name in _FACES]
    texels = np.stack([np.broadcast_to(face, (*face.shape[:2], 3)) for face in in_order])
    if not np.all(np.isfinite(texels)):
        raise ValueError("radiance is not finite: a cube of it cannot be written")
    size = texels.shape[1]
    fits = np.max(np.abs(texels), initial=0.0) <= _LARGEST_HALF
    dtype = np.dtype("<f2") if fits else np.dtype("<f4")
    opaque = np.ones((*texels.shape[:3], 1))
    level = np.concatenate([texels, opaque], axis=3).astype(dtype).tobytes()
    described, told = _descriptor(dtype), _pairs()
    at = _HEADER + _LEVEL
    start = at + len(described) + len(told)
    # A level begins at a multiple of its texels' bytes.
    gap = -start % (4 * dtype.itemsize)
    head = struct.pack("<9I", _FORMATS[dtype], dtype.itemsize, size, size, 0, 0, len(_FACES), 1, 0)
    parts = struct.pack("<4I2Q", at, len(described), at + len(described), len(told), 0, 0)
    index = struct.pack("<3Q", start + gap, len(level), len(level))
    return b"".join([_IDENTIFIER, head, parts, index, described, told, bytes(gap), level])


def _descriptor(dtype: np.dtype) -> bytes:
    """Describe a texel: linear red, green, blue with the primaries of BT.709, and alpha."""
    bits = 8 * dtype.itemsize
    samples = b"".join(
        # Of floats the limits are -1 and 1, in single precision whatever the length.
        struct.pack("<HBBIff", bits * at, bits - 1, channel | _SIGNED_FLOAT, 0, -1.0, 1.0)
        for at, channel in enumerate(_RED_GREEN_BLUE_ALPHA)
    )
    block = struct.pack("<4B", _RGB, _BT709, _LINEAR, 0)
    block += bytes(4) + bytes([4 * dtype.itemsize]) + bytes(7) + samples
    # Vendor and type are Khronos's basic ones; the version is that of the data format 1.3.
    block = struct.pack("<IHH", 0, 2, 8 + len(block)) + block
    return struct.pack("<I", 4 + len(block)) + block


def _pairs() -> bytes:
    """Say that rows go right and down, as those of cubes do, and who wrote the file."""
    found = b""
    for key, value in (("KTXorientation", "rd"), ("KTXwriter", "jaxrender")):
        pair = f"{key}\0{value}\0".encode()
        found += struct.pack("<I", len(pair)) + pair + bytes(-len(pair) % 4)
    return found
