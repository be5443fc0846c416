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

from jaxrender.brdf.compression.squares import Goal, compression_of
from jaxrender.brdf.half_vector import are_visible
from jaxrender.brdf.measured import MeasuredAlbedo
from jaxrender.brdf.tables.cell_means import CELL_SAMPLES, albedo_of, tabulate
from jaxrender.brdf.wavelet import WaveletBRDF
from jaxrender.geometry import NUSSELT, Components
from jaxrender.geometry.disc_cells import covered_shares
from jaxrender.shapes import AnyArray, Array, Directions, Float, Int, checked
from jaxrender.wavelets import (
    CellForest,
    CoefficientTree,
    Traversal,
    Wavelet,
    haar,
    is_stepwise,
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
        cls,
        scattering: Scattering,
        size: int,
        wavelet: Wavelet | None = None,
        keep: float = 1.0,
        cell_samples: int = CELL_SAMPLES,
    ) -> "ScatteringTrees":
        """Make a tree for each pair of sides as ``brdf.compression.compressed`` does.

        ``keep`` is a fraction of the non-zero coefficients.  Raises ``ValueError`` for values that
        are negative or not finite, a size that is no power of two and a fraction outside (0, 1].
        """
        dtype, trees = jax.dtypes.canonicalize_dtype(float).type, []
        for incoming in range(_SIDES):
            for outgoing in range(_SIDES):
                brdf = _Side.of(scattering, (incoming, outgoing))
                table, masked = tabulate(brdf, size, dtype=dtype, cell_samples=cell_samples)
                if masked:
                    raise ValueError(
                        f"{masked} means of values that are negative or not finite; mend the "
                        "function"
                    )
                trees.append(compression_of(table, wavelet or haar(), Goal(keep)).tree)
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
        the disc's 4 dk dl are pi (ERRATA 75).  Cells count by the share that the disc covers.
        """
        disc = covered_shares(self.trees[0].size)
        means = [
            np.tensordot(disc / disc.sum(), albedo_of(np.asarray(tree.samples())), axes=2)
            for tree in self.trees
        ]
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


class _Side(MeasuredAlbedo):
    """A BSDF between two sides as a BRDF: each direction mirrored above the surface."""

    scattering: Scattering
    signs: Float[AnyArray, "2"]
    channels: int = eqx.field(static=True)

    @property
    def reciprocal(self) -> bool:
        return False

    @property
    def isotropic(self) -> bool:
        return False

    @classmethod
    def of(cls, scattering: Scattering, sides: tuple[int, int]) -> "_Side":
        up = jnp.array([[0.0, 0.0, 1.0]])
        signs = 1.0 - 2 * np.array(sides)
        return cls(scattering, signs, jax.eval_shape(scattering, up, up).shape[-1])

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        return np.eye(self.channels)

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        pair = jnp.broadcast_arrays(*incoming, *outgoing)
        towards, away = (
            jnp.stack([part[0], part[1], sign.astype(part[2].dtype) * part[2]], axis=-1)
            for part, sign in zip((pair[:3], pair[3:]), jnp.asarray(self.signs), strict=True)
        )
        found = self.scattering(towards, away)
        visible, cosine = are_visible(incoming, outgoing), jnp.asarray(incoming.z)
        return tuple(jnp.where(visible, found[..., c] * cosine, 0) for c in range(self.channels))
