"""Simulation-based calibration: worlds drawn from stated priors, faults and all, fitted blindly.

    python experiments/calibrated_ranks.py [--count 40] [--first 0]

Each draw is a ball of a material of its own under a probe and a lamp, from twelve sides, with 1 %
noise (``ball_worlds.py``).  Its photographs have the faults that a careful capture may have, all at
once, each as large as the prior of ``solve.free`` says: turned cameras, exposures that differ, and
a lamp that is near in every second draw.  In every fourth the lobe is GGX and not T 6.2.  The fit
is told none of it, and frees what it names (``free: auto``).

If errors are right, the rank of the truth, by the normal distribution of each number, is even
between 0 and 1.  Printed for each draw: the outcome, what was freed, and by how many standard
errors sigma, mu, ks and kd are off.  Then for each number: the counts in ten bins, chi-squared and
its probability, and how often the 90 % interval holds the truth.  Where too many are in the middle,
the errors are too wide.
"""

import argparse
import time
from typing import NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402
from ball_worlds import VIEWS, World, clean, photographs  # noqa: E402
from planted import camera as turn_cameras  # noqa: E402
from scipy.stats import chi2, norm  # noqa: E402

from jaxrender.brdf import Microfacet, material_named  # noqa: E402
from jaxrender.inverse import BRDFFit, FitSettings, KnownLight, fit_brdf, unknowns_of  # noqa: E402
from jaxrender.inverse.leverage import draw, leverage  # noqa: E402
from jaxrender.inverse.nuisances import NUISANCES  # noqa: E402
from jaxrender.lighting import DirectionalSources  # noqa: E402

SAMPLES, BINS = 12_000, 10
NUMBERS = ("sigma", "mu", "ks", "kd")
# Every so many draws have a near lamp, and a lobe of another model.
NEAR, OTHER_LOBE = 2, 4
# A rotation about an axis of its own is as large as three about three axes.
TURN = np.sqrt(3) * NUISANCES["camera"].units[0].prior
GAIN = NUISANCES["exposure"].units[0].prior / 100
NEARNESS = NUISANCES["nearness"].units[0].prior
# No lamp stands nearer than at five radii.
NEAREST = 0.2


class Ranked(NamedTuple):
    """One draw: the fit, and how far each number is off, in standard errors."""

    fit: BRDFFit
    off: dict[str, float]


def drawn(seed: int) -> tuple[World, World]:
    """Draw a world, and what is told of it."""
    rng = np.random.default_rng(5000 + seed)
    told = clean(seed)
    kd, ks = rng.uniform(0.05, 0.3, 3), np.full(3, rng.uniform(0.05, 0.2))
    sigma, mu = float(np.exp(rng.uniform(np.log(0.08), np.log(0.3)))), float(rng.uniform(1.3, 1.8))
    material = Microfacet(kd, ks, sigma, mu)
    true = told._replace(material=material, gains=np.exp(GAIN * rng.normal(size=VIEWS)))
    true = turn_cameras(true, TURN, rng)
    if seed % NEAR:
        true = true._replace(nearness=min(abs(NEARNESS * rng.normal()), NEAREST))
    if seed % OTHER_LOBE == OTHER_LOBE - 1:
        other = material_named("ggx", {"kd": kd, "ks": ks, **material.numbers})
        true = true._replace(material=other)
    return true, told


def ranked(seed: int) -> Ranked:
    """Photograph a world, fit it, and compare."""
    true, told = drawn(seed)
    pool = photographs(true, told, seed)
    light = KnownLight(told.environment, DirectionalSources(told.lamp[None], told.irradiance[None]))
    some = draw(pool, leverage(pool, light), SAMPLES, 0).observations
    kind = Microfacet(np.ones(3), np.ones(3), 0.15, 1.5)
    settings = FitSettings(free="auto")
    fit = fit_brdf(some, light, unknowns_of(kind), kind, settings, shape=told.shape, pool=pool)
    off = {}
    for name in NUMBERS:
        parts = fit.parameters.value, fit.parameters.standard_error
        value, error = (float(np.ravel(np.asarray(part.of(name)))[0]) for part in parts)
        truth = getattr(true.material, name)
        off[name] = (value - float(np.ravel(np.asarray(truth))[0])) / error
    return Ranked(fit, off)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="the seed of the first draw")
    asked = parser.parse_args()
    found: list[Ranked] = []
    for seed in range(asked.first, asked.first + asked.count):
        begun = time.perf_counter()
        one = ranked(seed)
        found.append(one)
        freed = () if one.fit.calibration is None else one.fit.calibration.free
        off = "  ".join(f"{name} {value:5.1f}" for name, value in one.off.items())
        print(
            f"{seed:4d} {one.fit.outcome.value:16s} {off}  {time.perf_counter() - begun:4.0f} s  "
            f"{' '.join(freed)}",
            flush=True,
        )
        if seed % 8 == 7:
            # Every case compiles programs of its own; more exhaust a process's memory maps.
            jax.clear_caches()
    for name in NUMBERS:
        off = np.array([one.off[name] for one in found])
        counts = np.histogram(norm.cdf(off), BINS, (0, 1))[0]
        squares = float(np.sum((counts - counts.mean()) ** 2) / counts.mean())
        inside = np.mean(np.abs(off) < norm.ppf(0.95))
        print(
            f"{name:6s} {counts.tolist()}  chi-squared {squares:.1f}, "
            f"p {chi2.sf(squares, BINS - 1):.3f}; inside {100 * inside:.0f} %"
        )


if __name__ == "__main__":
    main()
