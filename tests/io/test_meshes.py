"""Mesh files: the surface that the file describes, whole, and nothing lost in silence.

Pinned down: seams closed for smooth normals; file normals kept; texture coordinates of every corner
kept, also where vertices merge; parts placed where the file says, mirrored ones too; scale; and a
message for every broken file.  The oracle for areas and volumes is
trimesh; a sphere's normals are its directions.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh
from jaxrender.geometry.sculpture import sculpture
from jaxrender.io.meshes import MESH_SUFFIXES, read_mesh, write_mesh

DATA = Path(__file__).parents[3] / "shared" / "data" / "meshes"
real = pytest.mark.skipif(not DATA.exists(), reason="the real meshes are not on this machine")

CORNERS = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
# Angle-weighted normals of a sphere of 1280 faces against the directions themselves.
SMOOTH = 6e-3
STRETCHED = 0.05  # the same after squeezing and stretching it by factors of 2
SINGLE = 1e-6  # STL and GLB hold float32
SUFFIXES = [suffix.removeprefix(".") for suffix in MESH_SUFFIXES]
# STL holds triangles alone.
WITH_TEXTURE = [suffix for suffix in SUFFIXES if suffix != "stl"]


def write(tmp_path: Path, text: str, name: str = "m.obj") -> Path:
    (tmp_path / name).write_text(text)
    return tmp_path / name


def sphere(**options) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=3, **options)


def volume(mesh: Mesh) -> float:
    corners = mesh.vertices[mesh.faces]
    return float(np.linalg.det(corners).sum() / 6)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_sphere_is_closed_and_smooth(tmp_path, suffix):
    """STL has no shared vertices; only merged ones give the sphere's normals."""
    path = tmp_path / f"sphere.{suffix}"
    options: dict[str, Any] = {"include_normals": False} if suffix == "glb" else {}
    sphere(radius=2).export(path, **options)
    mesh = read_mesh(path)
    assert len(mesh.vertices) == 642
    assert mesh.is_closed()
    np.testing.assert_allclose(mesh.normals, mesh.vertices / 2, atol=SMOOTH)


def test_texture_seams_are_merged(tmp_path):
    """A tetrahedron whose every corner has its own texture coordinate."""
    texts = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", *(f"vt {i / 12} 0.5" for i in range(12))]
    corners = [1, 3, 2, 1, 2, 4, 1, 4, 3, 2, 3, 4]
    texts += [
        "f " + " ".join(f"{corners[i]}/{i + 1}" for i in range(k, k + 3)) for k in (0, 3, 6, 9)
    ]
    mesh = read_mesh(write(tmp_path, "\n".join(texts) + "\n"))
    assert len(mesh.vertices) == 4
    assert mesh.is_closed()
    assert volume(mesh) == pytest.approx(1 / 6)
    # Every corner keeps its own pair, whichever vertex it now shares.
    assert mesh.texture_coordinates is not None
    expected = np.stack([np.arange(12) / 12, np.full(12, 0.5)], axis=-1).reshape(4, 3, 2)
    np.testing.assert_allclose(mesh.texture_coordinates, expected, atol=1e-12)


@pytest.mark.parametrize("suffix", WITH_TEXTURE)
def test_texture_coordinates_and_normals_round_trip(tmp_path, suffix):
    mesh = sculpture(2, 0)
    assert mesh.texture_coordinates is not None
    write_mesh(tmp_path / f"m.{suffix}", mesh)
    again = read_mesh(tmp_path / f"m.{suffix}")
    assert again.texture_coordinates is not None
    np.testing.assert_allclose(again.texture_coordinates, mesh.texture_coordinates, atol=SINGLE)
    for name in ("vertices", "normals"):
        written, read = (getattr(one, name)[one.faces] for one in (mesh, again))
        np.testing.assert_allclose(read, written, atol=SINGLE)
    assert [path.name for path in tmp_path.iterdir()] == [f"m.{suffix}"]


def test_texture_coordinates_of_the_corners_of_a_ply(tmp_path):
    """A .ply may hold them by face; the normals of vertices stay with their vertices."""
    header = ["ply", "format ascii 1.0", "element vertex 4"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    header += ["element face 2", "property list uchar int vertex_indices"]
    header += ["property list uchar float texcoord", "end_header"]
    corners = [[1, 1], [1, 0], [0, 1], [0, 0]]
    body = [f"{x} {y} 0 {x} {y} 1" for x, y in corners]
    body += ["3 3 1 0 6 0 0 0.5 0 0.5 0.5", "3 3 0 2 6 0.5 0 1 0 1 1"]
    mesh = read_mesh(write(tmp_path, "\n".join(header + body) + "\n", "m.ply"))
    expected = [[[0, 0], [0.5, 0], [0.5, 0.5]], [[0.5, 0], [1, 0], [1, 1]]]
    assert mesh.texture_coordinates is not None
    np.testing.assert_allclose(mesh.texture_coordinates, expected)
    np.testing.assert_allclose(mesh.normals[:, :2] / mesh.normals[:, 2:], corners)


def test_dropped_faces_take_their_texture_coordinates_along(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 1/1 2/2\nf 1/3 2/2 3/1\n"
    mesh = read_mesh(write(tmp_path, text))
    assert mesh.texture_coordinates is not None
    np.testing.assert_allclose(mesh.texture_coordinates, [[[0, 1], [1, 0], [0, 0]]])


def test_zeros_of_either_sign_are_one_place(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv -0 0 0\nv -1 0 0\nf 1 2 3\nf 4 3 5\n"
    assert len(read_mesh(write(tmp_path, text)).vertices) == 4


def test_near_vertices_stay_apart(tmp_path):
    """A mesh in kilometres: 1e-9 is a millionth of a metre, and no seam."""
    text = "v 0 0 0\nv 1e-9 0 0\nv 0 1e-9 0\nf 1 2 3\n"
    mesh = read_mesh(write(tmp_path, text), scale=1e9)
    np.testing.assert_allclose(mesh.bounds()[1], [1, 1, 0], rtol=1e-12)


@pytest.mark.parametrize("suffix", WITH_TEXTURE)
def test_normals_of_the_file_are_kept(tmp_path, suffix):
    """Flat normals on a cube, which merging and averaging would round off."""
    faces = np.arange(36).reshape(12, 3)
    box = trimesh.creation.box()
    vertices = box.triangles.reshape(-1, 3)
    flat = trimesh.Trimesh(
        vertices, faces, vertex_normals=np.repeat(box.face_normals, 3, axis=0), process=False
    )
    options: dict[str, Any] = {"ply": {"vertex_normal": True}}.get(
        suffix, {"include_normals": True}
    )
    flat.export(tmp_path / f"cube.{suffix}", **options)
    mesh = read_mesh(tmp_path / f"cube.{suffix}")
    face_normals = np.cross(*np.moveaxis(np.diff(mesh.vertices[mesh.faces], axis=1), 1, 0))
    expected = face_normals / np.linalg.norm(face_normals, axis=1, keepdims=True)
    for corner in range(3):
        np.testing.assert_allclose(mesh.normals[mesh.faces[:, corner]], expected, atol=SINGLE)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("normals", [False, True])
def test_parts_lie_where_the_file_puts_them(tmp_path, mirrored, normals):
    """One ball instanced twice: at the origin, and squeezed, turned and moved."""
    transform = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])
    transform[:3, :3] *= [-1 if mirrored else 1, 0.5, 2]
    transform[:3, 3] = [10, 0, 0]
    scene = trimesh.Scene()
    ball = sphere()
    ball.vertex_normals = ball.vertices
    scene.add_geometry(ball, node_name="a", geom_name="ball")
    scene.graph.update(frame_to="b", matrix=transform, geometry="ball")
    scene.export(tmp_path / "two.glb", include_normals=normals)
    mesh = read_mesh(tmp_path / "two.glb", scale=0.5)
    # Volumes are signed: an inward winding would subtract.
    assert volume(mesh) == pytest.approx(2 * sphere().volume / 8, rel=SINGLE)
    moved = mesh.vertices[:, 0] > 2.5
    own = (2 * mesh.vertices[moved] - [10, 0, 0]) @ np.linalg.inv(transform[:3, :3]).T
    expected = own @ np.linalg.inv(transform[:3, :3])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals[moved], expected, atol=SINGLE if normals else STRETCHED)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CORNERS.replace("v 1 1 1", "v nan 1 1") + "f 1 2 8\n", r"vertex \d+ .* is \[nan\s+1"),
        (CORNERS.replace("v 1 1 1", "v 1 1e999 1") + "f 1 2 8\n", r"1 of \d+ are not finite"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 nan\nf 1//1 2//1 3//1\n", r"vertex normal 0 .* nan"),
        ("# nothing\n", r"the file has no faces"),
        (CORNERS, r"the file has no faces"),
        (
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 nan\nf 1/1 2/1 3/1\n",
            r"texture coordinate of corner 0 .* nan",
        ),
        ("v 0 0 0\nv 1 0 0\nf 1 2 9\n", r"not a readable mesh"),
        ("v a b c\nf 1 2 3\n", r"not a readable mesh"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", r"all 1 faces have zero area"),
    ],
)
def test_broken_meshes_are_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=r"m\.obj: .*" + message):
        read_mesh(write(tmp_path, text))


def test_zero_area_faces_are_counted(tmp_path):
    mesh = read_mesh(write(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 1 2\n"))
    assert mesh.dropped_faces == 1


def test_other_files_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"gone\.obj: no such mesh file"):
        read_mesh(tmp_path / "gone.obj")
    with pytest.raises(InputError, match=r"m\.fbx: unknown mesh format; use \.obj"):
        read_mesh(write(tmp_path, "", "m.fbx"))
    with pytest.raises(InputError, match=r"m\.ply: not a readable mesh \(Not a ply file"):
        read_mesh(write(tmp_path, "hello", "m.ply"))
    with pytest.raises(ValueError, match="scale is 0: it must be positive"):
        read_mesh("any.obj", scale=0)


@real
def test_a_closed_mesh_with_texture_coordinates():
    mesh = read_mesh(DATA / "spot.obj")
    assert len(mesh.vertices) == 2930
    assert mesh.is_closed()
    assert not mesh.is_convex()


@real
def test_a_scan_with_holes():
    mesh = read_mesh(DATA / "bun_zipper_res3.ply", scale=10)
    assert len(mesh.vertices) == 1889
    assert len(mesh.faces) + mesh.dropped_faces == 3851
    assert not mesh.is_closed()
