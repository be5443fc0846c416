"""T 5.7.1: how many coefficients analytic BRDFs need about the reflected ray.

    python experiments/counts_5_7_1.py [--out F.png]

Smallest P, and for it the smallest F, that leave less than 3 % of the energy of rho^ out (T 5.18):
the simplified microfacet of T 5.34, the skin that Marschner et al. measured (Lafortune lobes, the
coefficients that pbrt-v1 gives for it, one lobe set a channel), Kajiya and Kay's fibres by their
tangent, and other models at typical parameters, weighted by cos t_o as T 5.34 is.  Draws what is
left out against P.
"""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from jaxrender.brdf import (
    BRDF,
    BlinnPhong,
    CookTorrance,
    Lafortune,
    Microfacet,
    OrenNayar,
    TorranceSparrow,
    Ward,
)
from jaxrender.geometry import Components
from jaxrender.spectra import (
    CentralSpectrum,
    CentralTable,
    FacetLobe,
    central_spectrum,
    central_spectrum_of,
    missing_energy,
    required_orders,
    tabulated_spectrum,
)

TOLERANCE = 0.03
LIMITS = (30, 10)
# Tangent of half the narrowest lobe that the quadrature is spread for.
NARROWEST = 0.05
# T table 5.5, and the smallest that suffice; P = 2 and eps < .03 for all in T 5.7.1.
SIGMAS = {
    0.1: ((24, 3), (23, 2)),
    0.2: ((12, 2), (11, 2)),
    0.3: ((7, 2), (7, 2)),
    0.4: ((5, 2), (5, 2)),
    0.5: ((5, 2), (4, 2)),
}
# Rows of light and viewer, azimuths.
LITERAL_NODES = (128, 96, 128)
SKIN_PUBLISHED, FIBRES_PUBLISHED, FIBRES_EXPONENT, FIBRES_ROWS = 4, 8, 32, 256
# Red, green, blue; the lobes' (C_xy, C_z, exponent).
SKIN_ALBEDO = (0.428425, 0.301341, 0.331054)
SKIN_LOBES = (
    (
        (-1.131747, -1.209182, 6.421658),
        (-1.016939, -1.462488, 3.699932),
        (-0.966018, -1.222419, 3.524889),
    ),
    (
        (-0.546570, 0.380123, 3.685044),
        (-0.643533, 0.410559, 4.266495),
        (-0.638934, 0.437367, 4.539742),
    ),
    (
        (-0.998888, 0.857998, 64.208486),
        (-1.020153, 0.703913, 63.919687),
        (-1.027479, 0.573625, 43.809866),
    ),
)
BLACK, WHITE, GREY = np.zeros(1), np.ones(1), np.full(1, 0.2)
GOLD = np.array([0.2]), np.array([3.0])
MODELS: dict[str, BRDF] = {
    "Blinn-Phong, s = 32": BlinnPhong(BLACK, WHITE, 32.0),
    "Blinn-Phong, s = 128": BlinnPhong(BLACK, WHITE, 128.0),
    "GGX + Smith, alpha = .2": Microfacet(BLACK, WHITE, 0.2, None, "half", "smith", "ggx"),
    "GGX + Smith, alpha = .4": Microfacet(BLACK, WHITE, 0.4, None, "half", "smith", "ggx"),
    "Ward, .2": Ward(BLACK, WHITE, 0.2),
    "Ward, bounded, .2": Ward(BLACK, WHITE, 0.2, None, "bounded"),
    "Cook-Torrance, gold, .2": CookTorrance(BLACK, WHITE, 0.2, *GOLD),
    "Torrance-Sparrow, 1.5, .2": TorranceSparrow(BLACK, WHITE, 0.2, 1.5),
    "Torrance-Sparrow, diffuse .2": TorranceSparrow(GREY, WHITE, 0.2, 1.5),
    "Oren-Nayar, sigma = .5": OrenNayar(GREY, 0.5),
}


def skin(channel: int) -> Lafortune:
    """The skin of one channel: exponents differ between channels."""
    lobes = np.array(SKIN_LOBES)[:, channel]
    coefficients = lobes[:, [0, 0, 1]]
    albedo = np.array(SKIN_ALBEDO[channel : channel + 1])
    return Lafortune(albedo / np.pi, np.ones((len(lobes), 1)), coefficients, lobes[:, 2])


def lobes_spectrum(
    brdf: BRDF, limits: tuple[int, int] = LIMITS, weighted: bool = True
) -> CentralSpectrum:
    """The spectrum of one channel, its lobes added up, also where isotropy depends on values."""
    amplitudes = np.asarray(brdf.amplitudes)[:, 0]

    def lobe(incoming: Components, outgoing: Components):
        everywhere = Components(*(jnp.broadcast_to(c, incoming.z.shape) for c in outgoing))
        return sum(a * value for a, value in zip(amplitudes, brdf.transfer(incoming, everywhere)))

    return central_spectrum(lobe, limits, jnp.asarray(np.pi), jnp.asarray(NARROWEST), weighted)


def skin_spectrum(limits: tuple[int, int] = LIMITS, weighted: bool = True) -> CentralSpectrum:
    """All channels of the skin together."""
    each = [lobes_spectrum(skin(channel), limits, weighted) for channel in range(3)]
    coefficients = np.concatenate([np.asarray(one.coefficients) for one in each], axis=-1)
    energy = np.concatenate([np.asarray(one.energy) for one in each])
    return CentralSpectrum(coefficients, energy, weighted)


def facets(sigma: float) -> CentralSpectrum:
    """T 5.34: the Gaussian lobe times cos t_o."""
    lobe = FacetLobe(sigma)
    return central_spectrum(lobe, LIMITS, *lobe.extent, weighted=True)


def facets_without_horizon(sigma: float) -> CentralSpectrum:
    """T 5.34 taken literally: it goes on below the horizon, where the light cannot be."""
    rows, exits, columns = LITERAL_NODES
    light, viewer = CentralTable.polar_angles(rows), CentralTable.polar_angles(exits)
    angles = np.meshgrid(light, viewer, CentralTable.azimuths(columns), indexing="ij")
    towards = _direction(angles[0], angles[2])
    normal, outgoing = _direction(angles[1] / 2, 0), _direction(angles[1], 0)
    half = towards + outgoing
    cosine = np.einsum("ioax,ioax->ioa", half, normal) / np.linalg.norm(half, axis=-1)
    values = np.exp(-((np.arccos(np.clip(cosine, -1, 1)) / sigma) ** 2)) / (4 * np.pi * sigma**2)
    return tabulated_spectrum(CentralTable(values[..., None]), (LIMITS[0], 4))


def _direction(polar: np.ndarray, azimuth: np.ndarray | float) -> np.ndarray:
    sine = np.sin(polar)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)], axis=-1)


def fibres() -> CentralSpectrum:
    """cos^s(t_i - t_o) about the tangent, no azimuth in it: one column."""
    angles = CentralTable.polar_angles(FIBRES_ROWS)
    values = np.maximum(np.cos(angles[:, None] - angles[None, :]), 0) ** FIBRES_EXPONENT
    return tabulated_spectrum(CentralTable(values[:, :, None, None]), LIMITS)


def listed(spectrum: CentralSpectrum) -> str:
    """What is left out at F = 30 for each P, per cent."""
    return " ".join(f"{100 * value:5.2f}" for value in missing_energy(spectrum)[LIMITS[0]])


def print_facets() -> dict[str, CentralSpectrum]:
    print("microfacet (T 5.34), eps < .03; published: P = 2 suffices, F ~ 1 / sigma")
    print("                     with the horizon                no horizon (5.34 literally)")
    print("sigma  table 5.5  eps there  smallest  eps      eps there  smallest  eps     minimum")
    found = {}
    for sigma, (printed, minimum) in SIGMAS.items():
        spectra = facets(sigma), facets_without_horizon(sigma)
        line, met = f"{sigma:4.1f}   {printed!s:9s}", True
        for spectrum in spectra:
            orders = required_orders(spectrum, TOLERANCE)
            smallest = orders.light, orders.viewer
            met = met and smallest == minimum
            line += f"{missing_energy(spectrum)[printed]:9.4f}    {smallest!s:9s}"
            line += f"{orders.missing:7.4f}  "
        print(f"{line}  {minimum!s:8s}{'as found' if met else 'NOT as found'}")
        found[f"microfacet {sigma}"] = spectra[0]
    print("the table's orders all suffice, but are not the smallest for sigma .1, .2 and .5")
    return found


def print_skin() -> dict[str, CentralSpectrum]:
    found = {}
    print(f"\nskin, Lafortune; published: P = {SKIN_PUBLISHED} suffices for eps < .03")
    for name, weighted in (("skin, rho cos t_i", False), ("skin, times cos t_o", True)):
        spectrum = skin_spectrum(LIMITS, weighted)
        published = missing_energy(spectrum)[LIMITS[0], SKIN_PUBLISHED]
        verdict = "met" if published < TOLERANCE else "NOT met"
        print(f"{name:20s} eps at F = 30, P = 4: {published:.4f} ({verdict})")
        print(f"{'':20s} P = 0, 1, ...: {listed(spectrum)} %")
        if missing_energy(spectrum)[-1, -1] < TOLERANCE:
            orders = required_orders(spectrum, TOLERANCE)
            print(f"{'':20s} smallest (F, P) = ({orders.light}, {orders.viewer})")
        found[name] = spectrum
    return found


def print_fibres() -> dict[str, CentralSpectrum]:
    spectrum = fibres()
    orders = required_orders(spectrum, TOLERANCE)
    others = np.abs(np.asarray(spectrum.coefficients)[:, :, 1:]).max()
    print(f"\nKajiya-Kay, s = {FIBRES_EXPONENT}; published P = {FIBRES_PUBLISHED}, q = 0 alone")
    print(f"measured P = {orders.viewer}, F = {orders.light}, eps {orders.missing:.4f};", end=" ")
    print(f"P + 1 = {orders.viewer + 1} terms; largest coefficient of q > 0: {others:g}")
    print(f"P = 0, 1, ...: {listed(spectrum)} %")
    return {"Kajiya-Kay 32": spectrum}


def print_models() -> dict[str, CentralSpectrum]:
    found = {}
    print(
        "\nothers, times cos t_o: (F, P) for eps < .03; per cent left out at F = 30, P = 0, 1, ..."
    )
    for name, brdf in MODELS.items():
        spectrum = central_spectrum_of(brdf, LIMITS, True)
        missing = missing_energy(spectrum)
        if missing[-1, -1] < TOLERANCE:
            orders = required_orders(spectrum, TOLERANCE)
            need = f"({orders.light}, {orders.viewer})"
        else:
            need = f"> {LIMITS}"
        print(f"{name:30s}{need:12s}{listed(spectrum)}")
        found[name] = spectrum
    print(
        "Torrance-Sparrow's Fresnel reflectance rises from .04 to 1: most energy of the lobe alone"
    )
    print("is at exits beyond 60 degrees; over a diffuse base this hardly counts")
    return found


def draw(found: dict[str, CentralSpectrum], path: Path):
    """Draw what is left out at F = 30 against P."""
    figure, axes = plt.subplots(figsize=(9, 5.2), layout="constrained")
    styles = ("-", "--", ":")
    for number, (name, spectrum) in enumerate(found.items()):
        missing = np.maximum(missing_energy(spectrum)[LIMITS[0]], 1e-6)
        axes.semilogy(
            missing, styles[number // 10], marker="o", ms=3, label=name, color=f"C{number % 10}"
        )
    axes.axhline(TOLERANCE, color="black", lw=0.8, label="eps = .03")
    axes.set(xlabel="P", ylabel="energy left out at F = 30", ylim=(1e-5, 1))
    axes.set_title("T 5.7.1: orders of the viewer's direction", fontsize=11)
    figure.legend(loc="outside right upper", fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    print(f"picture: {path}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("experiments/out/counts_5_7_1.png"))
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    found = print_facets() | print_skin() | print_fibres() | print_models()
    draw(found, arguments.out)


if __name__ == "__main__":
    main()
