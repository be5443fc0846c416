"""The few images that all pictures of a diffuse object are mixed from (T 4.3.3, 7.1).

Under distant light, without shadows cast, a picture of a Lambertian object from one view is
sum_lm L_lm b_lm with the *basis images* b_lm = albedo A_l Y_lm(n) / pi: nine of them to degree 2.
They follow from the shape, or from photographs under known lights, and then relight the object
without any geometry.  Which mixtures of them matter most, averaged over all directional lights, are
the view's principal components, found here by mathematics instead of from thousands of pictures.

Pictures are lists of pixels: [pixel, channel].  Host side, NumPy float64.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.harmonics import band_limit_of, degrees, real_basis
from jaxrender.shapes import AnyArray, Directions, Float, checked
from jaxrender.spectra.lambertian import lambertian_transfer

# Lights that differ by less than this from mixtures of each other cannot be told apart.
_LEAST_CONDITION = 1e-6


@checked
def basis_images(
    normals: Directions, band_limit: int = 2
) -> Float[np.ndarray, "coefficient *batch"]:
    """Compute A_l Y_lm(n): the irradiance that each harmonic of the light makes at each pixel."""
    basis = np.asarray(real_basis(jnp.asarray(np.asarray(normals, float)), band_limit))
    scaled = basis * lambertian_transfer(band_limit)[degrees(band_limit)]
    return np.moveaxis(scaled, -1, 0)


class RecoveredBasis(NamedTuple):
    """Basis images found from photographs, their texture included.

    ``condition`` is the ratio of the largest to the smallest singular value of the lights' table:
    how many times larger than the photographs' the relative noise of the images can be.
    """

    images: Float[np.ndarray, "coefficient pixel channel"]
    condition: float


@checked
def basis_from_photographs(
    photographs: Float[AnyArray, "photograph pixel channel"],
    lights: Float[AnyArray, "light coefficient channel"],
) -> RecoveredBasis:
    """Recover the basis images from photographs under known lights, each pixel by itself.

    No geometry is needed, and the albedo comes along; ``lights`` are the coefficients of the light
    of each photograph.  Raises ``ValueError`` for fewer photographs than coefficients, or lights
    that are mixtures of each other.
    """
    pictures, lights = np.asarray(photographs, float), np.asarray(lights, float)
    count, coefficients = lights.shape[:2]
    band_limit_of(coefficients)
    if len(pictures) != count:
        raise ValueError(f"{len(pictures)} photographs and {count} lights: give a light for each")
    if count < coefficients:
        raise ValueError(
            f"{count} photographs cannot tell {coefficients} basis images apart: "
            f"take {coefficients} or more, or use fewer coefficients"
        )
    images = np.empty((coefficients, *pictures.shape[1:]))
    condition = 1.0
    for channel in range(pictures.shape[2]):
        table = lights[..., channel]
        sizes = np.linalg.svd(table, compute_uv=False)
        if not sizes[-1] > _LEAST_CONDITION * sizes[0]:
            distinct = int(np.sum(sizes > _LEAST_CONDITION * sizes[0]))
            raise ValueError(
                f"the lights of channel {channel} are mixtures of {distinct} lights, and "
                f"{coefficients} basis images are asked for: vary the light more"
            )
        condition = max(condition, float(sizes[0] / sizes[-1]))
        images[..., channel] = np.linalg.lstsq(table, pictures[..., channel], rcond=None)[0]
    return RecoveredBasis(images, condition)


@checked
def relit(
    images: Float[AnyArray, "coefficient pixel channel"],
    coefficients: Float[AnyArray, "coefficient channel"],
) -> Float[np.ndarray, "pixel channel"]:
    """Mix basis images by a new light's coefficients: a picture under that light."""
    return np.einsum("kpc,kc->pc", np.asarray(images), np.asarray(coefficients))


class PrincipalComponents(NamedTuple):
    """The principal components of a view under all directional lights, the strongest first.

    ``fractions`` are the parts of the pictures' total variance; ``mixtures`` the components as
    mixtures of the basis images (one column each), orthonormal over the view's pixels.
    """

    fractions: Float[np.ndarray, "component"]
    mixtures: Float[np.ndarray, "coefficient component"]

    @checked
    def images(self, normals: Directions) -> Float[np.ndarray, "component *batch"]:
        """Draw the components on the pixels with these normals."""
        return np.tensordot(
            self.mixtures.T, basis_images(normals, band_limit_of(len(self.mixtures))), axes=1
        )


@checked
def principal_components(
    normals: Directions, band_limit: int = 2, about_mean: bool = False
) -> PrincipalComponents:
    """Compute the principal components of all pictures of a view (T 7.1, low dimensions).

    Over all directional sources of equal strength the light's coefficients are uncorrelated and
    equally strong, so the pictures' second moments are those of the basis images: the eigenvectors
    of the (F+1)^2 square matrix of their inner products.  On the whole sphere the harmonics are
    orthogonal and are the components themselves; what is seen from one view mixes them.
    ``about_mean`` takes the mean picture (the degree 0 part, which all lights share) off first.
    """
    images = basis_images(normals.reshape(-1, 3), band_limit)
    if about_mean:
        images[0] = 0
    inner = images @ images.T / images.shape[1]
    values, vectors = np.linalg.eigh(inner)
    values, vectors = np.maximum(values[::-1], 0), vectors[:, ::-1]
    scale = np.sqrt(np.where(values > 1e-14 * values[0], values, np.inf))
    return PrincipalComponents(values / values.sum(), vectors / scale)
