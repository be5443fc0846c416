"""Sums along the rows of an image: between its texels and the waves cos(m phi), sin(m phi).

    waves_m = sum_j image_j (cos, sin)(m phi_j),      image_j = sum_m waves_m (cos, sin)(m phi_j)

The two are each other's adjoint.  Waves are [order, trig, channel, row].  Few orders are a matrix
product over the columns, folded into a quarter where their number allows it; many are an FFT.
"""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics.grids import SeparableGrid
from jaxrender.shapes import Array, Float

# Measured on two cores: above them the FFT beats the matrix product over the columns, folded into
# a quarter or, where their number is not divisible, all of them.  From waves to an image the FFT
# runs on one thread and its transpositions cost more than itself: in float32 the product takes 6 ms
# where the FFT takes 10 (degree 255, 3 x 512 x 1024).
_HIGHEST_DEGREE_BY_QUARTERS = 95
_HIGHEST_DEGREE_TO_IMAGE_BY_QUARTERS = {"float32": 255}
_HIGHEST_DEGREE_BY_PRODUCT = 63

_einsum = partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)


def waves_from_image(grid: SeparableGrid, band_limit: int, image: Array) -> Array:
    """Return the sums over each row of image x (cos, sin)(m phi): [order, trig, channel, row]."""
    if _by_quarters(grid, band_limit, _HIGHEST_DEGREE_BY_QUARTERS):
        return _waves_from_quarters(_quarters(grid, band_limit), band_limit, image)
    if _by_product(grid, band_limit):
        return _einsum(
            "tmw,hwc->mtch", jnp.asarray(_trigonometry(grid, band_limit), image.dtype), image
        )
    spectrum = jnp.fft.rfft(image, axis=1)[:, : band_limit + 1]
    # The first column lies half a texel from azimuth 0.
    turned = spectrum * _half_texel(grid, band_limit, spectrum.dtype)
    return jnp.transpose(jnp.stack([turned.real, -turned.imag]), (2, 0, 3, 1))


def image_from_waves(grid: SeparableGrid, band_limit: int, waves: Array) -> Array:
    """Return the sum of waves x (cos, sin)(m phi): the adjoint of ``waves_from_image``."""
    most = _HIGHEST_DEGREE_TO_IMAGE_BY_QUARTERS.get(waves.dtype.name, _HIGHEST_DEGREE_BY_QUARTERS)
    if _by_quarters(grid, band_limit, most):
        return _image_from_quarters(_quarters(grid, band_limit), waves)
    if _by_product(grid, band_limit):
        return _einsum(
            "tmw,mtch->hwc", jnp.asarray(_trigonometry(grid, band_limit), waves.dtype), waves
        )
    turned = jnp.transpose(jax.lax.complex(waves[:, 0], -waves[:, 1]), (2, 0, 1))
    turned = turned * jnp.conj(_half_texel(grid, band_limit, turned.dtype))
    # irfft counts every order but 0 twice, for its conjugate.
    share = jnp.asarray(np.where(np.arange(band_limit + 1) == 0, 1.0, 0.5), turned.dtype)
    spectrum = turned * share[None, :, None]
    return jnp.fft.irfft(spectrum, n=grid.width, axis=1) * grid.width


def _waves_from_quarters(table: np.ndarray, band_limit: int, image: Array) -> Array:
    height, width, channels = image.shape
    first, second, third, fourth = jnp.split(image, 4, axis=1)
    second, fourth = second[:, ::-1], fourth[:, ::-1]
    here, there = first + third, first - third
    mirror, turned = second + fourth, second - fourth
    folded = jnp.stack([here + mirror, there - turned, here - mirror, there + turned])
    # A copy of its own puts the columns last, where the product wants them.
    planar = jnp.moveaxis(jax.lax.optimization_barrier(folded), 3, 2)
    rows = planar.reshape(4, height * channels, width // 4)
    products = jnp.matmul(rows, jnp.asarray(table, image.dtype), precision="highest")
    by_trig = products.reshape(2, 2, height, channels, -1)
    waves = jnp.transpose(by_trig, (4, 1, 0, 3, 2)).reshape(-1, 2, channels, height)
    return waves[: band_limit + 1]


def _image_from_quarters(table: np.ndarray, waves: Array) -> Array:
    count, _, channels, height = waves.shape
    pairs = table.shape[2]
    padded = jnp.pad(waves, ((0, 2 * pairs - count), (0, 0), (0, 0), (0, 0)))
    by_trig = jnp.transpose(padded.reshape(pairs, 2, 2, channels, height), (2, 1, 4, 3, 0))
    rows = by_trig.reshape(4, height * channels, pairs)
    transposed = jnp.asarray(np.swapaxes(table, 1, 2), waves.dtype)
    folded = jnp.matmul(rows, transposed, precision="highest").reshape(4, height, channels, -1)
    # Channels last before anything is mirrored: as one loop the two are four times slower.
    together = jax.lax.optimization_barrier(jnp.moveaxis(folded, 2, 3))
    cosine_even, cosine_odd, sine_even, sine_odd = together
    here, mirror = cosine_even + sine_even, (cosine_even - sine_even)[:, ::-1]
    there, turned = cosine_odd + sine_odd, (sine_odd - cosine_odd)[:, ::-1]
    quarters = [here + there, mirror + turned, here - there, mirror - turned]
    return jnp.concatenate(quarters, axis=1)


def _by_quarters(grid: SeparableGrid, band_limit: int, most: int) -> bool:
    return band_limit <= most and grid.width % 4 == 0


def _by_product(grid: SeparableGrid, band_limit: int) -> bool:
    # An order of width / 2 or more, which only synthesis meets, has no place of its own in the FFT.
    return band_limit <= _HIGHEST_DEGREE_BY_PRODUCT or 2 * band_limit >= grid.width


def _half_texel(grid: SeparableGrid, band_limit: int, dtype) -> Array:
    angles = np.arange(band_limit + 1) * np.pi / grid.width
    return jnp.asarray(np.exp(-1j * angles), dtype)[None, :, None]


@lru_cache(maxsize=32)
def _quarters(grid: SeparableGrid, band_limit: int) -> Float[np.ndarray, "wave column order"]:
    """Return cos of even and of odd orders, sin of even and of odd ones, on the first quarter.

    Azimuths p, pi - p, pi + p and 2 pi - p have the same cosine and sine of m p but for signs that
    depend on the parity of m only: the columns are folded with them before the product.
    """
    azimuths = grid.azimuths()[: grid.width // 4]
    even = np.multiply.outer(azimuths, np.arange(0, band_limit + 2 - band_limit % 2, 2))
    odd = even + azimuths[:, None]
    return np.stack([np.cos(even), np.cos(odd), np.sin(even), np.sin(odd)])


@lru_cache(maxsize=32)
def _trigonometry(grid: SeparableGrid, band_limit: int) -> Float[np.ndarray, "trig order column"]:
    angles = np.multiply.outer(np.arange(band_limit + 1), grid.azimuths())
    return np.stack([np.cos(angles), np.sin(angles)])
