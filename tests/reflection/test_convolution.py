"""The convolution theorem in each of its forms, against sums over nodes in angle.

Random band-limited light and BRDF; each reflected radiance is also the sum over an exact grid of
light times BRDF in the rotated frame.  Pinned down besides: B_lmpq is the coefficient in
orthonormal functions, with Lambda_l (Parseval: ERRATA 37); a source at the pole gives the BRDF back
(T 3.14); a fixed exit of an anisotropic BRDF is the exact integral (T 2.44); the tangent frame
counts where the BRDF is anisotropic, and orders n below -l (ERRATA 6); the reciprocal form is the
other times cos t_o; a lobe about its own direction is one number a degree; the azimuthal terms
about R; compile time is not that of unrolled sums; refusals.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import AnisotropicWard, Microfacet
from jaxrender.geometry import Components, rotation
from jaxrender.harmonics import (
    LatLongGrid,
    coefficient_count,
    complex_basis,
    complex_from_real,
    degrees,
    evaluate,
    orders,
)
from jaxrender.lighting import HarmonicLight
from jaxrender.reflection.convolution import (
    SurfacePoints,
    convolve_anisotropic,
    convolve_at_direction,
    convolve_at_exit,
    convolve_isotropic,
    convolve_radial,
    evaluate_anisotropic,
    evaluate_at_direction,
    evaluate_at_exit,
    evaluate_isotropic,
    reflect_about_mirror,
)
from jaxrender.spectra import (
    FacetLobe,
    HemisphereRule,
    anisotropic_outgoing_coefficients,
    facet_azimuthal_transfer,
    isotropic_coefficients,
    lambertian_transfer,
    sum_lobes,
)

# Both sides are exact; this is rounding over some thousands of terms.
EXACT = 1e-10
INCOMING, OUTGOING, CHANNELS, POINTS = 4, 3, 2, 7
RNG = np.random.default_rng(0)
LIGHT = RNG.normal(size=(coefficient_count(INCOMING), CHANNELS))
GRID = LatLongGrid(2 * INCOMING + 2, 4 * INCOMING + 4)
NODES, WEIGHTS = GRID.directions().reshape(-1, 3), GRID.weights().ravel()


def unit_vectors(count, rng):
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def some_points():
    rng = np.random.default_rng(1)
    return SurfacePoints(
        rng.uniform(0, np.pi, POINTS),
        rng.uniform(0, 2 * np.pi, POINTS),
        rng.uniform(0, 2 * np.pi, POINTS),
        unit_vectors(POINTS, rng),
    )


def node_sum(kernel, points):
    """sum_k w_k L(R i_k) rho^(i_k, o): T 2.13 for ``kernel(incoming, outgoing) -> values``."""
    frames = np.asarray(rotation(points.alpha, points.beta, points.gamma))
    total = []
    for frame, outgoing in zip(frames, points.outgoing):
        light = np.asarray(evaluate(LIGHT, NODES @ frame.T))
        values = kernel(NODES, np.broadcast_to(outgoing, NODES.shape))
        total.append(np.einsum("k,kc,kc->c", WEIGHTS, light, values))
    return np.array(total)


def random_isotropic(channels=CHANNELS):
    """rho_lpq for q >= 0, real, zero beyond min(l, p)."""
    most = min(INCOMING, OUTGOING)
    rho = np.random.default_rng(2).normal(size=(INCOMING + 1, OUTGOING + 1, most + 1, channels))
    n, p, q = np.ogrid[: INCOMING + 1, : OUTGOING + 1, : most + 1]
    return rho * (q <= np.minimum(n, p))[..., None]


def equal_orders():
    """Every l, p, q of an isotropic transfer."""
    for n in range(INCOMING + 1):
        for p in range(OUTGOING + 1):
            for q in range(-min(n, p), min(n, p) + 1):
                yield n, p, q


def isotropic_kernel(rho):
    """T 2.53, term by term."""

    def kernel(incoming, outgoing):
        first = np.asarray(complex_basis(incoming, INCOMING))
        second = np.asarray(complex_basis(outgoing, OUTGOING))
        total = np.zeros((len(incoming), rho.shape[-1]), complex)
        for n, p, q in equal_orders():
            pair = first[:, n * (n + 1) + q].conj() * second[:, p * (p + 1) + q]
            total += pair[:, None] * rho[n, p, abs(q)]
        return total

    return kernel


def isotropic_points():
    points = some_points()
    return points._replace(gamma=np.zeros(POINTS))


def test_isotropic():
    rho, points = random_isotropic(), isotropic_points()
    field = convolve_isotropic(complex_from_real(LIGHT), rho)
    found = evaluate_isotropic(field, points)
    np.testing.assert_allclose(found, node_sum(isotropic_kernel(rho), points), atol=EXACT)


def test_a_colourless_transfer_serves_every_channel():
    rho, points = random_isotropic(1), isotropic_points()
    found = evaluate_isotropic(convolve_isotropic(complex_from_real(LIGHT), rho), points)
    repeated = np.repeat(rho, CHANNELS, axis=-1)
    np.testing.assert_allclose(found, node_sum(isotropic_kernel(repeated), points), atol=EXACT)


def test_the_coefficients_are_those_of_orthonormal_functions():
    """Parseval over (alpha, beta, o): sum |B_lmpq|^2, which L rho without Lambda_l is not."""
    rho, light = random_isotropic(1), complex_from_real(LIGHT[:, :1])
    field = convolve_isotropic(light, rho)
    x, w = np.polynomial.legendre.leggauss(INCOMING + 1)
    azimuth = np.arange(2 * INCOMING + 1) * 2 * np.pi / (2 * INCOMING + 1)
    outgoing_grid = LatLongGrid(2 * OUTGOING + 1, 2 * OUTGOING + 1)
    outgoing = outgoing_grid.directions().reshape(-1, 3)
    alpha, beta, exits = (
        index.ravel()
        for index in np.meshgrid(
            np.arange(len(x)), np.arange(len(azimuth)), np.arange(len(outgoing)), indexing="ij"
        )
    )
    points = SurfacePoints(
        np.arccos(x)[alpha], azimuth[beta], np.zeros(len(alpha)), outgoing[exits]
    )
    weights = w[alpha] * 2 * np.pi / len(azimuth) * outgoing_grid.weights().ravel()[exits]
    energy = weights @ np.abs(np.asarray(evaluate_isotropic(field, points))[:, 0]) ** 2
    assert energy == pytest.approx(float(np.sum(np.abs(np.asarray(field)) ** 2)), rel=EXACT)
    plain = np.asarray(field) / np.sqrt(4 * np.pi / (2 * np.arange(INCOMING + 1) + 1)).reshape(
        -1, 1, 1, 1, 1
    )
    assert abs(energy / np.sum(np.abs(plain) ** 2) - 1) > 0.5


def test_a_source_at_the_pole_gives_the_brdf_back():
    """B_l0pq = rho_lpq and nothing for m != 0 (T 3.14, 3.16 as corrected by ERRATA 12)."""
    source = complex_basis(np.array([[0, 0, 1.0]]), INCOMING).conj().T
    rho = random_isotropic(1)
    field = np.asarray(convolve_isotropic(source, rho))
    most = rho.shape[2] - 1
    np.testing.assert_allclose(field[:, INCOMING, :, most:], rho, atol=EXACT)
    assert np.abs(np.delete(field, INCOMING, axis=1)).max() < EXACT


def random_anisotropic():
    rng = np.random.default_rng(3)
    shape = (coefficient_count(INCOMING), coefficient_count(OUTGOING), CHANNELS)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def test_anisotropic_with_tangent_frames():
    rho, points = random_anisotropic(), some_points()

    def kernel(incoming, outgoing):
        first, second = complex_basis(incoming, INCOMING), complex_basis(outgoing, OUTGOING)
        return np.einsum("ka,abc,kb->kc", np.conj(first), rho, np.asarray(second))

    field = convolve_anisotropic(complex_from_real(LIGHT), rho)
    found = np.asarray(evaluate_anisotropic(field, points))
    np.testing.assert_allclose(found, node_sum(kernel, points), atol=EXACT)
    turned = points._replace(gamma=points.gamma + 0.5)
    assert np.abs(np.asarray(evaluate_anisotropic(field, turned)) - found).max() > 0.1


def test_anisotropic_at_a_fixed_exit():
    """T 2.44 of brushed metal is the integral over the hemisphere, of any tangent frame."""
    brdf = AnisotropicWard(np.array([0.1, 0.3]), np.array([0.5, 0.2]), 0.3, 0.6)
    exits, points = np.arange(POINTS) % 3, some_points()
    outgoing = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.48, -0.64, 0.6]])
    # A rule that is not the one of the coefficients.
    rule = HemisphereRule(45, 90)
    local, weights = rule.directions(), rule.weights()
    expected = []
    for frame, exit in zip(np.asarray(rotation(*points[:3])), exits):
        light = np.asarray(evaluate(LIGHT, local @ frame.T))
        values = np.asarray(brdf.evaluate(local, np.broadcast_to(outgoing[exit], local.shape)))
        expected.append((weights * local[:, 2]) @ (light * values))
    each = anisotropic_outgoing_coefficients(brdf, outgoing, INCOMING, HemisphereRule(64, 128))
    field = convolve_at_direction(complex_from_real(LIGHT), sum_lobes(each, brdf.amplitudes))
    found = np.asarray(evaluate_at_direction(field, exits, points))
    np.testing.assert_allclose(found, expected, atol=1e-6)
    turned = points._replace(gamma=points.gamma + 0.5)
    assert np.abs(np.asarray(evaluate_at_direction(field, exits, turned)) - found).max() > 0.05


def test_a_fixed_exit_is_a_slice_of_the_light_field():
    rho, points = random_anisotropic(), some_points()
    outgoing = np.asarray(complex_basis(points.outgoing, OUTGOING))
    field = convolve_at_direction(complex_from_real(LIGHT), np.einsum("xb,abc->xac", outgoing, rho))
    found = evaluate_at_direction(field, np.arange(POINTS), points)
    whole = convolve_anisotropic(complex_from_real(LIGHT), rho)
    np.testing.assert_allclose(found, evaluate_anisotropic(whole, points), atol=EXACT)


def test_every_order_below_zero_counts():
    """ERRATA 6: n = -l' ... l'; a transfer with n = -l' alone still reflects."""
    lowest = (orders(INCOMING) == -degrees(INCOMING))[:, None, None]
    rho, points = random_anisotropic() * lowest, some_points()
    found = evaluate_anisotropic(convolve_anisotropic(complex_from_real(LIGHT), rho), points)
    assert np.abs(np.asarray(found)).min() > 1e-3


def test_isotropic_is_anisotropic_with_equal_orders():
    rho, points = random_isotropic(), some_points()
    general = np.zeros(
        (coefficient_count(INCOMING), coefficient_count(OUTGOING), CHANNELS), complex
    )
    for n, p, q in equal_orders():
        general[n * (n + 1) + q, p * (p + 1) + q] = rho[n, p, abs(q)]
    light = complex_from_real(LIGHT)
    found = evaluate_anisotropic(convolve_anisotropic(light, general), points)
    # gamma is only the origin of the outgoing azimuth: the camera turns by it the other way.
    back = np.asarray(rotation(0 * points.gamma, points.gamma, 0 * points.gamma))
    seen = points._replace(outgoing=np.einsum("xij,xj->xi", back, points.outgoing))
    expected = evaluate_isotropic(convolve_isotropic(light, rho), seen)
    np.testing.assert_allclose(found, expected, atol=EXACT)


def test_fixed_exit_angle():
    """rho_lq(t_o) = sqrt(2 pi) sum_p rho_lpq |Y_pq(t_o)| is the same reflection (T 2.56, 2.57)."""
    rho, points = random_isotropic(), isotropic_points()
    most = rho.shape[2] - 1
    exit_angles = np.arccos(points.outgoing[:, 2])
    meridian = np.stack([np.sin(exit_angles), 0 * exit_angles, np.cos(exit_angles)], axis=1)
    basis = np.asarray(complex_basis(meridian, OUTGOING))
    p, q = np.ogrid[: OUTGOING + 1, : most + 1]
    around = basis[:, np.where(q <= p, p * (p + 1) + q, 0)] * (q <= p)
    transfer = np.sqrt(2 * np.pi) * np.einsum("lpqc,xpq->xlqc", rho, around)
    field = convolve_at_exit(complex_from_real(LIGHT), transfer)
    found = evaluate_at_exit(field, np.arange(POINTS), points)
    expected = evaluate_isotropic(convolve_isotropic(complex_from_real(LIGHT), rho), points)
    np.testing.assert_allclose(found, expected, atol=EXACT)


def test_reciprocal_form_is_the_other_times_the_exit_cosine():
    """T 2.58, 2.59, of a BRDF both of whose forms are band-limited enough to be summed."""
    brdf = Microfacet(np.ones(1), np.zeros(1), 0.5, None)
    rule = HemisphereRule(24, 48)
    light = complex_from_real(LIGHT)
    plain, reciprocal = (
        convolve_isotropic(
            light, isotropic_coefficients(brdf, (INCOMING, 12), rule, r)[0][..., None]
        )
        for r in (False, True)
    )
    points = isotropic_points()
    upper = points._replace(outgoing=np.array([[0.6, 0, 0.8]] * POINTS))
    b, b_cosine = (np.asarray(evaluate_isotropic(f, upper)) for f in (plain, reciprocal))
    # Degree 12 of a function that jumps at the horizon.
    assert np.abs(b_cosine - 0.8 * b).max() < 0.06 * np.abs(b).max()


def test_one_direction():
    """A Lambertian surface's irradiance is a sum over nodes of the band-limited clamped cosine."""
    transfer = lambertian_transfer(INCOMING)
    points = isotropic_points()
    normals = np.asarray(rotation(points.alpha, points.beta, points.gamma))[:, :, 2]
    found = evaluate(convolve_radial(LIGHT, transfer), normals)
    degree = np.arange(INCOMING + 1)

    def kernel(incoming, outgoing):
        series = (2 * degree + 1) / (4 * np.pi) * transfer
        return np.polynomial.legendre.legval(incoming[:, 2], series)[:, None].repeat(CHANNELS, 1)

    np.testing.assert_allclose(found, node_sum(kernel, points), atol=EXACT)


def test_about_the_reflected_direction():
    """T 3.43 with all its azimuthal terms, beside a sum over a fine grid in the world frame."""
    lobe = FacetLobe(jnp.asarray(0.4), None, "ggx", "smith")
    exit_angle = 0.9
    normal = np.array([0.48, -0.6, 0.64])
    tangent = np.cross([0, 0, 1.0], normal)
    tangent /= np.linalg.norm(tangent)
    camera = np.cos(exit_angle) * normal + np.sin(exit_angle) * tangent
    mirror = np.cos(exit_angle) * normal - np.sin(exit_angle) * tangent
    towards = normal - (normal @ mirror) * mirror
    towards /= np.linalg.norm(towards)
    frame = np.stack([towards, np.cross(mirror, towards), mirror], axis=1)
    terms = facet_azimuthal_transfer(lobe, np.array([np.cos(exit_angle)]), INCOMING, INCOMING)
    found = np.asarray(reflect_about_mirror(LIGHT, terms, frame[None]))[0]
    directions, irradiance = HarmonicLight(LIGHT, 128).nodes()
    local = np.stack([tangent, np.cross(normal, tangent), normal], axis=1)
    incoming = Components.of(directions @ local)
    outgoing = Components(*(jnp.full(incoming.z.shape, v) for v in camera @ local))
    values = np.where(np.asarray(incoming.z) > 0, np.asarray(lobe(incoming, outgoing)), 0)
    # The horizon's jump in the node sum at 128 rows.
    np.testing.assert_allclose(found, values @ np.asarray(irradiance), atol=1.5e-2)


def test_compiles_once_for_any_degree_quickly():
    """The graph does not grow with the degree: as many equations at degree 12 as at 4."""

    def equations(band_limit):
        light = jnp.zeros((coefficient_count(band_limit), 1), complex)
        rho = jnp.zeros((band_limit + 1, 4, 4, 1))
        points = some_points()

        def reflected(light, rho):
            return evaluate_isotropic(convolve_isotropic(light, rho), points)

        return str(jax.make_jaxpr(reflected)(light, rho)).count(" = ")

    assert equations(12) == equations(5)


def test_refusals():
    light = complex_from_real(LIGHT)
    with pytest.raises(ValueError, match="light to degree 4 and a transfer to degree 3"):
        convolve_isotropic(light, random_isotropic()[:4])
    with pytest.raises(ValueError, match="light to degree 4 and a transfer to degree 3"):
        convolve_anisotropic(light, random_anisotropic()[:16])
    with pytest.raises(ValueError, match="light to degree 4 and a transfer to degree 3"):
        convolve_at_direction(light, np.ones((1, 16, 1), complex))
    with pytest.raises(ValueError, match="terms of 3 degrees for light of 5"):
        reflect_about_mirror(LIGHT, np.ones((1, 3, 2)), np.eye(3)[None])
