"""T fig. 6.3: the BRDF of teflon under complex light, and fitted to a moving-source measurement.

    python experiments/figure_6_3.py [--views 60] [--size 160] [--physical]

Our method: kd, ks, mu and sigma from photographs under an area source and a source (T 6.4.2).  Fit
to data: the same ball under one source at a time, its BRDF tabulated by half-angle coordinates
(``inverse.brdf_table``), the model fitted to the table.  RMS is the error of either against the
table, as in the thesis; there it is mostly the model's, here the noise's, since the photographs are
made with the model (exact integral, 1 % noise).  ``--physical`` makes them with Smith's masking and
half-angle Fresnel, and fits the thesis's model all the same: then the RMS is mostly the model's
error at grazing angles.  Cells are weighed by their standard errors, not for the smallest linear
RMS as in the thesis, so that then the column fitted to the table may have the larger one.
"""

import argparse
import time
from typing import NamedTuple

import jax
import numpy as np
from teflon import moving_source_table, teflon, under_complex_light

from jaxrender.brdf import Microfacet
from jaxrender.inverse import KnownLight, fit_brdf, unknowns_of
from jaxrender.inverse.brdf_table.moving_source import fit_table, table_error
from jaxrender.inverse.brdf_table.table import BRDFTable
from jaxrender.inverse.intervals import Uncertain


class Column(NamedTuple):
    """A column of the table."""

    reflectance: float
    kd: float
    ks: float
    mu: float
    sigma: float
    rms: float


PUBLISHED = (
    Column(0.86, 0.89, 0.11, 1.78, 0.12, 0.093),
    Column(0.87, 0.91, 0.09, 1.85, 0.13, 0.085),
)
NAMES = ("reflectance", "kd/(kd+ks)", "ks/(kd+ks)", "mu", "sigma", "RMS")


def column(brdf: Microfacet, table: BRDFTable) -> Column:
    """Lay a material out as the thesis does; reflectance is pi kd + ks, as the recipe scales it."""
    kd, ks = float(np.mean(brdf.kd)), float(np.mean(brdf.ks))
    mu, sigma = float(brdf.mu), float(brdf.sigma)
    rms = table_error(table, brdf)
    return Column(np.pi * kd + ks, kd / (kd + ks), ks / (kd + ks), mu, sigma, rms)


def print_errors(name: str, parameters: Uncertain, truth: Microfacet):
    """Print how far each parameter is off, in per cent and in its own standard errors."""
    parts = []
    for field in ("kd", "ks", "sigma", "mu"):
        value, error = (
            np.mean(part.of(field)) for part in (parameters.value, parameters.standard_error)
        )
        off = float(value - np.mean(getattr(truth, field)))
        relative = 100 * off / np.mean(getattr(truth, field))
        parts.append(f"{field} {relative:+.3f} % ({off / error:+.1f} s.e.)")
    print(f"{name:14s} off by " + ", ".join(parts))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=60)
    parser.add_argument("--size", type=int, default=160)
    parser.add_argument("--physical", action="store_true")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    start = time.perf_counter()
    scene = teflon()
    model = scene.material
    if arguments.physical:
        truth = Microfacet(model.kd, model.ks, model.sigma, model.mu, "half", "smith")
        scene = scene._replace(material=truth)
    table = moving_source_table(scene, arguments.size)
    print(f"table: {table.count.sum()} pixels in {np.count_nonzero(table.filled)} cells")
    unknowns = unknowns_of(model)
    to_data = fit_table(table, unknowns, model)
    observations = under_complex_light(scene, arguments.views)
    light = KnownLight(scene.area.to_environment(64), scene.source)
    ours = fit_brdf(observations, light, unknowns, model)
    columns = [column(brdf, table) for brdf in (ours.brdf, to_data.brdf, scene.material)]
    print(f"\n{'':12s} {'--- thesis ---':>19s}   {'--- here ---':>26s}")
    print(
        f"{'':12s} {'our method':>10s} {'to data':>8s}   "
        f"{'our method':>10s} {'to data':>8s} {'truth':>8s}"
    )
    for name, *values in zip(NAMES, *PUBLISHED, *columns):
        if name == "RMS":
            texts = [f"{v:.1%}" for v in values[:2]] + [f"{v:.2%}" for v in values[2:]]
        else:
            texts = [f"{v:.2f}" for v in values[:2]] + [f"{v:.4f}" for v in values[2:]]
        widths = (10, 8, 12, 8, 8)
        print(f"{name:12s} " + " ".join(f"{t:>{w}s}" for t, w in zip(texts, widths)))
    print()
    print_errors("complex light", ours.parameters, scene.material)
    print_errors("moving source", to_data.parameters, scene.material)
    print(f"outcome under complex light: {ours.outcome.value}; {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
