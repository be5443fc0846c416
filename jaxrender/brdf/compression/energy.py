"""The white furnace of trees: how much of the light from a direction leaves again, at most 1.

Thresholding spreads light over neighbouring directions of incidence.  A tree may send out up to
``FURNACE_LIMIT`` times what its table does from directions down to ``LAST_DEGREE``.  Where one
would do more, its table is dimmed and thresholded again.  A material that itself sends out more
than arrives is dimmed by ``conserving``.  Both are

    rho'(w_i, w_r) = g(w_i) g(w_r) rho(w_i, w_r),      0 < g <= 1,

which keeps reciprocity, isotropy and hue, and leaves directions alone that need nothing.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.measured import MeasuredAlbedo
from jaxrender.brdf.properties import directional_albedo, evaluated_about_mirror
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Bool, Float

FURNACE_LIMIT = 1.02
DEGREES = (0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 75.0, 80.0, 85.0)
"""Angles from the normal at which the albedo of an isotropic tree is measured."""
LAST_DEGREE = DEGREES[-1]
# Sums over cells and directions are good to this.
TOLERANCE = 0.02
CONSERVES, CREATES, BRDF_CREATES = "conserves_energy", "creates_energy", "brdf_creates_energy"
# Where g is tabulated: denser towards grazing, where albedos grow.
_NODES = np.cos(np.radians([*np.arange(0, 80, 5.0), *np.arange(80, 90, 1.0), 89.5]))[::-1]
_TURNS = 4
_STEPS = 500
# Between its nodes g is linear, and sums are rounded.
_SPARE = 1e-3
_POWER = 0.7
MENDINGS = 8
"""So often a table is dimmed; what is left then is a factor of the whole tree."""

Albedo = Float[np.ndarray, "*direction channel"]
Weights = Float[np.ndarray, "*direction"]
Near = Bool[np.ndarray, "*direction"]


class Energy(NamedTuple):
    """The share of light that a tree sends out again, beside that of its table.

    ``ratio`` is the largest of tree over table from the same direction, down to ``LAST_DEGREE``,
    and ``undimmed`` what it would be if the table had not been dimmed.  ``lost`` is the share of
    uniform light that the table reflects and the tree does not.
    """

    largest: float
    of_table: float
    ratio: float
    undimmed: float
    lost: float

    @classmethod
    def of(
        cls, found: Albedo, table: Albedo, weights: Weights, near: Near, first: float
    ) -> "Energy":
        """Compare albedos from the same directions; ``weights`` are projected solid angles.

        ``first`` is the largest ``excess`` before the table was dimmed.
        """
        whole, left = (float(np.sum(weights[..., None] * part)) for part in (table, found))
        lit = weights > 0
        largest, of_table = (float(np.max(part[lit], initial=0)) for part in (found, table))
        ratio = float(np.max(_ratio(found, table)[near], initial=0))
        lost = 1 - left / whole if whole > 0 else 0.0
        return cls(largest, of_table, ratio, max(FURNACE_LIMIT * first, ratio), lost)

    @property
    def outcome(self) -> str:
        """``conserves_energy``, or who sends out more than arrives: the tree, or the BRDF too."""
        if self.largest <= 1 + TOLERANCE:
            return CONSERVES
        return BRDF_CREATES if self.of_table > 1 + TOLERANCE else CREATES

    def sentence(self) -> str:
        """Say it."""
        said = (
            f"energy: {self.outcome}; largest albedo {self.largest:.3g} (the table "
            f"{self.of_table:.3g}), from any direction at most {self.ratio:.3g} times the table's; "
            f"{100 * self.lost:.2g} % of what the table reflects is lost"
        )
        if self.undimmed > FURNACE_LIMIT:
            said += f"; dimmed where it would be up to {self.undimmed:.3g} times"
        if self.outcome != CONSERVES:
            said += "; --conserve scales it"
        return said


def excess(
    found: Albedo, table: Albedo, near: Near, limit: float | None
) -> Float[np.ndarray, "*direction"]:
    """Divide a tree's albedo by what it may be, in the worst channel.

    It may be ``FURNACE_LIMIT`` times the table's where ``near`` the normal, and ``limit`` anywhere.
    """
    above = np.where(near, _ratio(found, table) / FURNACE_LIMIT, 0)
    return above if limit is None else np.maximum(above, found.max(axis=-1) / limit)


def _ratio(found: Albedo, table: Albedo) -> Float[np.ndarray, "*direction"]:
    return np.where(table > 0, found / np.where(table > 0, table, 1), 0).max(axis=-1)


def dimmed_further(
    factors: Float[np.ndarray, "*direction"], above: Float[np.ndarray, "*direction"]
) -> Float[np.ndarray, "*direction"]:
    """Lower g where there is an excess: between what a mirror needs, a root, and white, all."""
    return factors / np.maximum(above * (1 + _SPARE), 1) ** _POWER


def isotropic_albedo(brdf: BRDF) -> Float[np.ndarray, "degree channel"]:
    """Evaluate the albedo at ``DEGREES``."""
    return directional_albedo(brdf, np.cos(np.radians(DEGREES)))


class Dimmed(MeasuredAlbedo):
    """Another BRDF times g(cos t_i) g(cos t_r), linear between ascending ``cosines``."""

    brdf: BRDF
    cosines: Float[AnyArray, "node"]
    factors: Float[AnyArray, "node"]

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """The BRDF's own."""
        return self.brdf.amplitudes

    @property
    def reciprocal(self) -> bool:
        """When the BRDF is."""
        return self.brdf.reciprocal

    @property
    def isotropic(self) -> bool:
        """When the BRDF is."""
        return self.brdf.isotropic

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate each lobe of the BRDF times both factors."""
        nodes, factors = jnp.asarray(self.cosines), jnp.asarray(self.factors)
        arriving, leaving = (
            jnp.interp(jnp.asarray(part.z), nodes, factors) for part in (incoming, outgoing)
        )
        return tuple(
            lobe * (arriving * leaving).astype(lobe.dtype)
            for lobe in self.brdf.transfer(incoming, outgoing)
        )


class Conserving(NamedTuple):
    """A BRDF that sends out no more than arrives, and what that cost."""

    brdf: BRDF
    largest: float
    """The largest albedo before."""
    lost: float
    """Of uniform light that it reflected before, the share that it no longer does."""

    def sentence(self) -> str:
        """Say it."""
        if not isinstance(self.brdf, Dimmed):
            return f"conserve: largest albedo {self.largest:.3g}, nothing to scale"
        factor = np.interp(np.cos(np.radians([0, 45, 75, 85])), _NODES, self.brdf.factors)
        listed = ", ".join(f"{g:.3g}" for g in factor)
        return (
            f"conserve: the BRDF's largest albedo is {self.largest:.3g}; multiplied by "
            f"g(t_i) g(t_r), g = {listed} at 0, 45, 75, 85 degrees, which keeps reciprocity; "
            f"{100 * self.lost:.3g} % of what it reflects of uniform light is lost"
        )


def conserving(brdf: BRDF) -> Conserving:
    """Dim a BRDF as little as leaves no albedo above 1; one that conserves energy is returned.

    Anisotropic ones are looked at from four directions in half a turn.  g is found by symmetric
    scaling (Sinkhorn 1967) of the light from each angle to each other, in the worst channel.
    """
    turns = np.arange(1 if brdf.isotropic else _TURNS) * np.pi / _TURNS
    exchange = np.stack([[_exchange(brdf, c, turn) for c in _NODES] for turn in turns])

    def albedo(g: Float[np.ndarray, "node"]) -> Float[np.ndarray, "turn node channel"]:
        return g[:, None] * np.einsum("tijc,j->tic", exchange, g)

    factors = np.ones(len(_NODES))
    before = albedo(factors)
    largest = float(before.max())
    if largest <= 1:
        return Conserving(brdf, largest, 0.0)
    for _ in range(_STEPS):
        worst = albedo(factors).max(axis=(0, 2))
        factors = np.minimum(factors / np.sqrt(np.maximum(worst, 1e-12)), 1)
    factors *= np.sqrt((1 - _SPARE) / max(float(albedo(factors).max()), 1))
    shares = np.gradient(_NODES**2)
    left, whole = (float(np.einsum("tic,i->", a, shares)) for a in (albedo(factors), before))
    return Conserving(Dimmed(brdf, _NODES, factors), largest, 1 - left / whole)


def _exchange(brdf: BRDF, cosine: float, azimuth: float) -> Float[np.ndarray, "node channel"]:
    """Sum what one direction sends to each node's neighbourhood, by linear shares."""
    leaving, light = evaluated_about_mirror(brdf, cosine, azimuth)
    above = np.clip(np.searchsorted(_NODES, leaving), 1, len(_NODES) - 1)
    step = _NODES[above] - _NODES[above - 1]
    share = np.clip((leaving - _NODES[above - 1]) / step, 0, 1)
    return np.stack(
        [
            np.bincount(above, share * one, len(_NODES))
            + np.bincount(above - 1, (1 - share) * one, len(_NODES))
            for one in light.T
        ],
        axis=-1,
    )
