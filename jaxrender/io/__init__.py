"""Files to and from the objects of the levels below; nothing below touches disk.

``images``
    pictures as pixel values, with everything refused that would pass in silence
``captures``
    photographs with their cameras, masks and exposures, from a ``transforms.json``
``curves``
    the response curve of a camera
``environments``
    panoramas of any named convention as an ``Environment``
``lights``
    directional sources for each photograph
``meshes``
    triangle meshes
``measured`` ``merl``
    measured reflectance: at scattered directions, and the MERL database's tables
``jsonfiles``
    what the JSON formats above share

Every error is an ``InputError`` that names file, place, value and remedy.
"""

from jaxrender.io.captures import Capture, Frame, read_capture, read_mask, read_photograph
from jaxrender.io.curves import read_curve
from jaxrender.io.environments import read_environment, write_environment
from jaxrender.io.images import Image, image_size, read_image, write_image
from jaxrender.io.lights import read_per_frame_lights
from jaxrender.io.measured import ScatteredMeasurements, read_cornell
from jaxrender.io.merl import MerlTable, read_merl, write_merl
from jaxrender.io.meshes import read_mesh, write_mesh

__all__ = [
    "Capture",
    "Frame",
    "Image",
    "MerlTable",
    "ScatteredMeasurements",
    "image_size",
    "read_capture",
    "read_cornell",
    "read_curve",
    "read_environment",
    "read_image",
    "read_mask",
    "read_merl",
    "read_mesh",
    "read_per_frame_lights",
    "read_photograph",
    "write_environment",
    "write_image",
    "write_merl",
    "write_mesh",
]
