"""What each model is, against its published formula, its limits or an independent computation.

Pinned down: Phong's lobe is T 3.34 with unit energy on the sphere, clipped or not; Blinn-Phong's
albedo is ks head-on; a small roughness makes a mirror of Fresnel's reflectance; the distribution's
factor is 1 / 4 (ERRATA 54); Ward's normalisations in closed form; Lafortune's C = (-1, -1, 1) is
the cosine to the mirror direction; Kajiya and Kay's peak lies on the mirror cone; Oren-Nayar at
sigma = 0 is Lambert, and its formulas written with angles; cylinders by tracing a sampled profile,
and flat ones are their material; He-Torrance's series in mpmath, its rough limit Beckmann's and its
energy head-on shared with the mirror part; mixtures add.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from brdf_problems import GOLD, KD, KS, direction, upper_directions

from jaxrender.brdf import (
    BRDF,
    BlinnPhong,
    CookTorrance,
    HeTorrance,
    KajiyaKay,
    Lafortune,
    Lambertian,
    Mixture,
    OrenNayar,
    Phong,
    PoulinFournier,
    TorranceSparrow,
    Ward,
    conductor_fresnel,
    directional_albedo,
    fresnel,
)
from jaxrender.brdf.he_torrance import diffraction_series, product_logarithm
from jaxrender.geometry import Components

ROUNDING = 1e-11
QUADRATURE = 1e-4
WHITE, BLACK = np.ones(1), np.zeros(1)
A, B = upper_directions(100, 0), upper_directions(100, 1)
HALF = (A + B) / np.linalg.norm(A + B, axis=1, keepdims=True)
BETWEEN = np.sum(A * HALF, axis=1)
evaluate = eqx.filter_jit(BRDF.evaluate)


def mirrored(directions):
    return directions * [-1, -1, 1]


def specular(brdf, a=A, b=B):
    return np.asarray(evaluate(brdf, a, b))[:, 0]


def test_phong_is_the_thesis_transfer_function():
    mirror = np.maximum(np.sum(mirrored(A) * B, axis=1), 0)
    expected = KS * ((12.5 + 1) / (2 * np.pi) * mirror**12.5)[:, None] + KD * A[:, 2:]
    found = np.asarray(evaluate(Phong(KD, KS, 12.5), A, B)) * A[:, 2:]
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)


@pytest.mark.parametrize(("clipped", "energy"), [(False, 1.0), (True, 0.5)])
def test_phongs_lobe_has_unit_energy_over_the_sphere(clipped, energy):
    """At grazing exit half of the lobe lies below the horizon."""
    x, w = np.polynomial.legendre.leggauss(64)
    azimuth = (np.arange(128) + 0.5) * np.pi / 64
    sphere = direction(x[:, None], azimuth[None, :])
    outgoing = direction(1e-6, 0.0)
    transfer = Phong(BLACK, WHITE, 8.0, clipped).transfer(
        Components.of(sphere), Components.of(outgoing)
    )[1]
    assert np.sum(w @ np.asarray(transfer)) * np.pi / 64 == pytest.approx(energy, abs=2e-3)


@pytest.mark.parametrize("exponent", [0.0, 1.0, 7.3, 400.0])
def test_blinn_phong_returns_ks_head_on(exponent):
    albedo = directional_albedo(BlinnPhong(BLACK, WHITE, exponent), [1.0])
    assert albedo[0, 0] == pytest.approx(1, abs=QUADRATURE)


@pytest.mark.parametrize("distribution", ["gaussian", "beckmann", "ggx"])
@pytest.mark.parametrize("cosine", [1.0, 0.5])
def test_a_small_roughness_is_a_mirror(distribution, cosine):
    brdf = TorranceSparrow(BLACK, WHITE, 0.02, 1.5, distribution=distribution, masking="smith")
    expected = float(fresnel(1.5, np.full(1, cosine))[0])
    assert directional_albedo(brdf, [cosine])[0, 0] == pytest.approx(expected, rel=0.01)
    metal = CookTorrance(
        np.zeros(2), np.ones(2), 0.02, *GOLD, distribution=distribution, masking="smith"
    )
    expected = [
        float(conductor_fresnel(*n, np.full(1, cosine))[0]) for n in zip(*GOLD, strict=True)
    ]
    np.testing.assert_allclose(directional_albedo(metal, [cosine])[0], expected, rtol=0.01)


def test_torrance_sparrow_has_the_factor_of_a_unit_projected_area():
    brdf = TorranceSparrow(KD, KS, 0.4, 1.5, None, "ggx", "none")
    c = HALF[:, 2]
    density = 0.16 / (np.pi * (c**2 * (0.16 - 1) + 1) ** 2)
    lobe = density * np.asarray(fresnel(1.5, BETWEEN)) / (4 * A[:, 2] * B[:, 2])
    np.testing.assert_allclose(evaluate(brdf, A, B), KD + KS * lobe[:, None], rtol=ROUNDING)


def test_ward_by_its_three_normalisations():
    ax, ay = 0.3, 0.6
    exponent = (HALF[:, 0] / ax) ** 2 + (HALF[:, 1] / ay) ** 2
    gaussian = np.exp(-exponent / HALF[:, 2] ** 2) / (4 * np.pi * ax * ay)
    cosines, full = A[:, 2] * B[:, 2], A + B
    expected = {
        "ward": gaussian / np.sqrt(cosines),
        "duer": gaussian / cosines,
        # As printed, with the half vector's full length.
        "bounded": gaussian * 4 * np.sum(full**2, axis=1) / full[:, 2] ** 4,
    }
    for name, value in expected.items():
        found = specular(Ward(BLACK, WHITE, ax, ay, name))
        np.testing.assert_allclose(found, value, rtol=ROUNDING, atol=1e-200)


def test_equal_widths_are_isotropic():
    for one, both in (
        (Ward(BLACK, WHITE, 0.3), Ward(BLACK, WHITE, 0.3, 0.3)),
        (
            TorranceSparrow(BLACK, WHITE, 0.3, distribution="ggx"),
            TorranceSparrow(BLACK, WHITE, 0.3, None, 0.3, "ggx"),
        ),
    ):
        assert both.isotropic
        np.testing.assert_array_equal(specular(one), specular(both))


def test_lafortune_is_phong_and_retroreflection():
    for signs, target in (([-1, -1, 1], mirrored(B)), ([1, 1, 1], B)):
        brdf = Lafortune(KD, KS[None, :], np.array([signs], float), np.full(1, 9.5))
        lobe = np.maximum(np.sum(A * target, axis=1), 0) ** 9.5
        np.testing.assert_allclose(
            evaluate(brdf, A, B), KD + KS * lobe[:, None], rtol=ROUNDING, atol=1e-15
        )


def test_lafortunes_bound_on_energy_is_reached_head_on():
    """One mirror lobe: 2 pi / (n + 2) from the normal, what the promise compares with 1."""
    one = np.array([[-1.0, -1.0, 1.0]]), np.full(1, 20.0)
    ks = np.full((1, 1), 22 / (2 * np.pi))
    assert directional_albedo(Lafortune(BLACK, ks, *one), [1.0])[0, 0] == pytest.approx(1, abs=1e-6)
    assert Lafortune(BLACK, 0.999 * ks, *one).conserves_energy
    assert not Lafortune(BLACK, 1.001 * ks, *one).conserves_energy


def test_kajiya_kays_lobe_is_the_cone_of_a_thin_cylinder():
    """A direction and any other with the opposite component along the fibre: the peak."""
    on_cone = np.stack(
        [-A[:, 0], *(np.sqrt(1 - A[:, 0] ** 2) * s for s in (np.sin(0.5), np.cos(0.5)))], axis=-1
    )
    lobe = KajiyaKay(BLACK, WHITE, 40.0).transfer(Components.of(A), Components.of(on_cone))[1]
    np.testing.assert_allclose(lobe, 1, rtol=1e-9)
    angles = [np.arccos(d[:, 0]) for d in (A, B)]
    expected = np.maximum(-np.cos(angles[0] + angles[1]), 0) ** 3.5
    diffuse, lobe = KajiyaKay(WHITE, WHITE, 3.5).transfer(Components.of(A), Components.of(B))
    np.testing.assert_allclose(lobe, expected, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(diffuse, np.sin(angles[0]), rtol=ROUNDING)


@pytest.mark.parametrize("qualitative", [False, True])
def test_oren_nayar_without_roughness_is_lambert(qualitative):
    brdf = OrenNayar(KD, 0.0, qualitative)
    np.testing.assert_allclose(evaluate(brdf, A, B), evaluate(Lambertian(KD), A, B), rtol=ROUNDING)


def test_oren_nayar_by_angles():
    sigma, albedo = 0.5, 0.7
    t = np.arccos([A[:, 2], B[:, 2]])
    alpha, beta = t.max(axis=0), t.min(axis=0)
    cosine = np.cos(np.arctan2(A[:, 1], A[:, 0]) - np.arctan2(B[:, 1], B[:, 0]))
    s2 = sigma**2
    c2 = (
        0.45
        * s2
        / (s2 + 0.09)
        * np.where(cosine >= 0, np.sin(alpha), np.sin(alpha) - (2 * beta / np.pi) ** 3)
    )
    c3 = 0.125 * s2 / (s2 + 0.09) * (4 * alpha * beta / np.pi**2) ** 2
    once = 1 - 0.5 * s2 / (s2 + 0.33) + cosine * c2 * np.tan(beta)
    once += (1 - np.abs(cosine)) * c3 * np.tan((alpha + beta) / 2)
    twice = 0.17 * s2 / (s2 + 0.13) * (1 - cosine * (2 * beta / np.pi) ** 2)
    expected = (albedo * once + albedo**2 * twice) / np.pi
    kd = np.full(1, albedo / np.pi)
    np.testing.assert_allclose(specular(OrenNayar(kd, sigma)), expected, rtol=1e-9)
    short = 1 - 0.5 * s2 / (s2 + 0.33)
    short += 0.45 * s2 / (s2 + 0.09) * np.maximum(cosine, 0) * np.sin(alpha) * np.tan(beta)
    found = specular(OrenNayar(kd, sigma, qualitative=True))
    np.testing.assert_allclose(found, albedo * short / np.pi, rtol=1e-9)


def traced_cylinders(a, b, spacing, height, exponent, count=600):
    """Diffuse and specular sums over a sampled profile, each sample shaded by every other."""
    y = (np.arange(count) + 0.5) / count * spacing - spacing / 2
    floor, width = 1 - height, np.sqrt(height * (2 - height))
    on_arc = np.abs(y) < width
    z = np.where(on_arc, np.sqrt(np.maximum(1 - y**2, 0)), floor)
    normal = np.stack([0 * y, np.where(on_arc, y, 0), np.where(on_arc, z, 1)], axis=-1)
    # A step of y is 1 / n_z of length, which the foreshortening takes up again.
    length = spacing / count / normal[:, 2]
    copies = np.arange(-4, 5) * spacing
    other_y, other_z = (y[None, :] + copies[:, None]).ravel(), np.tile(z, copies.size)

    def is_open(d):
        gap = (other_y[None, :] - y[:, None]) * np.sign(d[1])
        rise = (other_z[None, :] - z[:, None]) * abs(d[1]) - gap * d[2]
        return ~np.any((gap > 2 * spacing / count) & (rise > 1e-4), axis=1)

    used = is_open(a) & is_open(b) & (normal @ a > 0) & (normal @ b > 0)
    half = (a + b) / np.linalg.norm(a + b)
    diffuse = np.where(used, length * (normal @ a) * (normal @ b), 0)
    scale = (exponent + 2) * (exponent + 4) / (8 * np.pi * (2 ** (-exponent / 2) + exponent))
    lobe = scale * np.maximum(normal @ half, 0) ** exponent
    return np.array([diffuse.sum(), (diffuse * lobe).sum()]) / (spacing * a[2] * b[2])


@pytest.mark.parametrize(("spacing", "height"), [(2.0, 1.0), (3.5, 1.0), (2.6, 0.4)])
def test_cylinders_by_tracing_their_profile(spacing, height):
    pairs = upper_directions(10, 7, 0.2).reshape(5, 2, 3)
    brdf = PoulinFournier(np.array([1.0, 0]), np.array([0, 1.0]), 15.0, spacing, height)
    found = evaluate(brdf, pairs[:, 0], pairs[:, 1])
    expected = [traced_cylinders(a, b, spacing, height, 15.0) for a, b in pairs]
    # Samples of the profile at the edge of a shadow count wholly or not at all.
    np.testing.assert_allclose(found, expected, rtol=0.02, atol=3e-3)


def test_flat_cylinders_are_their_material():
    flat = PoulinFournier(KD, KS, 12.0, 2.5, 1e-9)
    np.testing.assert_allclose(
        evaluate(flat, A, B), evaluate(BlinnPhong(KD, KS, 12.0), A, B), rtol=1e-3
    )


@pytest.mark.parametrize("g", [1e-3, 0.5, 7.0, 27.9, 28.6, 300.0])
@pytest.mark.parametrize("steepness", [0.0, 1.0])
def test_diffraction_series(g, steepness):
    q = steepness * g
    terms = mpmath.nsum(
        lambda m: mpmath.exp(-g - q / m) * mpmath.mpf(g) ** m / mpmath.factorial(m) / m,
        [1, int(g + 15 * np.sqrt(g) + 20)],
    )
    peak = max(float(terms), 1 / max(g, 1) * g / (1 + g))
    found = float(diffraction_series(jnp.full(1, g), jnp.full(1, q))[0])
    assert found == pytest.approx(float(terms), abs=1e-7 * peak)


@pytest.mark.parametrize("g", [0.5, 63.0, 100.0])
def test_the_series_ends_in_nothing_far_from_the_mirror_direction(g):
    """In single precision the powers of an expansion would overflow there."""
    at, far = jnp.float32(g), jnp.float32(1e7)
    assert float(diffraction_series(at, far)) == 0
    slopes = jax.grad(lambda a, q: diffraction_series(a, q), (0, 1))(at, far)
    np.testing.assert_array_equal(slopes, np.zeros(2))


def test_product_logarithm_is_the_inverse_of_u_exp_u():
    u = np.array([0, 1e-9, 1e-3, 0.5, 3.0, 24.0])
    np.testing.assert_allclose(product_logarithm(jnp.asarray(u * np.exp(u))), u, rtol=1e-12)


def test_rough_he_torrance_is_beckmanns():
    """Away from grazing, where the seen part of the surface is all of it."""
    up = np.abs(A[:, 2] * B[:, 2]) > 0.3
    a, b = A[up], B[up]
    rough = HeTorrance(BLACK, WHITE, 20.0, 200.0, np.full(1, 0.5), np.full(1, 1.5), BLACK)
    facets = TorranceSparrow(BLACK, WHITE, 0.2, 1.5, None, "beckmann", "smith")
    c = ((a + b) / np.linalg.norm(a + b, axis=1, keepdims=True))[:, 2]
    near = c > 0.95
    found, expected = (specular(brdf, a[near], b[near]) for brdf in (rough, facets))
    np.testing.assert_allclose(found, expected, rtol=5e-3)


@pytest.mark.parametrize("roughness", [0.005, 0.03, 0.1])
def test_he_torrance_shares_the_light_between_mirror_and_lobe(roughness):
    """Head-on, F = 1 and gentle slopes: exp(-g) is mirrored and 1 - exp(-g) scattered."""
    brdf = HeTorrance(
        BLACK, WHITE, roughness, 3.0, np.full(1, 0.5), np.full(1, 1.0), np.full(1, 1e5)
    )
    mirror = np.exp(-((4 * np.pi * roughness / 0.5) ** 2))
    assert brdf.specular_reflectance(np.ones(1))[0, 0] == pytest.approx(mirror, abs=1e-4)
    assert directional_albedo(brdf, [1.0])[0, 0] == pytest.approx(1 - mirror, abs=2e-3)


def test_mixtures_add():
    parts = BlinnPhong(KD, KS, 5.0), Ward(KS, KD, 0.3)
    weights = np.array([[0.2, 0.5], [0.7, 0.1]])
    expected = sum(
        w * np.asarray(evaluate(part, A, B)) for w, part in zip(weights, parts, strict=True)
    )
    np.testing.assert_allclose(evaluate(Mixture(parts, weights), A, B), expected, rtol=ROUNDING)
    assert not Mixture((BlinnPhong(KD, KS, 5.0), Phong(KD, KS, 5.0)), weights).reciprocal
    assert not Mixture((Lambertian(KD), Lambertian(KD)), 0.6 + 0 * weights).conserves_energy
