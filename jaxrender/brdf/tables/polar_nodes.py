"""A BRDF as a table over the polar angles and azimuths of both directions, anisotropic.

Nodes: polar angles t_k = T k / (n - 1) from the normal to T = ``largest_polar``, azimuths
p_k = 2 pi k / n.  Between them the value is linear in each of the four angles and periodic in the
azimuths; beyond T it is held constant in the polar angle, down to the horizon.  At the normal all
azimuths are one direction, but a table may have a value for each: which one is seen there depends
on where the direction comes from.  Values are in 1/sr.
"""

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.half_vector import are_visible
from jaxrender.brdf.measured import ValuesPerChannel
from jaxrender.brdf.parameters import is_known
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float, Int


class _Node(NamedTuple):
    """One of the four nodes about a direction: its index among all, and its weight."""

    index: Int[Array, "*batch"]
    weight: Float[Array, "*batch"]


class PolarNodesTable(ValuesPerChannel):
    """``values`` in 1/sr [theta_i, phi_i, theta_o, phi_o, channel]; ``largest_polar`` in radians.

    Raises ``ValueError`` for a table of another rank, with fewer than two polar angles, for values
    that are negative or not finite, and for a largest polar angle outside (0, pi/2].
    """

    values: Float[AnyArray, "theta_i phi_i theta_o phi_o channel"]
    largest_polar: float = eqx.field(static=True)

    def __check_init__(self):
        shape = np.shape(self.values)
        if len(shape) != 5 or min(shape[0], shape[2]) < 2 or min(shape) < 1:
            raise ValueError(
                f"values has shape {shape}: give [theta_i, phi_i, theta_o, phi_o, channel] with at "
                "least 2 polar angles of either direction"
            )
        if not 0 < self.largest_polar <= np.pi / 2:
            raise ValueError(
                f"largest_polar={self.largest_polar:.6g}: it lies in (0, pi/2] radians"
            )
        if is_known(self.values):
            values = np.asarray(self.values)
            broken = ~(np.isfinite(values) & (values >= 0))
            if broken.any():
                place = tuple(int(i) for i in np.argwhere(broken)[0])
                raise ValueError(
                    f"values{list(place)} is {values[place]:.6g} ({broken.sum()} such): values "
                    "are finite and not negative"
                )

    @property
    def reciprocal(self) -> bool:
        """When the table's own values are, all of them exactly; measured ones are not."""
        values = np.asarray(self.values)
        turned = np.moveaxis(values, (0, 1), (2, 3))
        return values.shape == turned.shape and bool(np.all(values == turned))

    @property
    def isotropic(self) -> bool:
        """No promise: between the nodes of any table the azimuths matter apart."""
        return False

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Interpolate each channel times cos t_i."""
        n_ti, n_pi, n_to, n_po, channels = self.values.shape
        rows = jnp.asarray(self.values).reshape(-1, channels)
        value = jnp.zeros(())
        for near, far in itertools.product(
            _nodes(incoming, n_ti, n_pi, self.largest_polar),
            _nodes(outgoing, n_to, n_po, self.largest_polar),
        ):
            weight = near.weight * far.weight
            found = rows[near.index * (n_to * n_po) + far.index].astype(weight.dtype)
            value = value.astype(weight.dtype) + weight[..., None] * found
        visible = are_visible(incoming, outgoing)
        return tuple(jnp.where(visible, value[..., c] * incoming.z, 0) for c in range(channels))


def node_directions(shape: tuple[int, int], largest_polar: float) -> Float[np.ndarray, "_ _ 3"]:
    """Lay out the directions of a table's nodes, [polar, azimuth, 3]."""
    polar = largest_polar * np.arange(shape[0])[:, None] / (shape[0] - 1)
    azimuth = 2 * np.pi * np.arange(shape[1])[None, :] / shape[1]
    parts = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def _nodes(
    direction: Components, n_polar: int, n_azimuth: int, largest: float
) -> tuple[_Node, ...]:
    """Find the four nodes about a direction, and the weights that interpolate linearly."""
    x, y, z = (jnp.asarray(part) for part in direction)
    square = x * x + y * y
    at_pole = square == 0
    # Either branch is differentiated: keep the arc tangents away from 0/0.
    across = jnp.sqrt(jnp.where(at_pole, 1, square))
    polar = jnp.where(at_pole, 0, jnp.arctan2(across, z))
    turn = jnp.where(at_pole, 0, jnp.arctan2(y, jnp.where(at_pole, 1, x))) / (2 * np.pi)
    down = jnp.clip(polar / largest, 0, 1) * (n_polar - 1)
    around = jnp.where(turn < 0, turn + 1, turn) * n_azimuth
    i = _cell(down, n_polar - 1)
    k = _cell(around, n_azimuth)
    ahead, aside = down - i.astype(down.dtype), around - k.astype(around.dtype)
    corners = itertools.product(
        ((i, 1 - ahead), (i + 1, ahead)), ((k, 1 - aside), ((k + 1) % n_azimuth, aside))
    )
    return tuple(_Node(i * n_azimuth + k, a * b) for (i, a), (k, b) in corners)


def _cell(position: Float[Array, "*batch"], count: int) -> Int[Array, "*batch"]:
    return jnp.clip(jnp.floor(jax.lax.stop_gradient(position)), 0, count - 1).astype(np.int32)
