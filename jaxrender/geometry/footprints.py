"""How much of a surface a pixel covers: the ellipse that a circular pixel filter becomes (L 7.2).

The circle of one pixel's diameter is projected along the pixel's rays on the plane tangential to
the surface behind the pixel's centre.  To first order, exactly for parallel rays, the result is an
ellipse, the image of the circle under the two steps dP/dx and dP/dy that the point makes on that
plane when the pixel's centre moves by a pixel to the right and down:

    dP = a - d (n.a) / (n.d),     a the step of the ray at the point's depth, d its direction.

Its axes' lengths are the singular values of the steps.  The true section of a cone may be a
hyperbola (L's footnote); the first order has a size all the same.  Host side, NumPy float64.
"""

import numpy as np

from jaxrender.geometry.cameras import Camera, Orthographic, Pinhole
from jaxrender.geometry.hits import Shape
from jaxrender.geometry.mesh import Mesh
from jaxrender.geometry.sphere import Sphere
from jaxrender.geometry.surface import SurfaceView
from jaxrender.shapes import Float, checked

# The azimuth has no derivative at a sphere's poles; so close to them (squared) it is large.
_AT_POLE = 1e-12


def pixel_steps(camera: Camera, view: SurfaceView) -> Float[np.ndarray, "row column 2 3"]:
    """Find dP/dx and dP/dy of every pixel, world units; zero where nothing is hit.

    The tangent plane is that of the face.  Raises ``ValueError`` for cameras that are neither
    pinhole nor orthographic.
    """
    directions, normals = -view.outgoing, view.geometric_normals
    axes = np.array([1, -1])[:, None] * camera.world_from_camera[:3, :2].T
    if isinstance(camera, Pinhole) and camera.lens is not None:
        across = _through_lens(camera, view)
    elif isinstance(camera, Pinhole):
        lengths = np.array([1 / camera.fl_x, 1 / camera.fl_y])[:, None]
        depth = (camera.position - view.points) @ camera.world_from_camera[:3, 2]
        across = depth[..., None, None] * (lengths * axes)
    elif isinstance(camera, Orthographic):
        across = np.broadcast_to(camera.scale * axes, (*view.hit.shape, 2, 3))
    else:
        raise ValueError(f"a {type(camera).__name__} has no known pixel steps: use a pinhole")
    slant = np.einsum("rci,rci->rc", normals, directions)
    slide = np.einsum("rcki,rci->rck", across, normals) / np.where(view.hit, slant, 1)[..., None]
    steps = across - slide[..., None] * directions[:, :, None, :]
    return np.where(view.hit[..., None, None], steps, 0)


def _through_lens(camera: Pinhole, view: SurfaceView) -> Float[np.ndarray, "row column 2 3"]:
    """Find the steps across the ray that move a point by a pixel to the right and down."""
    across = np.zeros((*view.hit.shape, 2, 3))
    directions = -view.outgoing[view.hit]
    distance = np.linalg.norm(view.points[view.hit] - camera.position, axis=-1)
    slopes = camera.pixel_slopes(directions)
    # A step along the ray moves no pixel, and the smallest step has no such part.
    across[view.hit] = distance[:, None, None] * np.swapaxes(np.linalg.pinv(slopes), -1, -2)
    return across


@checked
def texture_steps(
    shape: Shape, view: SurfaceView, steps: Float[np.ndarray, "row column 2 3"]
) -> Float[np.ndarray, "row column 2 2"]:
    """Turn steps on the surface into those of the texture coordinates (u, v).

    Those are ``geometry.texels``'s: a mesh's own, latitude and longitude on a sphere.  Raises
    ``ValueError`` for other shapes and a mesh without texture coordinates.
    """
    found = np.zeros((*view.hit.shape, 2, 2))
    on = view.hit
    if isinstance(shape, Sphere):
        place = (view.points[on] - shape.center) / shape.radius
        found[on] = _sphere_steps(place, steps[on] / shape.radius)
    elif isinstance(shape, Mesh) and shape.texture_coordinates is not None:
        found[on] = _mesh_steps(shape, view.face[on], steps[on])
    else:
        raise ValueError(
            f"this {type(shape).__name__} has no texture coordinates: use a sphere, or a mesh that "
            "has some"
        )
    return found


def axis_lengths(steps: Float[np.ndarray, "*batch 2 _"]) -> Float[np.ndarray, "*batch 2"]:
    """Find the ellipse's axes, the longer first, in the steps' own units."""
    return np.linalg.svd(steps, compute_uv=False)


@checked
def size_in_texels(
    steps: Float[np.ndarray, "*batch 2 2"], image: tuple[int, int]
) -> Float[np.ndarray, "*batch"]:
    """Measure footprints by their longer axis, in texels of an image of (rows, columns)."""
    return axis_lengths(steps * np.array([image[1], image[0]]))[..., 0]


def _sphere_steps(
    place: Float[np.ndarray, "sample 3"], steps: Float[np.ndarray, "sample 2 3"]
) -> Float[np.ndarray, "sample 2 2"]:
    x, y = place[:, :2].T[:, :, None]
    dx, dy, dz = np.moveaxis(steps, -1, 0)
    square = np.maximum(x * x + y * y, _AT_POLE)
    u = (x * dy - y * dx) / square / (2 * np.pi)
    # v = 1 - polar / pi, and d(polar) = -dz / sin(polar).
    v = dz / np.sqrt(square) / np.pi
    return np.stack([u, v], axis=-1)


def _mesh_steps(
    mesh: Mesh, face: np.ndarray, steps: Float[np.ndarray, "sample 2 3"]
) -> Float[np.ndarray, "sample 2 2"]:
    """Write steps as multiples of a face's edges, which the texture's edges follow."""
    corners = mesh.vertices[mesh.faces[face]]
    texture = mesh.texture_coordinates
    assert texture is not None
    places = texture[face]
    edges, sides = corners[:, 1:] - corners[:, :1], places[:, 1:] - places[:, :1]
    gram = np.einsum("sai,sbi->sab", edges, edges)
    right = np.einsum("sai,ski->sak", edges, steps)
    multiples = np.linalg.solve(gram, right)
    return np.einsum("sak,sai->ski", multiples, sides)
