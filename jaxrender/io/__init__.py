"""Files to and from the objects of the levels below; nothing below touches disk.

``images``
    pictures as pixel values, with everything refused that would pass in silence
``encodings``
    what a picture states about its values
``raw``
    camera RAW as linear values, by the extra ``raw``
``captures``
    photographs with their cameras, masks and exposures, as this and other programs write them
``exports``
    results for other programs: Mitsuba, glTF, light
``curves``
    the response curve of a camera
``environments``
    panoramas of any named convention as an ``Environment``
``lights``
    directional sources for each photograph
``meshes`` ``mesh_headers``
    triangle meshes, and what their files claim
``measured`` ``alta``
    measured reflectance at scattered directions: Cornell's text, ALTA's text
``merl`` ``utia`` ``rgl``
    measured reflectance as tables, of three databases
``tables`` ``trees`` ``tree_layout``
    our own: tables over two directions, with standard errors; coefficient trees
``photometric``
    luminaires: IES files
``netcdf`` ``text_heaps`` ``atomic`` ``jsonfiles`` ``xmlfiles`` ``numbered_words``
    what formats share: files of named arrays, files that appear whole or not at all, texts
``alta_parametrisations``
    the coordinates that ALTA's files may be in

Every error is an ``InputError`` that names file, place, value and remedy.
"""

from jaxrender.io.alta import AltaMeasurements, read_alta, write_alta
from jaxrender.io.captures import (
    Capture,
    Frame,
    read_capture,
    read_mask,
    read_photograph,
    write_capture,
)
from jaxrender.io.curves import read_curve, write_curve
from jaxrender.io.encodings import contradiction
from jaxrender.io.environments import read_environment, write_environment
from jaxrender.io.images import Image, image_size, read_image, write_image
from jaxrender.io.lights import read_per_frame_lights
from jaxrender.io.measured import ScatteredMeasurements, read_cornell
from jaxrender.io.merl import MerlTable, read_merl, write_merl
from jaxrender.io.meshes import read_mesh, write_mesh
from jaxrender.io.photometric import Photometry, read_ies
from jaxrender.io.raw import RawPhotograph, read_raw
from jaxrender.io.rgl import RglMaterial, read_rgl, read_tensors, write_rgl, write_tensors
from jaxrender.io.tables import BRDFTable, read_table, write_table
from jaxrender.io.tree_layout import TreeAbout
from jaxrender.io.trees import TreeFile, read_tree, write_tree
from jaxrender.io.utia import UtiaTable, read_utia

__all__ = [
    "AltaMeasurements",
    "BRDFTable",
    "Capture",
    "Frame",
    "Image",
    "MerlTable",
    "Photometry",
    "RawPhotograph",
    "RglMaterial",
    "ScatteredMeasurements",
    "TreeAbout",
    "TreeFile",
    "UtiaTable",
    "contradiction",
    "image_size",
    "read_alta",
    "read_capture",
    "read_cornell",
    "read_curve",
    "read_environment",
    "read_ies",
    "read_image",
    "read_mask",
    "read_merl",
    "read_mesh",
    "read_per_frame_lights",
    "read_photograph",
    "read_raw",
    "read_rgl",
    "read_table",
    "read_tensors",
    "read_tree",
    "read_utia",
    "write_alta",
    "write_capture",
    "write_curve",
    "write_environment",
    "write_image",
    "write_merl",
    "write_mesh",
    "write_rgl",
    "write_table",
    "write_tensors",
    "write_tree",
]
