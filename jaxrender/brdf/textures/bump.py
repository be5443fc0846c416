"""Bump maps as BRDF textures: a BRDF under a perturbed normal is another BRDF (L 7.4).

With R the smallest rotation that takes the normal n = +Z to the perturbed one n',

    F'(w_i, w_r) = F(R^T w_i, R^T w_r) max(0, n'.w_i) / (n.w_i),

zero where a direction is below the horizon of n or of n'.  Both directions are turned, and the
cosine is replaced, so that radiance = F' (n.w_i) E is the turned facet's; L 7.11 adds two numbers
to all four places of Nusselt's square and leaves the cosine out (ERRATA 72).

The surface stays flat for the viewer: a texel's share of a pixel is that of its area on the plane,
and nothing hides anything, as bump maps have it.  Such a BRDF is not reciprocal, and near the
horizon of n more light may leave than arrives.  With ``projected`` it is the facet's as part of a
real surface whose mean plane has the normal n: times (n'.w_r) / ((n'.n) (n.w_r)), the facet's share
of what is seen over its share of the plane.  That is reciprocal, and right where nothing hides
anything; means of it over a height field's facets, its shadows excepted, are what a
gonioreflectometer measures.

Maps have row 0 at v = 1 (u to the right, v upwards).
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.brdf.parameters import is_known
from jaxrender.brdf.textures.texture import BRDFTexture, tree_of
from jaxrender.geometry import Components, world_from_local
from jaxrender.shapes import AnyArray, Array, Float, Int
from jaxrender.wavelets import Wavelet

Normals = Float[AnyArray, "row column 3"]

# Of squared lengths of normals.
_UNIT = 1e-5


class Tilted(BRDF):
    """A BRDF whose normal is ``normal`` in the frame of the surface; a unit vector above it.

    Raises ``ValueError`` for a normal that is not of length one, or at or below the horizon.
    """

    brdf: BRDF
    normal: Float[AnyArray, "3"]
    projected: bool = eqx.field(static=True, default=False)
    """Whether the facet's own share of the view counts, see above."""

    def __check_init__(self):
        if is_known(self.normal):
            normal = np.asarray(self.normal, float)
            if not (abs(normal @ normal - 1) <= _UNIT and normal[2] > 0):
                raise ValueError(f"normal={normal}: give a unit vector above the horizon (z > 0)")

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """The BRDF's own."""
        return self.brdf.amplitudes

    @property
    def reciprocal(self) -> bool:
        """When the BRDF is and either nothing is tilted or the facet counts as it is seen."""
        return self.brdf.reciprocal and (self.projected or self._upright)

    @property
    def conserves_energy(self) -> bool:
        """When the BRDF does and nothing is tilted: light from the horizon falls steeper on n'."""
        return self.brdf.conserves_energy and self._upright

    @property
    def isotropic(self) -> bool:
        """When the BRDF is and nothing is tilted."""
        return self.brdf.isotropic and self._upright

    @property
    def _upright(self) -> bool:
        return bool(np.all(np.asarray(self.normal)[:2] == 0))

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate the lobes times max(0, n'.w_i): the BRDF's transfer in the frame of n'."""
        dtype = jnp.asarray(incoming.z).dtype
        frame = world_from_local(jnp.asarray(self.normal, dtype))
        towards, away = incoming.in_frame(frame), outgoing.in_frame(frame)
        visible = are_visible(incoming, outgoing) & are_visible(towards, away)
        seen = jnp.ones_like(towards.z)
        if self.projected:
            seen = away.z / (frame[2, 2] * lifted(outgoing).z)
        return tuple(
            jnp.where(visible, lobe * seen, 0) for lobe in self.brdf.transfer(towards, away)
        )


def normals_of_perturbations(perturbations: Normals) -> Float[np.ndarray, "row column 3"]:
    """Add a vector to the normal +Z of each texel, as L 7.4's bump maps do, and normalise.

    Raises ``ValueError`` for vectors that are not finite or turn a normal to the horizon or below.
    """
    found = np.asarray(perturbations, float) + np.array([0.0, 0.0, 1.0])
    wrong = ~(np.isfinite(found).all(axis=-1) & (found[..., 2] > 0))
    if wrong.any():
        place = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise ValueError(
            f"perturbations{list(place)} is {np.asarray(perturbations)[place]} ({wrong.sum()} "
            "such): give finite vectors whose z is above -1"
        )
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def normals_of_heights(
    heights: Float[AnyArray, "row column"], size: tuple[float, float] = (1.0, 1.0)
) -> Float[np.ndarray, "row column 3"]:
    """Differentiate a periodic height field at its texels, by central differences.

    ``size`` is the texture's width and height in the heights' unit.  Row 0 is at v = 1: turn the
    rows of heights that count upwards, as ``height_field``'s do.  Raises ``ValueError`` for heights
    that are not finite and sizes that are not positive.
    """
    heights = np.asarray(heights, float)
    if not (np.isfinite(heights).all() and min(size) > 0):
        raise ValueError(f"heights must be finite and size {size} positive")
    rows, columns = heights.shape
    across = np.roll(heights, -1, axis=1) - np.roll(heights, 1, axis=1)
    up = np.roll(heights, 1, axis=0) - np.roll(heights, -1, axis=0)
    slopes = -across * columns / (2 * size[0]), -up * rows / (2 * size[1])
    return normals_of_perturbations(np.stack([*slopes, np.zeros_like(heights)], axis=-1))


class QuantisedNormals(NamedTuple):
    """The different normals of a bump map; ``index`` says which one each texel has."""

    index: Int[np.ndarray, "row column"]
    normals: Float[np.ndarray, "normal 3"]


def quantised(normals: Normals, step: float = 0.0) -> QuantisedNormals:
    """List the different normals, and which one each texel has.

    With ``step``, x and y of a normal are rounded to multiples of it (radians, nearly, for normals
    near +Z): (x, y) is then wrong by a distance of at most step / sqrt(2).  Raises ``ValueError``
    for a negative step, and one so large that a normal would be rounded to the horizon.
    """
    normals = np.asarray(normals, float)
    if not step >= 0:
        raise ValueError(f"step={step}: give 0, for equal normals only, or more")
    flat = normals.reshape(-1, 3)
    flat = flat[:, :2] if step == 0 else np.rint(flat[:, :2] / step) * step
    # Adding 0 makes one zero of both.
    different, row = np.unique(flat + 0.0, axis=0, return_inverse=True)
    square = np.sum(different**2, axis=1)
    if not (square < 1).all():
        raise ValueError(f"step={step} rounds a normal to the horizon: give a smaller one")
    found = np.concatenate([different, np.sqrt(1 - square)[:, None]], axis=1)
    return QuantisedNormals(row.reshape(normals.shape[:2]), found)


def bump_texture(
    brdf: BRDF,
    normals: Normals,
    step: float = 0.0,
    *,
    size: int = 16,
    keep: float = 1.0,
    wavelet: Wavelet | None = None,
    projected: bool = False,
) -> BRDFTexture:
    """Make the texture of a BRDF under a map of normals, for ``BRDFPyramid.averaging`` (L 7.12).

    Normals are ``quantised``, and each different one's ``Tilted`` is analysed by ``tree_of``;
    raises as these do.
    """
    index, different = quantised(normals, step)
    dtype = jnp.zeros(()).dtype
    trees = [
        tree_of(Tilted(brdf, jnp.asarray(normal, dtype), projected), size, keep, wavelet)
        for normal in different
    ]
    return BRDFTexture.of(index, trees)
