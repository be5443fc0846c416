"""Captures: photographs with their cameras, as this and other programs write them.

``capture``
    a photograph, its camera and its pixels
``contents``
    what else a folder says: shape, light, response
``recognised``
    the formats, each known by what it has in a folder; ``read_capture`` of any
``transforms`` ``lens_keys`` ``written``
    ``transforms.json`` of NeRF, Blender and Nerfstudio, in and out
``colmap``
    COLMAP's sparse models
``opencv`` ``opencv_storage``
    calibrations of OpenCV with poses; its files of named values
``diligent``
    photometric stereo: one camera, one distant light a photograph
``flash``
    rectified photographs of a flat sample, with the places of camera and flash
``mitsuba`` ``mitsuba_values``
    scenes of Mitsuba 3 in XML; their named values
``metashape``
    cameras of Metashape in XML
``stanford_orb`` ``objects_with_lighting``
    the layouts of two benchmarks, with panoramas and masks
``paths`` ``photo_headers``
    what formats share: where paths lead, EXIF
"""

from jaxrender.io.captures.capture import Capture, Frame, read_mask, read_photograph
from jaxrender.io.captures.contents import (
    Contents,
    StatedEnvironment,
    StatedLight,
    StatedPoint,
    StatedSource,
    StatedSphere,
    StatedSquare,
)
from jaxrender.io.captures.paths import Looking
from jaxrender.io.captures.photo_headers import PhotoHeader, read_photo_header
from jaxrender.io.captures.recognised import (
    FORMATS,
    Recognised,
    read_capture,
    read_contents,
    recognise,
)
from jaxrender.io.captures.written import write_capture

__all__ = [
    "FORMATS",
    "Capture",
    "Contents",
    "Frame",
    "Looking",
    "PhotoHeader",
    "Recognised",
    "StatedEnvironment",
    "StatedLight",
    "StatedPoint",
    "StatedSource",
    "StatedSphere",
    "StatedSquare",
    "read_capture",
    "read_contents",
    "read_mask",
    "read_photo_header",
    "read_photograph",
    "recognise",
    "write_capture",
]
