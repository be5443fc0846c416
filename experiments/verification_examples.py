"""The verification examples of T 3.2.1 to 3.2.7, each measured beside a reference value."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Lambertian, Microfacet
from jaxrender.geometry import Components, rotation
from jaxrender.harmonics import complex_from_real, evaluate, flat_index, real_basis
from jaxrender.lighting import DirectionalSources, OvercastSky
from jaxrender.reflection.convolution import (
    SurfacePoints,
    convolve_isotropic,
    convolve_radial,
    evaluate_isotropic,
)
from jaxrender.spectra import (
    HemisphereRule,
    axial_coefficients,
    clipped_mirror_coefficients,
    directional_coefficients,
    gaussian_phong_transfer,
    isotropic_coefficients,
    lambertian_transfer,
    light_coefficients,
    matched_gaussian_transfer,
    mirror_coefficients,
    normal_exitance_transfer,
    outgoing_coefficients,
    phong_transfer,
    uniform_coefficients,
)

THESIS, SECOND = "thesis", "second path"
POLE = np.array([0.0, 0.0, 1.0])
SMOOTH = Microfacet(np.zeros(1), np.ones(1), 0.5, None, "half", "smith")


class Line(NamedTuple):
    """One claim: the section, what it says, the reference, its source, the measured value."""

    section: str
    claim: str
    reference: float
    source: str
    measured: float
    allowed: float
    printed: float | None = None

    @property
    def difference(self) -> float:
        """How far apart the two are."""
        return abs(self.reference - self.measured)

    @property
    def holds(self) -> bool:
        """Whether they agree as well as the digits of the reference, or rounding, allow."""
        return self.difference <= self.allowed


def wavelength(degree: int) -> float:
    return float(np.sqrt(4 * np.pi / (2 * degree + 1)))


def directional() -> list[Line]:
    """T 3.2.1: a source at the pole, whose reflection is the BRDF's coefficients."""
    found = np.asarray(directional_coefficients(POLE, np.ones(1), 8))[:, 0]
    rho = isotropic_coefficients(SMOOTH, (8, 8), HemisphereRule(24, 48))[1][..., None]
    light = complex_from_real(found[:, None])
    field = np.asarray(convolve_isotropic(light, rho))[..., 0]
    most = rho.shape[2] - 1
    alpha, outgoing = 0.6, np.array([[0.48, -0.6, 0.64]])
    points = SurfacePoints(np.array([alpha]), np.array([0.3]), np.zeros(1), outgoing)
    angular = series(np.asarray(rho)[..., 0], incoming_of(alpha), outgoing)
    reflected = float(jnp.real(evaluate_isotropic(field[..., None], points))[0, 0])
    return [
        Line("3.2.1", "3.14  L_50 = 1 / Lambda_5", 1 / wavelength(5), THESIS, found[30], 1e-12),
        Line("3.2.1", "3.14  L_53 = 0", 0.0, THESIS, found[flat_index(5, 3)], 1e-12),
        Line(
            "3.2.1",
            "3.14  B_{4,0,3,2} = rho_{4,3,2}",
            float(rho[4, 3, 2, 0]),
            SECOND,
            float(field[4, 8, 3, most + 2].real),
            1e-12,
        ),
        Line("3.2.1", "3.15  B = rho^(alpha, pi, o), degree 8", angular, SECOND, reflected, 1e-10),
    ]


def incoming_of(alpha: float) -> np.ndarray:
    """The source at the pole from a normal at polar angle alpha: (alpha, pi)."""
    return np.array([[-np.sin(alpha), 0, np.cos(alpha)]])


def series(rho: np.ndarray, incoming: np.ndarray, outgoing: np.ndarray) -> float:
    """T 2.53, real since rho_lpq = rho_lp-q: sums of real harmonics of both signs."""
    limits = rho.shape[0] - 1, rho.shape[1] - 1
    first, second = (np.asarray(real_basis(d, n))[0] for d, n in zip((incoming, outgoing), limits))
    total = 0.0
    for (n, p, q), value in np.ndenumerate(rho):
        if q <= min(n, p):
            orders = {q, -q}
            total += value * sum(first[n * (n + 1) + m] * second[p * (p + 1) + m] for m in orders)
    return total


def axial_and_uniform() -> list[Line]:
    """T 3.2.2, 3.2.3: skies and uniform light."""
    sky = light_coefficients(OvercastSky(np.ones(1)), 6)
    numeric = axial_coefficients(
        lambda x: np.where(x > 0, (1 + 2 * x) / 3, 0), POLE, 6, [np.pi / 2]
    )
    level = uniform_coefficients(np.full(1, 1 / (4 * np.pi)), 2)
    rule = HemisphereRule(64, 128)
    at_exit = outgoing_coefficients(SMOOTH, np.array([0.6]), 0, rule)[1, 0, 0, 0]
    outgoing = np.broadcast_to([0.8, 0, 0.6], rule.directions().shape)
    transfer = SMOOTH.transfer(Components.of(rule.directions()), Components.of(outgoing))[1]
    albedo = float(np.asarray(transfer) @ rule.weights())
    constant = lambertian_transfer(0)[0] * float(evaluate(level, POLE[None])[0, 0])
    return [
        Line(
            "3.2.2",
            "3.18  overcast sky, L_30",
            float(sky[12, 0]),
            SECOND,
            float(numeric[12, 0]),
            1e-10,
        ),
        Line(
            "3.2.2",
            "3.18  overcast sky, largest m != 0",
            0.0,
            THESIS,
            float(np.abs(np.delete(np.asarray(sky)[:, 0], [0, 2, 6, 12, 20, 30, 42])).max()),
            1e-12,
        ),
        Line(
            "3.2.3",
            "3.19  L_00 = 1 / Lambda_0",
            1 / wavelength(0),
            THESIS,
            float(level[0, 0]),
            1e-12,
        ),
        Line(
            "3.2.3",
            "3.21  rho_00(t_o), t_o = 53 deg",
            float(np.sqrt(2 * np.pi)) / wavelength(0) * albedo,
            "ERRATA 14",
            float(at_exit),
            1e-10,
            float(np.sqrt(2 * np.pi)) * albedo,
        ),
        Line(
            "3.2.3",
            "3.22  B of a diffuse surface",
            0.25,
            "ERRATA 15",
            constant,
            1e-12,
            np.pi / wavelength(0),
        ),
    ]


def mirror() -> list[Line]:
    """T 3.2.4: the mirror."""
    rho, clipped = mirror_coefficients(6), clipped_mirror_coefficients(6)
    rng = np.random.default_rng(0)
    light = rng.normal(size=(49, 1))
    field = convolve_isotropic(complex_from_real(light), rho[..., None])
    outgoing = np.array([[0.48, 0.36, 0.8]])
    points = SurfacePoints(np.array([0.7]), np.array([1.1]), np.zeros(1), outgoing)
    reflected = float(jnp.real(evaluate_isotropic(field, points))[0, 0])
    frame = np.asarray(rotation(points.alpha, points.beta, points.gamma))[0]
    seen = frame @ (outgoing[0] * [-1, -1, 1])
    looked_up = float(evaluate(light, seen[None])[0, 0])
    return [
        Line("3.2.4", "3.25  B(o) = L(mirrored o)", looked_up, SECOND, reflected, 1e-10),
        Line(
            "3.2.4",
            "3.23  rho_220, half sphere",
            0.5,
            "ERRATA 16",
            float(clipped[2, 2, 0]),
            1e-10,
            1.0,
        ),
        Line(
            "3.2.4",
            "3.23  rho_120, half sphere",
            0.242,
            "ERRATA 16",
            float(clipped[1, 2, 0]),
            5e-4,
            0.0,
        ),
    ]


def lambertian() -> list[Line]:
    """T 3.2.5: the clamped cosine."""
    transfer = lambertian_transfer(6)
    published = (3.142, 2.094, 0.785, 0.0, -0.131, 0.0, 0.049)
    lines = [
        Line(
            "3.2.5",
            f"3.33  Lambda_{degree} rho_{degree}",
            value,
            THESIS,
            float(transfer[degree]),
            5e-4,
        )
        for degree, value in enumerate(published)
    ]
    source = DirectionalSources(np.array([[0.6, 0, 0.8]]), np.ones((1, 1)))
    normal = np.array([[0.0, 0.6, 0.8]])
    reflected = convolve_radial(light_coefficients(source, 64), lambertian_transfer(64))
    rho = isotropic_coefficients(Lambertian(np.ones(1)), (2, 0))[0, 2, 0, 0]
    expected = transfer[2] / wavelength(2) * 2 * np.pi / wavelength(0)
    lines.append(
        Line(
            "3.2.5",
            "3.28  E = N.S by degree 64",
            0.64,
            SECOND,
            float(evaluate(reflected, normal)[0, 0]),
            2e-3,
        )
    )
    lines.append(Line("3.2.5", "rho_200 about the normal", expected, SECOND, float(rho), 1e-10))
    return lines


def phong() -> list[Line]:
    """T 3.2.6: Phong's lobe."""
    x, w = np.polynomial.legendre.leggauss(64)
    u = (x + 1) / 2
    degree4 = np.polynomial.legendre.legval(u, [0, 0, 0, 0, 1])
    integral = float(33 * np.sum(w / 2 * u**32 * degree4))
    exact = np.asarray(phong_transfer(32.0, 40))
    product = 32 * 30 / (37 * 35)
    worst = float(np.abs(np.asarray(gaussian_phong_transfer(32.0, 40)) - exact).max())
    small, large = (float(phong_transfer(s, 2)[2]) for s in (8.0, 128.0))
    return [
        Line("3.2.6", "3.36  A_4, s = 32, by quadrature", product, THESIS, integral, 1e-12),
        Line("3.2.6", "3.37  A_4, s = 32, products", product, THESIS, float(exact[4]), 1e-14),
        Line("3.2.6", "3.40  worst error, s = 32", 0.039, "ERRATA 22", worst, 5e-4),
        Line("3.2.6", "A_2 of s = 8 (then of s = 128)", 8 / 11, THESIS, small, 1e-12),
        Line("3.2.6", "A_2 of s = 128: the wider spectrum", 128 / 131, THESIS, large, 1e-12),
    ]


def microfacet() -> list[Line]:
    """T 3.2.7: the microfacet lobe at normal exitance."""
    lines = []
    for sigma, gaussian, energy, matched in (
        (0.1, 0.044, 0.993, 0.0012),
        (0.2, 0.091, 0.974, 0.0048),
        (0.3, 0.139, 0.941, 0.011),
        (0.5, 0.231, 0.805, 0.060),
    ):
        model = Microfacet(np.zeros(1), np.ones(1), sigma, None)
        exact = np.asarray(normal_exitance_transfer(model, jnp.ones(1), 64)[0])
        degree = np.arange(65)
        off = float(np.abs(np.exp(-((sigma * degree) ** 2)) - exact).max())
        better = float(np.abs(np.asarray(matched_gaussian_transfer(sigma, 64)) - exact).max())
        lines += [
            Line(
                "3.2.7",
                f"3.44  A_0, sigma {sigma}",
                energy,
                "ERRATA 27",
                float(exact[0]),
                6e-4,
                1.0,
            ),
            Line("3.2.7", f"3.51  worst error, sigma {sigma}", gaussian, "ERRATA 27", off, 6e-4),
            Line(
                "3.2.7",
                f"      of A_0 exp(-s^2 l(l+1)), {sigma}",
                matched,
                "ERRATA 27",
                better,
                6e-4,
            ),
        ]
    return lines
