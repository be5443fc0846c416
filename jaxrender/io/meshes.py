"""Mesh files, through trimesh.

A file's parts become one mesh in the file's own coordinates, times ``scale``.  Texture seams
and STL's loose triangles are closed by merging vertices at exactly the same place, so that smooth
normals (angle-weighted, by ``geometry.Mesh``) see all the faces that meet there.  Where every part
of the file brings vertex normals, those are kept, and its vertices stay as they are.
"""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import trimesh

from jaxrender.errors import InputError
from jaxrender.geometry.mesh import Mesh
from jaxrender.shapes import Bool, Float

MESH_SUFFIXES = (".obj", ".ply", ".glb", ".stl")


def read_mesh(path: str | Path, scale: float | int = 1.0) -> Mesh:
    """Read a mesh, its lengths multiplied by ``scale``.

    Raises InputError when the file is missing or malformed, has no faces, or has vertices or
    normals that are not finite.
    """
    path = Path(path)
    if not (math.isfinite(scale) and scale > 0):
        raise ValueError(f"scale is {scale}: it must be positive and finite")
    parts = _parts(path)
    vertices = np.concatenate([part.vertices for part in parts])
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    faces = np.concatenate([part.faces + offset for part, offset in zip(parts, offsets)])
    normals = [part.vertex_normals for part in parts if _has_normals(part)]
    _check_finite(path, "vertex", vertices)
    if len(normals) == len(parts):
        given = np.concatenate(normals)
        _check_finite(path, "vertex normal", given)
        return _mesh(path, scale * vertices, faces, given)
    # Exactly equal: a tolerance would be in units that nobody knows.
    merged, index = np.unique(vertices, axis=0, return_inverse=True)
    return _mesh(path, scale * merged, index.reshape(-1)[faces], None)


def write_mesh(
    path: str | Path,
    mesh: Mesh,
    columns: Mapping[str, Float[np.ndarray, "vertex"] | Bool[np.ndarray, "vertex"]] | None = None,
) -> None:
    """Write a mesh with its normals, in the format that the path's ending names.

    ``columns`` are further numbers of every vertex, by name, which only PLY has room for.
    """
    path = Path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{path}: unknown mesh format; use {', '.join(MESH_SUFFIXES)}")
    solid = trimesh.Trimesh(
        mesh.vertices, mesh.faces, vertex_normals=mesh.normals, process=False, validate=False
    )
    if columns and path.suffix.lower() != ".ply":
        raise InputError(f"{path}: only .ply has room for {', '.join(columns)}")
    for name, values in (columns or {}).items():
        solid.vertex_attributes[name] = np.asarray(values, np.float32)
    if path.suffix.lower() == ".ply":
        solid.export(path, vertex_normal=True)
    else:
        solid.export(path)


def _parts(path: Path) -> list[trimesh.Trimesh]:
    """The triangle meshes of a file, each moved to where the file puts it."""
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{path}: unknown mesh format; use {', '.join(MESH_SUFFIXES)}")
    if not path.is_file():
        raise InputError(f"{path}: no such mesh file; mend the path")
    try:
        # Unprocessed: trimesh would drop broken vertices without a word.
        scene = trimesh.load_scene(path, process=False, skip_materials=True)
    except Exception as error:  # a malformed file can fail anywhere in its reader
        raise InputError(f"{path}: not a readable mesh ({error})") from error
    parts = [_placed(scene, node) for node in sorted(scene.graph.nodes_geometry)]
    parts = [part for part in parts if part is not None and len(part.faces)]
    if not parts:
        raise InputError(f"{path}: the file has no faces; export triangles")
    return parts


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


def _mesh(path: Path, vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray | None) -> Mesh:
    try:
        return Mesh(vertices, faces, normals)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
