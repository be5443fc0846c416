"""The quadrature about the reflected direction: any lobe as functions of the angle from R.

With N = (sin t_o, 0, cos t_o) seen from R = +Z, a lobe f(w_i, w_o) (a transfer function, BRDF times
cos t_i) of exit angle t_o is

h_lq(t_o) = Lambda_l int f(t, phi) Y_lq(t, phi) dw            (T 3.43, real harmonics)

over the directions above the horizon, t the angle from R and phi the azimuth about it, 0 towards
N.  Isotropic lobes are symmetric about the plane of incidence, so the orders q < 0 vanish.
Reflected radiance is sum_lq Lambda_l^-1 h_lq L_lq with the light's coefficients in that frame;
the order q = 0 alone is the azimuthal mean, h_l.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.batches import in_batches
from jaxrender.geometry import Components
from jaxrender.harmonics import coefficient_count, flat_index, legendre, real_basis
from jaxrender.shapes import AnyArray, Array, Float, checked

# Gauss-Legendre nodes in azimuth up to the horizon, to which one is added for each order q.
# With these, and as many in the angle from R as ``_node_count`` says, the transfer is good to 1e-6
# of its largest value for sigma from .01 to 1, exit cosines from .15 and degrees to 128 (1e-5 at
# cosine .02).
_AZIMUTH_NODES = 32
# Towards grazing exit a lobe is narrower across the plane of incidence by its cosine (T 3.52), and
# the azimuths crowd towards the plane by this power of it; less where waves of high orders have to
# be followed all around: by 1 / (3 + 3 Q / 8).
_CROWDING, _CROWDING_PER_ORDER = 3.0, 0.375
# Exit cosines below this are crowded for as this one.
_LEAST_CROWDED = 0.01
# A block of exit cosines has at most so many harmonics at its nodes: 256 MiB in double precision.
_MOST_NUMBERS = 2**25
# Closer to 1 than so many roundings an exit cosine counts as that: the angle has a slope there.
_HEAD_ON_ROUNDINGS = 4

Lobe = Callable[[Components, Components], Array]


@checked
def mean_transfer(
    lobe: Lobe,
    exit_cosines: Float[AnyArray, "bin"],
    band_limit: int,
    reach: Float[Array, ""],
    tail: Float[Array, ""] | None = None,
) -> Float[Array, "bin degree"]:
    """Compute h_l, the order q = 0 of a lobe, for each exit cosine.

    The lobe is called for directions above the horizon; it is negligible further than ``reach``
    radians from R.  Where its tail falls slowly, ``tail`` is the tangent of half its width: the
    nodes are then spread over every scale.
    """
    exit_angles = exit_angles_of(exit_cosines)[:, None]
    polar, weights = _polar_nodes(exit_angles, reach, tail, band_limit)
    moments = _moments(lobe, exit_angles, polar, 0)[..., 0]
    kernel = 2 * jnp.pi * moments * jnp.sin(polar) * weights
    polynomials = legendre(jnp.cos(polar), band_limit)
    return jnp.einsum("bt,btl->bl", kernel, polynomials, precision="highest")


@checked
def azimuthal_transfer(
    lobe: Lobe,
    exit_cosines: Float[AnyArray, "bin"],
    band_limits: tuple[int, int],
    reach: Float[Array, ""],
    tail: Float[Array, ""] | None = None,
) -> Float[Array, "bin degree order"]:
    """Compute h_lq for degrees to the first and orders 0 to the second of the band limits.

    Zero where q > l.  Arguments as of ``mean_transfer``.  Many exit cosines go through in blocks.

    Raises ``ValueError`` if more orders than degrees are asked for.
    """
    band_limit, order_limit = band_limits
    coefficient_count(band_limit)
    if not 0 <= order_limit <= band_limit:
        raise ValueError(
            f"orders to {order_limit} of degrees to {band_limit}: an order is at most its degree"
        )
    nodes = 2 * _node_count(band_limit, tail is not None)
    block = max(1, _MOST_NUMBERS // (nodes * coefficient_count(band_limit)))
    if exit_cosines.shape[0] <= block:
        return _orders(lobe, exit_cosines, band_limits, reach, tail)

    # What each block has computed is computed again for its derivatives, not kept.
    @jax.checkpoint
    def of_one(cosine: Float[Array, ""]) -> Float[Array, "degree order"]:
        return _orders(lobe, cosine[None], band_limits, reach, tail)[0]

    return in_batches(of_one, exit_cosines, block)


def _orders(
    lobe: Lobe,
    exit_cosines: Float[AnyArray, "bin"],
    band_limits: tuple[int, int],
    reach: Float[Array, ""],
    tail: Float[Array, ""] | None,
) -> Float[Array, "bin degree order"]:
    """Compute ``azimuthal_transfer`` for as many exit cosines as memory holds at once."""
    band_limit, order_limit = band_limits
    exit_angles = exit_angles_of(exit_cosines)[:, None]
    polar, weights = _polar_nodes(exit_angles, reach, tail, band_limit)
    moments = _moments(lobe, exit_angles, polar, order_limit)
    kernel = 2 * jnp.pi * moments * (jnp.sin(polar) * weights)[..., None]
    # At azimuth 0 the harmonics of the orders q >= 0 are their polar factors.
    meridian = jnp.stack([jnp.sin(polar), jnp.zeros_like(polar), jnp.cos(polar)], axis=-1)
    index, exists = _order_table(band_limit, order_limit)
    factors = jnp.where(exists, real_basis(meridian, band_limit)[..., index], 0)
    wavelength = jnp.asarray(np.sqrt(4 * np.pi / (2 * np.arange(band_limit + 1) + 1)), polar.dtype)
    terms = jnp.einsum("btq,btlq->blq", kernel, factors, precision="highest")
    return wavelength[None, :, None] * terms


def exit_angles_of(exit_cosines: Float[AnyArray, "bin"]) -> Float[Array, "bin"]:
    """Take arccos of exit cosines, with a finite slope head-on.

    A mean about R is an even function of the angle, hence smooth in the cosine, but arccos itself
    is not at 1.  N.V of unit vectors may round to just above 1, too.
    """
    cosines = jnp.maximum(jnp.asarray(exit_cosines), 0)
    highest = 1 - _HEAD_ON_ROUNDINGS * float(jnp.finfo(cosines.dtype).eps)
    # The value is held below 1, the slope passes.
    beyond = jax.lax.stop_gradient(jnp.maximum(cosines - highest, 0))
    return jnp.arccos(cosines - beyond)


def _order_table(band_limit: int, order_limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Return where Y_lq lives, [degree, order], and which of them exist."""
    degree = np.arange(band_limit + 1)[:, None]
    order = np.arange(order_limit + 1)[None, :]
    exists = order <= degree
    index = np.where(exists, degree * (degree + 1) + order, flat_index(0, 0))
    return index, exists


def _polar_nodes(
    exit_angles: Float[Array, "bin 1"],
    reach: Float[Array, ""],
    tail: Float[Array, ""] | None,
    band_limit: int,
) -> tuple[Float[Array, "bin node"], Float[Array, "bin node"]]:
    """Place nodes over the lobe's extent, split where the circles about R first cross the horizon.

    There the averaged lobe has a kink that one Gauss rule could not follow.  The integral does not
    depend on where its nodes are, so they follow the lobe without being differentiated; not so
    those of a tail, of which there are only as many as the value needs: between fixed ones the
    derivative of a narrow lobe would be off by 5e-5.
    """
    reach = jax.lax.stop_gradient(reach)
    # Circles wider than pi / 2 + t_o lie below the horizon altogether.
    reach = jnp.minimum(reach, jnp.pi / 2 + exit_angles)
    touch = jnp.minimum(jnp.pi / 2 - exit_angles, reach)
    if tail is not None:
        # t = 2 arctan(tail tan v): in v a Lorentzian tail is a trigonometric polynomial.
        reach, touch = (jnp.arctan2(jnp.sin(t / 2), tail * jnp.cos(t / 2)) for t in (reach, touch))
    nodes, weights = np.polynomial.legendre.leggauss(_node_count(band_limit, tail is not None))
    nodes = jnp.asarray((nodes + 1) / 2, exit_angles.dtype)[None, :]
    weights = jnp.asarray(weights / 2, exit_angles.dtype)[None, :]
    above, across = touch, reach - touch
    # A square puts nodes densest where the cut begins, and removes its square-root kink.
    polar = jnp.concatenate([above * nodes, touch + across * nodes**2], axis=1)
    weights = jnp.concatenate([above * weights, across * 2 * nodes * weights], axis=1)
    if tail is None:
        return polar, weights
    sine, cosine = jnp.sin(polar), jnp.cos(polar)
    stretch = 2 * tail / (cosine**2 + (tail * sine) ** 2)
    return 2 * jnp.arctan2(tail * sine, cosine), weights * stretch


def _node_count(band_limit: int, has_tail: bool) -> int:
    """Say how many nodes each side of the horizon's first touch needs.

    Some for the lobe, and some for each wave of the polynomials that its nodes have to follow: many
    more where they are spread over every scale of a tail.
    """
    return max(64, 32 + 3 * band_limit) if has_tail else max(40, 16 + 5 * band_limit // 4)


def _safe_arccos(cosines: Float[Array, "bin node"]) -> Float[Array, "bin node"]:
    """Take arccos with the ends clipped, and a derivative of zero there instead of infinity."""
    inside = jnp.abs(cosines) < 1
    angle = jnp.arccos(jnp.where(inside, cosines, 0))
    return jnp.where(inside, angle, jnp.where(cosines > 0, 0, jnp.pi))


def _moments(
    lobe: Lobe,
    exit_angles: Float[Array, "bin 1"],
    polar: Float[Array, "bin node"],
    order_limit: int,
) -> Float[Array, "bin node order"]:
    """Average lobe x cos(q phi) over the part of each circle about R that is above the horizon."""
    sin_o, cos_o = jnp.sin(exit_angles), jnp.cos(exit_angles)
    sin_t, cos_t = jnp.sin(polar), jnp.cos(polar)
    # In the plane of incidence: N = +Z, R = (-sin t_o, 0, cos t_o), V = (sin t_o, 0, cos t_o).
    # A circle of radius t about R, azimuth 0 towards N, meets the horizon at
    # cos phi = -cot t cot t_o.
    lift = sin_t * sin_o
    cosine = jnp.where(lift > 0, -cos_t * cos_o / jnp.where(lift > 0, lift, 1), -jnp.sign(cos_t))
    horizon = _safe_arccos(cosine)[..., None]
    nodes, weights = np.polynomial.legendre.leggauss(_AZIMUTH_NODES + order_limit)
    # tan phi = k tan u of equally weighted u; the integral does not depend on k.
    crowding = 1 / (_CROWDING + _CROWDING_PER_ORDER * order_limit)
    k = (jnp.maximum(cos_o, _LEAST_CROWDED) ** crowding)[..., None]
    # The sine of pi may round to below zero, and the end would be -pi.
    end = jnp.arctan2(jnp.maximum(jnp.sin(horizon), 0), k * jnp.cos(horizon))
    u = end * jnp.asarray((nodes + 1) / 2, polar.dtype)[None, None, :]
    cos_u, sin_u = jnp.cos(u), k * jnp.sin(u)
    squared = cos_u**2 + sin_u**2
    scale = sin_t[..., None] * jax.lax.rsqrt(squared)
    toward, across = scale * cos_u, scale * sin_u
    along = cos_t[..., None]
    sin_o, cos_o = sin_o[..., None], cos_o[..., None]
    incoming = Components(toward * cos_o - along * sin_o, across, toward * sin_o + along * cos_o)
    outgoing = Components(sin_o, jnp.zeros_like(sin_o), cos_o)
    weights = jnp.asarray(weights / 2, polar.dtype)[None, None, :]
    values = lobe(incoming, outgoing) * weights * (end * k / jnp.pi) / squared
    if order_limit == 0:
        return jnp.sum(values, axis=-1, keepdims=True)
    orders = jnp.arange(order_limit + 1, dtype=polar.dtype)
    waves = jnp.cos(jnp.arctan2(sin_u, cos_u)[..., None] * orders[None, None, None, :])
    return jnp.einsum("bta,btaq->btq", values, waves, precision="highest")
