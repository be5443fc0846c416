"""One pass over the pixels: the normal equations of a light for every material at once.

A sample's row for light L_lm is K_d Y~_lm(x) + K_s V(R) h_l(t_o) Y_lm(R) (T 6.15, 6.16).  Y~_lm is
A_l Y_lm(n) (ERRATA 42), or the transfer vectors of T 6.10.  The material enters through K_d, K_s
and h_l, and h_l is a function of the exit cosine alone.  So the products of the columns

    a = (Y~_lm(x) to the diffuse band limit,  V(R) Y_lm(R) to the light's)

are summed apart for bins of the exit cosine (``stream``): sum w^2 a a', sum w^2 a B, sum w^2 B^2.
The normal equations of any (K_d, K_s, sigma, mu) under any transfer are then sums over bins.  The
bins are weighted with the transfer at their nodes: as cheap for 10^8 pixels as for 10^4.

Bins are hats: a sample between two nodes is shared by both, linearly.  This makes two samples of
it, each at a node.  So the equations are those of a true least-squares problem, and are exact to
second order in the distance of the nodes.
"""

from functools import lru_cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet, normalised_fresnel
from jaxrender.harmonics import coefficient_count, degrees
from jaxrender.inverse.lighting.normal_equations import NormalEquations
from jaxrender.shapes import AnyArray, Array, Float
from jaxrender.spectra import TRANSFERS, transfer_of_samples

# Exit cosines of usable pixels, and as many nodes as keep a row within 1e-3 down there.
_LOWEST_COSINE, _NODES = 0.1, 64


class BinnedGram(eqx.Module):
    """Sums over samples by bin of the exit cosine; ``measured`` counts weights above 0.

    ``products`` holds the upper triangle of sum w^2 a a', once where all channels share weights.
    """

    nodes: Float[AnyArray, "bin"]
    products: Float[AnyArray, "bin weighting pair"]
    moments: Float[AnyArray, "bin column channel"]
    energies: Float[AnyArray, "bin channel"]
    measured: Float[AnyArray, "channel"]
    band_limit: int = eqx.field(static=True)
    diffuse_band_limit: int = eqx.field(static=True)

    def joined(self, other: "BinnedGram") -> "BinnedGram":
        """Add the sums of other samples; ``ValueError`` where nodes, degrees or weights differ."""
        mine, others = (
            (g.band_limit, g.diffuse_band_limit, g.products.shape, g.moments.shape)
            for g in (self, other)
        )
        if mine != others or not np.array_equal(self.nodes, other.nodes):
            raise ValueError(
                f"sums of unlike kinds, {mine} and {others}: stream both with the same band limits,"
                " nodes, channels and kind of weights"
            )
        apart = eqx.tree_at(lambda g: g.nodes, other, np.zeros_like(np.asarray(other.nodes)))
        return jax.tree.map(lambda a, b: np.asarray(a) + np.asarray(b), self, apart)

    @property
    def counts(self) -> Float[np.ndarray, "bin"]:
        """Sum w^2 V(R) by bin, over all weightings: by sum_lm Y_lm^2 = (l* + 1)^2 / (4 pi)."""
        _, place_of = _pairs(self.band_limit, self.diffuse_band_limit)
        squares = np.diag(place_of)[coefficient_count(self.diffuse_band_limit) :]
        of_bin = np.sum(np.asarray(self.products)[:, :, squares], axis=(1, 2))
        return 4 * np.pi / len(squares) * of_bin

    def of_channel(self, channel: int) -> "BinnedGram":
        """Keep the sums of one channel."""
        only = slice(channel, channel + 1)
        products = self.products[:, only if self.products.shape[1] > 1 else slice(None)]
        sums = (self.moments[..., only], self.energies[:, only], self.measured[only])
        return BinnedGram(self.nodes, products, *sums, self.band_limit, self.diffuse_band_limit)

    def equations(
        self,
        passed: Float[Array, "bin degree"],
        kd: Float[AnyArray, "channel"],
        ks: Float[AnyArray, "channel"],
    ) -> NormalEquations:
        """Add up the bins with the transfer ``passed`` at the nodes; inside ``jit`` or outside."""
        pair_of, place_of = _pairs(self.band_limit, self.diffuse_band_limit)
        kinds = jnp.concatenate([jnp.ones_like(passed[:, :1]), passed], axis=1)
        factors = (kinds[:, :, None] * kinds[:, None, :]).reshape(len(passed), -1)
        # Else the compiler evaluates the transfer again for each of the pairs that share it.
        factors = jax.lax.optimization_barrier(factors)

        # Bin after bin: the sums stay in the processor's cache, and one factor serves many pairs.
        def add(sums, one_bin):
            products, factor = one_bin
            return sums + products * factor[pair_of][None, :], None

        products = jnp.asarray(self.products)
        upper = jax.lax.scan(add, jnp.zeros_like(products[0]), (products, factors))[0]
        whole = upper[:, place_of]
        count = coefficient_count(self.diffuse_band_limit)
        every = degrees(self.band_limit)
        kd, ks = (jnp.asarray(a, whole.dtype) for a in (kd, ks))
        fill = ((0, 0), (0, len(every) - count))
        crossed = jnp.pad(whole[:, :count, count:], (*fill, (0, 0)))
        diffuse = jnp.pad(whole[:, :count, :count], (*fill, fill[1]))
        by_amplitude = (diffuse, crossed + crossed.mT, whole[:, count:, count:])
        amplitudes = (kd * kd, kd * ks, ks * ks)
        gram = sum(a[:, None, None] * part for a, part in zip(amplitudes, by_amplitude))
        moments = jnp.asarray(self.moments)
        seen = jnp.pad(jnp.sum(moments[:, :count], axis=0), (fill[1], (0, 0)))
        mirrored = jnp.einsum("bl,blc->lc", passed[:, every], moments[:, count:])
        moment = kd[:, None] * seen.T + ks[:, None] * mirrored.T
        energy = jnp.sum(jnp.asarray(self.energies), axis=0)
        return NormalEquations(jnp.asarray(gram), moment, energy, jnp.asarray(self.measured))

    def equations_of(self, brdf: Microfacet, transfer: str = "exit-cosine") -> NormalEquations:
        """Make the equations for a material under a named transfer, as ``light_operator`` does."""
        passed = passed_at(brdf, self.nodes, self.band_limit, transfer)
        return _added_up(self, passed, jnp.asarray(brdf.kd), jnp.asarray(brdf.ks))


_added_up = eqx.filter_jit(BinnedGram.equations)


def passed_at(
    brdf: Microfacet, cosines: Float[AnyArray, "bin"], band_limit: int, transfer: str
) -> Float[Array, "bin degree"]:
    """Evaluate the transfer: one of ``TRANSFERS``, or ``none``, F alone (T 6.15).

    Raises ``ValueError`` for any other.
    """
    if transfer == "none":
        fresnel = normalised_fresnel(brdf.mu, jnp.asarray(cosines))
        return jnp.broadcast_to(fresnel[:, None], (len(cosines), band_limit + 1))
    if transfer not in TRANSFERS:
        raise ValueError(f"transfer={transfer!r}: choose one of none, {', '.join(TRANSFERS)}")
    return transfer_of_samples(brdf, jnp.asarray(cosines), band_limit, transfer)


def exit_cosine_nodes(
    lowest: float = _LOWEST_COSINE, count: int = _NODES
) -> Float[np.ndarray, "bin"]:
    """Place nodes from ``lowest`` to 1 in equal ratios: grazing, the transfer bends most.

    Raises ``ValueError`` unless 0 < lowest < 1 and there are two or more.
    """
    if not 0 < lowest < 1 or count < 2:
        raise ValueError(f"lowest={lowest}, count={count}: 0 < lowest < 1, and two nodes or more")
    return np.geomspace(lowest, 1, count)


@lru_cache
def _pairs(band_limit: int, diffuse_limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Say which product of transfers belongs to each stored pair, and where each element stands.

    Columns are of one kind for the diffuse part, whose transfer is 1, and of one for each degree.
    """
    kind = np.concatenate(
        [np.zeros(coefficient_count(diffuse_limit), int), degrees(band_limit) + 1]
    )
    first, second = np.triu_indices(len(kind))
    place = np.zeros((len(kind), len(kind)), int)
    place[first, second] = place[second, first] = np.arange(len(first))
    return kind[first] * (band_limit + 2) + kind[second], place
