"""The thesis's iteration for textures (T 6.4.2): K_d and K_s in turn, each weighted for itself.

    W_d = D cos t_o / (epsilon + S),   W_s = S cos t_o                                  (T 6.14)

K_d is solved for by weights W_d with K_s held, K_s by W_s with K_d held, until neither moves.  It
is the twin of :func:`jaxrender.inverse.texture.site_systems.solve_sites`, to which it converges
when both weights are the same; where S is nearly a multiple of D, only slowly.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxrender.inverse.models import Columns
from jaxrender.inverse.texture.site_sums import SiteMaterial, SiteSums
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int

# epsilon of T 6.14, beside the mean of S.
_EPSILON = 1e-2
# A sum of weights this small beside the mean over the sites is numerically zero.
_UNSEEN = 1e-3


class Confidence(NamedTuple):
    """The weights W_d and W_s of every observation."""

    diffuse: Float[Array, "sample"]
    specular: Float[Array, "sample"]


class Alternation(NamedTuple):
    """Where the iteration ended.

    ``specular_unseen`` marks sites that got the mean K_s, ``diffuse_unseen`` those too dimly lit
    for a K_d: the thesis's marks.
    """

    material: SiteMaterial
    specular_unseen: Bool[Array, "site"]
    diffuse_unseen: Bool[Array, "site"]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]


def confidence(columns: Columns, exit_cosines: Float[AnyArray, "sample"]) -> Confidence:
    """Evaluate T 6.14, D and S being the means of their channels."""
    diffuse, specular = jnp.mean(columns.diffuse, axis=1), jnp.mean(columns.specular, axis=1)
    cosines = jnp.asarray(exit_cosines)
    epsilon = jnp.maximum(_EPSILON * jnp.mean(specular), jnp.finfo(specular.dtype).tiny)
    return Confidence(diffuse * cosines / (epsilon + specular), specular * cosines)


@eqx.filter_jit
def alternate(
    diffuse: SiteSums,
    specular: SiteSums,
    start: Float[Array, ""],
    most: int = 1000,
    tolerance: float = 1e-8,
) -> Alternation:
    """Solve for K_d and K_s in turn, from one K_s everywhere.

    ``diffuse`` and ``specular`` are the sums of the same observations weighted by W_d and by W_s.
    It ends after ``most`` rounds, or where a round changes K_s by less than ``tolerance`` of the
    mean.
    """
    lit, shiny = jnp.mean(diffuse.dd, axis=1), jnp.sum(specular.ss, axis=1)
    unlit = lit <= _UNSEEN * jnp.mean(lit)
    unseen = (shiny <= _UNSEEN * jnp.mean(shiny)) | unlit

    def kd_given(ks: Float[Array, "site"]) -> Float[Array, "site channel"]:
        right = diffuse.db - diffuse.ds * ks[:, None]
        return jnp.maximum(right / jnp.where(diffuse.dd > 0, diffuse.dd, 1), 0)

    def ks_given(kd: Float[Array, "site channel"]) -> Float[Array, "site"]:
        right = jnp.sum(specular.sb - specular.ds * kd, axis=1)
        ks = jnp.maximum(right / jnp.where(shiny > 0, shiny, 1), 0)
        seen = jnp.sum(jnp.where(unseen, 0, 1).astype(ks.dtype))
        mean = jnp.sum(jnp.where(unseen, 0, ks)) / jnp.maximum(seen, 1)
        return jnp.where(unseen, jnp.where(seen > 0, mean, start), ks)

    def again(state: tuple) -> Bool[Array, ""]:
        _, change, steps = state
        return (change > tolerance) & (steps < most)

    def round_(state: tuple) -> tuple:
        ks, _, steps = state
        moved = ks_given(kd_given(ks))
        change = jnp.max(jnp.abs(moved - ks)) / jnp.maximum(jnp.mean(moved), 1e-30)
        return moved, change, steps + 1

    first = jnp.full(shiny.shape, start, shiny.dtype), jnp.asarray(jnp.inf, shiny.dtype), 0
    ks, change, steps = jax.lax.while_loop(again, round_, first)
    material = SiteMaterial(kd_given(ks), ks)
    return Alternation(material, unseen, unlit, jnp.asarray(steps), change <= tolerance)
