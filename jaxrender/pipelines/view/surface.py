"""The object of a page: a sphere, or a mesh with positions and normals of 16 bits."""

from typing import Any

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Shape, Sphere
from jaxrender.pipelines.view.packing import octahedral, packed

# Meshes above this size make a page that few browsers turn smoothly.
MOST_FACES = 1_000_000
_STEPS = 65535


def refuse_large(mesh: Mesh) -> None:
    """Raise ``InputError`` for a mesh of too many faces."""
    if len(mesh.faces) > MOST_FACES:
        raise InputError(
            f"the mesh has {len(mesh.faces)} faces, and a page holds at most {MOST_FACES}: "
            "simplify it, and fit again"
        )


def surface_document(shape: Shape, textured: bool = False) -> dict[str, Any]:
    """Lay out a shape as text; ``InputError`` for a mesh of too many faces.

    Where it is ``textured`` the vertices of a mesh are split by their texture coordinates.
    """
    if isinstance(shape, Sphere):
        return {"kind": "sphere", "center": shape.center.tolist(), "radius": shape.radius}
    assert isinstance(shape, Mesh)
    refuse_large(shape)
    used, corners = np.unique(shape.faces, return_inverse=True)
    own = {}
    if textured:
        assert shape.texture_coordinates is not None
        pairs = shape.texture_coordinates.reshape(-1, 2)
        rows = np.column_stack([shape.faces.ravel(), pairs])
        written, corners = np.unique(rows, axis=0, return_inverse=True)
        used = written[:, 0].astype(int)
        own["coordinates"] = packed(written[:, 1:].astype(np.float32))
    lower, upper = shape.bounds()
    size = np.where(upper > lower, upper - lower, 1.0)
    positions = np.rint((shape.vertices[used] - lower) / size * _STEPS).astype(np.uint16)
    center = (lower + upper) / 2
    radius = float(np.linalg.norm(shape.vertices[used] - center, axis=1).max())
    kind = np.uint16 if len(used) <= _STEPS + 1 else np.uint32
    return {
        "kind": "mesh",
        "center": center.tolist(),
        "radius": radius,
        "lower": lower.tolist(),
        "size": size.tolist(),
        "positions": packed(positions),
        "normals": packed(octahedral(_unit(shape.normals[used]))),
        "faces": packed(corners.reshape(-1, 3).astype(kind)),
        **own,
    }


def _unit(normals: np.ndarray) -> np.ndarray:
    """Replace what has no length, which no face that is seen uses."""
    missing = ~np.any(normals, axis=1)
    return np.where(missing[:, None], [0.0, 0.0, 1.0], normals)
