"""Spectra about the reflected ray, and which of their orders suffice (T 5.3, 5.5).

- the simplified microfacet of T 5.34 needs exactly the orders that were found for it, Kajiya and
  Kay's fibres P = 8 of q = 0 alone;
- what is left out falls with either order, from below 1 down to 0;
- a spectrum's transfer comes to the azimuthal transfer of the lobe as P grows;
- the table's three sums and the quadrature about R agree on a lobe that is smooth at the horizon;
- the bound on the reflected light's error is never violated; as printed (ERRATA 36) it is;
- the closed forms for Phong's lobe against its spectrum and against quadrature.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import Lafortune, Microfacet, PoulinFournier
from jaxrender.geometry import Components
from jaxrender.harmonics import coefficient_count, degrees
from jaxrender.spectra import (
    CentralSpectrum,
    CentralTable,
    FacetLobe,
    Orders,
    central_spectrum,
    central_spectrum_of,
    crossover_exponent,
    facet_azimuthal_transfer,
    missing_energy,
    missing_light,
    phong_order,
    phong_transfer,
    phong_width,
    required_orders,
    residual_bound,
    tabulated_spectrum,
)

TOLERANCE = 0.03
MINIMA = {0.1: (23, 2), 0.2: (11, 2), 0.3: (7, 2), 0.4: (5, 2), 0.5: (4, 2)}
LIMITS = (30, 4)
# float64 sums over a few thousand nodes.
ROUNDING = 1e-12


def facets(sigma: float, limits: tuple[int, int] = LIMITS) -> CentralSpectrum:
    """T 5.34: the Gaussian lobe times cos t_o."""
    lobe = FacetLobe(jnp.asarray(sigma))
    return central_spectrum(lobe, limits, *lobe.extent, weighted=True)


def wavelengths(count: int) -> np.ndarray:
    return np.sqrt(4 * np.pi / (2 * np.arange(count) + 1))


def radial(transfer: np.ndarray, energy: float | None = None) -> CentralSpectrum:
    """A lobe about R that is the same for every viewer, its energy over one sphere given."""
    rho = transfer / wavelengths(len(transfer))
    energy = float(np.sum(rho**2)) if energy is None else energy
    coefficients = np.sqrt(4 * np.pi) * rho[:, None, None, None]
    return CentralSpectrum(coefficients, np.array([4 * np.pi * energy]))


def phong(exponent: float, band_limit: int) -> CentralSpectrum:
    transfer = np.asarray(phong_transfer(np.asarray(exponent), band_limit))
    energy = (exponent + 1) ** 2 / (2 * np.pi * (2 * exponent + 1))
    return radial(transfer, energy)


def beyond(light: np.ndarray, spectrum: CentralSpectrum) -> np.ndarray:
    """The part of the energy of B beyond each degree: of sum Lambda_l^2 rho_l^2 |L_lm|^2."""
    first = spectrum.band_limits[0]
    power = np.bincount(degrees(first), weights=np.sum(light**2, axis=1))
    rho = np.asarray(spectrum.coefficients)[:, 0, 0, 0]
    energy = (wavelengths(first + 1) * rho) ** 2 * power
    return 1 - energy.cumsum() / energy.sum()


def printed_bound(light: np.ndarray, energy: float, spectrum: CentralSpectrum) -> np.ndarray:
    """T 5.19 as printed: Lambda_{F+1} instead of its square."""
    right = residual_bound(light, energy, spectrum)
    odds = right / np.maximum(1 - right, 1e-300) / wavelengths(len(right) + 1)[1:]
    return odds / (1 + odds)


# ------------------------------------------------------------------------- orders that suffice


@pytest.mark.parametrize("sigma", MINIMA)
def test_the_microfacet_needs_the_orders_found_for_it(sigma):
    spectrum = facets(sigma)
    orders = required_orders(spectrum, TOLERANCE)
    assert (orders.light, orders.viewer) == MINIMA[sigma]
    missing = missing_energy(spectrum)
    assert missing[orders.light, orders.viewer] == orders.missing < TOLERANCE
    # One less of either does not do, even with all there are of the other.
    assert missing[orders.light - 1, orders.viewer] >= TOLERANCE
    assert missing[-1, orders.viewer - 1] >= TOLERANCE


def test_fibres_need_eight_orders_without_azimuth():
    angles = CentralTable.polar_angles(128)
    lobe = np.maximum(np.cos(angles[:, None] - angles[None, :]), 0) ** 32
    spectrum = tabulated_spectrum(CentralTable(lobe[:, :, None, None]), (30, 10))
    assert required_orders(spectrum, TOLERANCE).viewer == 8
    assert not np.any(np.asarray(spectrum.coefficients)[:, :, 1:])


def test_missing_energy_falls_with_either_order():
    missing = missing_energy(facets(0.2))
    assert np.all(missing < 1)
    assert np.all(missing > -ROUNDING)
    assert np.all(np.diff(missing, axis=0) <= ROUNDING)
    assert np.all(np.diff(missing, axis=1) <= ROUNDING)


def test_a_cut_keeps_the_energy_and_what_is_missing():
    spectrum = facets(0.3)
    cut = spectrum.cut((9, 2))
    assert cut.weighted
    assert cut.band_limits == (9, 2)
    np.testing.assert_allclose(missing_energy(cut), missing_energy(spectrum)[:10, :3], atol=1e-14)


def test_resolutions_are_ten_texels_a_degree():
    assert Orders(23, 2, 0.02).resolutions == (230, 20)
    assert Orders(0, 0, 0.02).resolutions == (1, 1)


# ------------------------------------------------------------------------- the spectra themselves


def test_the_transfer_comes_to_that_of_each_exit():
    lobe = FacetLobe(jnp.asarray(0.3))
    cosines = np.array([0.95, 0.8, 0.6])
    exact = np.asarray(facet_azimuthal_transfer(lobe, cosines, 12, 3)) * cosines[:, None, None]
    off, whole = [], facets(0.3, (12, 12))
    for order in (3, 6, 12):
        found = np.asarray(whole.cut((12, order)).transfer_at(cosines))[:, :, :4, 0]
        off.append(np.abs(found - exact).max())
    assert off[1] < 0.5 * off[0]
    assert off[2] < 0.5 * off[1]
    assert off[2] < 0.01


def test_the_energy_is_that_of_the_coefficients():
    # Parseval (T 5.17): all degrees together hold all there is; slowly, for the horizon's edge.
    missing = missing_energy(facets(0.5, (24, 24)))
    assert 0 < missing[24, 24] < 0.6 * missing[12, 12] < 4e-3


def test_table_and_quadrature_agree_where_the_horizon_is_smooth():
    def lobe(incoming: Components, outgoing: Components):
        mirror = incoming.z * outgoing.z - incoming.x * outgoing.x - incoming.y * outgoing.y
        return (incoming.z * outgoing.z) ** 4 * (1 + mirror) ** 2

    limits = (8, 5)
    quadrature = central_spectrum(lobe, limits, jnp.asarray(np.pi))
    light, viewer, azimuth = np.meshgrid(
        CentralTable.polar_angles(96),
        CentralTable.polar_angles(64),
        CentralTable.azimuths(64),
        indexing="ij",
    )
    # Seen from R = +Z with V at azimuth phi of the light; the normal half way.
    half = viewer / 2
    cos_i = np.sin(light) * np.cos(azimuth) * np.sin(half) + np.cos(light) * np.cos(half)
    values = (np.maximum(cos_i, 0) * np.cos(half)) ** 4 * (1 + np.cos(light)) ** 2
    table = tabulated_spectrum(CentralTable(values[..., None]), limits)
    scale = float(np.abs(np.asarray(quadrature.coefficients)).max())
    # The fourth power's last derivative jumps at the horizon, which the nodes of neither follow.
    np.testing.assert_allclose(table.coefficients, quadrature.coefficients, atol=1e-5 * scale)
    np.testing.assert_allclose(table.energy, quadrature.energy, rtol=1e-6)


def test_a_whole_brdf_is_its_lobe():
    lobe = FacetLobe(jnp.asarray(0.4))
    one, half = np.ones(1), np.full(2, 0.5)
    alone = central_spectrum(lobe, (6, 2), *lobe.extent, weighted=True)
    found = central_spectrum_of(Microfacet(0 * half, half * [1, 2], 0.4, None), (6, 2), True)
    expected = np.asarray(alone.coefficients) * np.array([0.5, 1.0])
    np.testing.assert_allclose(found.coefficients, expected, atol=2e-5)
    np.testing.assert_allclose(found.energy, np.asarray(alone.energy) * [0.25, 1.0], rtol=1e-4)
    assert alone.energy.shape == one.shape


def test_a_model_that_is_isotropic_by_its_values_has_a_spectrum():
    mirror = Lafortune(np.zeros(1), np.ones((1, 1)), np.array([[-1.0, -1.0, 1.0]]), np.full(1, 4.0))
    assert float(central_spectrum_of(mirror, (4, 1)).energy[0]) > 0


# ------------------------------------------------------------------------- the bound of T 5.19


@pytest.mark.parametrize("seed", range(20))
def test_the_bound_is_never_violated(seed):
    rng = np.random.default_rng(seed)
    first = int(rng.integers(3, 20))
    falling = (1.0 + degrees(first)) ** -rng.uniform(-0.5, 3)
    light = rng.normal(size=(coefficient_count(first), 3)) * falling[:, None]
    spectrum = phong(float(rng.uniform(0.5, 300)), first)
    bound = residual_bound(light, float(np.sum(light**2)), spectrum)
    # What the lobe holds beyond the light's degrees is missing from it, but from B nothing is.
    assert np.all(beyond(light, spectrum) <= bound + ROUNDING)


@pytest.mark.parametrize("order", range(5))
def test_the_bound_is_sharp_and_as_printed_violated(order):
    # The worst case: all that is missing of both lies in one degree.
    light = np.zeros((coefficient_count(order + 1), 1))
    light[[0, -1]] = 1
    transfer = np.zeros(order + 2)
    transfer[[0, -1]] = 1
    spectrum = radial(transfer)
    truth = beyond(light, spectrum)[order]
    assert residual_bound(light, 2.0, spectrum)[order] == pytest.approx(truth, rel=1e-12)
    assert printed_bound(light, 2.0, spectrum)[order] < truth * 0.97


def test_the_printed_bound_is_violated_at_degree_nought_by_a_phong_lobe():
    light = np.zeros((coefficient_count(1), 1))
    light[[0, 2]] = 1
    spectrum = radial(np.asarray(phong_transfer(np.asarray(8.0), 1)))
    truth = beyond(light, spectrum)[0]
    assert printed_bound(light, 2.0, spectrum)[0] < truth
    assert residual_bound(light, 2.0, spectrum)[0] >= truth * (1 - 1e-12)


def test_missing_light_is_what_the_degrees_beyond_hold():
    light = np.arange(1.0, 19.0).reshape(9, 2)
    missing = missing_light(light, 2 * float(np.sum(light**2)))
    assert missing[-1] == pytest.approx(0.5)
    assert missing[0] == pytest.approx(1 - 5 / (2 * np.sum(light**2)))


# ------------------------------------------------------------------------- Phong's closed forms


@pytest.mark.parametrize(("exponent", "degree"), [(32, 12), (64, 17)])
def test_phong_order_is_the_degree_that_suffices(exponent, degree):
    # ERRATA 40: 1 + sqrt(6 s) would be 15 and 21.
    assert required_orders(phong(float(exponent), 30), 0.01).light == degree
    assert abs(phong_order(float(exponent), 0.01) - degree) < 0.5


def test_phong_width_is_the_cap_that_holds_the_lobe():
    exponent, tolerance = 32.0, 0.05
    width = phong_width(exponent, tolerance)
    # The part W of the sphere is the cap down to the cosine 1 - 2 W.
    nodes, weights = np.polynomial.legendre.leggauss(64)
    cosines = 1 - width * (1 - nodes)
    held = np.sum(weights * width * (exponent + 1) * cosines**exponent)
    assert held == pytest.approx(1 - tolerance, rel=1e-12)
    assert width == pytest.approx(0.0434, abs=5e-5)


def test_sums_win_from_an_exponent_of_464_at_100_rows():
    # S^4 / 3 as printed would be 33 million (ERRATA 39).
    assert crossover_exponent(100) == pytest.approx(464, abs=0.5)


# ------------------------------------------------------------------------- refusals

CONSTANT = CentralSpectrum(np.ones((3, 2, 2, 1)), np.array([8.0]))


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: CONSTANT.cut((3, 1)), r"\(3, 1\) of a spectrum to \(2, 1\)"),
        (lambda: CONSTANT.cut((2, -1)), "from 0 up"),
        (lambda: required_orders(CONSTANT, 0.0), "between 0 and 1"),
        (lambda: required_orders(CONSTANT, 1.0), "between 0 and 1"),
        (lambda: required_orders(DARK, 0.5), "without energy"),
        (lambda: required_orders(LARGER, 0.1), "compute its spectrum to more"),
        (lambda: missing_light(np.ones((4, 1)), 0.0), "light without energy"),
        (lambda: missing_light(np.ones((5, 1)), 1.0), "5"),
        (lambda: phong_order(32.0, 1.5), "tolerance 1.5"),
        (lambda: phong_width(32.0, 0.0), "tolerance 0"),
        (lambda: facets(0.2, (-1, 0)), "-1"),
        (lambda: facets(0.2, (4, -2)), "-2"),
        (lambda: central_spectrum_of(FIBRES, (4, 2)), "PoulinFournier is anisotropic"),
        (lambda: tabulated_spectrum(COARSE, (6, 2)), r"\(6, 2\) of a BRDF table of 6 x 5 x 5"),
        (lambda: tabulated_spectrum(COARSE, (4, 5)), "p to 4"),
        (lambda: tabulated_spectrum(COARSE, (4, 3)), "q to 2"),
        (lambda: tabulated_spectrum(COARSE, (-1, 0)), "-1"),
    ],
)
def test_refusals_say_what_to_do(call, said):
    with pytest.raises(ValueError, match=said):
        call()


DARK = CentralSpectrum(np.zeros((3, 2, 2, 1)), np.zeros(1))
LARGER = CentralSpectrum(np.ones((3, 2, 2, 1)), np.array([1000.0]))
COARSE = CentralTable(np.ones((6, 5, 5, 1)))
FIBRES = PoulinFournier(np.zeros(1), np.ones(1), 8.0)
