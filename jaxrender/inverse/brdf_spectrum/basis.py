"""The unknown coefficients of an isotropic BRDF, and what a pixel is in terms of them (T 2.53).

All is about the *normal*, T's own parameters in T 6.4.2 (figure 6.2 has its highlight at azimuth
difference pi): there reciprocity is a symmetry of the coefficients, which about the reflected
direction it is not (ERRATA 11).  Two forms,

    plain        rho^ = rho cos t_i          = sum rho_lpq  y_lpq(i, o)
    reciprocal   rho~ = rho cos t_i cos t_o  = sum rho~_lpq y_lpq(i, o),   rho~_lpq = rho~_plq

with y_lpq = Y_lq(t_i) Y_pq(t_o) cos(q (phi_o - phi_i)), real harmonics at azimuth 0: isotropy
(rho_lpq = rho_lp-q, real) has joined the orders q and -q.  Turn the light into a frame of the
surface whose x axis holds the view, and B = sum rho_lpq L'_lq Y_pq(t_o): one product a coefficient.
"""

from functools import cached_property, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import SurfaceSamples, dot, world_from_local
from jaxrender.harmonics import associated, coefficient_count, real_basis, rotate
from jaxrender.shapes import AnyArray, Array, Coefficients, Float, Int

# Closer to the normal than this (radians) a view has no plane of incidence.
_HEAD_ON = 1e-9


class SpectrumBasis(eqx.Module):
    """Coefficients l, p = 0 ... ``band_limit``, q = 0 ... min(l, p); hashable, all static.

    ``reciprocal`` takes rho~ for rho^ and lets (l, p) and (p, l) share one unknown.
    Raises ``ValueError`` for a negative band limit.
    """

    band_limit: int = eqx.field(static=True)
    reciprocal: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        coefficient_count(self.band_limit)

    @cached_property
    def indices(self) -> Int[np.ndarray, "3 unknown"]:
        """Degree l, outgoing degree p and order q of each unknown; l >= p where shared."""
        size = self.band_limit + 1
        every = np.indices((size, size, size)).reshape(3, -1)
        degree, outgoing, order = every
        kept = order <= np.minimum(degree, outgoing)
        if self.reciprocal:
            kept &= degree >= outgoing
        return every[:, kept]

    @property
    def count(self) -> int:
        """The number of unknowns."""
        return self.indices.shape[1]

    def spread(
        self, values: Float[AnyArray, "unknown channel"]
    ) -> Float[np.ndarray, "degree outgoing_degree order channel"]:
        """Lay the unknowns out as rho_lpq, zero where q > min(l, p)."""
        values = np.asarray(values)
        size = self.band_limit + 1
        degree, outgoing, order = self.indices
        table = np.zeros((size, size, size, values.shape[1]))
        if self.reciprocal:
            table[outgoing, degree, order] = values
        table[degree, outgoing, order] = values
        return table

    def gather(
        self, table: Float[AnyArray, "degree outgoing_degree order channel"]
    ) -> Float[np.ndarray, "unknown channel"]:
        """Pick the unknowns out of rho_lpq: the inverse of ``spread``."""
        return np.asarray(table)[tuple(self.indices)]

    def rows(
        self, light: Coefficients, samples: SurfaceSamples
    ) -> Float[Array, "sample unknown channel"]:
        """What each coefficient at 1 adds to each sample's radiance, under light of its degrees.

        Light of fewer or more degrees is filled up or cut.
        """
        return _rows(self, jnp.asarray(light), *(jnp.asarray(a) for a in samples))

    def pair_rows(
        self, incoming: Float[AnyArray, "pair 3"], outgoing: Float[AnyArray, "pair 3"]
    ) -> Float[Array, "pair unknown"]:
        """What each coefficient at 1 adds to rho cos t_i for pairs of local directions."""
        return _pair_rows(self, jnp.asarray(incoming), jnp.asarray(outgoing))

    def norms(self) -> Float[np.ndarray, "unknown"]:
        """The integral of y_lpq^2 over both spheres, both of a shared pair: 1, 2 or 4."""
        degree, outgoing, order = self.indices
        twice = self.reciprocal & (degree != outgoing)
        return np.where(order > 0, 2.0, 1.0) * np.where(twice, 2.0, 1.0)

    def visible_overlap(self) -> Float[np.ndarray, "unknown unknown"]:
        """The integral of y_lpq y_l'p'q over the pairs of directions above the horizon."""
        upper = _hemisphere_overlap(self.band_limit)
        degree, outgoing, order = self.indices
        same = order[:, None] == order[None, :]
        pairs = [(degree, outgoing)]
        if self.reciprocal:
            pairs.append((outgoing, degree))
        total = np.zeros((self.count, self.count))
        once = np.where(degree != outgoing, 1.0, 0.5) if self.reciprocal else np.ones(self.count)
        for first, second in pairs:
            for other_first, other_second in pairs:
                product = (
                    upper[order[:, None], first[:, None], other_first[None, :]]
                    * upper[order[:, None], second[:, None], other_second[None, :]]
                )
                total += once[:, None] * once[None, :] * product
        return np.where(same, total * np.where(order > 0, 2.0, 1.0)[:, None], 0)


@partial(jax.jit, static_argnames="basis")
def _rows(basis: SpectrumBasis, light: Array, normals: Array, outgoing: Array) -> Array:
    count = coefficient_count(basis.band_limit)
    missing = max(count - light.shape[0], 0)
    light = jnp.pad(light[:count], ((0, missing), (0, 0)))
    cosine = dot(normals, outgoing)
    frames = _view_frames(normals, outgoing, cosine)
    local = rotate(light, jnp.swapaxes(frames, -1, -2))
    sine = jnp.sqrt(jnp.maximum(1 - cosine * cosine, 0))
    view = jnp.stack([sine, jnp.zeros_like(sine), cosine], axis=-1)
    around = real_basis(view, basis.band_limit)[..., None]
    return _products(basis, local, around, cosine[:, None, None])


@partial(jax.jit, static_argnames="basis")
def _pair_rows(basis: SpectrumBasis, incoming: Array, outgoing: Array) -> Array:
    arrive, leave = (real_basis(d, basis.band_limit) for d in (incoming, outgoing))
    # Of opposite orders together: Y_lq(i) Y_pq(o) cos(q (phi_o - phi_i)).
    rows = _pair_products(basis, arrive, leave)
    if basis.reciprocal:
        rows = jnp.where(
            _different(basis)[None, :], rows + _pair_products(basis, leave, arrive), rows
        )
        rows = rows / outgoing[:, 2:]
    return rows


def _products(basis: SpectrumBasis, local: Array, around: Array, cosine: Array) -> Array:
    degree, outgoing, order = basis.indices
    first, second = degree * (degree + 1) + order, outgoing * (outgoing + 1) + order
    rows = local[:, first] * around[:, second]
    if not basis.reciprocal:
        return rows
    swapped = local[:, second] * around[:, first]
    return jnp.where(_different(basis)[None, :, None], rows + swapped, rows) / cosine


def _pair_products(basis: SpectrumBasis, arrive: Array, leave: Array) -> Array:
    degree, outgoing, order = basis.indices
    first, second = degree * (degree + 1), outgoing * (outgoing + 1)
    same = arrive[:, first + order] * leave[:, second + order]
    opposite = arrive[:, first - order] * leave[:, second - order]
    return jnp.where(order[None, :] > 0, same + opposite, same)


def _different(basis: SpectrumBasis) -> np.ndarray:
    return basis.indices[0] != basis.indices[1]


def _view_frames(normals: Array, outgoing: Array, cosine: Array) -> Float[Array, "sample 3 3"]:
    """Build local frames whose x axis holds the view; any tangent where it is head on."""
    across = outgoing - cosine[:, None] * normals
    length = jnp.sqrt(dot(across, across))
    head_on = length < _HEAD_ON
    safe = jnp.where(head_on, 1, length)[:, None]
    x = jnp.where(head_on[:, None], world_from_local(normals)[..., 0], across / safe)
    return jnp.stack([x, jnp.cross(normals, x), normals], axis=-1)


def _hemisphere_overlap(band_limit: int) -> Float[np.ndarray, "order degree degree"]:
    """Integrate Y_lq Y_l'q over the upper hemisphere, azimuth included: 1 over the sphere."""
    cosines, weights = np.polynomial.legendre.leggauss(band_limit + 2)
    cosines, weights = (cosines + 1) / 2, weights / 2
    table = associated(cosines, np.sqrt(1 - cosines**2), band_limit)
    turn = np.where(np.arange(band_limit + 1) > 0, np.pi, 2 * np.pi)
    overlap = np.einsum("lqt,mqt,t->qlm", table, table, weights)
    return overlap * turn[:, None, None]
