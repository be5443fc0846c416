"""Lights and BRDFs as coefficients by degree: where direction becomes frequency (T 3).

``light``
    harmonic coefficients of any light
``distributions``
    the analytic ones: directional, axially symmetric and uniform light, overcast and clear sky
``mirror`` ``lambertian`` ``phong``
    the mirror, the clamped cosine and the Phong lobe, exactly, to any degree
``microfacet``
    the transfer h_l(sigma, mu, exit cosine) of a microfacet lobe, with its Gaussian and
    normal-exitance twins
``microfacet_series``
    the thesis's own series of that transfer for small exit angles
``facets`` ``mirror_frame``
    the same for other facet distributions, with the azimuthal terms; the quadrature about the
    reflected direction behind them all
``numeric``
    rho_lpq, rho_{ln,pq} and rho_lq(t_o) of any BRDF by quadrature
``spectrum``
    the spectrum of any BRDF about its lobes' central direction
``central`` ``orders`` ``ringing``
    the same with its dependence on the viewer, rho_lpq about the reflected direction; which
    degrees of light and viewer suffice; windows for those that are cut
"""

from jaxrender.spectra.central import (
    CentralSpectrum,
    CentralTable,
    central_spectrum,
    central_spectrum_of,
    tabulated_spectrum,
)
from jaxrender.spectra.distributions import (
    axial_coefficients,
    clear_coefficients,
    directional_coefficients,
    overcast_coefficients,
    uniform_coefficients,
    zonal_coefficients,
)
from jaxrender.spectra.facets import (
    FACET_DISTRIBUTIONS,
    FacetLobe,
    facet_azimuthal_transfer,
    facet_transfer,
    matched_gaussian_transfer,
)
from jaxrender.spectra.lambertian import lambertian_transfer
from jaxrender.spectra.light import light_coefficients
from jaxrender.spectra.microfacet import (
    TRANSFERS,
    azimuthal_transfer_of_samples,
    exit_cosine_transfer,
    extent_of,
    gaussian_transfer,
    head_on_transfer,
    normal_exitance_transfer,
    transfer_at,
    transfer_of_samples,
    transfer_table,
)
from jaxrender.spectra.microfacet_series import series_transfer, squared_half_angle
from jaxrender.spectra.mirror import (
    clipped_mirror_coefficients,
    mirror_coefficients,
    mirror_transfer,
)
from jaxrender.spectra.mirror_frame import azimuthal_transfer, mean_transfer
from jaxrender.spectra.numeric import (
    HemisphereRule,
    anisotropic_coefficients,
    anisotropic_outgoing_coefficients,
    isotropic_coefficients,
    outgoing_coefficients,
    sum_lobes,
)
from jaxrender.spectra.orders import (
    TEXELS_PER_DEGREE,
    Orders,
    crossover_exponent,
    missing_energy,
    missing_light,
    phong_order,
    phong_width,
    required_orders,
    residual_bound,
)
from jaxrender.spectra.phong import (
    PHONG_TRANSFERS,
    gaussian_phong_transfer,
    matched_phong_transfer,
    phong_transfer,
    phong_transfer_by_gamma,
    power_transfer,
)
from jaxrender.spectra.ringing import lobe_ringing, windowed_spectrum
from jaxrender.spectra.spectrum import spectrum_of

__all__ = [
    "CentralSpectrum",
    "CentralTable",
    "FACET_DISTRIBUTIONS",
    "FacetLobe",
    "HemisphereRule",
    "Orders",
    "PHONG_TRANSFERS",
    "TEXELS_PER_DEGREE",
    "TRANSFERS",
    "anisotropic_coefficients",
    "anisotropic_outgoing_coefficients",
    "axial_coefficients",
    "azimuthal_transfer",
    "azimuthal_transfer_of_samples",
    "central_spectrum",
    "central_spectrum_of",
    "clear_coefficients",
    "clipped_mirror_coefficients",
    "crossover_exponent",
    "directional_coefficients",
    "exit_cosine_transfer",
    "extent_of",
    "facet_azimuthal_transfer",
    "facet_transfer",
    "gaussian_phong_transfer",
    "gaussian_transfer",
    "isotropic_coefficients",
    "lambertian_transfer",
    "light_coefficients",
    "lobe_ringing",
    "matched_gaussian_transfer",
    "matched_phong_transfer",
    "mean_transfer",
    "mirror_coefficients",
    "mirror_transfer",
    "missing_energy",
    "missing_light",
    "normal_exitance_transfer",
    "outgoing_coefficients",
    "overcast_coefficients",
    "phong_order",
    "phong_transfer",
    "phong_transfer_by_gamma",
    "phong_width",
    "power_transfer",
    "required_orders",
    "residual_bound",
    "series_transfer",
    "spectrum_of",
    "squared_half_angle",
    "sum_lobes",
    "tabulated_spectrum",
    "head_on_transfer",
    "transfer_at",
    "transfer_of_samples",
    "transfer_table",
    "uniform_coefficients",
    "windowed_spectrum",
    "zonal_coefficients",
]
