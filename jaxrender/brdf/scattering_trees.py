"""Reflection and transmission together: a coefficient tree for each pair of sides (L 3.3.1).

Light that passes a surface is a function on S^2 x S^2.  Either sphere of directions is two
hemispheres, and each of them Nusselt's square with (x, y) as they are, so that a direction and the
one straight through it (x, y, -z) share a place.  The four trees, [incoming side][outgoing side],
side 0 above (+Z) and 1 below, are reflection on the diagonal and transmission off it.

Values are the BSDF f in 1/sr: what leaves is the integral of f L |cos t_i| dw over the sphere.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.wavelet import WaveletBRDF
from jaxrender.geometry import NUSSELT
from jaxrender.shapes import AnyArray, Array, Directions, Float, Int, checked
from jaxrender.wavelets import (
    CellForest,
    CoefficientTree,
    Traversal,
    Wavelet,
    analyse_nonstandard,
    haar,
    is_stepwise,
    keep_fraction,
)

_SIDES = 2
_AXES = 4
Scattering = Callable[[Directions, Directions], Float[Array, "*batch channel"]]


class ScatteringTrees(eqx.Module):
    """A BSDF over all pairs of directions; ``trees`` are [above-above, above-below, ...].

    Raises ``ValueError`` for other than four trees, and for trees that differ in wavelet, size or
    channels or are not over four axes.
    """

    trees: tuple[CoefficientTree, ...]

    def __check_init__(self):
        trees = self.trees
        if len(trees) != _SIDES**2:
            raise ValueError(f"{len(trees)} trees; give four, one for each pair of sides")
        kinds = {(tree.wavelet.name, tree.size, tree.axes, tree.channels) for tree in trees}
        if len(kinds) > 1 or trees[0].axes != _AXES:
            raise ValueError(
                f"trees of (wavelet, size, axes, channels) {sorted(kinds)}: give four alike, of "
                f"{_AXES} axes"
            )

    @classmethod
    def of(
        cls, scattering: Scattering, size: int, wavelet: Wavelet | None = None, keep: float = 1.0
    ) -> "ScatteringTrees":
        """Tabulate a BSDF on ``size``^4 cells for each pair of sides; keep part of each tree.

        ``keep`` is a fraction of the non-zero coefficients.  Raises ``ValueError`` for values that
        are not finite, a size that is no power of two and a fraction outside (0, 1].
        """
        chosen, trees = wavelet or haar(), []
        for incoming in range(_SIDES):
            for outgoing in range(_SIDES):
                table = _table(scattering, size, (incoming, outgoing))
                coefficients = analyse_nonstandard(chosen, table)
                kept = keep_fraction(coefficients, keep, joint=True).coefficients
                trees.append(CoefficientTree.of_coefficients(chosen, kept))
        return cls(tuple(trees))

    @checked
    def evaluate(
        self, incoming: Directions, outgoing: Directions
    ) -> Float[Array, "*batch channel"]:
        """Evaluate f in 1/sr, clamped at 0; directions of either side, away from the surface."""
        pair = jnp.broadcast_arrays(incoming, outgoing)
        places = [NUSSELT.square_from_direction(part) for part in pair]
        points = jnp.concatenate(places, axis=-1).reshape(-1, _AXES)
        sides = [(part[..., 2] < 0).astype(np.int32).reshape(-1) for part in pair]
        found = _looked_up(self.trees, points, _SIDES * sides[0] + sides[1])
        return jnp.maximum(found, 0).reshape(*pair[0].shape[:-1], -1)

    def reflection(self, side: int = 0) -> WaveletBRDF:
        """Return the reflection of one side, seen from that side with its normal as +Z.

        For side 1 the frame is turned over by z -> -z: places stay where they are.
        """
        return WaveletBRDF(self.trees[(_SIDES + 1) * side])

    def reflectance(self) -> Float[np.ndarray, "incoming_side outgoing_side channel"]:
        """Return the share of uniform light from one side that leaves to another.

        The mean over the incoming disc of the integral of f cos t_o dw_o; 4 dk dl is cos t dw, and
        the disc's 4 dk dl are pi (ERRATA 75).
        """
        means = [np.asarray(tree.root) * 16 / np.pi for tree in self.trees]
        return np.stack(means).reshape(_SIDES, _SIDES, -1)


@eqx.filter_jit
def _looked_up(
    trees: tuple[CoefficientTree, ...],
    points: Float[AnyArray, "point 4"],
    which: Int[Array, "point"],
) -> Float[Array, "point channel"]:
    if is_stepwise(trees[0].wavelet):
        return CellForest.of(trees).evaluate(points, which)
    each = jnp.stack([Traversal.of(tree).evaluate(points) for tree in trees])
    return jnp.take_along_axis(each, which[None, :, None], axis=0)[0]


def _table(
    scattering: Scattering, size: int, sides: tuple[int, int]
) -> Float[Array, "kappa_i lambda_i kappa_r lambda_r channel"]:
    """Sample pairs of one pair of sides, some incoming directions at a time; zero off the disc."""
    inside = np.asarray(NUSSELT.covers(NUSSELT.centres((size, size))))
    if not inside.any():
        raise ValueError(f"size={size}: no cell has a direction; give more samples")
    upper = NUSSELT.cell_directions((size, size))[inside]
    incoming, outgoing = (upper * [1, 1, 1 - 2 * side] for side in sides)
    found = np.asarray(
        jax.lax.map(
            lambda one: scattering(jnp.broadcast_to(one, outgoing.shape), outgoing), incoming
        )
    )
    if not np.isfinite(found).all():
        raise ValueError(f"{np.sum(~np.isfinite(found))} values are not finite; mend the function")
    table = np.zeros((size, size, size, size, found.shape[-1]), found.dtype)
    rows = np.zeros((len(upper), size, size, found.shape[-1]), found.dtype)
    rows[:, inside] = found
    table[inside] = rows
    return jnp.asarray(table)
