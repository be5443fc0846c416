"""The Lambertian transfer: the clamped cosine by degree, in closed form (T 3.32, 4.11)."""

import numpy as np

from jaxrender.shapes import Float


def lambertian_transfer(band_limit: int) -> Float[np.ndarray, "degree"]:
    """Compute A_l = Lambda_l rho_l of the clamped cosine for degrees 0 to ``band_limit``.

    A_1 = 2 pi / 3, A_l = 0 for other odd l, and for even l

    A_l = 2 pi (-1)^(l/2 - 1) / ((l + 2)(l - 1)) * l! / (2^l ((l/2)!)^2)

    with ((l/2)!)^2, not the (l!/2)^2 of the printed T 4.11 (ERRATA 19).  The factorials are taken
    as a running product, so any degree is exact to rounding.
    """
    if band_limit < 0:
        raise ValueError(f"band_limit={band_limit}: the band limit must not be negative")
    transfer = np.zeros(band_limit + 1)
    if band_limit >= 1:
        transfer[1] = 2 * np.pi / 3
    even = np.arange(0, band_limit + 1, 2)
    # l! / (2^l ((l/2)!)^2) = prod over k = 1 .. l/2 of (2k - 1) / 2k
    k = np.arange(1, len(even))
    central = np.concatenate([[1.0], np.cumprod((2 * k - 1) / (2 * k))])
    sign = np.where(even // 2 % 2 == 1, 1.0, -1.0)
    transfer[even] = 2 * np.pi * sign * central / ((even + 2) * (even - 1))
    return transfer
