"""Zernike polynomials on the pair of hemispheres (Koenderink, van Doorn and Stavridi, 1996).

A direction lies on the unit disc at (x, y) / sqrt(1 + z), the radius being sqrt(2) sin(t / 2):
solid angle is twice the area there.  With the polynomial R_n^m of the radius (R_n^m(1) = 1),

    H_nkm = c [R_n^m(r_i) R_k^m(r_o) + R_k^m(r_i) R_n^m(r_o)] cos m (p_i - p_o),
    0 <= m <= k <= n <= order,  n - m and k - m even,

are all that reciprocity, isotropy and mirror symmetry leave; the bracket has one term if n = k, and

    c^2 = (n + 1) (k + 1) / (4 pi^2),  times 2 if m > 0 and times 1/2 if k < n,

makes them orthonormal in dw_i dw_o.  Order 2 has 5 of them and order 8 has 55: what the CUReT
database fits to its 205 measurements (T 5.7.2).  H is a polynomial of the places on the disc,
smooth everywhere; a series of them may be negative where nothing was measured.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.brdf.measured import MeasuredAlbedo
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

# Beyond this the alternating sums of the polynomials lose single precision altogether.
LARGEST_ORDER = 16


class ZernikeIndex(NamedTuple):
    """Which function: degrees n >= k and the azimuthal frequency m."""

    n: int
    k: int
    m: int


def zernike_indices(order: int) -> tuple[ZernikeIndex, ...]:
    """List the functions up to an order, by n, k, m.

    Raises ``ValueError`` for an order that is negative or above 16.
    """
    if not 0 <= order <= LARGEST_ORDER:
        raise ValueError(f"order={order}: choose 0 to {LARGEST_ORDER}")
    return tuple(
        ZernikeIndex(n, k, m)
        for n in range(order + 1)
        for k in range(n % 2, n + 1, 2)
        for m in range(n % 2, k + 1, 2)
    )


class ZernikeBRDF(MeasuredAlbedo):
    """``coefficients`` in 1/sr of the functions that ``zernike_indices(order)`` lists.

    The functions are the lobes: a fit may eliminate the coefficients.  Raises ``ValueError`` for
    another number of coefficients than the order's.
    """

    coefficients: Float[AnyArray, "lobe channel"]
    order: int = eqx.field(static=True)

    def __check_init__(self):
        wanted = len(zernike_indices(self.order))
        if self.coefficients.shape[0] != wanted:
            raise ValueError(
                f"{self.coefficients.shape[0]} coefficients; order {self.order} has {wanted}"
            )

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """The coefficients."""
        return self.coefficients

    @property
    def reciprocal(self) -> bool:
        """Always, function by function."""
        return True

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate each function times cos t_i."""
        visible = are_visible(incoming, outgoing)
        return tuple(
            jnp.where(visible, function * incoming.z, 0)
            for function in zernike_functions(incoming, outgoing, self.order)
        )


def zernike_functions(
    incoming: Components, outgoing: Components, order: int
) -> tuple[Float[Array, "*batch"], ...]:
    """Evaluate all functions up to an order, above the horizon, in the order of their list."""
    one, other = _on_disc(incoming), _on_disc(outgoing)
    # (r_i r_o)^m cos m (p_i - p_o) is the real part of a power; the radial factors want r^m less.
    real, imaginary = one[0] * other[0] + one[1] * other[1], one[1] * other[0] - one[0] * other[1]
    turns = [(jnp.ones_like(real), jnp.zeros_like(real))]
    for _ in range(order):
        a, b = turns[-1]
        turns.append((a * real - b * imaginary, a * imaginary + b * real))
    squares = [x * x + y * y for x, y in (one, other)]
    pairs = [(n, m) for n in range(order + 1) for m in range(n % 2, n + 1, 2)]
    inward, outward = ({p: _reduced(*p, square) for p in pairs} for square in squares)
    found = []
    for n, k, m in zernike_indices(order):
        product = inward[n, m] * outward[k, m]
        if k < n:
            product = product + inward[k, m] * outward[n, m]
        found.append(_norm(n, k, m) * product * turns[m][0])
    return tuple(found)


def radial_polynomial(n: int, m: int) -> Float[np.ndarray, "power"]:
    """Give R_n^m(r) / r^m as coefficients of powers of r^2, lowest first; n - m is even."""
    half = (n - m) // 2
    falling = [
        (-1) ** s
        * math.factorial(n - s)
        // (math.factorial(s) * math.factorial(n - half - s) * math.factorial(half - s))
        for s in range(half + 1)
    ]
    return np.array(falling[::-1], float)


def _on_disc(direction: Components) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    raised = lifted(direction)
    scale = jax.lax.rsqrt(1 + raised.z)
    return jnp.asarray(raised.x * scale), jnp.asarray(raised.y * scale)


def _reduced(n: int, m: int, square: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    total = jnp.zeros_like(square)
    for coefficient in radial_polynomial(n, m)[::-1]:
        total = total * square + float(coefficient)
    return total


def _norm(n: int, k: int, m: int) -> float:
    square = (n + 1) * (k + 1) / (4 * np.pi**2)
    return math.sqrt(square * (2 if m > 0 else 1) * (0.5 if k < n else 1))
