"""The spectrum of any BRDF about its lobes' central direction: one number a degree (T 3.9).

A radially symmetric lobe u(C.L) has A_l = Lambda_l rho_l = 2 pi int u P_l, and reflects light as
B_lm = A_l L_lm (T 2.62, 3.10).  Where a formula exists it is used; else the lobe is integrated
about the reflected direction R of an exit angle, which leaves the order q = 0 of T 3.43: exact at
normal exitance, the azimuthal mean elsewhere.
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp

from jaxrender.brdf import BRDF, Lambertian, Microfacet, Phong
from jaxrender.geometry import Components
from jaxrender.harmonics import coefficient_count
from jaxrender.shapes import Array, Float
from jaxrender.spectra.lambertian import lambertian_transfer
from jaxrender.spectra.microfacet import exit_cosine_transfer
from jaxrender.spectra.mirror_frame import mean_transfer
from jaxrender.spectra.phong import phong_transfer

# Tangent of half the narrowest lobe that the nodes of the numeric way are spread for.
_NARROWEST = 0.05


def spectrum_of(
    brdf: BRDF,
    band_limit: int,
    exit_cosine: float = 1.0,
    numeric: bool = False,
) -> Float[Array, "lobe degree"]:
    """Compute A_l of every lobe of a BRDF at amplitude one, for an exit cosine (1: head-on).

    A Lambertian lobe is taken about the normal, every other about the reflected direction.
    ``numeric=True`` leaves the formulas out, for all lobes about the reflected direction.

    Raises ``ValueError`` for an exit cosine outside (0, 1], a negative band limit, and an
    anisotropic BRDF, whose lobes are not symmetric about the plane of incidence.
    """
    coefficient_count(band_limit)
    if not brdf.isotropic:
        raise ValueError(
            f"{type(brdf).__name__} is anisotropic: use anisotropic_coefficients, or its mean over "
            "turns, IsotropicMean(brdf)"
        )
    if not 0 < exit_cosine <= 1:
        raise ValueError(f"exit_cosine={exit_cosine}: give a cosine above 0 and up to 1")
    formula = None if numeric else _FORMULAS.get(type(brdf))
    if formula is not None:
        return formula(brdf, band_limit, exit_cosine)
    return _numeric(brdf, band_limit, exit_cosine)


def _lambertian(brdf: Lambertian, band_limit: int, exit_cosine: float) -> Array:
    kind = jnp.asarray(brdf.kd).dtype
    return jnp.asarray(lambertian_transfer(band_limit), kind)[None, :]


def _microfacet(brdf: Microfacet, band_limit: int, exit_cosine: float) -> Array:
    exit_cosines = jnp.full((1,), exit_cosine, jnp.asarray(brdf.ks).dtype)
    specular = exit_cosine_transfer(brdf, exit_cosines, band_limit)[0]
    diffuse = jnp.asarray(lambertian_transfer(band_limit), specular.dtype)
    return jnp.stack([diffuse, specular])


def _phong(brdf: Phong, band_limit: int, exit_cosine: float) -> Array:
    if brdf.clipped and exit_cosine < 1:
        return _numeric(brdf, band_limit, exit_cosine)
    specular = phong_transfer(brdf.exponent, band_limit)
    diffuse = jnp.asarray(lambertian_transfer(band_limit), specular.dtype)
    return jnp.stack([diffuse, specular])


# By the model's exact class: a model derived from one of them need not have its lobes.
_FORMULAS: dict[type, Callable[..., Array]] = {
    Lambertian: _lambertian,
    Microfacet: _microfacet,
    Phong: _phong,
}


def _numeric(brdf: BRDF, band_limit: int, exit_cosine: float) -> Array:
    dtype = jnp.asarray(brdf.amplitudes).dtype
    return _azimuthal_mean(brdf, jnp.asarray(exit_cosine, dtype), band_limit)


@eqx.filter_jit
def _azimuthal_mean(brdf: BRDF, exit_cosine: Float[Array, ""], band_limit: int) -> Array:
    dtype = exit_cosine.dtype
    reach, tail = jnp.asarray(jnp.pi, dtype), jnp.asarray(_NARROWEST, dtype)

    def lobe_number(k: int) -> Array:
        def lobe(incoming: Components, outgoing: Components) -> Array:
            everywhere = Components(*(jnp.broadcast_to(c, incoming.z.shape) for c in outgoing))
            return brdf.transfer(incoming, everywhere)[k]

        return mean_transfer(lobe, exit_cosine[None], band_limit, reach, tail)[0]

    return jnp.stack([lobe_number(k) for k in range(brdf.amplitudes.shape[0])])
