"""The angular distribution of a luminaire: intensity as a function of direction, as goniometers
give it.

Frame of the luminaire: +Z up, so that a luminaire at the ceiling shines towards -Z.  The vertical
angle v counts from the nadir -Z, the horizontal angle h from +X towards +Y, counterclockwise from
above: the direction *away from the luminaire* is (sin v cos h, sin v sin h, -cos v).  (Type C
photometry.)

Between the nodes intensity is linear in either angle; in the horizontal one it is periodic, in the
vertical one zero outside the nodes.  Units are those of the table: cd, or W/sr; a receiver at
distance r that faces the luminaire gets I / r^2 (lx, or W/m^2).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.shapes import AnyArray, Array, Directions, Float, checked

_TURN = 2 * np.pi
# How many roundings beyond the last vertical angle still count as on it.
_ROUNDINGS = 8


class AngularIntensity(eqx.Module):
    """``values`` [horizontal, vertical, channel] at ascending angles in radians.

    Horizontal angles lie in [0, 2 pi) and vertical ones in [0, pi]; one horizontal angle alone is
    symmetry about the axis.  Raises ``ValueError`` for shapes that do not match, fewer than two
    vertical angles, angles that do not ascend or lie outside, and intensities that are negative or
    not finite.
    """

    horizontal: Float[AnyArray, "horizontal"]
    vertical: Float[AnyArray, "vertical"]
    values: Float[AnyArray, "horizontal vertical channel"]

    def __check_init__(self):
        sizes = (*self.horizontal.shape, *self.vertical.shape)
        if np.shape(self.values)[:2] != sizes or len(np.shape(self.values)) != 3:
            raise ValueError(
                f"values has shape {np.shape(self.values)} for {sizes[0]} horizontal and {sizes[1]}"
                " vertical angles: give [horizontal, vertical, channel]"
            )
        if sizes[0] < 1 or sizes[1] < 2:
            raise ValueError(f"{sizes[0]} x {sizes[1]} angles: give at least 1 x 2")
        if any(isinstance(a, Tracer) for a in (self.horizontal, self.vertical, self.values)):
            return
        _refuse_angles("horizontal", np.asarray(self.horizontal), "[0, 2 pi)", _TURN * (1 - 1e-9))
        _refuse_angles("vertical", np.asarray(self.vertical), "[0, pi]", np.pi * (1 + 1e-6))
        values = np.asarray(self.values)
        broken = ~(np.isfinite(values) & (values >= 0))
        if broken.any():
            place = tuple(int(i) for i in np.argwhere(broken)[0])
            raise ValueError(
                f"values{list(place)} is {values[place]:.6g} ({broken.sum()} such): intensities "
                "are finite and not negative"
            )

    @checked
    def intensity(self, directions: Directions) -> Float[Array, "*batch channel"]:
        """Interpolate along unit directions away from the luminaire."""
        directions = jnp.asarray(directions)
        x, y, z = (directions[..., k] for k in range(3))
        square = x * x + y * y
        on_axis = square == 0
        # Either branch is differentiated: keep the arc tangents away from 0/0.
        across = jnp.sqrt(jnp.where(on_axis, 1, square))
        polar = jnp.where(on_axis, jnp.where(z > 0, np.pi, 0), jnp.arctan2(across, -z))
        turn = jnp.where(on_axis, 0, jnp.arctan2(y, jnp.where(on_axis, 1, x)))
        low, high, along, inside = self._vertical_cell(polar)
        left, right, around = self._horizontal_cell(turn)
        values = jnp.asarray(self.values, directions.dtype)
        along, around = along[..., None], around[..., None]
        near = (1 - along) * values[left, low] + along * values[left, high]
        far = (1 - along) * values[right, low] + along * values[right, high]
        return jnp.where(inside[..., None], (1 - around) * near + around * far, 0)

    def flux(self) -> Float[Array, "channel"]:
        """Integrate the interpolant over the sphere, exactly: lm, or W.

        A piece between a and b with middle m and half width d gives its ends the shares
        int (b - v) sin v dv / (b - a) = sin m sin d + cos m (cos d - sin d / d), and with - for +.
        """
        nodes, values = jnp.asarray(self.vertical), jnp.asarray(self.values)
        middle, half = (nodes[1:] + nodes[:-1]) / 2, (nodes[1:] - nodes[:-1]) / 2
        even = jnp.sin(middle) * jnp.sin(half)
        odd = jnp.cos(middle) * (jnp.cos(half) - jnp.sinc(half / np.pi))
        nothing = jnp.zeros(1, nodes.dtype)
        down = jnp.concatenate([even + odd, nothing]) + jnp.concatenate([nothing, even - odd])
        gaps = self._gaps()
        around = (gaps + jnp.roll(gaps, 1)) / 2
        down, around = down.astype(values.dtype), around.astype(values.dtype)
        return jnp.einsum("h,v,hvc->c", around, down, values, precision="highest")

    def _gaps(self) -> Float[Array, "horizontal"]:
        """Measure from each horizontal angle to the next, once around in all."""
        nodes = jnp.asarray(self.horizontal)
        return jnp.concatenate([nodes[1:], nodes[:1] + _TURN]) - nodes

    def _vertical_cell(self, polar: Float[Array, "*batch"]) -> tuple[Array, Array, Array, Array]:
        nodes = jnp.asarray(self.vertical, polar.dtype)
        slack = _ROUNDINGS * float(jnp.finfo(polar.dtype).eps)
        inside = (polar >= nodes[0] - slack) & (polar <= nodes[-1] + slack)
        found = jnp.searchsorted(nodes, jax.lax.stop_gradient(polar), side="right")
        low = jnp.clip(found - 1, 0, nodes.size - 2)
        fraction = (polar - nodes[low]) / (nodes[low + 1] - nodes[low])
        return low, low + 1, jnp.clip(fraction, 0, 1), inside

    def _horizontal_cell(self, turn: Float[Array, "*batch"]) -> tuple[Array, Array, Array]:
        nodes, gaps = jnp.asarray(self.horizontal, turn.dtype), self._gaps().astype(turn.dtype)
        turn = jnp.where(turn < 0, turn + _TURN, turn)
        found = jnp.searchsorted(nodes, jax.lax.stop_gradient(turn), side="right")
        # Before the first node is the gap that the last one opens.
        left = (found - 1) % nodes.size
        ahead = turn - nodes[left]
        fraction = jnp.where(ahead < 0, ahead + _TURN, ahead) / gaps[left]
        return left, (left + 1) % nodes.size, jnp.clip(fraction, 0, 1)


def _refuse_angles(
    name: str, angles: Float[np.ndarray, "angle"], interval: str, largest: float
) -> None:
    if not (np.isfinite(angles).all() and np.all(np.diff(angles) > 0)):
        raise ValueError(f"{name} angles {angles}: they must ascend")
    if angles[0] < 0 or angles[-1] > largest:
        raise ValueError(
            f"{name} angles from {angles[0]:.6g} to {angles[-1]:.6g}: they lie in {interval} "
            "radians"
        )
