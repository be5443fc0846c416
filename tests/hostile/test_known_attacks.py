"""Files that once ended in a traceback, a hang, or more memory than there is; and their kin.

- A picture whose damage is no text, or whose header claims more than its file can hold.
- Faces of vertices that are not there; numbers that a mesh takes again and again; other files.
- YAML aliases that multiply; brackets within brackets, in YAML and JSON; numbers of many digits.
- Texts in Latin-1; arrays of a NetCDF file that lie elsewhere, or unpack to far more than it has.
- Every limit is raised by its environment variable, or by ``allow``.
"""

import json
import struct
import sys
import time

import h5py
import numpy as np
import OpenImageIO as oiio
import pytest
import trimesh
from trimesh.resolvers import FilePathResolver

from jaxrender import limits
from jaxrender.errors import InputError
from jaxrender.io import (
    read_capture,
    read_cornell,
    read_curve,
    read_image,
    read_mesh,
    read_per_frame_lights,
    read_table,
    read_tensors,
    write_image,
)
from jaxrender.io.images import _check_header
from jaxrender.pipelines.config import load_run_config
from jaxrender.pipelines.result import read_result

from . import READ, REFUSED, SUBJECTS, judged

LAUGHS = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefgh", "bcdefghi")
)
DEEP = 3000
SECONDS = 5.0


def made(tmp_path, name):
    path = tmp_path / SUBJECTS[name].name
    SUBJECTS[name].make(path)
    return path


def test_damage_that_is_no_text_is_told(tmp_path):
    path = made(tmp_path, "exr")
    path.write_bytes(path.read_bytes().replace(b"channels\0chlist", b"channels\0\xe9hlist", 1))
    with pytest.raises(InputError, match=r"p\.exr: a damaged image \(.*save the picture anew"):
        read_image(path)


def test_a_picture_far_too_small_for_its_header_is_refused(tmp_path):
    """What the library refuses by itself, and what it would let pass."""
    path = made(tmp_path, "exr")
    windows = [
        struct.pack("<4i", 0, 0, right, bottom) for right, bottom in ((23, 11), (16383,) * 2)
    ]
    path.write_bytes(path.read_bytes().replace(*windows))
    with pytest.raises(InputError, match=r"p\.exr: .*save the picture anew"):
        read_image(path)
    message = r"claims 16384 x 16384 and 3 channels: 805,306,368 numbers.*JAXRENDER_MAX_PACKING"
    with pytest.raises(InputError, match=message):
        _check_header(path, oiio.ImageSpec(16384, 16384, 3, "half"))


def test_pictures_of_16k_pass(tmp_path):
    """Of any file that can hold them."""
    path = tmp_path / "p.exr"
    with path.open("wb") as file:
        file.truncate(2**20)
    _check_header(path, oiio.ImageSpec(16384, 16384, 4, "half"))


@pytest.mark.parametrize("beyond", [-1, 8, 2**31 - 1])
def test_faces_of_missing_vertices_in_a_ply(tmp_path, beyond):
    path = tmp_path / "m.ply"
    content = trimesh.creation.box().export(file_type="ply")
    # The last face's last corner.
    path.write_bytes(content[:-4] + struct.pack("<i", beyond))
    with pytest.raises(InputError, match=r"m\.ply: .*face 11 .*and there are 8; 1 of 12 faces"):
        read_mesh(path)


def glb(path, change=None, body=None):
    """Write a ball of 642 vertices and 1280 faces as .glb, its JSON or its numbers changed."""
    content = trimesh.creation.icosphere(subdivisions=3).export(file_type="glb")
    length = struct.unpack_from("<I", content, 12)[0]
    header = json.loads(content[20 : 20 + length])
    rest = bytearray(content[20 + length :])
    if change:
        change(header)
    if body:
        body(header, rest)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    path.write_bytes(head + text + rest)


def test_faces_of_missing_vertices_in_a_glb(tmp_path):
    def beyond(header, rest):
        indices = header["accessors"][header["meshes"][0]["primitives"][0]["indices"]]
        start = 8 + header["bufferViews"][indices["bufferView"]].get("byteOffset", 0)
        rest[start : start + 4] = struct.pack("<I", 4000)

    glb(tmp_path / "m.glb", body=beyond)
    with pytest.raises(InputError, match=r"m\.glb: .*face 0 .*4000.*export the mesh again"):
        read_mesh(tmp_path / "m.glb")


def many_parts(header):
    header["meshes"][0]["primitives"] *= 5000


def many_nodes(header):
    place = next(i for i, node in enumerate(header["nodes"]) if "mesh" in node)
    first, count = len(header["nodes"]), 4000
    header["nodes"] += [header["nodes"][place] | {"name": f"n{i}"} for i in range(count)]
    header["nodes"].append({"name": "all", "children": list(range(first, first + count))})
    header["scenes"][0]["nodes"] = [first + count]


def many_views(header):
    header["bufferViews"] += [header["bufferViews"][0] | {"byteLength": 2**20}] * 900


GLTF = {
    "numbers made of nothing": (
        lambda header: header["accessors"][0].pop("bufferView"),
        "accessor 0 has no numbers of its own",
    ),
    "parts without end": (many_parts, "JAXRENDER_MAX_REPEATED_FACES to allow more"),
    "places without end": (many_nodes, "JAXRENDER_MAX_REPEATED_FACES to allow more"),
    "views without end": (many_views, "JAXRENDER_MAX_REPEATED_FACES to allow more"),
    "count": (lambda header: header["accessors"][0].update(count=-1), "accessor 0: `count` is -1"),
    "list": (lambda header: header.update(meshes={"a": 1}), "`meshes` is no list of objects"),
    "flat": (
        lambda header: [node.update(scale=[0, 0, 0]) for node in header["nodes"]],
        "all 1280 faces have zero area",
    ),
}


@pytest.mark.parametrize("name", GLTF)
def test_hostile_gltf(tmp_path, name):
    change, message = GLTF[name]
    glb(tmp_path / "m.glb", change)
    with pytest.raises(InputError, match=rf"m\.glb: .*{message}"):
        read_mesh(tmp_path / "m.glb")


def test_a_mesh_names_no_other_file(tmp_path, monkeypatch):
    """Its picture would be read, and nobody asked for it."""
    asked = []
    monkeypatch.setattr(FilePathResolver, "get", lambda _, name: asked.append(name) or b"")

    def foreign(header):
        header["images"] = [{"uri": "beside.png"}]
        header["textures"] = [{"source": 0}]
        header["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        header["meshes"][0]["primitives"][0]["material"] = 0

    glb(tmp_path / "m.glb", foreign)
    assert len(read_mesh(tmp_path / "m.glb").faces) == 1280
    assert not asked


def test_a_ply_cannot_have_more_elements_than_bytes(tmp_path):
    text = trimesh.creation.box().export(file_type="ply", encoding="ascii")
    (tmp_path / "m.ply").write_bytes(text.replace(b"vertex 8", b"vertex 2000000000"))
    with pytest.raises(InputError, match=r"m\.ply:\d+: vertex: the header counts 2,000,000,000"):
        read_mesh(tmp_path / "m.ply")


CONFIGS = {
    "laughs": (LAUGHS, r":\d+:\d+: aliases counted: 8,193 values.*JAXRENDER_MAX_CONFIG_VALUES"),
    "brackets": ("a: " + "[" * DEEP, r":1:\d+: more than 64 levels.*JAXRENDER_MAX_DEPTH"),
    "braces": ("{a: " * DEEP, r":1:\d+: more than 64 levels.*JAXRENDER_MAX_DEPTH"),
    "dashes": ("- " * DEEP, r":1:\d+: more than 64 levels.*JAXRENDER_MAX_DEPTH"),
    "many": ("a: [" + "1, " * 30_000 + "]", r"more than 8,192 values.*JAXRENDER_MAX_CONFIG_VALUES"),
    "large": ("#" * 2**17 + "\n", r"131,073 bytes.*JAXRENDER_MAX_CONFIG_BYTES"),
}


@pytest.mark.parametrize("name", CONFIGS)
def test_hostile_yaml(tmp_path, name):
    text, message = CONFIGS[name]
    (tmp_path / "c.yaml").write_text(text)
    start = time.monotonic()
    with pytest.raises(InputError, match=rf"c\.yaml.*{message}"):
        load_run_config(tmp_path / "c.yaml")
    assert time.monotonic() - start < SECONDS


JSON = {
    "brackets": ("[" * DEEP + "]" * DEEP, "nested too deeply|levels of brackets"),
    "a little deep": ("[" * 65 + "]" * 65, "65 levels of brackets.*JAXRENDER_MAX_DEPTH"),
    "objects": ('{"a":' * DEEP + "1" + "}" * DEEP, "nested too deeply|levels of brackets"),
    "digits": ("9" * 5000, "a whole number of 5000 digits"),
    "keys": (
        json.dumps({f"k{i}": 1 for i in range(30_000)})[:-1] + ', "k7": 2}',
        "`k7` occurs twice",
    ),
}


@pytest.mark.parametrize("name", JSON)
def test_hostile_json(tmp_path, name):
    text, message = JSON[name]
    for file, read in (
        ("transforms.json", read_capture),
        ("l.json", lambda path: read_per_frame_lights(path, ["one"])),
        ("result.json", lambda path: read_result(path.parent)),
    ):
        (tmp_path / file).write_text(text)
        start = time.monotonic()
        with pytest.raises(InputError, match=f"{file}.*({message})"):
            read(tmp_path / file)
        assert time.monotonic() - start < SECONDS


@pytest.mark.parametrize("read", [read_curve, read_cornell])
def test_a_table_in_latin_1_is_told_so(tmp_path, read):
    (tmp_path / "CIE.csv").write_bytes("0,0\n# Lumière\n1,1\n".encode("latin-1"))
    message = r"CIE\.csv:2: not a text in UTF-8 \(byte 10 is 0xe8\).*Latin-1.*save it as UTF-8"
    with pytest.raises(InputError, match=message):
        read(tmp_path / "CIE.csv")


def test_a_damaged_netcdf_file_prints_nothing(tmp_path, monkeypatch):
    path, ignored = made(tmp_path, "table"), []
    monkeypatch.setattr(sys, "unraisablehook", ignored.append)
    content = path.read_bytes()
    # Where the root group is described: the file opens, and then its names cannot be read.
    for at in (96, 104, 112, 144, 152):
        path.write_bytes(content[:at] + b"\xff" * 4 + content[at + 4 :])
        with pytest.raises(InputError, match=r"t\.nc: damaged or cut short"):
            read_table(path)
    assert not ignored


def test_free_room_among_texts_ends_where_it_should(tmp_path):
    """The library would go round it without end."""
    path = made(tmp_path, "table")
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL")
    # The first object becomes free room of no bytes.
    struct.pack_into("<HHIQ", content, heap + 16, 0, 0, 0, 0)
    path.write_bytes(content)
    with pytest.raises(
        InputError, match=rf"t\.nc: damaged or cut short \(texts at byte {heap}\); .*again"
    ):
        read_table(path)


def replaced(path, **made):
    """Put another array in the place of a table's own."""
    with h5py.File(path, "a") as file:
        del file["brdf"]
        dataset = file.create_dataset("brdf", **made)
        for axis, name in enumerate(("kappa_i", "lambda_i", "kappa_r", "lambda_r", "channel")):
            dataset.dims[axis].attach_scale(file[name])


HUGE = (4, 4, 4, 4, 2**22)
ARRAYS = {
    "nothing stored": ({"shape": HUGE, "dtype": "f8"}, "JAXRENDER_MAX_PACKING"),
    "too many": ({"shape": (4, 4, 4, 4, 2**40), "dtype": "f8"}, "JAXRENDER_MAX_NUMBERS"),
    "elsewhere": (
        {"shape": (4, 4, 4, 4, 3), "dtype": "f8", "external": [("other", 0, h5py.h5f.UNLIMITED)]},
        "`brdf` has its numbers in another file",
    ),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_hostile_arrays(tmp_path, name):
    arguments, message = ARRAYS[name]
    path = made(tmp_path, "table")
    replaced(path, **arguments)
    with pytest.raises(InputError, match=rf"t\.nc: .*{message}"):
        read_table(path)


def test_a_tensor_without_numbers_has_a_shape_that_arrays_can_have(tmp_path):
    header = b"tensor_file\0" + struct.pack("<BBI", 1, 0, 1) + struct.pack("<H", 1) + b"a"
    (tmp_path / "m.bsdf").write_bytes(header + struct.pack("<HBQ2Q", 2, 1, 0, 0, 2**62))
    with pytest.raises(InputError, match=r"m\.bsdf: the field 'a' .*no array"):
        read_tensors(tmp_path / "m.bsdf")


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "x" * 5000, "x" * 253])
def test_names_that_no_file_can_have(tmp_path, name):
    frame = {"file_path": name, "transform_matrix": np.eye(4).tolist()}
    text = json.dumps({"w": 4, "h": 4, "fl_x": 4, "frames": [frame]})
    (tmp_path / "transforms.json").write_text(text)
    with pytest.raises(InputError, match=r"transforms\.json: frame 0 .*mend the path"):
        read_capture(tmp_path / "transforms.json")
    if "x" not in name:
        config = (
            f"task: brdf\ncapture: {{transforms: {json.dumps(name)}, geometry: {{sphere: {{}}}}}}\n"
        )
        (tmp_path / "c.yaml").write_text(config + "lighting: {environment: {path: p.exr}}\n")
        with pytest.raises(InputError, match=r"c\.yaml:2:\d+: .* names no file; mend the path"):
            load_run_config(tmp_path / "c.yaml")


def test_what_a_file_says_cannot_steer_a_terminal(tmp_path):
    (tmp_path / "c.csv").write_text("0,0\n1,\x1b[2J\u202e" + "x" * 10_000)
    assert judged(read_curve, tmp_path / "c.csv") == REFUSED
    with pytest.raises(InputError) as caught:
        raise InputError("a: \x1b[31m\ud800\n" + "x\n" * 1000)
    lines = str(caught.value).split("\n")
    assert lines[0] == r"a: \x1b[31m\ud800"
    assert (len(lines), lines[-1]) == (50, "... and 953 more lines; mend these first")


def test_limits_can_be_raised(tmp_path, monkeypatch):
    path = tmp_path / "p.png"
    write_image(path, np.ones((4, 4, 3)))
    with pytest.raises(ValueError, match="JAXRENDER_MAX_PIXELS: 0; give a number from 1"):
        limits.PIXELS.allow(0)
    before = limits.PIXELS.most
    try:
        limits.PIXELS.allow(15)
        with pytest.raises(InputError, match=r"16 pixels, and at most 15 are read.*MAX_PIXELS"):
            read_image(path)
        monkeypatch.setenv("JAXRENDER_MAX_PIXELS", "16")
        assert judged(read_image, path) == READ
        monkeypatch.setenv("JAXRENDER_MAX_PIXELS", "many")
        with pytest.raises(InputError, match="JAXRENDER_MAX_PIXELS is 'many'; wanted a whole"):
            read_image(path)
    finally:
        limits.PIXELS.allow(before)
