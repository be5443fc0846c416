"""The thesis's own account of the microfacet lobe at small exit angles (T 3.2.7).

Seen about R, with the light at t_i from it in the azimuth phi_i (0 in the plane of incidence), the
half angle is to first order

    t_h^2 = (t_i / 2)^2 (1 + sin^2 phi_i tan^2 t_o)                                    T 3.52

so that the lobe is wider in the plane of incidence than across it.  The first term of exp(-t_h^2 /
sigma^2) in tan^2 t_o, averaged over the azimuth, gives

    Lambda_l rho_l = 1 / cos t_o int_0^inf 2u e^(-u^2) P_l(cos 2 sigma u)
                     (1 - u^2 tan^2 t_o / 2) du                                        T 3.53

Both are for facets of Gaussian angle (T 3.42), without Fresnel, masking or horizon, and for narrow
lobes, where sin t_i is t_i.  ``microfacet.exit_cosine_transfer`` has none of these limits: this is
what its twin ``gaussian_transfer`` (T 3.51) comes from, with the next term.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.parameters import Scalar
from jaxrender.harmonics import legendre
from jaxrender.shapes import AnyArray, Array, Float, checked

# Where exp(-u^2) ends, and how many Gauss nodes up to there: some for it, some for each degree's
# waves cos(2 sigma l u) up to sigma = 1.
_END = 6.5
_NODES, _NODES_PER_DEGREE = 48, 8


@checked
def squared_half_angle(
    angles: Float[AnyArray, "*batch"],
    azimuths: Float[AnyArray, "*batch"],
    exit_cosines: Float[AnyArray, "*batch"],
) -> Float[Array, "*batch"]:
    """Compute t_h^2 of lights near R to first order (T 3.52), in radians squared.

    ``angles`` of the light from R, ``azimuths`` about R from the plane of incidence.  The error
    falls as the third power of the angle.
    """
    cosines = jnp.asarray(exit_cosines)
    squared_tangent = 1 / cosines**2 - 1
    across = jnp.sin(jnp.asarray(azimuths)) ** 2
    return (jnp.asarray(angles) / 2) ** 2 * (1 + across * squared_tangent)


@eqx.filter_jit
@checked
def series_transfer(
    sigma: Scalar, exit_cosines: Float[AnyArray, "bin"], band_limit: int
) -> Float[Array, "bin degree"]:
    """Compute Lambda_l rho_l of T 3.53 for each exit cosine, by quadrature in u.

    Against the exact transfer the error is of the order t_o^4 (1 + (sigma l)^4) and sigma^2.
    """
    cosines = jnp.asarray(exit_cosines)
    nodes, weights = np.polynomial.legendre.leggauss(_NODES + _NODES_PER_DEGREE * band_limit)
    u, weights = _END * (nodes + 1) / 2, _END * weights / 2
    kernel = jnp.asarray(2 * u * np.exp(-(u**2)) * weights, cosines.dtype)
    squared = jnp.asarray(u**2, cosines.dtype)
    polynomials = legendre(jnp.cos(2 * sigma * jnp.asarray(u, cosines.dtype)), band_limit)
    whole, bent = (
        jnp.einsum("u,ul->l", terms, polynomials, precision="highest")
        for terms in (kernel, kernel * squared)
    )
    squared_tangent = (1 / cosines**2 - 1)[:, None]
    return (whole[None, :] - bent[None, :] * squared_tangent / 2) / cosines[:, None]
