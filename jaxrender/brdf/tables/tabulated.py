"""A measured or simulated BRDF as a table over two directions (L chapter 3).

Each direction is a place on the unit square by an ``Embedding``: Nusselt's (L 4.1) or the polar map
(L 3.3.1).  ``values[k_i, l_i, k_r, l_r, channel]`` are rho in 1/sr at the centres of the cells, any
number along each axis; ``reconstruction`` says what is between them.  Below the horizon rho is 0.

The corners of Nusselt's square stand for no direction, yet cells there are neighbours of cells that
do.  ``of`` fills them with the value at the nearest direction just above the horizon
(``extended``), so that grazing light is not mixed with darkness; ``zero`` leaves them 0 as L 4.1
does, which is what a wavelet transform should be given.  The polar map has no such cells.

Sums over cells stand for integrals over the hemisphere: each cell whose centre is a direction has
its projected solid angle, all of them scaled to add up to pi, so that white is white.
"""

from functools import partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.half_vector import are_visible
from jaxrender.brdf.measured import ValuesPerChannel
from jaxrender.brdf.parameters import is_known, refuse_unlisted
from jaxrender.brdf.tables.cells import (
    Size,
    Table,
    above_horizon,
    cell_weights,
    covered,
    exchanged,
    refuse_unknown,
    size_of,
    values_of_pairs,
)
from jaxrender.brdf.tables.reconstruction import RECONSTRUCTIONS, Taps, direction_taps, weighted_sum
from jaxrender.geometry import NUSSELT, Components, Embedding
from jaxrender.shapes import AnyArray, Array, Float, checked

OUTSIDE = ("extended", "zero")

# What sums of float32 are good for.
_ROUNDING = 1e-5

_evaluate = eqx.filter_jit(BRDF.evaluate)


class TabulatedBRDF(ValuesPerChannel):
    """``values`` in 1/sr on the cells of an ``embedding`` of both directions.

    Negative values are kept as they are (thresholded wavelets have some); ``masked`` removes them.
    Raises ``ValueError`` for a table of another rank, an empty one, one of more than 2^31 pairs,
    values that are not finite, and an unlisted reconstruction.
    """

    values: Table
    embedding: Embedding = eqx.field(static=True, default=NUSSELT)
    reconstruction: str = eqx.field(static=True, default="linear")

    def __check_init__(self):
        refuse_unlisted("reconstruction", self.reconstruction, tuple(RECONSTRUCTIONS))
        shape = np.shape(self.values)
        if len(shape) != 5 or min(shape) < 1:
            raise ValueError(
                f"values has shape {shape}: give [kappa_i, lambda_i, kappa_r, lambda_r, channel], "
                "none of them 0"
            )
        size_of(shape[:4])
        if is_known(self.values):
            refuse_unknown(np.asarray(self.values))

    @classmethod
    def of(
        cls,
        brdf: BRDF,
        size: int | Size,
        embedding: Embedding = NUSSELT,
        reconstruction: str = "linear",
        outside: str = "extended",
    ) -> "TabulatedBRDF":
        """Tabulate every channel of a BRDF at the centres of ``size`` cells (one number: all axes).

        Values have JAX's default precision.  The BRDF is sampled, not averaged: lobes narrower than
        a cell may fall between the samples.  Raises ``ValueError`` for an unlisted ``outside``, an
        empty or too large table, and values that are not finite.
        """
        refuse_unlisted("outside", outside, OUTSIDE)
        refuse_unlisted("reconstruction", reconstruction, tuple(RECONSTRUCTIONS))
        size = size_of(size)
        ends = size[:2], size[2:]
        incoming, outgoing = (above_horizon(embedding, end) for end in ends)
        values = values_of_pairs(partial(_evaluate, brdf), incoming, outgoing).reshape(*size, -1)
        if outside == "zero":
            covered_i, covered_r = (covered(embedding, end) for end in ends)
            values[~covered_i] = 0
            values[:, :, ~covered_r] = 0
        return cls(values, embedding, reconstruction)

    @property
    def size(self) -> Size:
        """How many samples each of the four axes has."""
        return size_of(np.shape(self.values)[:4])

    @property
    def reciprocal(self) -> bool:
        """When the samples are symmetric to rounding, which every reconstruction passes on."""
        values = np.asarray(self.values)
        if self.size[:2] != self.size[2:]:
            return False
        allowed = _ROUNDING * np.abs(values).max()
        return bool(np.abs(values - exchanged(values)).max() <= allowed)

    @property
    def conserves_energy(self) -> bool:
        """When the sum over the reflected cells is at most 1 from every incident one."""
        return bool(np.max(self.albedo()) <= 1 + _ROUNDING)

    @property
    def isotropic(self) -> bool:
        """Never promised: between samples a turned pair differs; ``isotropy_error`` measures it."""
        return False

    def albedo(self) -> Float[np.ndarray, "kappa_i lambda_i channel"]:
        """Sum rho cos t_r dw over the reflected cells, on the host; 0 where no light comes from."""
        weights = cell_weights(self.embedding, self.size[2:])
        found = np.einsum("ijklc,kl->ijc", np.asarray(self.values), weights, optimize=True)
        return np.where(covered(self.embedding, self.size[:2])[..., None], found, 0)

    @checked
    def at_places(
        self, incoming: Float[AnyArray, "*#batch 2"], outgoing: Float[AnyArray, "*#batch 2"]
    ) -> Float[Array, "*batch channel"]:
        """Reconstruct rho in 1/sr at places on the two squares, those beyond the horizon too."""
        size = self.size
        arriving, leaving = (
            direction_taps(self.reconstruction, self.embedding, end, places)
            for end, places in ((size[:2], incoming), (size[2:], outgoing))
        )
        cells = size[2] * size[3]
        rows = jnp.asarray(self.values).reshape(-1, self.values.shape[-1])
        return weighted_sum(rows, Taps(arriving.index * cells, arriving.weight), leaving)

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Reconstruct each channel times cos t_i."""
        ends = [jnp.stack(list(direction), axis=-1) for direction in (incoming, outgoing)]
        rank = max(end.ndim for end in ends)
        # One direction for many others has taps of its own, not theirs.
        ends = [end.reshape((1,) * (rank - end.ndim) + end.shape) for end in ends]
        value = self.at_places(*(self.embedding.square_from_direction(end) for end in ends))
        visible = are_visible(incoming, outgoing)
        return tuple(
            jnp.where(visible, value[..., c] * incoming.z, 0) for c in range(value.shape[-1])
        )

    def resampled(self, size: int | Size, embedding: Embedding | None = None) -> "TabulatedBRDF":
        """Reconstruct the table at the centres of other cells, or of another embedding's.

        The same size and embedding give the same table, save for B-splines, which smooth.  A new
        embedding's cells beyond the horizon are extended.  Coarser tables are sampled, not
        averaged.  Raises ``ValueError`` for an empty or too large table.
        """
        size, target = size_of(size), self.embedding if embedding is None else embedding
        places = tuple(self._places_of(target, end) for end in (size[:2], size[2:]))
        values = values_of_pairs(partial(_at_places, self), *places)
        return TabulatedBRDF(values.reshape(*size, -1), target, self.reconstruction)

    def _places_of(self, target: Embedding, size: tuple[int, int]) -> Float[np.ndarray, "cell 2"]:
        if target == self.embedding:
            return target.centres(size).reshape(-1, 2)
        directions = above_horizon(target, size)
        return np.asarray(self.embedding.square_from_direction(directions), float)


@eqx.filter_jit
def _at_places(table: TabulatedBRDF, incoming: Array, outgoing: Array) -> Array:
    return table.at_places(incoming, outgoing)
