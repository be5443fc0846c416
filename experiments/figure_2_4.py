"""T fig. 2.4: recentred about the reflected direction, BRDFs become compact, Phong's 1-D.

    python experiments/figure_2_4.py [--out FOLDER]

The thesis draws the idea; here it is measured.  For exit angles 0 to 75 degrees, the profile of
each lobe in the plane of incidence, against the angle from the normal and against the angle from R.
Prints where each lobe peaks about either centre, how much the recentred profile still changes with
the exit angle (Phong: not at all, as published), and the energy left in the azimuthal terms q > 0
about R (T 3.43).  Draws ``figure_2_4.png``.
"""

import argparse
import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import Components
from jaxrender.spectra import FacetLobe, facet_azimuthal_transfer

OUT = Path(__file__).parent / "out"
EXITS = np.radians([0.0, 30.0, 60.0, 75.0])
SIGMA, BAND_LIMIT = 0.15, 24
# T 6.4: the Phong exponent of the same width.
EXPONENT = 1 / (2 * SIGMA**2)
ANGLES = np.radians(np.linspace(-100, 100, 1601))
LOBES = ("phong", "microfacet", "ggx")


def profile(lobe: str, exit_angle: float, angles: np.ndarray = ANGLES) -> np.ndarray:
    """Transfer in the plane of incidence; angles from the normal, R at +exit_angle."""
    if lobe == "phong":
        cosine = np.maximum(np.cos(angles - exit_angle), 0)
        # T 3.34 ignores the horizon.
        return (EXPONENT + 1) / (2 * np.pi) * cosine**EXPONENT
    facets = FacetLobe(SIGMA, None, "ggx" if lobe == "ggx" else "gaussian")
    incoming = Components.of(direction(angles))
    outgoing = Components.of(direction(np.full_like(angles, -exit_angle)))
    return np.where(np.cos(angles) > 0, np.asarray(facets(incoming, outgoing)), 0)


def direction(angle: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)


def recentred(lobe: str, exit_angle: float) -> np.ndarray:
    """The same against the angle from R."""
    return profile(lobe, exit_angle, ANGLES + exit_angle)


def azimuthal_share(exit_angle: float, distribution: str) -> float:
    """Share of the lobe's energy in the orders q > 0 about R, to the band limit."""
    lobe = FacetLobe(jnp.asarray(SIGMA), None, distribution)
    cosines = np.array([np.cos(exit_angle)])
    terms = np.asarray(facet_azimuthal_transfer(lobe, cosines, BAND_LIMIT, BAND_LIMIT))[0]
    # rho_lq = h_lq / Lambda_l: the energy is the sum of their squares.
    energy = terms**2 * (2 * np.arange(BAND_LIMIT + 1) + 1)[:, None]
    return energy[:, 1:].sum() / energy.sum()


def print_table():
    print(f"sigma {SIGMA}, Phong exponent {EXPONENT:.1f} (T 6.4: 1 / 2 sigma^2)")
    print("published: Phong is 1-D about R; a microfacet lobe nearly so, except near grazing")
    print("lobe         exit deg  peak from N  peak from R  shape about R  energy in q > 0")
    for lobe in LOBES:
        head_on = recentred(lobe, 0.0)
        for exit_angle in EXITS:
            values = profile(lobe, exit_angle)
            peak = ANGLES[np.argmax(values)]
            shape = recentred(lobe, exit_angle)
            changed = np.abs(shape / shape.max() - head_on / head_on.max()).max()
            kind = "ggx" if lobe == "ggx" else "gaussian"
            share = 0.0 if lobe == "phong" else azimuthal_share(exit_angle, kind)
            print(
                f"{lobe:12s} {np.degrees(exit_angle):8.0f}  {np.degrees(peak):11.1f}"
                f"  {np.degrees(peak - exit_angle):11.1f}  {100 * changed:11.1f} %"
                f"  {100 * share:12.2f} %"
            )


def draw(path: Path):
    os.environ.setdefault("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(11, 6), layout="constrained", sharey="col")
    for column, lobe in zip(axes.T, LOBES):
        for exit_angle in EXITS:
            label = f"exit {np.degrees(exit_angle):.0f}°"
            column[0].plot(np.degrees(ANGLES), profile(lobe, exit_angle), label=label)
            column[1].plot(np.degrees(ANGLES), recentred(lobe, exit_angle), label=label)
        column[0].set(title=lobe, xlabel="angle from the normal, degrees", xlim=(-60, 95))
        column[1].set(xlabel="angle from the reflected direction, degrees", xlim=(-60, 60))
    axes[0, 0].legend(fontsize=8)
    axes[0, 0].set_ylabel("transfer, 1/sr")
    axes[1, 0].set_ylabel("transfer, 1/sr")
    figure.suptitle("T fig. 2.4: recentred about R")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    print(f"written: {path}")


def main():
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    print_table()
    draw(arguments.out / "figure_2_4.png")


if __name__ == "__main__":
    main()
