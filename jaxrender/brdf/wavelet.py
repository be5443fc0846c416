"""A coefficient tree as a BRDF: rho(kappa_i, lambda_i, kappa_r, lambda_r), Nusselt's square (L 4).

Axes 0 and 1 are the incoming direction, 2 and 3 the outgoing one.  Haar's trees are looked up cell
by cell, those of other wavelets by traversal, and ``levels`` chooses the level of detail.  What is
looked up is made of the coefficients inside the evaluation, so that the tree is all there is: one
trains its values, and writes the tree that was trained.

What thresholding leaves of a table may be negative (ERRATA 76), which no reflectance is: values are
clamped at 0, which brings them nearer to the table's.  Predicted errors are the tree's, an upper
bound for the BRDF's.  Cells that are not wholly above the horizon belong to it all the same.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.half_vector import are_visible
from jaxrender.brdf.measured import MeasuredAlbedo
from jaxrender.geometry import NUSSELT, Components, Embedding
from jaxrender.shapes import AnyArray, Array, Float
from jaxrender.wavelets import CellForest, CoefficientTree, Traversal, is_stepwise

_AXES = 4


class WaveletBRDF(MeasuredAlbedo):
    """A tree over pairs of directions, in 1/sr; ``levels`` of it, by default all.

    Raises ``ValueError`` for a tree of other than four axes and for levels that it has not.
    """

    tree: CoefficientTree
    embedding: Embedding = eqx.field(static=True, default=NUSSELT)
    levels: int | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        if self.tree.axes != _AXES:
            raise ValueError(f"a tree of {self.tree.axes} axes; a BRDF has {_AXES}")
        if self.levels is not None and not 0 <= self.levels <= self.tree.levels:
            raise ValueError(
                f"levels={self.levels}: the tree has {self.tree.levels}; ask for 0 to that"
            )

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """One: every channel has a lobe of its own."""
        return np.eye(self.tree.channels)

    @property
    def reciprocal(self) -> bool:
        """Never promised: thresholds are blind to it."""
        return False

    @property
    def isotropic(self) -> bool:
        """Never promised: a square grid has preferred azimuths."""
        return False

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate each channel times cos t_i."""
        pair = jnp.broadcast_arrays(*incoming, *outgoing)
        towards, away = (jnp.stack(part, axis=-1) for part in (pair[:3], pair[3:]))
        points = jnp.concatenate(
            [self.embedding.square_from_direction(part) for part in (towards, away)], axis=-1
        )
        found = _looked_up(self.tree, points.reshape(-1, _AXES), self.levels)
        found = jnp.maximum(found, 0).reshape(*points.shape[:-1], -1)
        visible, cosine = are_visible(incoming, outgoing), jnp.asarray(incoming.z)
        return tuple(
            jnp.where(visible, found[..., c].astype(cosine.dtype) * cosine, 0)
            for c in range(self.tree.channels)
        )


@eqx.filter_jit
def _looked_up(
    tree: CoefficientTree, points: Float[Array, "point 4"], levels: int | None
) -> Float[Array, "point channel"]:
    reader = CellForest.of([tree]) if is_stepwise(tree.wavelet) else Traversal.of(tree)
    return reader.evaluate(points, levels=levels)
