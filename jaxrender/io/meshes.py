"""Mesh files, through trimesh.

A file's parts become one mesh in the file's own coordinates, times ``scale``.  Texture seams
and STL's loose triangles are closed by merging vertices at exactly the same place, so that smooth
normals (angle-weighted, by ``geometry.Mesh``) see all the faces that meet there.  Where every part
of the file brings vertex normals, those are kept, and its vertices stay as they are.  Texture
coordinates belong to the corners of faces, so merging leaves them alone; they too are kept where
every part has them.  Those of a .glb are read where the part has a material.
"""

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.resolvers import Resolver
from trimesh.visual import TextureVisuals

from jaxrender.errors import InputError
from jaxrender.geometry.mesh import Mesh
from jaxrender.io.mesh_headers import ANEW, check_header, check_repeats
from jaxrender.shapes import Bool, Float, Int

# Lengths beyond this have no squares in single precision, in which rays are traced.
_LARGEST = 1e18

MESH_SUFFIXES = (".obj", ".ply", ".glb", ".stl")


def read_mesh(path: str | Path, scale: float | int = 1.0) -> Mesh:
    """Read a mesh, its lengths multiplied by ``scale``.

    Raises InputError when the file is missing, malformed or too large, has no faces, or has
    vertices or normals that are not finite, or faces of vertices that it has not.
    """
    path = Path(path)
    if not (math.isfinite(scale) and scale > 0):
        raise ValueError(f"scale is {scale}: it must be positive and finite")
    # What overflows is found among the numbers, and named by its place.
    with np.errstate(all="ignore"):
        return _read(path, scale)


def _read(path: Path, scale: float | int) -> Mesh:
    parts = _parts(path)
    vertices = np.concatenate([part.vertices for part in parts])
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    faces = np.concatenate([part.faces + offset for part, offset in zip(parts, offsets)])
    normals = [part.vertex_normals for part in parts if _has_normals(part)]
    coordinates = _texture_coordinates(path, parts)
    _check_finite(path, "vertex", vertices)
    far = np.flatnonzero(np.abs(scale * vertices).max(axis=1) > _LARGEST)
    if far.size:
        raise InputError(
            f"{path}: vertex {far[0]} (counted from 0) is {vertices[far[0]]}, times {scale:g}; "
            f"wanted coordinates up to {_LARGEST:g}: mend the file, or give another scale"
        )
    if len(normals) == len(parts):
        given = np.concatenate(normals)
        _check_finite(path, "vertex normal", given)
        return _mesh(path, scale * vertices, faces, given, coordinates)
    # Exactly equal: a tolerance would be in units that nobody knows.
    merged, index = np.unique(vertices, axis=0, return_inverse=True)
    return _mesh(path, scale * merged, index.reshape(-1)[faces], None, coordinates)


def write_mesh(
    path: str | Path,
    mesh: Mesh,
    columns: Mapping[str, Float[np.ndarray, "vertex"] | Bool[np.ndarray, "vertex"]] | None = None,
) -> None:
    """Write a mesh with its normals and texture coordinates, in the format of the path's ending.

    ``columns`` are further numbers of every vertex, by name, which only PLY has room for.  Vertices
    with several texture coordinates are split; STL has neither those nor normals.
    """
    path = Path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{path}: unknown mesh format; use {', '.join(MESH_SUFFIXES)}")
    if columns and path.suffix.lower() != ".ply":
        raise InputError(f"{path}: only .ply has room for {', '.join(columns)}")
    vertex, faces, coordinates = _split(mesh)
    solid = trimesh.Trimesh(
        mesh.vertices[vertex],
        faces,
        vertex_normals=mesh.normals[vertex],
        visual=None if coordinates is None else TextureVisuals(uv=coordinates),
        process=False,
        validate=False,
    )
    for name, values in (columns or {}).items():
        solid.vertex_attributes[name] = np.asarray(values, np.float32)[vertex]
    options: dict[str, Any] = {".ply": {"vertex_normal": True}, ".obj": {"write_texture": False}}
    solid.export(path, **options.get(path.suffix.lower(), {}))


def _split(
    mesh: Mesh,
) -> tuple[
    Int[np.ndarray, "written"], Int[np.ndarray, "face 3"], Float[np.ndarray, "written 2"] | None
]:
    """Give every written vertex one pair of coordinates: which vertex it is, faces, coordinates."""
    if mesh.texture_coordinates is None:
        return np.arange(len(mesh.vertices)), mesh.faces, None
    corners = np.column_stack([mesh.faces.ravel(), mesh.texture_coordinates.reshape(-1, 2)])
    written, index = np.unique(corners, axis=0, return_inverse=True)
    return written[:, 0].astype(int), index.reshape(-1, 3), written[:, 1:]


def _parts(path: Path) -> list[trimesh.Trimesh]:
    """The triangle meshes of a file, each moved to where the file puts it."""
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{path}: unknown mesh format; use {', '.join(MESH_SUFFIXES)}")
    if not path.is_file():
        raise InputError(f"{path}: no such mesh file; mend the path")
    check_header(path)
    # Of a .ply with texture coordinates trimesh reorders the vertices but not their normals.
    parts = _loaded(path, fix_texture=False)
    if not parts:
        raise InputError(f"{path}: the file has no faces; export triangles")
    return parts


def _loaded(path: Path, fix_texture: bool) -> list[trimesh.Trimesh]:
    glb = path.suffix.lower() == ".glb"
    options: dict[str, Any] = {"fix_texture": fix_texture} if path.suffix.lower() == ".ply" else {}
    try:
        # trimesh warns of much before it fails, and of pictures that nobody asks for.
        with warnings.catch_warnings(action="ignore"):
            # Unprocessed: trimesh would drop broken vertices without a word.  Without its material
            # a part of a .glb loses its texture coordinates.
            scene = trimesh.load_scene(
                path, process=False, skip_materials=not glb, resolver=_Nothing(), **options
            )
            for name, part in scene.geometry.items():
                if isinstance(part, trimesh.Trimesh):
                    _check_part(path, name, part)
            nodes = sorted(scene.graph.nodes_geometry)
            sizes = [len(scene.geometry[scene.graph[node][1]].vertices) for node in nodes]
            check_repeats(path, sum(sizes))
            parts = [_placed(scene, node) for node in nodes]
            return [part for part in parts if part is not None and len(part.faces)]
    except InputError:
        raise
    except Exception as error:  # a malformed file can fail anywhere in its reader
        raise InputError(f"{path}: not a readable mesh ({error}); {ANEW}") from None


class _Nothing(Resolver):
    """Finds no other file: a mesh must not name those of whoever reads it."""

    def __init__(self):
        """Nothing is looked up anywhere."""

    def get(self, name: str) -> bytes:
        raise ValueError(f"other files are not read: {name}")

    def write(self, name: str, data: bytes) -> None:
        raise ValueError(f"other files are not written: {name}")

    def namespaced(self, namespace: str) -> "_Nothing":
        return self

    def keys(self) -> list[str]:
        return []


def _check_part(path: Path, name: str, part: trimesh.Trimesh) -> None:
    """Refuse faces of vertices that are not there, and what is no triangle in space."""
    place = f"{path}: part {name!r}"
    for kind, rows in (("vertices", part.vertices), ("faces", part.faces)):
        if rows.ndim != 2 or (rows.shape[1] != 3 and len(rows)):
            raise InputError(f"{place}: {kind} of shape {rows.shape}; wanted three numbers each")
    is_known = (part.faces >= 0) & (part.faces < len(part.vertices))
    wrong = np.logical_not(is_known).any(axis=1)
    if wrong.any():
        face = int(np.argmax(wrong))
        raise InputError(
            f"{place}: face {face} (counted from 0) has the vertices {part.faces[face]}, and there "
            f"are {len(part.vertices)}; {wrong.sum()} of {len(part.faces)} faces are such: {ANEW}"
        )


def _texture_coordinates(
    path: Path, parts: list[trimesh.Trimesh]
) -> Float[np.ndarray, "face 3 2"] | None:
    """The texture coordinates of every corner; None where a part has none."""
    if not all(_has_coordinates(part) for part in parts):
        return None
    if path.suffix.lower() == ".ply":
        parts = _loaded(path, fix_texture=True)
    given = [np.asarray(_uv(part), np.float64)[part.faces, :2] for part in parts]
    coordinates = np.concatenate(given)
    _check_finite(path, "texture coordinate of corner", coordinates.reshape(-1, 2))
    return coordinates


def _has_coordinates(part: trimesh.Trimesh) -> bool:
    uv = _uv(part)
    return uv is not None and uv.ndim == 2 and len(uv) == len(part.vertices) and uv.shape[1] >= 2


def _uv(part: trimesh.Trimesh) -> np.ndarray | None:
    """Texture coordinates of a part's vertices, as trimesh has them."""
    return getattr(part.visual, "uv", None)


def _placed(scene: trimesh.Scene, node: str) -> trimesh.Trimesh | None:
    """One instance of a part in the coordinates of the file; None for points and lines."""
    transform, name = scene.graph[node]
    part = scene.geometry[name]
    if not isinstance(part, trimesh.Trimesh) or np.array_equal(transform, np.eye(4)):
        return part if isinstance(part, trimesh.Trimesh) else None
    matrix = transform[:3, :3]
    mirrored = np.linalg.det(matrix) < 0
    normals = part.vertex_normals @ np.linalg.inv(matrix) if _has_normals(part) else None
    return trimesh.Trimesh(
        vertices=part.vertices @ matrix.T + transform[:3, 3],
        faces=part.faces[:, ::-1] if mirrored else part.faces,
        vertex_normals=normals,
        visual=part.visual if _has_coordinates(part) else None,
        process=False,
    )


def _has_normals(part: trimesh.Trimesh) -> bool:
    """Whether the file gave vertex normals: trimesh then holds them before anyone asks."""
    return "vertex_normals" in part._cache


def _check_finite(path: Path, kind: str, values: np.ndarray) -> None:
    broken = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if broken.size:
        raise InputError(
            f"{path}: {kind} {broken[0]} (counted from 0) is {values[broken[0]]}; {broken.size} of "
            f"{len(values)} are not finite: mend the file"
        )


def _mesh(
    path: Path,
    vertices: Float[np.ndarray, "vertex 3"],
    faces: Int[np.ndarray, "face 3"],
    normals: Float[np.ndarray, "vertex 3"] | None,
    texture_coordinates: Float[np.ndarray, "face 3 2"] | None,
) -> Mesh:
    try:
        return Mesh(vertices, faces, normals, texture_coordinates)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
