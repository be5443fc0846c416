"""An isotropic BRDF as a table over two polar angles and the azimuth between them (L 2.9).

f(t_i, t_r, p_r - p_i), the azimuth in [0, 2 pi), samples at the centres of the cells of
t / (pi/2) and p / 2 pi, as on the polar map; values in 1/sr.  The same reconstructions as
``TabulatedBRDF``, for the cube root of its square's samples.  Beyond the pole of either angle the
azimuth goes on by half a turn (an even number of azimuths is asked for); beyond the horizon the
end samples are repeated.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.half_vector import are_visible
from jaxrender.brdf.measured import ValuesPerChannel
from jaxrender.brdf.parameters import is_known, refuse_unlisted
from jaxrender.brdf.tables.cells import refuse_unknown, values_of_pairs
from jaxrender.brdf.tables.reconstruction import (
    RECONSTRUCTIONS,
    Taps,
    axis_taps,
    polar_taps,
    product_taps,
    weighted_sum,
)
from jaxrender.geometry import Components, direction_from_angles
from jaxrender.shapes import AnyArray, Array, Float

_evaluate = eqx.filter_jit(BRDF.evaluate)


class PolarIsotropicTable(ValuesPerChannel):
    """``values`` in 1/sr of [theta_i, theta_r, azimuth, channel].

    Raises ``ValueError`` for a table of another rank, an odd number of azimuths, values that are
    not finite, and an unlisted reconstruction.
    """

    values: Float[AnyArray, "theta_i theta_r azimuth channel"]
    reconstruction: str = eqx.field(static=True, default="linear")

    def __check_init__(self):
        refuse_unlisted("reconstruction", self.reconstruction, tuple(RECONSTRUCTIONS))
        shape = np.shape(self.values)
        if len(shape) != 4 or min(shape) < 1 or shape[2] % 2:
            raise ValueError(
                f"values has shape {shape}: give [theta_i, theta_r, azimuth, channel] with an even "
                "number of azimuths"
            )
        if is_known(self.values):
            refuse_unknown(np.asarray(self.values))

    @classmethod
    def of(
        cls, brdf: BRDF, size: tuple[int, int, int], reconstruction: str = "linear"
    ) -> "PolarIsotropicTable":
        """Tabulate a BRDF at the centres of ``size`` cells, in JAX's default precision.

        Raises ``ValueError`` for a BRDF that is not isotropic, and whatever the constructor does.
        """
        if not brdf.isotropic:
            raise ValueError(f"{type(brdf).__name__} is anisotropic here; use TabulatedBRDF")
        if len(size) != 3 or min(size) < 1:
            raise ValueError(f"size={size}: give three positive numbers")
        polar_i, polar_r, azimuth = ((np.arange(n) + 0.5) / n for n in size)
        incoming = np.asarray(direction_from_angles(np.pi / 2 * polar_i, 0.0), float)
        grid = np.meshgrid(np.pi / 2 * polar_r, 2 * np.pi * azimuth, indexing="ij")
        outgoing = np.asarray(direction_from_angles(*grid), float).reshape(-1, 3)
        found = values_of_pairs(lambda a, b: _evaluate(brdf, a, b), incoming, outgoing)
        return cls(found.reshape(*size, -1), reconstruction)

    @property
    def reciprocal(self) -> bool:
        """When exchanging the polar angles and turning the azimuth back gives the same samples."""
        values = np.asarray(self.values)
        if values.shape[0] != values.shape[1]:
            return False
        back = values.transpose(1, 0, 2, 3)[:, :, ::-1]
        return bool(np.abs(values - back).max() <= 1e-5 * np.abs(values).max())

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Reconstruct each channel times cos t_i."""
        n_i, n_r, n_p, channels = self.values.shape
        along_i, beyond_i = polar_taps(self.reconstruction, _polar(incoming), n_i)
        along_r, beyond_r = polar_taps(self.reconstruction, _polar(outgoing), n_r)
        around = axis_taps(self.reconstruction, _turn(incoming, outgoing), n_p)
        # Two half turns are none.
        turn = (beyond_i[:, None] ^ beyond_r[None]).astype(jnp.int32) * (n_p // 2)
        pairs = along_i.index[:, None] * n_r + along_r.index[None]
        weight = along_i.weight[:, None] * along_r.weight[None]
        outer = product_taps(Taps(pairs * (n_p + n_p // 2) + turn, weight))
        # Half a turn more of every row, so that a half turn is a shift of the index.
        values = jnp.asarray(self.values)
        rows = jnp.concatenate([values, values[:, :, : n_p // 2]], axis=2).reshape(-1, channels)
        value = weighted_sum(rows, outer, Taps(around.index % n_p, around.weight))
        visible = are_visible(incoming, outgoing)
        return tuple(jnp.where(visible, value[..., c] * incoming.z, 0) for c in range(channels))


def _polar(direction: Components) -> Float[Array, "*batch"]:
    """Evaluate the polar angle over a right one, without derivatives at the pole."""
    square = jnp.asarray(direction.x**2 + direction.y**2)
    at_pole = square == 0
    sine = jnp.sqrt(jnp.where(at_pole, 1, square))
    return jnp.where(at_pole, 0, jnp.arctan2(sine, jnp.abs(direction.z))) / (np.pi / 2)


def _turn(incoming: Components, outgoing: Components) -> Float[Array, "*batch"]:
    """Evaluate the azimuth from the incoming to the outgoing direction in turns, in [0, 1)."""
    across = incoming.x * outgoing.y - incoming.y * outgoing.x
    along = jnp.asarray(incoming.x * outgoing.x + incoming.y * outgoing.y)
    angle = jnp.arctan2(across, jnp.where((across == 0) & (along == 0), 1, along)) / (2 * np.pi)
    return jnp.where(angle < 0, angle + 1, angle)
