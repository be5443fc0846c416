"""The tangent frame of the surface behind each texel: what normal maps are relative to.

A frame has the tangent along which u grows, made square to the normal; normal x tangent; and the
normal.  That is the frame of Mitsuba's ``normalmap``.  Its second axis points down the image on
surfaces whose texture is mirrored.  A texel whose centre no face covers has the nearest one's.
"""

import numpy as np
from scipy.ndimage import distance_transform_edt

from jaxrender.geometry import Mesh, Shape, Sphere
from jaxrender.geometry.texels import covering_faces, texel_coordinates
from jaxrender.shapes import Float, Int

_TINY = 1e-20


def texel_frames(shape: Shape, image: tuple[int, int]) -> Float[np.ndarray, "row column axis 3"]:
    """Find the frame at the centre of every texel.

    Raises ``ValueError`` for a mesh without texture coordinates, and for other shapes.
    """
    if isinstance(shape, Sphere):
        return _of_sphere(image)
    if not isinstance(shape, Mesh) or shape.texture_coordinates is None:
        raise ValueError("the shape has no texture coordinates, so that no texel has a frame")
    face, weights = _faces(shape, image)
    known = face >= 0
    if not known.any():
        raise ValueError("no face of the mesh covers the centre of a texel")
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    row, column = np.asarray(nearest)
    face, weights = face[row, column], weights[row, column]
    normals = np.einsum("rck,rcki->rci", weights, shape.normals[shape.faces[face]])
    return _frames(normals, _along(shape)[face])


def vertex_frames(mesh: Mesh) -> Float[np.ndarray, "corner axis 3"]:
    """Find the frames at the corners of all faces, in the order of the faces."""
    along = np.repeat(_along(mesh), 3, axis=0)
    return _frames(mesh.normals[mesh.faces.ravel()], along)


def in_frames(
    offset: Float[np.ndarray, "*batch 3"], frames: Float[np.ndarray, "*batch axis 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Turn what is added to unit normals into unit normals of the frames."""
    inside = np.einsum("...ai,...i->...a", frames, np.nan_to_num(offset))
    inside[..., 2] = 1
    return inside / np.linalg.norm(inside, axis=-1, keepdims=True)


def _of_sphere(image: tuple[int, int]) -> Float[np.ndarray, "row column axis 3"]:
    u, v = texel_coordinates(image).reshape(*image, 2).transpose(2, 0, 1)
    azimuth, polar = 2 * np.pi * u, np.pi * (1 - v)
    normals = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    )
    return _frames(normals, np.stack([-np.sin(azimuth), np.cos(azimuth), 0 * azimuth], axis=-1))


def _along(mesh: Mesh) -> Float[np.ndarray, "face 3"]:
    """Differentiate each face's places by u: the solution of J (dp/du, dp/dv) = edges."""
    assert mesh.texture_coordinates is not None
    corner, uv = mesh.vertices[mesh.faces], mesh.texture_coordinates
    first, second = (corner[:, k] - corner[:, 0] for k in (1, 2))
    (u1, v1), (u2, v2) = ((uv[:, k] - uv[:, 0]).T for k in (1, 2))
    area = u1 * v2 - u2 * v1
    return (v2[:, None] * first - v1[:, None] * second) * np.sign(area)[:, None]


def _frames(
    normals: Float[np.ndarray, "*batch 3"], along: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch axis 3"]:
    """Square the tangents up; where there is none any will do."""
    normal = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), _TINY)
    tangent = along - np.sum(along * normal, axis=-1, keepdims=True) * normal
    length = np.linalg.norm(tangent, axis=-1, keepdims=True)
    any_axis = np.eye(3)[np.argmin(np.abs(normal), axis=-1)]
    other = np.cross(normal, any_axis)
    other /= np.maximum(np.linalg.norm(other, axis=-1, keepdims=True), _TINY)
    tangent = np.where(length > _TINY, tangent / np.maximum(length, _TINY), other)
    return np.stack([tangent, np.cross(normal, tangent), normal], axis=-2)


def _faces(
    mesh: Mesh, image: tuple[int, int]
) -> tuple[Int[np.ndarray, "row column"], Float[np.ndarray, "row column 3"]]:
    """Find the face over each texel's centre (-1: none), and where in it that lies."""
    found, weights = np.full(image, -1), np.zeros((*image, 3))
    covering = covering_faces(mesh, image)
    found.flat[covering.texel] = covering.face
    weights.reshape(-1, 3)[covering.texel] = covering.weights
    return found, weights
