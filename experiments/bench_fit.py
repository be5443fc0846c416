"""The frequency fit of 12,000 samples beside SciPy's Levenberg-Marquardt and simplex, same arrays.

    python experiments/bench_fit.py [--runs 25] [--precision float64 float32]

Everybody minimises the same sum of squares: the tabulated dual model (diffuse column, B-spline rows
over log sigma, Fresnel ratio), noisy photographs by the exact integral, one start with sigma 1.4
and mu 1.2 times too large.  Ours is one call of ``search``; cold includes compilation.  SciPy, in
float64, has the model in NumPy with the weights folded into the table beforehand, and every
help: linear unknowns at their best for the start.  All share one core: vectors of this length
are too short for a second, and waiting for it costs either side more than it does.  All take
turns, so that a busy machine is busy for all.  The ratio of medians is held against what is
demanded for all six unknowns, the quicker of two Jacobians counting.  With the linear unknowns
eliminated by hand SciPy gets our own idea; its two unknowns are shown beside that.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable
from typing import NamedTuple

# Both are read when NumPy and JAX are imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import jax
import jax.numpy as jnp
import numpy as np
import scenes
import scipy
from scipy.optimize import OptimizeResult, least_squares, minimize

from jaxrender.brdf import Microfacet
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import KnownLight, unknowns_of
from jaxrender.inverse.elimination import Data, Fit, Problem
from jaxrender.inverse.models import TabulatedModel
from jaxrender.inverse.prepared_light import prepare_light
from jaxrender.inverse.search import search
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.reflection import RoughnessTable, roughness_table

SAMPLES, CHANNELS = 12_000, 3
MATERIAL = Microfacet(np.array([0.19, 0.11, 0.07]), np.full(3, 0.21), 0.14, 1.62)
NAMES, START = ("sigma", "mu"), (1.4 * 0.14, 1.2 * 1.62)
NOISE = NoiseModel(0.01, 1e-4)
# What is demanded: times faster than Levenberg-Marquardt, and than the simplex.
DEMANDED = {"float64": (4, 30), "float32": (10, 80)}
# Answers agree to this: SciPy's own stopping tolerances allow the simplex no more than 1e-4.
AGREEMENT = 1e-3


class Twin:
    """The same tabulated model in NumPy, weighted once and for all."""

    def __init__(self, table: RoughnessTable, data: Data):
        weights = np.asarray(data.weights)
        self.knots = table.log_sigma
        self.rows = (np.asarray(table.spline)[0] * weights).reshape(self.knots.count + 2, -1)
        self.diffuse = np.asarray(table.diffuse) * weights
        self.measured = np.asarray(data.radiance) * weights
        self.cosines = np.clip(np.asarray(table.exit_cosines), 0, 1)
        self.squared_cosines = self.cosines**2
        self.diffuse_squares = self.products(self.diffuse, self.diffuse)

    def products(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Sum over the samples, channel by channel."""
        return np.einsum("sc,sc->c", a, b)

    def lobe(self, sigma: float) -> tuple[np.ndarray, np.ndarray]:
        """Look up the specular column without Fresnel, and its derivative by sigma."""
        step = float(self.knots.step)
        position = (np.log(sigma) - float(self.knots.first)) / step
        cell = int(np.clip(np.floor(position), 0, self.knots.count - 2))
        t = position - cell
        value = np.array([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 0, t**3]) / 6
        value[2] = 1 - value.sum()
        slope = np.array([-((1 - t) ** 2), 3 * t**2 - 4 * t, -3 * t**2 + 2 * t + 1, t**2]) / 2
        both = np.stack([value, slope / (step * sigma)]) @ self.rows[cell : cell + 4]
        return both[0].reshape(-1, CHANNELS), both[1].reshape(-1, CHANNELS)

    def fresnel(self, mu: float) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate F(mu, t) / F(mu, 0) and its derivative by mu."""
        c = self.cosines
        g = np.sqrt(mu * mu - 1 + self.squared_cosines)
        less, more = g - c, g + c
        above, below = c * more - 1, c * less + 1
        s, ratio = less / more, above / below
        square, factor = s * s, 1 + ratio * ratio
        scale, by_mu = ((mu + 1) / (mu - 1)) ** 2 / 2, mu / g
        value = scale * square * factor
        by_s = 4 * s * c / (more * more) * factor
        by_ratio = 2 * square * ratio * c * (below - above) / (below * below)
        slope = scale * by_mu * (by_s + by_ratio) - 4 / (mu * mu - 1) * value
        return value[:, None], slope[:, None]

    def specular(self, sigma: float, mu: float) -> np.ndarray:
        """Evaluate the specular column."""
        return self.lobe(sigma)[0] * self.fresnel(mu)[0]

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Weighted residuals for x = (kd red, green, blue, ks, sigma, mu)."""
        predicted = self.diffuse * x[:3] + x[3] * self.specular(x[4], x[5])
        return (predicted - self.measured).ravel()

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Differentiate the residuals."""
        (lobe, by_sigma), (fresnel, by_mu) = self.lobe(x[4]), self.fresnel(x[5])
        found = np.zeros((*lobe.shape, 6))
        for channel in range(CHANNELS):
            found[:, channel, channel] = self.diffuse[:, channel]
        found[:, :, 3] = lobe * fresnel
        found[:, :, 4] = x[3] * by_sigma * fresnel
        found[:, :, 5] = x[3] * lobe * by_mu
        return found.reshape(-1, 6)

    def split(self, target: np.ndarray, specular: np.ndarray) -> tuple[np.ndarray, float]:
        """Solve for the kd and the ks that come closest to ``target``."""
        mixed = self.products(self.diffuse, specular) / self.diffuse_squares
        plain = self.products(self.diffuse, target) / self.diffuse_squares
        cross = self.diffuse_squares * mixed
        ks = (np.vdot(specular, target) - cross @ plain) / (
            np.vdot(specular, specular) - cross @ mixed
        )
        return plain - ks * mixed, float(ks)

    def eliminated(self, x: np.ndarray) -> np.ndarray:
        """Weighted residuals for x = (sigma, mu), kd and ks at their best."""
        specular = self.specular(*x)
        kd, ks = self.split(self.measured, specular)
        return (self.diffuse * kd + ks * specular - self.measured).ravel()

    def eliminated_jacobian(self, x: np.ndarray) -> np.ndarray:
        """Differentiate those (Kaufman's form: what kd and ks can explain is taken off)."""
        (lobe, by_sigma), (fresnel, by_mu) = self.lobe(x[0]), self.fresnel(x[1])
        specular = lobe * fresnel
        ks = self.split(self.measured, specular)[1]
        columns = []
        for moved in (ks * by_sigma * fresnel, ks * lobe * by_mu):
            kd, share = self.split(moved, specular)
            columns.append((moved - self.diffuse * kd - share * specular).ravel())
        return np.stack(columns, axis=1)

    def start(self) -> np.ndarray:
        """All six unknowns at the start: kd and ks are the best there."""
        kd, ks = self.split(self.measured, self.specular(*START))
        return np.array([*kd, ks, *START])


class Contestant(NamedTuple):
    """What is timed, and what turns its result into (sigma, mu) and a remark."""

    call: Callable
    read: Callable


class Timed(NamedTuple):
    """Median and shortest time in milliseconds, the answer (sigma, mu) and what it took."""

    median: float
    shortest: float
    answer: np.ndarray
    remark: str


def scene() -> tuple[RoughnessTable, Data]:
    """Photograph a glossy ball under an area light and a source, and tabulate the dual model."""
    samples, view = scenes.ring_samples(SAMPLES, 0.15, seed=0)
    towards = np.array([[0.9, 0.5, 0.4], [0, 0, 1]])
    middle = np.array([[1, 0.97, 0.92], [0.06, 0.07, 0.09]])
    lobes = SmoothLobes(towards, np.radians([30.0, 60.0]), middle)
    source = DirectionalSources(np.array([[-0.35, 0.8, 0.5]]), np.array([[1.2, 1.15, 1.05]]))
    exact = scenes.photograph_function(lobes.radiance, MATERIAL, samples, view, source)
    measured = NOISE.add(exact.radiance, np.random.default_rng(1))
    light = KnownLight(lobes.to_environment(128), source)
    dual = prepare_light(light, exact, MATERIAL, "auto", None).dual
    table = roughness_table(MATERIAL, samples, dual, (0.14 / 1.8, 0.14 * 1.8))
    return table, Data(measured, 1 / NOISE.standard_deviation(exact.radiance), view)


def ours(table: RoughnessTable, data: Data, dtype) -> Contestant:
    """Make the call of our solver, in one precision."""

    def cast(x):
        x = jnp.asarray(x)
        return x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x

    table, data = jax.tree.map(cast, (table, data))
    unknowns = unknowns_of(MATERIAL)
    problem = Problem.of(unknowns, CHANNELS, dtype)
    start = unknowns.pack(dict(zip(NAMES, START)))[None].astype(dtype)
    model = TabulatedModel(MATERIAL, table)

    def call() -> Fit:
        return jax.block_until_ready(search(problem, model, data, start))

    def read(fit: Fit) -> tuple[np.ndarray, str]:
        found = unknowns.unpack(fit.solution.point).numbers
        remark = f"{int(fit.solution.steps)} steps"
        remark += "" if bool(fit.solution.converged) else ", NOT CONVERGED"
        return np.array([float(found[name]) for name in NAMES]), remark

    return Contestant(call, read)


def peers(twin: Twin) -> dict[str, Contestant]:
    """Make the calls of SciPy: Levenberg-Marquardt and simplex, with and without elimination."""
    every, two = twin.start(), np.array(START)

    def squares(function: Callable) -> Callable:
        def half_sum(x: np.ndarray) -> float:
            left = function(x)
            return 0.5 * float(np.dot(left, left))

        return half_sum

    def read(found: OptimizeResult) -> tuple[np.ndarray, str]:
        return found.x[-2:], f"{found.nfev} evaluations"

    def marquardt(function: Callable, start: np.ndarray, jacobian="2-point") -> Contestant:
        return Contestant(lambda: least_squares(function, start, jacobian, method="lm"), read)

    def simplex(function: Callable, start: np.ndarray) -> Contestant:
        options = {"maxiter": 5000, "maxfev": 5000}
        goal = squares(function)
        return Contestant(
            lambda: minimize(goal, start, method="Nelder-Mead", options=options), read
        )

    return {
        "lm, 6 unknowns": marquardt(twin.residuals, every),
        "lm, 6 unknowns, Jacobian": marquardt(twin.residuals, every, twin.jacobian),
        "lm, 2 unknowns": marquardt(twin.eliminated, two),
        "lm, 2 unknowns, Jacobian": marquardt(twin.eliminated, two, twin.eliminated_jacobian),
        "simplex, 6 unknowns": simplex(twin.residuals, every),
        "simplex, 2 unknowns": simplex(twin.eliminated, two),
    }


def take_turns(contestants: dict[str, Contestant], runs: int) -> dict[str, Timed]:
    """Time all calls in turn, so that what else the machine does hits all of them alike.

    Everybody runs twice and is timed the second time: warm means that the processor's caches hold
    one's own arrays, not those of whoever ran before.
    """
    times: dict[str, list[float]] = {name: [] for name in contestants}
    last = {}
    for _ in range(runs):
        for name, (call, _) in contestants.items():
            call()
            start = time.perf_counter()
            last[name] = call()
            times[name].append(1e3 * (time.perf_counter() - start))
    return {
        name: Timed(statistics.median(spent), min(spent), *contestants[name].read(last[name]))
        for name, spent in times.items()
    }


def report(precision: str, cold: float, timed: dict[str, Timed]):
    """Print all times, the ratios, and whether the answers agree."""
    own = timed["ours"]
    print(f"\nours in {precision}, SciPy in float64; ours cold (with compilation): {cold:.2f} s")
    print(f"{'':28s} {'median ms':>9s} {'least ms':>9s} {'ratio':>7s}     sigma       mu")
    for name, one in timed.items():
        off = np.max(np.abs(one.answer / own.answer - 1))
        flag = "" if off < AGREEMENT else f"  DIFFERS by {off:.1e}"
        ratio = "" if name == "ours" else f"{one.median / own.median:7.1f}"
        print(
            f"{name:28s} {one.median:9.2f} {one.shortest:9.2f} {ratio:>7s} "
            f"{one.answer[0]:9.6f} {one.answer[1]:8.5f}  {one.remark}{flag}"
        )
    for name, least in zip(("lm, 6 unknowns", "simplex, 6 unknowns"), DEMANDED[precision]):
        ratio = timed[name].median / own.median
        undisturbed = timed[name].shortest / own.shortest
        print(
            f"  {ratio:6.1f} times faster than {name} (least times: {undisturbed:.1f}); "
            f"demanded {least}: {'met' if ratio >= least else 'NOT met'}"
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=25)
    parser.add_argument("--precision", nargs="+", choices=list(DEMANDED), default=list(DEMANDED))
    arguments = parser.parse_args()
    load = os.getloadavg()[0]
    print(
        f"{os.cpu_count()} cores (load {load:.1f}), {jax.default_backend()}, jax {jax.__version__}"
        f", scipy {scipy.__version__}; {SAMPLES} samples of {CHANNELS} channels"
    )
    jax.config.update("jax_enable_x64", True)
    table, data = scene()
    table, data = jax.tree.map(np.asarray, (table, data))
    twin = Twin(table, data)
    for precision in arguments.precision:
        # float32 as most users run it: with x64 off nothing can be promoted.
        jax.config.update("jax_enable_x64", precision == "float64")
        own = ours(table, data, np.dtype(precision))
        start = time.perf_counter()
        own.call()
        cold = time.perf_counter() - start
        report(precision, cold, take_turns({"ours": own, **peers(twin)}, arguments.runs))


if __name__ == "__main__":
    main()
