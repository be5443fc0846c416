"""Incoming directions with the density of a BRDF's coefficient tree, the outgoing fixed (L 8.5).

A tree over (kappa_i, lambda_i, kappa_r, lambda_r), samples of rho in the Nusselt embedding, has the
cosine in its area: cos t dw = 4 dkappa dlambda.  Its slice at the outgoing pair, normalised, is
L 8.6's q over the square, and per steradian

    p(w_i | w_o) = (1 - s) q cos t_i / 4  +  s cos t_i / pi,

so that an estimate L_i rho cos t_i / p is 4 L_i rho / q for s = 0 (L 8.4 lacks the 4, ERRATA 74),
and the albedo is 4 times the tree's integral (ERRATA 75).  L searches the reflected pair and relies
on reciprocity; here the outgoing pair is the fixed one.

The share s, uniform on the disc, bounds what the tree misses by pi rho / s: thresholded trees are
zero (clamped, ERRATA 76) where the BRDF is not, and with s = 0 that light is lost for good.

A cell on the disc's rim counts by the share of it that the disc covers, and is drawn from in that
part alone (``disc_cells``).  So the sum over cells is the integral over the disc, every draw is a
direction above the horizon, and the density integrates over the hemisphere to 1.  Where a slice of
the tree holds nothing, q is uniform on the disc.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.samplers import DirectionSampler
from jaxrender.geometry import NUSSELT
from jaxrender.geometry.disc_cells import covered_shares, places_in_disc
from jaxrender.shapes import AnyArray, Array, Directions, Float, checked
from jaxrender.wavelets.sampling import CellDensities, TabulatedDensities
from jaxrender.wavelets.tree import CoefficientTree

_OUTGOING_AXES = (2, 3)
# Host arrays of any length are padded to powers of two from here, so that few programs are made.
_LEAST_BATCH = 64


class TreeSampler(eqx.Module, DirectionSampler):
    """Draws incoming directions; local, +Z the normal, both pointing away from the surface.

    ``share`` s of them is cosine-weighted whatever the tree.  Outgoing directions below the horizon
    count as if mirrored above it.
    """

    densities: CellDensities
    share: float = eqx.field(static=True, default=0.1)

    def __check_init__(self):
        if not 0 <= self.share <= 1:
            raise ValueError(f"a share of {self.share}; give 0 to 1, .1 bounds weights well")
        if self.densities.axes != 4 or self.densities.fixed_axes != _OUTGOING_AXES:
            raise ValueError(
                f"densities over {self.densities.axes} axes with {self.densities.fixed_axes} "
                f"fixed; a BRDF has 4, and its outgoing pair {_OUTGOING_AXES} is fixed"
            )

    @classmethod
    @checked
    def of(
        cls,
        tree: CoefficientTree,
        share: float = 0.1,
        levels: int | None = None,
        weights: Float[AnyArray, "channel"] | None = None,
        kind: type[CellDensities] = TabulatedDensities,
    ) -> "TreeSampler":
        """Take ``levels`` of a tree of rho, its channels added with ``weights`` (by default, mean).

        ``kind`` may be ``SlicedDensities`` for a tree too large to tabulate.  Raises ``ValueError``
        for a tree that has not four axes, and what ``kind.of`` and the constructor refuse.
        """
        if tree.axes != 4:
            raise ValueError(f"a tree of {tree.axes} axes; a BRDF has 4, two for each direction")
        size = 1 << (tree.levels if levels is None else max(levels, 0))
        return cls(kind.of(tree, _OUTGOING_AXES, levels, weights, covered_shares(size)), share)

    @checked
    def draw(
        self, outgoing: Directions, uniforms: Float[AnyArray, "*batch 2"]
    ) -> Float[Array, "*batch 3"]:
        """Map uniform numbers in [0, 1) to incoming directions, in the precision of the numbers."""
        rows, batch = _rows(outgoing, uniforms)
        return _draw(self, *rows)[: int(np.prod(batch))].reshape(*batch, 3)

    @checked
    def density(self, outgoing: Directions, incoming: Directions) -> Float[Array, "*batch"]:
        """Evaluate the density per steradian; zero at and below the horizon."""
        rows, batch = _rows(outgoing, incoming)
        return _density(self, *rows)[: int(np.prod(batch))].reshape(batch)


@eqx.filter_jit
def _draw(
    sampler: TreeSampler, outgoing: Float[Array, "ray 3"], uniforms: Float[Array, "ray 2"]
) -> Float[Array, "ray 3"]:
    """Spend the first number on the choice between disc and tree, and stretch what is left."""
    share, chance = sampler.share, uniforms[:, 0]
    from_disc = chance < share
    disc = _place_on_disc(chance / (share or 1), uniforms[:, 1])
    rest = jnp.maximum(chance - share, 0) / ((1 - share) or 1)
    numbers = jnp.stack([rest, uniforms[:, 1]], axis=1)
    fixed = NUSSELT.square_from_direction(outgoing)
    size = sampler.densities.size
    scaled = sampler.densities.draw(numbers, fixed).places * size
    cells = jnp.clip(jnp.floor(scaled), 0, size - 1)
    drawn = places_in_disc(cells.astype(np.int32), scaled - cells, size)
    return NUSSELT.direction_from_square(jnp.where(from_disc[:, None], disc, drawn))


@eqx.filter_jit
def _density(
    sampler: TreeSampler, outgoing: Float[Array, "ray 3"], incoming: Float[Array, "ray 3"]
) -> Float[Array, "ray"]:
    places, fixed = (NUSSELT.square_from_direction(d) for d in (incoming, outgoing))
    by_area = sampler.densities.density(places, fixed)
    cosine = jnp.maximum(incoming[:, 2], 0)
    return ((1 - sampler.share) * by_area / 4 + sampler.share / np.pi) * cosine


def _place_on_disc(first: Float[Array, "ray"], second: Float[Array, "ray"]) -> Array:
    """Uniform by area on the disc of radius 1/2 about (1/2, 1/2)."""
    radius, azimuth = jnp.sqrt(jnp.clip(first, 0, 1)), 2 * np.pi * second
    flat = radius[:, None] * jnp.stack([jnp.cos(azimuth), jnp.sin(azimuth)], axis=1)
    return (flat + 1) / 2


def _rows(
    outgoing: Directions, others: Float[AnyArray, "*batch number"]
) -> tuple[tuple[Array, Array], tuple[int, ...]]:
    """Flatten the batch; on the host, repeat the last row up to a power of two."""
    batch = np.shape(others)[:-1]
    count = int(np.prod(batch))
    flat = [array.reshape(count, array.shape[-1]) for array in (outgoing, others)]
    missing = max(_LEAST_BATCH, 1 << max(count - 1, 0).bit_length()) - count
    if all(isinstance(array, np.ndarray) for array in flat) and count:
        flat = [np.concatenate([a, np.repeat(a[-1:], missing, axis=0)]) for a in flat]
    fixed, numbers = (jnp.asarray(array) for array in flat)
    return (fixed.astype(numbers.dtype), numbers), batch
