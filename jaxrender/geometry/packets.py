"""Shadow rays in packets of sixteen, a third quicker than one by one.

embreex asks Embree about single rays only.  Where Numba is installed, a loop compiled by it
(``packet_loop``) calls Embree's packet query in the library that embreex's wheel brings along.  The
numbers below are those of Embree 4's headers.
"""

import ctypes
import logging
import weakref
from functools import cache
from importlib import metadata
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

# What the packet queries are called in Numba's code, by their width, widest first: another Embree
# in this process (Mitsuba's) has queries of Embree's own names.
PACKET_QUERIES = {16: "jaxrender_rtcOccluded16", 8: "jaxrender_rtcOccluded8"}
# RTCDeviceProperty: Embree's version, and whether the processor takes packets of that width.
_MAJOR_VERSION, _NATIVE = 1, {16: 34, 8: 33}
# RTCGeometryType, RTCBufferType and RTCFormat.
_TRIANGLES, _INDICES, _VERTICES, _UINT3, _FLOAT3 = 0, 0, 1, 0x5003, 0x9003
_ROW_BYTES = 12


class PacketScene:
    """A triangle mesh in a scene of Embree's that is asked for packets of shadow rays.

    RuntimeError where packets are not ``available``, or if Embree refuses the mesh.
    """

    def __init__(self, vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]):
        embree = _embree()
        if embree is None:
            raise RuntimeError("rays cannot be traced in packets here: see packets.available")
        library, device, self._width = embree
        self._scene = scene = library.rtcNewScene(device)
        weakref.finalize(self, library.rtcReleaseScene, scene)
        triangles = library.rtcNewGeometry(device, _TRIANGLES)
        for kind, form, rows in (
            (_VERTICES, _FLOAT3, np.ascontiguousarray(vertices, np.float32)),
            (_INDICES, _UINT3, np.ascontiguousarray(faces, np.uint32)),
        ):
            room = library.rtcSetNewGeometryBuffer(triangles, kind, 0, form, _ROW_BYTES, len(rows))
            if room:
                ctypes.memmove(room, rows.ctypes.data, rows.nbytes)
        library.rtcCommitGeometry(triangles)
        library.rtcAttachGeometry(scene, triangles)
        library.rtcReleaseGeometry(triangles)  # the scene holds it from here on
        library.rtcCommitScene(scene)
        if error := library.rtcGetDeviceError(device):
            raise RuntimeError(f"Embree refuses a mesh of {len(faces)} faces: its error {error}")

    def occluded_pairs(
        self,
        origins: Float[np.ndarray, "place 3"],
        directions: Float[np.ndarray, "direction 3"],
        asked: Bool[np.ndarray, "place direction"],
    ) -> Bool[np.ndarray, "place direction"]:
        """Whether the rays of those pairs that are asked for meet the mesh; False elsewhere."""
        # Numba takes half a second to import and compiles for two, once a machine.
        from jaxrender.geometry.packet_loop import trace

        blocked = np.zeros(asked.shape, bool)
        rays = (np.ascontiguousarray(rows, np.float32) for rows in (origins, directions))
        trace(self._scene, self._width, *rays, np.ascontiguousarray(asked), blocked)
        return blocked


def available() -> bool:
    """Whether Numba is installed, and embreex has an Embree 4 that takes packets here."""
    return _embree() is not None


class _Embree(NamedTuple):
    """The library, a device that is never let go, and how many rays it takes at once."""

    library: ctypes.CDLL
    device: int
    width: int


@cache
def _embree() -> _Embree | None:
    if not _has_numba():
        return None
    library = _library()
    if library is None:
        return None
    device = library.rtcNewDevice(None)
    if not device or library.rtcGetDeviceProperty(device, _MAJOR_VERSION) != 4:
        return None
    for width, native in _NATIVE.items():
        if library.rtcGetDeviceProperty(device, native):
            _name_queries(library)
            return _Embree(library, device, width)
    return None


def _has_numba() -> bool:
    try:
        import numba  # noqa: F401
    except ModuleNotFoundError as missing:
        if missing.name == "numba":
            return False
        broken = missing
    except Exception as error:  # whatever an import of foreign modules runs into
        broken = error
    else:
        return True
    logging.getLogger(__package__).warning(
        "Numba is installed but cannot be imported, so rays are traced one by one: %s", broken
    )
    return False


def _library() -> ctypes.CDLL | None:
    """The one that embreex has loaded, with the types of what is called in it."""
    try:
        files = metadata.files("embreex") or ()
        (path,) = (str(file.locate()) for file in files if "embree4" in file.name)
        library = ctypes.CDLL(path)
        _declare(library)
    except (metadata.PackageNotFoundError, ValueError, OSError, AttributeError):
        return None  # built differently: Embree elsewhere, or not its fourth version
    return library


def _declare(library: ctypes.CDLL) -> None:
    address, number, size = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
    for name, returned, taken in (
        ("rtcNewDevice", address, [ctypes.c_char_p]),
        ("rtcGetDeviceProperty", ctypes.c_ssize_t, [address, number]),
        ("rtcGetDeviceError", number, [address]),
        ("rtcNewScene", address, [address]),
        ("rtcCommitScene", None, [address]),
        ("rtcReleaseScene", None, [address]),
        ("rtcNewGeometry", address, [address, number]),
        ("rtcSetNewGeometryBuffer", address, [address, number, number, number, size, size]),
        ("rtcCommitGeometry", None, [address]),
        ("rtcReleaseGeometry", None, [address]),
        ("rtcAttachGeometry", number, [address, address]),
        *((f"rtcOccluded{width}", None, [address] * 4) for width in PACKET_QUERIES),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = returned, taken


def _name_queries(library: ctypes.CDLL) -> None:
    """Let Numba's code find the packet queries."""
    from llvmlite import binding

    for width, name in PACKET_QUERIES.items():
        query = getattr(library, f"rtcOccluded{width}")
        binding.add_symbol(name, ctypes.cast(query, ctypes.c_void_p).value)
