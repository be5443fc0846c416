"""The isotropic part of any BRDF: its mean over turns about the normal, and over mirror images.

    rho_mean(w_i, w_o) = 1 / 2N  sum over k, m of rho(T_km w_i, T_km w_o),
    T_km = Rz(2 pi k / N) M^m,    k = 0 .. N - 1,    m = 0, 1,

with M the mirror image y -> -y.  The mean over all turns and mirror images is the isotropic BRDF
nearest to rho in the norm int int rho^2 cos t_i cos t_o; N turns stand for it, and what they leave
changes with the azimuth by waves of N and more periods.  Isotropic here means without handedness
too, as the expansions about the reflected ray have it (T 5.22: rho_lpq = rho_lp,-q).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

TURNS = 16


class IsotropicMean(BRDF):
    """The mean of a BRDF over ``turns``, each with its mirror image: 2 ``turns`` evaluations.

    Raises ``ValueError`` for fewer than one turn.
    """

    brdf: BRDF
    turns: int = eqx.field(static=True, default=TURNS)

    def __check_init__(self):
        if self.turns < 1:
            raise ValueError(f"turns={self.turns}: give at least one, {TURNS} for smooth lobes")

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """The BRDF's own."""
        return self.brdf.amplitudes

    @property
    def reciprocal(self) -> bool:
        """When the BRDF is."""
        return self.brdf.reciprocal

    @property
    def conserves_energy(self) -> bool:
        """When the BRDF does: its largest albedo is no less than the mean's."""
        return self.brdf.conserves_energy

    @property
    def isotropic(self) -> bool:
        """By construction, to what finitely many turns leave."""
        return True

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Average each lobe's transfer function, one turn at a time."""
        pair = jnp.broadcast_arrays(*incoming, *outgoing)
        azimuths = 2 * np.pi * np.arange(self.turns) / self.turns
        turns = jnp.asarray(
            [(np.cos(a), np.sin(a), side) for a in azimuths for side in (1.0, -1.0)], pair[0].dtype
        )

        def add(total: tuple, turn: Float[Array, "3"]):
            ends = (_turned(Components(*pair[i : i + 3]), turn) for i in (0, 3))
            return tuple(a + b for a, b in zip(total, self.brdf.transfer(*ends))), None

        shapes = jax.eval_shape(lambda: self.brdf.transfer(incoming, outgoing))
        start = tuple(jnp.zeros(pair[0].shape, lobe.dtype) for lobe in shapes)
        found, _ = jax.lax.scan(add, start, turns)
        return tuple(lobe / len(turns) for lobe in found)


def _turned(direction: Components, turn: Float[Array, "3"]) -> Components:
    cosine, sine, side = turn
    x, y = direction.x, direction.y * side
    return Components(cosine * x - sine * y, sine * x + cosine * y, direction.z)
