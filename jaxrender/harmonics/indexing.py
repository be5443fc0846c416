"""Where the coefficient of degree l and order m lives: flat index l(l+1)+m, m from -l to l.

A band limit F is the highest degree kept, so an array up to it holds (F+1)^2 coefficients.
"""

import math

import numpy as np
from jaxtyping import Int


def coefficient_count(band_limit: int) -> int:
    """Return (F+1)^2, the number of harmonics of degree 0 to F; ValueError if F is negative."""
    if band_limit < 0:
        raise ValueError(f"band_limit is {band_limit}; it is a degree, so give 0 or more")
    return (band_limit + 1) ** 2


def band_limit_of(count: int) -> int:
    """Return the F for which (F+1)^2 = count; ValueError if count is not a positive square."""
    root = math.isqrt(max(count, 0))
    if count < 1 or root * root != count:
        raise ValueError(
            f"{count} coefficients fit no band limit; give (F + 1)^2 of them: 1, 4, 9, 16, ..."
        )
    return root - 1


def flat_index(degree: int, order: int) -> int:
    """Return l(l+1)+m; ValueError unless l >= 0 and |m| <= l."""
    if degree < 0:
        raise ValueError(f"degree {degree} does not exist; give 0 or more")
    if abs(order) > degree:
        raise ValueError(f"order {order} does not exist at degree {degree}; give |order| <= degree")
    return degree * (degree + 1) + order


def degrees(band_limit: int) -> Int[np.ndarray, " coefficient"]:
    """Return the degree l of every flat index."""
    every = np.arange(coefficient_count(band_limit))
    return np.sqrt(every + 0.5).astype(int)


def orders(band_limit: int) -> Int[np.ndarray, " coefficient"]:
    """Return the order m of every flat index."""
    every = np.arange(coefficient_count(band_limit))
    degree = degrees(band_limit)
    return every - degree * (degree + 1)
