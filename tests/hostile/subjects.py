"""A small file of every format, by the project's writers or byte by byte, and its reader."""

import json
import struct
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
import OpenImageIO as oiio
import trimesh

from jaxrender.geometry.sculpture import sculpture
from jaxrender.harmonics import LatLongGrid
from jaxrender.io import (
    AltaMeasurements,
    BRDFTable,
    TreeAbout,
    read_alta,
    read_capture,
    read_cornell,
    read_curve,
    read_environment,
    read_ies,
    read_image,
    read_merl,
    read_mesh,
    read_per_frame_lights,
    read_rgl,
    read_table,
    read_tree,
    read_utia,
    write_alta,
    write_image,
    write_mesh,
    write_table,
    write_tree,
)
from jaxrender.io.captures import Looking, Recognised, read_contents
from jaxrender.io.merl import DIMENSIONS
from jaxrender.pipelines.config import load_recipe, load_run_config
from jaxrender.pipelines.config.sweep import load_sweep
from jaxrender.pipelines.result import read_result
from jaxrender.pipelines.shrm_files import read_shrm, write_shrm
from jaxrender.pipelines.shrm_layout import ShrmAbout
from jaxrender.reflection.shrm import GlobalShrm
from jaxrender.wavelets import CoefficientTree, haar

sys.path.append(str(Path(__file__).parents[1] / "io"))
from benchmark_folders import objects_with_lighting, stanford_orb
from capture_formats import FORMATS as CAPTURES
from raw_files import even_dng

NAMES = ("one", "two")
_TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8")
_MATRIX = np.eye(4).tolist()

CONFIG = """\
task: brdf
capture:
  transforms: t.json
  geometry: {mesh: cat.ply, scale: 2}
  response: {curve: curve.txt}
  invalid: mask
lighting:
  environment: {path: probe.exr, convention: mirror-ball, scale: 3}
  directional: [{direction: [0, 0.6, 0.8], irradiance: [1, 2, 3]}]
brdf: {kd: [0.1, 0.2, 0.3], ks: {bounds: [0, 1]}, sigma: {bounds: [0.1, 1], start: 0.2}, mu: 1.5}
samples: {min_cosine: 0.2, count: 1e4, seed: 3}
"""
RECIPE = """\
geometry: {sphere: {}}
brdf: {kd: 0.1, ks: 0.2, sigma: 0.1, mu: 1.5}
lighting:
  directional: [{direction: [0, 0, 1], irradiance: 3}]
"""
SWEEP = "base: base.yaml\ngrid:\n  samples.seed: [1, 2, 3]\n"


class Subject(NamedTuple):
    """A format: how its file ends, what is damaged like, how it is made, and its reader.

    ``kind`` is text, binary or glb.  ``make`` writes a file; what it leaves beside it stays whole.
    """

    name: str
    kind: str
    make: Callable[[Path], None]
    read: Callable[[Path], object]


def picture(channels: int = 3, rows: int = 12) -> np.ndarray:
    """Make a smooth picture of values from 0 to 1."""
    down, across = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, 2 * rows), indexing="ij")
    return np.stack([down, across, down * across, 1 - down][:channels], axis=-1)


def _image(suffix: str, channels: int = 3) -> Subject:
    def make(path: Path) -> None:
        write_image(path, picture(channels))

    return Subject(f"p.{suffix}", "binary", make, read_image)


def _exr(compression: str, tiled: bool = False) -> Subject:
    def make(path: Path) -> None:
        values = np.ascontiguousarray(0.2 + 0.6 * picture(4, 40), np.float32)
        spec = oiio.ImageSpec(80, 40, 4, "half")
        spec.attribute("compression", compression)
        if tiled:
            spec.tile_width = spec.tile_height = 16
        out = oiio.ImageOutput.create(str(path))
        assert out.open(str(path), spec)
        assert out.write_image(values)
        assert out.close()

    return Subject("p.exr", "binary", make, read_image)


def _mesh(suffix: str) -> Subject:
    def make(path: Path) -> None:
        write_mesh(path, sculpture(2, 0))

    kind = {"obj": "text", "glb": "glb"}.get(suffix, "binary")
    return Subject(f"m.{suffix}", kind, make, read_mesh)


def _box(name: str, **options: object) -> Subject:
    def make(path: Path) -> None:
        trimesh.creation.box().export(path, **options)

    return Subject(name, "text", make, read_mesh)


def _text(name: str, text: str, read: Callable[[Path], object]) -> Subject:
    def make(path: Path) -> None:
        path.write_text(text, encoding="utf-8")

    return Subject(name, "text", make, read)


def _sweep(path: Path) -> None:
    (path.parent / "base.yaml").write_text(CONFIG, encoding="utf-8")
    path.write_text(SWEEP, encoding="utf-8")


def _alta(path: Path) -> None:
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(2, 9, 3))
    directions[..., 2] = np.abs(directions[..., 2]) + 0.1
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    write_alta(path, AltaMeasurements(*directions, rng.random((9, 3))))


def _merl(path: Path) -> None:
    head = struct.pack("<3i", *DIMENSIONS)
    path.write_bytes(head + np.full(3 * int(np.prod(DIMENSIONS)), 0.5).tobytes())


def _rgl(path: Path) -> None:
    phi, theta = np.zeros(1, np.float32), np.array([0, 0.4, 0.9, 1.5], np.float32)

    def ones(*shape: int) -> np.ndarray:
        return np.ones(shape, np.float32)

    fields = {
        "theta_i": theta, "phi_i": phi, "ndf": ones(6, 5), "sigma": ones(4, 7),
        "vndf": ones(1, 4, 8, 6), "luminance": ones(1, 4, 5, 5), "rgb": ones(1, 4, 3, 5, 4),
        "description": np.frombuffer(b"made up", np.uint8), "jacobian": np.ones(1, np.uint8),
    }  # fmt: skip
    at = 18 + sum(2 + len(name) + 11 + 8 * one.ndim for name, one in fields.items())
    header, body = b"tensor_file\0" + struct.pack("<BBI", 1, 0, len(fields)), b""
    for name, one in fields.items():
        kind = _TYPES.index(one.dtype.str[1:]) + 1
        header += struct.pack("<H", len(name)) + name.encode()
        header += struct.pack(f"<HBQ{one.ndim}Q", one.ndim, kind, at + len(body), *one.shape)
        body += one.tobytes()
    path.write_bytes(header + body)


def _table(path: Path) -> None:
    values = np.random.default_rng(0).random((4, 4, 4, 4, 3))
    write_table(path, BRDFTable(values, 0.1 * values, about={"source": "made up"}))


def _tree(path: Path) -> None:
    samples = np.random.default_rng(0).normal(size=(8, 8, 3))
    tree = CoefficientTree.of_coefficients(haar(), samples)
    write_tree(path, tree, TreeAbout("made up", "none", ("u", "v"), "1", "plain"))


def _shrm(path: Path) -> None:
    grid = LatLongGrid(10, 20)
    maps = np.random.default_rng(1).normal(size=(*grid.shape, 4, 3))
    write_shrm(path, GlobalShrm(maps, grid, 3, False), ShrmAbout("probe.hdr", "phong:exponent=3"))


def _capture(path: Path) -> object:
    return read_capture(path, require_images=False)


def _foreign(name: str, form: str, read: str, kind: str = "text") -> Subject:
    """A file of another program's capture; ``read`` is the one that its format is known by."""

    def make(path: Path) -> None:
        if not (path.parent / name).exists():
            CAPTURES[form].write(path.parent)
        places = (path.parent / "sparse/0" / name, path.parent / name)
        path.write_bytes(next(one for one in places if one.exists()).read_bytes())
        for beside in (path.parent / "sparse/0").glob("*"):
            if beside.name != name:
                beside.replace(path.parent / beside.name)

    def contents(path: Path) -> object:
        looking = Looking(path.parent, require_images=False, original=True)
        return read_contents(Recognised(form.split()[0], path.parent / read), looking)

    return Subject(name, kind, make, contents)


def _orb(path: Path) -> None:
    scene = stanford_orb(path.parent.parent.parent, path.parent.name)
    assert scene == path.parent


def _owl(path: Path) -> None:
    top = path.parent.parent if path.parent.name == "inputs" else path.parent
    if not (top / "inputs").exists():
        objects_with_lighting(top, np.eye(3), rotated=False)


def _owl_contents(path: Path) -> object:
    top = path.parent.parent if path.parent.name == "inputs" else path.parent
    known_by = Recognised("objects-with-lighting", top / "inputs" / "exposure.txt")
    return read_contents(known_by, Looking(top, require_images=False))


def _orb_contents(path: Path) -> object:
    return read_contents(Recognised("stanford-orb", path), Looking(path.parent))


def _lights(path: Path) -> object:
    return read_per_frame_lights(path, NAMES)


def _result(path: Path) -> object:
    return read_result(path.parent)


_FRAMES = [
    {"file_path": f"images/{name}.png", "transform_matrix": _MATRIX, "exposure": 2}
    for name in NAMES
]
_TRANSFORMS = {"w": 64, "h": 48, "fl_x": 60.0, "cx": 32, "cy": 24, "frames": _FRAMES}
_IES = """\
IESNA:LM-63-1995
[TEST] made up
[MANUFAC] Lumi\u00e8re
TILT=INCLUDE
1 2 0 90 1 0.8
1 1000 1 5 3 1 2 0.5 0.5 0.1
1 1 100
0 22.5 45 67.5 90
0 45 90
100 90 80 70 60
100 90 80 70 60
100 90 80 70 60
"""
_CORNELL = "# made up\n3\n400 500 600\n" + "0.1 0.2 0.3 0.4 0.5 0.6 0.7\n" * 5
_LIGHT = {"direction": [0, 0.6, 0.8], "irradiance": [1, 2, 3]}

_FOREIGN = {
    "colmap cameras": _foreign("cameras.txt", "colmap text", "cameras.txt"),
    "colmap images": _foreign("images.txt", "colmap text", "cameras.txt"),
    "colmap binary cameras": _foreign("cameras.bin", "colmap binary", "cameras.bin", "binary"),
    "colmap binary images": _foreign("images.bin", "colmap binary", "cameras.bin", "binary"),
    "opencv yaml": _foreign("calibration.yml", "opencv yaml", "calibration.yml"),
    "opencv xml": _foreign("calibration.xml", "opencv xml", "calibration.xml"),
    "mitsuba scene": _foreign("scene.xml", "mitsuba", "scene.xml"),
    "metashape cameras": _foreign("cameras.xml", "metashape", "cameras.xml"),
}

_BENCHMARKS = {
    "orb": Subject("blender_HDR/ball/transforms_test.json", "text", _orb, _orb_contents),
    **{
        f"owl {name.split('/')[-1].split('.')[0]}": Subject(name, "text", _owl, _owl_contents)
        for name in ("inputs/camera_0001.txt", "inputs/exposure.txt", "world_to_env.txt")
    },
}
_RAW = {"raw": Subject("p.dng", "binary", even_dng, read_image)} if find_spec("rawpy") else {}

SUBJECTS: dict[str, Subject] = {
    **_FOREIGN,
    **_BENCHMARKS,
    **_RAW,
    **{one: _image(one) for one in ("exr", "hdr", "pfm", "tif", "png", "jpg", "tga")},
    "panorama": _image("hdr")._replace(read=lambda path: read_environment(path, height=8)),
    "exr tiled": _exr("piz", tiled=True),
    "exr dwaa": _exr("dwaa"),
    "exr b44": _exr("b44"),
    **{one: _mesh(one) for one in ("obj", "ply", "glb", "stl")},
    "ply text": _box("m.ply", encoding="ascii"),
    "stl text": _box("m.stl", file_type="stl_ascii"),
    "config": _text("c.yaml", CONFIG, load_run_config),
    "recipe": _text("r.yaml", RECIPE, load_recipe),
    "sweep": Subject("s.yaml", "text", _sweep, load_sweep),
    "transforms": _text("transforms.json", json.dumps(_TRANSFORMS, indent=1), _capture),
    "lights": _text("l.json", json.dumps({name: [_LIGHT] for name in NAMES}), _lights),
    "lights text": _text("l.txt", "2\n0 0 1\n0 0.6 0.8\n", _lights),
    "result": _text("result.json", json.dumps({"rms": 1.5, "brdf": {"kd": [1, 2]}}), _result),
    "curve": _text("c.csv", "# made up\n0,0\n0.5,0.2\n1,1\n", read_curve),
    "cornell": _text("c.astm", _CORNELL, read_cornell),
    "alta": Subject("a.alta", "text", _alta, read_alta),
    "ies": _text("l.ies", _IES, read_ies),
    "rgl": Subject("m.bsdf", "binary", _rgl, read_rgl),
    "utia": Subject(
        "m.bin",
        "binary",
        lambda p: p.write_bytes(np.ones(3 * 288**2).tobytes()) and None,
        read_utia,
    ),
    "merl": Subject("m.binary", "binary", _merl, read_merl),
    "table": Subject("t.nc", "binary", _table, read_table),
    "tree": Subject("w.nc", "binary", _tree, read_tree),
    "maps": Subject("s.nc", "binary", _shrm, read_shrm),
}
