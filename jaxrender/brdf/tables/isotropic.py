"""An isotropic BRDF as a table over the half and difference angles of Rusinkiewicz (1998).

With h the unit half vector and d = (w_i - w_o) / |w_i - w_o|,

    t_h = angle(h, n),    t_d = angle(h, w_i),    p_d = azimuth of d about h from the plane of h, n.

tan t_d = |w_i - w_o| / |w_i + w_o|, and tan p_d = (n . (h x d)) / (-n . d): exchanging w_i and w_o
turns p_d by pi and changes nothing else, so a table over p_d in [0, pi) is reciprocal.

Nodes, i from 0 to n - 1:  t_h = (pi/2) (i / n)^2, dense where highlights are, as in Matusik et al.,
A Data-Driven Reflectance Model (2003);  t_d = (pi/2) i / n;  p_d = pi i / n, periodic.  Between
them the value is linear in each angle, beyond the last one constant.  Values are in 1/sr.
"""

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.half_vector import are_visible, half_vector, lifted
from jaxrender.brdf.measured import ValuesPerChannel
from jaxrender.brdf.parameters import is_known
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int

HALF_PI = np.pi / 2

# A node below the horizon takes the value at this fraction of cos t_h above it.
_ABOVE_HORIZON = 0.02

_evaluate = eqx.filter_jit(BRDF.evaluate)


class HalfDifference(NamedTuple):
    """Angles in radians: t_h and t_d in [0, pi/2], p_d in [0, pi)."""

    theta_h: Float[AnyArray, "*batch"]
    theta_d: Float[AnyArray, "*batch"]
    phi_d: Float[AnyArray, "*batch"]


class Corner(NamedTuple):
    """One of the eight nodes about a point: its flat index in the table, and its weight."""

    index: Int[AnyArray, "*batch"]
    weight: Float[AnyArray, "*batch"]


class IsotropicTable(ValuesPerChannel):
    """``values`` in 1/sr at the nodes of a grid [theta_h, theta_d, phi_d, channel].

    Raises ``ValueError`` for a table of another rank, with fewer than two nodes of either polar
    angle, and for values that are negative or not finite.
    """

    values: Float[AnyArray, "theta_h theta_d phi_d channel"]

    def __check_init__(self):
        shape = np.shape(self.values)
        if len(shape) != 4 or min(shape[:2]) < 2 or min(shape) < 1:
            raise ValueError(
                f"values has shape {shape}: give [theta_h, theta_d, phi_d, channel] with at least "
                "2 nodes of theta_h and of theta_d"
            )
        if is_known(self.values):
            _refuse_broken(np.asarray(self.values))

    @classmethod
    def of(cls, brdf: BRDF, shape: tuple[int, int, int] = (90, 90, 180)) -> "IsotropicTable":
        """Tabulate a BRDF on ``shape`` nodes of theta_h, theta_d and phi_d.

        Nodes below the horizon take the value just above it at a smaller theta_d.  Raises
        ``ValueError`` for a BRDF that is not isotropic, and whatever the constructor refuses.
        """
        if not brdf.isotropic:
            raise ValueError(
                f"{type(brdf).__name__} is anisotropic here; only isotropic ones fit: take the "
                "mean over turns, IsotropicMean(brdf)"
            )
        angles = node_angles(shape)
        incoming, outgoing = pair_at(raised(angles, _ABOVE_HORIZON * np.cos(angles.theta_h)))
        found = _evaluate(brdf, incoming.reshape(-1, 3), outgoing.reshape(-1, 3))
        return cls(found.reshape(*shape, -1))

    @property
    def reciprocal(self) -> bool:
        """Always, by the range of phi_d."""
        return True

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Interpolate each channel times cos t_i."""
        angles = half_difference(incoming, outgoing)
        rows = jnp.asarray(self.values).reshape(-1, self.values.shape[-1])
        parts = [
            jnp.asarray(corner.weight)[..., None] * rows[corner.index].astype(corner.weight.dtype)
            for corner in corners(self.values.shape[:3], angles)
        ]
        visible, value = are_visible(incoming, outgoing), sum(parts[1:], parts[0])
        return tuple(
            jnp.where(visible, value[..., c] * incoming.z, 0) for c in range(value.shape[-1])
        )


def half_difference(incoming: Components, outgoing: Components) -> HalfDifference:
    """Evaluate the three angles; p_d = 0 where it means nothing, with derivatives 0."""
    incoming, outgoing = lifted(incoming), lifted(outgoing)
    half = half_vector(incoming, outgoing).direction
    apart = Components(*(a - b for a, b in zip(incoming, outgoing, strict=True)))
    # Of two numbers that are not negative, and of which the second is positive, the arc tangent of
    # the ratio is the angle; that of two arguments takes twice as long.
    theta_h = jnp.arctan(_length(half.x, half.y) / half.z)
    # |w_i + w_o| from the sum itself, which does not cancel at grazing.
    together = _length(*(a + b for a, b in zip(incoming, outgoing, strict=True)))
    theta_d = jnp.arctan(_length(*apart) / together)
    phi_d = _azimuth(half.x * apart.y - half.y * apart.x, -apart.z)
    # Each is evaluated once, and not once for each corner of a cell.
    return jax.lax.optimization_barrier(HalfDifference(theta_h, theta_d, phi_d))


def corners(shape: tuple[int, ...], angles: HalfDifference) -> tuple[Corner, ...]:
    """Find the eight nodes about each point, and the weights that interpolate linearly."""
    n_h, n_d, n_p = shape
    theta_h, theta_d, phi_d = (jnp.asarray(angle) for angle in angles)
    # The square root is for the index alone: its derivative at 0 is infinite.
    i = _cell(jnp.sqrt(jax.lax.stop_gradient(theta_h) / HALF_PI) * n_h, n_h)
    across = theta_h / HALF_PI * n_h**2 - jnp.square(i).astype(theta_h.dtype)
    along_h = _ends(i, across / (2 * i + 1).astype(theta_h.dtype), jnp.minimum(i + 1, n_h - 1))
    j = _cell(theta_d / HALF_PI * n_d, n_d)
    rest = theta_d / HALF_PI * n_d - j.astype(theta_d.dtype)
    along_d = _ends(j, rest, jnp.minimum(j + 1, n_d - 1))
    k = _cell(phi_d / np.pi * n_p, n_p)
    along_p = _ends(k, phi_d / np.pi * n_p - k.astype(phi_d.dtype), (k + 1) % n_p)
    return tuple(
        Corner((h.index * n_d + d.index) * n_p + p.index, h.weight * d.weight * p.weight)
        for h, d, p in itertools.product(along_h, along_d, along_p)
    )


def node_angles(shape: tuple[int, int, int]) -> HalfDifference:
    """Lay out the nodes of a table, each angle of the table's shape (radians)."""
    theta_h, theta_d, phi_d = (np.arange(n) / n for n in shape)
    grids = np.meshgrid(HALF_PI * theta_h**2, HALF_PI * theta_d, np.pi * phi_d, indexing="ij")
    return HalfDifference(*grids)


def pair_at(
    angles: HalfDifference,
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
    """Find an incoming and an outgoing direction with these angles, the half vector over +X.

    The other one below the horizon is part of the answer where no pair above it has the angles.
    """
    theta_h, theta_d, phi_d = (np.asarray(angle) for angle in angles)
    nothing = np.zeros_like(theta_h)
    half = np.stack([np.sin(theta_h), nothing, np.cos(theta_h)], axis=-1)
    downhill = np.stack([np.cos(theta_h), nothing, -np.sin(theta_h)], axis=-1)
    towards = np.cos(phi_d)[..., None] * downhill + np.sin(phi_d)[..., None] * [0, 1, 0]
    middle, side = np.cos(theta_d)[..., None] * half, np.sin(theta_d)[..., None] * towards
    return middle + side, middle - side


def raised(
    angles: HalfDifference, least_cosine: Float[np.ndarray, "*#batch"] | float
) -> HalfDifference:
    """Reduce t_d, and only then t_h, until both directions have at least this cosine.

    The lower direction's is cos t_h cos t_d - sin t_h |cos p_d| sin t_d.
    """
    theta_h = np.minimum(angles.theta_h, np.arccos(least_cosine))
    along, across = np.cos(theta_h), np.sin(theta_h) * np.abs(np.cos(angles.phi_d))
    ratio = np.minimum(least_cosine / np.hypot(along, across), 1)
    largest = np.arccos(ratio) - np.arctan2(across, along)
    return HalfDifference(theta_h, np.clip(angles.theta_d, 0, np.maximum(largest, 0)), angles.phi_d)


def nearest_known(
    known: Bool[np.ndarray, "theta_h theta_d phi_d"],
) -> Int[np.ndarray, "theta_h theta_d phi_d"]:
    """Number for each node the known one whose value it takes, itself if it is known.

    That is the next at a smaller theta_d, else at a larger one, else at the nearest smaller or
    larger theta_h; itself where nothing is known.
    """
    index = np.arange(known.size).reshape(known.shape)
    for axis, turned in ((1, False), (1, True), (0, False), (0, True)):
        if known.all():
            break
        order = slice(None, None, -1 if turned else 1)
        seen = np.moveaxis(known, axis, 0)[order]
        rows = np.arange(len(seen)).reshape(-1, 1, 1)
        # The last row at or before each that is known; -1 where there is none yet.
        source = np.maximum.accumulate(np.where(seen, rows, -1), axis=0)
        ahead = np.moveaxis(index, axis, 0)[order]
        copied = np.take_along_axis(ahead, np.maximum(source, 0), axis=0)
        index = np.moveaxis(copied[order], 0, axis)
        known = np.moveaxis((source >= 0)[order], 0, axis)
    return index


def _length(*parts: Float[AnyArray, "*batch"]) -> Float[Array, "*batch"]:
    squares = [jnp.square(part) for part in parts]
    square = sum(squares[1:], squares[0])
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1)), 0)


def _azimuth(y: Float[AnyArray, "*batch"], x: Float[AnyArray, "*batch"]) -> Float[Array, "*batch"]:
    """Evaluate the azimuth modulo pi, in [0, pi)."""
    steep = jnp.abs(y) > jnp.abs(x)
    above, below = jnp.where(steep, -x, y), jnp.where(steep, y, x)
    # Of a ratio that is at most 1, and smooth where x = 0.
    angle = jnp.arctan(above / jnp.where(below == 0, 1, below)) + jnp.where(steep, HALF_PI, 0)
    angle = jnp.where(angle < 0, angle + np.pi, angle)
    # Rounding may reach pi itself, which is 0.
    return jnp.where(angle < np.pi, angle, 0)


def _cell(position: Float[Array, "*batch"], count: int) -> Int[Array, "*batch"]:
    return jnp.clip(jnp.floor(jax.lax.stop_gradient(position)), 0, count - 1).astype(np.int32)


def _ends(
    index: Int[Array, "*batch"], fraction: Float[Array, "*batch"], following: Int[Array, "*batch"]
) -> tuple[Corner, Corner]:
    fraction = jnp.clip(fraction, 0, 1)
    return Corner(index, 1 - fraction), Corner(following, fraction)


def _refuse_broken(values: Float[np.ndarray, "..."]) -> None:
    broken = ~(np.isfinite(values) & (values >= 0))
    if broken.any():
        place = tuple(int(i) for i in np.argwhere(broken)[0])
        raise ValueError(
            f"values{list(place)} is {values[place]:.6g} ({broken.sum()} such): values are finite "
            "and not negative; fill entries that were not measured from their neighbours"
        )
