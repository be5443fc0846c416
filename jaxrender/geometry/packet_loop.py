"""The loop that fills packets of rays and has Embree answer them, compiled by Numba.

Imported by ``packets`` alone, and only when packets are asked for: Numba is an extra.
"""

import inspect

import numpy as np
from numba import njit, types

from jaxrender.geometry.packets import PACKET_QUERIES

# Rows of RTCRay8 and RTCRay16, each as long as the packet is wide.
_ROWS, _ORIGIN, _DIRECTION, _FAR, _MASK = 12, 0, 4, 8, 9
# Embree reads packets from addresses that are multiples of this.
_ALIGNED = 64
# (which rays are valid, scene, rays, no arguments), all of them addresses.
_QUERY = types.void(types.uintp, types.uintp, types.uintp, types.uintp)
_ask_8 = types.ExternalFunction(PACKET_QUERIES[8], _QUERY)
_ask_16 = types.ExternalFunction(PACKET_QUERIES[16], _QUERY)


def _trace(scene, width, origins, directions, asked, blocked):
    """Set those of ``blocked`` whose pair is asked for and whose ray meets the scene."""
    buffer = np.zeros(_ROWS * width + _ALIGNED // 4, np.float32)
    first = -buffer.ctypes.data % _ALIGNED // 4
    rays = buffer[first : first + _ROWS * width].reshape(_ROWS, width)
    masks = rays.view(np.uint32)[_MASK]
    switches = np.zeros(width + _ALIGNED // 4, np.int32)
    first = -switches.ctypes.data % _ALIGNED // 4
    valid = switches[first : first + width]
    pair = np.zeros(width, np.int64)
    wanted, found = asked.reshape(-1), blocked.reshape(-1)
    filled, k, last = 0, -1, asked.size - 1
    for place in range(len(origins)):
        for direction in range(len(directions)):
            k += 1
            if wanted[k]:
                for axis in range(3):
                    rays[_ORIGIN + axis, filled] = origins[place, axis]
                    rays[_DIRECTION + axis, filled] = directions[direction, axis]
                rays[_FAR, filled], masks[filled] = np.inf, 0xFFFFFFFF
                valid[filled], pair[filled] = -1, k
                filled += 1
            if filled == width or (filled and k == last):
                valid[filled:] = 0
                if width == 16:
                    _ask_16(valid.ctypes.data, scene, rays.ctypes.data, 0)
                else:
                    _ask_8(valid.ctypes.data, scene, rays.ctypes.data, 0)
                for ray in range(filled):
                    # Embree marks a blocked ray by a far end of minus infinity.
                    found[pair[ray]] = rays[_FAR, ray] < 0
                filled = 0


def _compiled(function):
    """Compile a function, which is kept on disk for the next process if there is a place for it."""
    # Whatever checks types may have wrapped it: Numba compiles the bare one.
    bare = inspect.unwrap(function)
    try:
        return njit(nogil=True, cache=True)(bare)
    except RuntimeError:  # neither here nor in the user's folder may anything be written
        return njit(nogil=True)(bare)


trace = _compiled(_trace)
