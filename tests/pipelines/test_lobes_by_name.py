"""Lobes named on a command line.

- A specification becomes the spectrum of that model, amplitude one, Lambert's base left out.
- The significant degree is the last before a quiet stretch: Lambert's gaps do not end it, what
  quadrature leaves far out does not prolong it, and a mirror has all degrees.
"""

import numpy as np
import pytest

from jaxrender.brdf import TorranceSparrow
from jaxrender.errors import InputError
from jaxrender.pipelines.lobes import lobe_of, significant_degree
from jaxrender.spectra import lambertian_transfer, phong_transfer, spectrum_of


def test_specifications_are_models_at_amplitude_one():
    phong = lobe_of("phong:exponent=8")
    np.testing.assert_allclose(phong.transfer(6), phong_transfer(np.asarray(8.0), 6))
    assert phong.about == "reflected direction"
    np.testing.assert_allclose(lobe_of("lambertian").transfer(4), lambertian_transfer(4))
    ggx = lobe_of("torrance-sparrow:roughness=0.3,distribution=ggx")
    model = TorranceSparrow(np.zeros(1), np.ones(1), 0.3, distribution="ggx")
    np.testing.assert_allclose(ggx.transfer(5), np.asarray(spectrum_of(model, 5))[1])
    assert ggx.file_name == "torrance-sparrow_roughness_0.3_distribution_ggx"
    np.testing.assert_allclose(lobe_of("mirror").transfer(3), 1)
    named = lobe_of("ggx:sigma=0.3,mu=1.5")
    assert named.file_name == "ggx_sigma_0.3_mu_1.5"
    spelled = "microfacet:sigma=0.3,mu=1.5,distribution=ggx,masking=smith,fresnel=half"
    np.testing.assert_array_equal(named.transfer(5), lobe_of(spelled).transfer(5))


def test_significant_degrees():
    # A_26 / A_0 = 1.02e-3 is the last above a thousandth; all odd degrees from 3 vanish.
    lambert = lambertian_transfer(80)
    above = np.flatnonzero(np.abs(lambert) > 1e-3 * lambert[0])
    assert significant_degree(lambert) == above[-1] > 9
    lobe = np.exp(-0.1 * np.arange(120.0) ** 2)
    lobe[100] = 0.02
    assert significant_degree(lobe) == 8
    assert significant_degree(np.ones(12)) == 11


def test_what_has_no_spectrum_is_refused():
    with pytest.raises(InputError, match="an anisotropic lobe has no spectrum"):
        lobe_of("kajiya-kay:exponent=5")
    with pytest.raises(InputError, match="a mirror has no parameters"):
        lobe_of("mirror:sigma=0.1")
