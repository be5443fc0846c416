"""A reflection map from photographs of a sphere: its surface light field, no BRDF asked (T 5.8).

A photograph of a sphere shows every central direction R once, from the camera's own direction.  At
each texel of the map the photographs are a few values of one smooth function of the viewer, whose
harmonics to degree P are found by least squares.  With fewer photographs than (P+1)^2 the higher
degrees are held down by a penalty ``ridge`` p^2 (p+1)^2 relative to one observation's weight.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import Camera, Orthographic, Pinhole, Sphere, observe
from jaxrender.harmonics import LatLongGrid, degrees, real_basis
from jaxrender.reflection.shrm.maps import GlobalShrm, check_columns
from jaxrender.shapes import AnyArray, Array, Bool, Float, ImageArray, Int

# From a camera at a finite distance the normal that shows R depends on where the point is, and
# that on the normal: each round takes off a factor of the radius over the distance.
_ROUNDS = 12


class SphereFit(NamedTuple):
    """The map, how many photographs saw each texel, and the residual of those."""

    shrm: GlobalShrm
    seen: Int[np.ndarray, "row column"]
    relative_rms: float


class ViewerGoal(NamedTuple):
    """To which degree P, over which exit cosines, with which penalty on the higher degrees."""

    order: int
    least_cosine: float = 0.15
    ridge: float = 1e-4


def shrm_from_photographs(
    cameras: Sequence[Camera],
    photographs: Sequence[ImageArray],
    sphere: Sphere,
    grid: LatLongGrid,
    goal: ViewerGoal,
) -> SphereFit:
    """Fit the maps B_pq of a sphere seen by each camera, at every texel of ``grid``.

    Texels that no photograph shows are an error: ``ValueError`` says how many; also for no
    photograph at all, where cameras and photographs do not belong together, and for a grid with an
    odd number of columns.
    """
    check_columns(grid)
    if not cameras or len(cameras) != len(photographs):
        raise ValueError(
            f"{len(cameras)} cameras and {len(photographs)} photographs: give one camera each, "
            "and at least one"
        )
    centres = grid.directions().reshape(-1, 3)
    views = [
        _looked_up(camera, np.asarray(image, float), sphere, centres, goal.least_cosine)
        for camera, image in zip(cameras, photographs)
    ]
    values, outgoing, seen = (np.stack(part, axis=1) for part in zip(*views))
    count = seen.sum(axis=1)
    if not count.all():
        raise ValueError(
            f"{np.count_nonzero(count == 0)} of {len(count)} central directions are in no "
            "photograph: add cameras around the sphere, or lower least_cosine "
            f"({goal.least_cosine:g})"
        )
    found, left = _solve(outgoing, values, seen, goal.order, goal.ridge)
    maps = np.asarray(found).reshape(*grid.shape, -1, values.shape[2])
    total = np.sum(values[seen] ** 2)
    rms = float(np.sqrt(float(left) / total)) if total > 0 else 0.0
    band_limit = max(grid.band_limit - goal.order, 0)
    return SphereFit(GlobalShrm(maps, grid, band_limit), count.reshape(grid.shape), rms)


class _View(NamedTuple):
    """What one photograph shows at each central direction."""

    values: Float[np.ndarray, "texel channel"]
    outgoing: Float[np.ndarray, "texel 3"]
    seen: Bool[np.ndarray, "texel"]


def _looked_up(
    camera: Camera,
    image: Float[np.ndarray, "row column channel"],
    sphere: Sphere,
    centres: Float[np.ndarray, "texel 3"],
    least_cosine: float,
) -> _View:
    """Find the pixel that shows each central direction, and interpolate the photograph there."""
    if image.shape[:2] != (camera.height, camera.width):
        raise ValueError(
            f"a photograph of {image.shape[0]} x {image.shape[1]} pixels for a camera of "
            f"{camera.height} x {camera.width}: give the pair that belongs together"
        )
    outgoing = _towards(camera, np.broadcast_to(sphere.center, centres.shape))
    normals = centres
    for _ in range(_ROUNDS):
        normals = _unit(centres + outgoing)
        outgoing = _towards(camera, sphere.center + sphere.radius * normals)
    points = sphere.center + sphere.radius * normals
    x, y = camera.project(points).T - 0.5
    hit = observe(camera, sphere).hit
    top, left = np.floor(y), np.floor(x)
    inside = (top >= 0) & (left >= 0) & (top < image.shape[0] - 1) & (left < image.shape[1] - 1)
    top, left = (np.where(inside, place, 0).astype(int) for place in (top, left))
    down, right = np.where(inside, y - top, 0)[:, None], np.where(inside, x - left, 0)[:, None]
    value = np.zeros((len(centres), image.shape[2]))
    for row, share in ((top, 1 - down), (top + 1, down)):
        for column, part in ((left, 1 - right), (left + 1, right)):
            value += share * part * image[row, column]
            inside &= hit[row, column]
    facing = np.einsum("xi,xi->x", normals, outgoing) >= least_cosine
    return _View(value, outgoing, inside & facing)


def _towards(camera: Camera, points: Float[np.ndarray, "texel 3"]) -> Float[np.ndarray, "texel 3"]:
    """The unit directions from points to the camera."""
    if isinstance(camera, Orthographic):
        return np.broadcast_to(_unit(camera.world_from_camera[:3, 2]), points.shape)
    assert isinstance(camera, Pinhole), "the cameras there are"
    return _unit(camera.position - points)


def _unit(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1)


@eqx.filter_jit
def _solve(
    outgoing: Float[AnyArray, "texel view 3"],
    values: Float[AnyArray, "texel view channel"],
    seen: Bool[AnyArray, "texel view"],
    order: int,
    ridge: float,
) -> tuple[Float[Array, "texel outgoing channel"], Float[Array, ""]]:
    mask = jnp.asarray(seen).astype(jnp.asarray(values).dtype)[..., None]
    basis = real_basis(jnp.asarray(outgoing), order) * mask
    wanted = jnp.asarray(values) * mask
    degree = degrees(order)
    penalty = ridge * np.diag((degree * (degree + 1.0)) ** 2)
    gram = jnp.einsum("xvk,xvj->xkj", basis, basis, precision="highest") + penalty[None]
    right = jnp.einsum("xvk,xvc->xkc", basis, wanted, precision="highest")
    # The constant is not held down: where it alone is seen the matrix is definite as well.
    found = jnp.linalg.solve(gram, right)
    left = wanted - jnp.einsum("xvk,xkc->xvc", basis, found, precision="highest")
    return found, jnp.sum(left**2)
