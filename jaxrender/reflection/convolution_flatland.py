"""The convolution theorem on the circle: T's flatland, where rotating is shifting (T 2.2.2, 2.3.1).

B(alpha, t_o) = int L(alpha + t_i) rho^(t_i, t_o) dt_i over the visible half circle, both angles
from the normal, and rho^ = rho cos t_i zero beyond pi / 2.  In Fourier coefficients (T 2.17)

    B_lp = sqrt(2 pi) L_l rho_lp    (T 2.24)

with rho^ = sum rho_lp conj(F_l(t_i)) F_p(t_o), B = sum B_lp F_l(alpha) F_p(t_o) (T 2.20).  Orders
run from -F to F.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Inexact

from jaxrender.harmonics import circle_basis, reflect_circle
from jaxrender.shapes import AnyArray, Array, Float, checked

# Gauss-Legendre nodes over each half circle: exact to rounding for smooth transfers to degree 60.
_NODES = 96


def flatland_coefficients(
    transfer: Callable[[Array, Array], Array], band_limits: tuple[int, int]
) -> Complex[Array, "order outgoing_order"]:
    """Compute rho_lp = iint rho^ F_l(t_i) conj(F_p(t_o)) over both visible half circles (T 2.20).

    ``transfer`` maps incoming and outgoing angles, [node, node], to rho^ = rho cos t_i.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    angles = jnp.asarray(nodes * np.pi / 2)
    weights = jnp.asarray(weights * np.pi / 2)
    shape = (_NODES, _NODES)
    values = transfer(
        jnp.broadcast_to(angles[:, None], shape), jnp.broadcast_to(angles[None, :], shape)
    )
    weighted = values * weights[:, None] * weights[None, :]
    incoming, outgoing = (circle_basis(angles, limit) for limit in band_limits)
    weighted = weighted.astype(incoming.dtype)
    return jnp.einsum("io,il,op->lp", weighted, incoming, outgoing.conj(), precision="highest")


@checked
def convolve_flatland(
    light: Complex[AnyArray, "light_order"], transfer: Inexact[AnyArray, "order outgoing"]
) -> Complex[Array, "order outgoing"]:
    """Compute B_lp = sqrt(2 pi) L_l rho_lp (T 2.24), or B_l(t_o) of rho_l(t_o) (T 2.25).

    Raises ``ValueError`` for an even number of orders or different ones.
    """
    own = jnp.asarray(light)
    return reflect_circle(own[:, None], jnp.asarray(transfer).astype(own.dtype))


@checked
def evaluate_flatland(
    field: Complex[AnyArray, "order outgoing_order"],
    alpha: Float[AnyArray, "point"],
    outgoing: Float[AnyArray, "point"],
) -> Complex[Array, "point"]:
    """Sum B = sum_lp B_lp F_l(alpha) F_p(t_o) at normals ``alpha`` and local angles (T 2.20)."""
    values = jnp.asarray(field)
    limits = tuple((count - 1) // 2 for count in values.shape)
    normal, exit_ = (
        circle_basis(jnp.asarray(angle), limit)
        for angle, limit in zip((alpha, outgoing), limits, strict=True)
    )
    return jnp.einsum("xl,lp,xp->x", normal, values, exit_, precision="highest")
