"""A cube of light as KTX 2.0: read by a reader that follows the specification, field by field.

- Header, index and level lie where the specification says, and the texels are those of the faces.
- The descriptor speaks of linear floats of half or, for light beyond them, single precision.
- Rows go right and down, as is demanded of cubes.
"""

import struct
from typing import NamedTuple

import numpy as np
import pytest

from jaxrender.io.exports.ktx import ktx_of_faces

SIZE = 5
# KTX 2.0, 3.11: +X -X +Y -Y +Z -Z.
FACES = ("px", "nx", "py", "ny", "pz", "nz")


class Read(NamedTuple):
    """What a file says."""

    header: tuple[int, ...]
    descriptor: bytes
    pairs: dict[str, str]
    texels: np.ndarray


def read(content):
    assert content[:12] == b"\xabKTX 20\xbb\r\n\x1a\n"
    header = struct.unpack_from("<9I", content, 12)
    dfd, dfd_length, kvd, kvd_length = struct.unpack_from("<4I", content, 48)
    assert struct.unpack_from("<2Q", content, 64) == (0, 0)
    at, length, whole = struct.unpack_from("<3Q", content, 80)
    assert (dfd, kvd) == (104, 104 + dfd_length)
    assert length == whole == len(content) - at
    assert at % (4 * header[1]) == 0
    pairs, place = {}, kvd
    while place < kvd + kvd_length:
        (size,) = struct.unpack_from("<I", content, place)
        key, value, rest = content[place + 4 : place + 4 + size].split(b"\0")
        assert rest == b""
        pairs[key.decode()] = value.decode()
        place += 4 + size + -size % 4
    assert place == kvd + kvd_length
    texels = np.frombuffer(content, {2: "<f2", 4: "<f4"}[header[1]], offset=at)
    shape = header[6], header[3], header[2], 4
    return Read(header, content[dfd:kvd], pairs, texels.reshape(shape))


def faces(brightest=2.0, channels=3):
    rng = np.random.default_rng(0)
    return {n: brightest * rng.uniform(size=(SIZE, SIZE, channels)) for n in sorted(FACES)}


@pytest.mark.parametrize(
    ("brightest", "code", "length", "error"), [(2.0, 97, 2, 1e-3), (1e6, 109, 4, 1e-7)]
)
def test_a_cube_is_what_its_faces_are(brightest, code, length, error):
    given = faces(brightest)
    found = read(ktx_of_faces(given))
    # Format, bytes of a number, width, height, depth, layers, faces, levels, no compression.
    assert found.header == (code, length, SIZE, SIZE, 0, 0, 6, 1, 0)
    for name, face in zip(FACES, found.texels):
        np.testing.assert_allclose(face[..., :3], given[name], rtol=error)
    np.testing.assert_array_equal(found.texels[..., 3], 1)
    assert found.pairs == {"KTXorientation": "rd", "KTXwriter": "jaxrender"}
    assert list(found.pairs) == sorted(found.pairs)


@pytest.mark.parametrize(("brightest", "bits"), [(2.0, 16), (1e6, 32)])
def test_the_descriptor_is_that_of_linear_floats(brightest, bits):
    words = read(ktx_of_faces(faces(brightest))).descriptor
    assert len(words) == 92
    total, vendor_and_type, version, size = struct.unpack_from("<IIHH", words)
    assert (total, vendor_and_type, version, size) == (92, 0, 2, 88)
    # RGB with alpha, the primaries of BT.709, linear, alpha not premultiplied.
    assert tuple(words[12:16]) == (1, 1, 1, 0)
    assert tuple(words[16:20]) == (0, 0, 0, 0)
    assert tuple(words[20:28]) == (bits // 2, 0, 0, 0, 0, 0, 0, 0)
    for at, channel in enumerate((0, 1, 2, 15)):
        sample = struct.unpack_from("<HBBIff", words, 28 + 16 * at)
        assert sample == (at * bits, bits - 1, channel | 0xC0, 0, -1.0, 1.0)


def test_grey_light_has_three_channels_and_what_is_not_finite_is_refused():
    grey = faces(channels=1)
    found = read(ktx_of_faces(grey)).texels
    np.testing.assert_allclose(found[0, ..., 2], grey["px"][..., 0], rtol=1e-3)
    grey["nz"][0, 0] = np.inf
    with pytest.raises(ValueError, match="not finite"):
        ktx_of_faces(grey)
