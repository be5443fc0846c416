"""Do 90 % intervals hold the truth in 90 % of repetitions, when the light is unknown?

    python experiments/coverage_unknown_light.py [--seeds 200] [--samples 320] [--smoothness 1]

Area light of degree 2 and one source; photographs by the polar quadrature (continuous light, no
grid, the source's lobe as it is), noise of 1 %, known, drawn anew for each seed.  ``lighting`` is
given the material, ``factorize`` nothing; both may use light to degree 4 and two sources.  Every
number is held against the truth alone: its coverage against the binomial 99.9 % band, and the
standard error that the fits state (root mean square) against the scatter that they show about their
mean, demanded within 15 %.  ``bias`` is the mean error in units of the stated standard error.

Slow light is expected to be smooth (a penalty on l (l + 1), ``FactorSettings.smoothness``: the
smaller, the smoother).  The standard error of a coefficient that the penalty has a say in is that
of what is known, and the truth is not drawn from the prior: its scatter is smaller and a bias takes
the rest.  ``--smoothness 100`` leaves the penalty out.

Light is in the gauge kd + ks = 1, as ``factorize`` returns it.
"""

import os

# Read when NumPy is imported: matrices of 27 unknowns are too small for a second thread to help.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from factorization_trial import AREA
from scenes import photograph_function, ring_samples
from scipy.stats import binom

from jaxrender.brdf import Microfacet
from jaxrender.harmonics import evaluate
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import (
    Factorization,
    FactorSettings,
    Known,
    Observations,
    Unknown,
    factorize,
)
from jaxrender.lighting import DirectionalSources

SIGMA, MU = 0.16, 1.5
MATERIAL = Microfacet(np.full(3, 0.2), np.full(3, 0.1), SIGMA, MU)
TOTAL = np.asarray(MATERIAL.kd) + np.asarray(MATERIAL.ks)
SOURCE = DirectionalSources(np.array([[-0.35, 0.8, 0.5]]), np.array([[1.2, 1.15, 1.05]]))
NOISE = NoiseModel(0.01, 0.0)
BAND_LIMIT, SOURCES = 4, 2
LOWEST_COSINE = 0.15
LEVEL, BAND, NORMAL_90 = 0.9, 0.999, 1.6448536269514722
WITHIN = 15.0
# Nine of ten points lie in a circle of this radius, in units of their rms distance, if they scatter
# alike in all directions.
CIRCLE_90 = 1.5174271293851465
MATERIAL_ALONE = Known((1 / 3,) * 3, Unknown(fixed=(SIGMA,)), Unknown(fixed=(MU,)))


class Counted(NamedTuple):
    """One number of one fit: its error, the standard error stated, and whether it is inside."""

    error: float
    stated: float
    inside: bool


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--samples", type=int, default=320)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--smoothness", type=float, default=1.0)
    parser.add_argument("--only", choices=("lighting", "factorize"))
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    samples, view = ring_samples(arguments.samples, LOWEST_COSINE, 3)
    exact = photograph_function(
        lambda towards: evaluate(jnp.asarray(AREA), towards), MATERIAL, samples, view, SOURCE
    )
    for task, known in (("lighting", MATERIAL_ALONE), ("factorize", Known())):
        if arguments.only in (None, task):
            settings = FactorSettings(BAND_LIMIT, SOURCES, arguments.smoothness, noise=NOISE)
            report(task, *repeat(task, exact, (known, settings), seeds))


def repeat(
    task: str, exact: Observations, how: tuple[Known, FactorSettings], seeds: range
) -> tuple[list[dict[str, Counted]], int]:
    """Fit each seed's photographs; give the numbers of each, and how many found a source more."""
    known, settings = how
    start, found, more = time.perf_counter(), [], 0
    for seed in seeds:
        rng = np.random.default_rng(7000 + seed)
        noisy = exact._replace(radiance=NOISE.add(np.asarray(exact.radiance), rng))
        fit = factorize(noisy, MATERIAL, settings, known)
        more += len(fit.scene.sources.directions) != 1
        found.append(numbers_of(fit, task == "factorize"))
        if len(found) % 50 == 0:
            print(f"  {task}: {len(found)} seeds, {time.perf_counter() - start:.0f} s", flush=True)
    return found, more


def numbers_of(fit: Factorization, with_material: bool) -> dict[str, Counted]:
    """List every number of a fit with its error and its stated standard error."""
    numbers = {}
    if with_material:
        value, low, high, error = fit.parameters[:4]
        for k, channel in enumerate(("red", "green", "blue")):
            truth = float(np.asarray(MATERIAL.ks)[k] / TOTAL[k])
            inside = bool(low.ks[k] <= truth <= high.ks[k])
            numbers[f"ks {channel}"] = Counted(
                float(value.ks[k]) - truth, float(error.ks[k]), inside
            )
        for name, truth in (("sigma", SIGMA), ("mu", MU)):
            inside = bool(low.of(name) <= truth <= high.of(name))
            off = float(value.of(name)) - truth
            numbers[name] = Counted(off, float(error.of(name)), inside)
    scene = fit.scene
    slow = np.zeros_like(scene.slow)
    slow[: len(AREA)] = AREA * TOTAL
    for degree in range(BAND_LIMIT + 1):
        for order in range(2 * degree + 1):
            each = degree**2 + order
            for k in range(3):
                name = f"light {degree}.{order}.{k}"
                error = scene.slow[each, k] - slow[each, k]
                numbers[name] = _counted(error, scene.slow_error[each, k])
    energy = np.asarray(scene.sources.irradiance)[0] - np.asarray(SOURCE.irradiance)[0] * TOTAL
    for k, off in enumerate(energy):
        numbers[f"source energy {k}"] = _counted(off, scene.energy_error[0, k])
    towards = np.asarray(SOURCE.directions)[0] / np.linalg.norm(np.asarray(SOURCE.directions)[0])
    off = float(np.linalg.norm(np.asarray(scene.sources.directions)[0] - towards))
    stated = float(scene.direction_error[0])
    numbers["source angle"] = Counted(off, stated, off <= CIRCLE_90 * stated)
    return numbers


def _counted(error: float, stated: float) -> Counted:
    return Counted(float(error), float(stated), bool(abs(error) <= NORMAL_90 * stated))


def report(task: str, fits: list[dict[str, Counted]], more: int):
    """Print coverage and standard errors: single numbers, and the light's degrees together."""
    low, high = band(len(fits))
    print(f"\n{task}: {len(fits)} noise seeds; {more} fits with a number of sources other than one")
    print(f"binomial 99.9 % band of one number: {low:.1f} to {high:.1f} %")
    print("  number              inside %   bias / s.e.   stated / achieved s.e., %")
    missed = 0
    for label, names in grouped(list(fits[0])):
        inside, bias, ratios = [], [], []
        for name in names:
            column = [fit[name] for fit in fits]
            errors = np.array([one.error for one in column])
            stated = np.sqrt(np.mean([one.stated**2 for one in column]))
            inside.append(100 * np.mean([one.inside for one in column]))
            # An angle is a distance: it has no sign, and scatters about the truth.
            angle = name == "source angle"
            bias.append(np.nan if angle else errors.mean() / stated)
            achieved = np.sqrt(np.mean(errors**2)) if angle else errors.std(ddof=1)
            ratios.append(100 * (stated / achieved - 1))
        outside = [not low <= share <= high for share in inside]
        wrong = [abs(ratio) > WITHIN for ratio in ratios]
        missed += int(np.sum(np.logical_or(outside, wrong)))
        verdict = f"{sum(outside)} outside, {sum(wrong)} beyond {WITHIN:g} %"
        span = (
            f"{_span(inside, '.1f'):>16s} {_span(bias, '+.2f'):>15s} {_span(ratios, '+.0f'):>14s}"
        )
        print(f"  {label:16s} {span}   {verdict if sum(outside) + sum(wrong) else ''}")
    print(f"{missed} of {len(fits[0])} numbers missed")


def grouped(names: list[str]) -> list[tuple[str, list[str]]]:
    """Put the light's coefficients of one degree, and a source's channels, on one line."""
    groups: dict[str, list[str]] = {}
    for name in names:
        label = name
        if name.startswith("light"):
            label = "light degree " + name.split()[1].split(".")[0]
        elif name.startswith("source energy"):
            label = "source energy"
        groups.setdefault(label, []).append(name)
    return list(groups.items())


def band(count: int) -> tuple[float, float]:
    """The binomial 99.9 % band of so many trials, per cent."""
    low, high = binom.interval(BAND, count, LEVEL)
    return 100 * low / count, 100 * high / count


def _span(values: list[float], form: str) -> str:
    if len(values) == 1:
        return f"{values[0]:{form}}"
    return f"{min(values):{form}} to {max(values):{form}}"


if __name__ == "__main__":
    main()
