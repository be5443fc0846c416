"""Seconds that JAX spends before the first result: of every public function, and of whole fits.

    python experiments/bench_compile.py [--degree 30] [--only NAME ...]
    python experiments/bench_compile.py --fits 5

Each function is called with nothing compiled before (and no compilation kept on disk); what counts
is what JAX announces: tracing, lowering, compiling.  ``first`` is the whole first call, ``warm``
the shortest of three more.  Functions that trace nothing of their own (NumPy tables, sums of a few
numbers) are left out.  Demanded: none above 2 s.

``--fits`` asks ``jaxrender fit`` instead, always in a new process: ``cold`` with nothing compiled
before, ``warm`` (the median of so many) with all of it kept on disk.  Demanded of the warm ones: 1,
1.5 and 2.5 s; the photographs are there already.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender import harmonics, reflection, spectra
from jaxrender.brdf import Microfacet, Phong
from jaxrender.geometry import SurfaceSamples
from jaxrender.lighting import DirectionalSources, Environment

DEMANDED = 2.0
POINTS = 500
CONFIGS = {"teflon_sphere": 1.0, "teflon_unknown_light": 1.5, "textured_ball": 2.5}


class Listener:
    """Adds up what JAX announces; nested traces are announced within their callers' too."""

    def __init__(self):
        self.seconds = 0.0
        jax.monitoring.register_event_duration_secs_listener(self.hear)

    def hear(self, event: str, duration_secs: float, **_: str | int):
        """Take what is said of compiling."""
        if event.startswith("/jax/core/compile/"):
            self.seconds += duration_secs


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def calls(degree: int) -> dict[str, Callable]:
    """Return every function with arguments of degree ``degree`` and some hundred points."""
    rng = np.random.default_rng(0)
    count = (degree + 1) ** 2
    grid = harmonics.LatLongGrid(2 * degree + 4, 4 * degree + 8)
    gauss = harmonics.GaussLegendreGrid(degree + 1, 2 * degree + 2)
    cube = harmonics.CubeGrid(degree + 2)
    rotations = harmonics.RotationGrid(degree)
    image = rng.uniform(size=(*grid.shape, 3))
    coefficients = rng.normal(size=(count, 3))
    directions = unit(rng.normal(size=(POINTS, 3)))
    normals, outgoing = directions, unit(directions + 0.5 * unit(rng.normal(size=(POINTS, 3))))
    samples = SurfaceSamples(jnp.asarray(normals), jnp.asarray(outgoing))
    turn = unit(np.linalg.qr(rng.normal(size=(3, 3)))[0])
    turn = turn * np.sign(np.linalg.det(turn))
    angles = rng.uniform(0.2, 1, 3)
    tensor = rng.normal(size=(degree + 1, 2 * degree + 1, 2 * degree + 1)) + 0j
    glossy = Microfacet(np.full(3, 0.2), np.full(3, 0.1), 0.2, 1.5)
    ggx = Microfacet(
        np.full(3, 0.2), np.full(3, 0.1), 0.2, 1.5, "half", "smith", distribution="ggx"
    )
    cosines = jnp.linspace(0.1, 1, 12)
    environment = Environment(image)
    sources = DirectionalSources(directions[:40], rng.uniform(size=(40, 3)))
    dual = reflection.DualLight(coefficients, sources)
    matrix = reflection.irradiance_matrix(coefficients[:9])
    few = degree // 4
    isotropic = jnp.ones((degree + 1, few + 1, few + 1, 1))
    points = reflection.SurfacePoints(*(rng.uniform(0.2, 1, POINTS) for _ in range(3)), outgoing)
    lobe = spectra.FacetLobe(0.2, 1.5)
    spectrum = spectra.CentralSpectrum(jnp.ones((degree + 1, 4, 4, 1)), jnp.ones(1))
    fine = harmonics.LatLongGrid(128, 256)
    local = reflection.LocalShrm(rng.uniform(size=(128, 256, 16, 3)), fine, degree)
    view = reflection.ViewFilter(4, False)
    return {
        "real_basis": partial(harmonics.real_basis, directions, degree),
        "complex_basis": partial(harmonics.complex_basis, directions, degree),
        "legendre": partial(harmonics.legendre, directions[:, 0], degree),
        "evaluate": partial(harmonics.evaluate, coefficients, directions),
        "degree_table": partial(harmonics.degree_table, coefficients, directions),
        "analyse": partial(harmonics.analyse, grid, image, degree),
        "analyse_dense": partial(harmonics.analyse_dense, grid, image, degree),
        "analyse, cube": partial(
            harmonics.analyse,
            cube,
            rng.uniform(size=(*cube.shape, 3)),
            min(degree, cube.band_limit),
        ),
        "synthesise": partial(harmonics.synthesise, grid, coefficients),
        "synthesise_dense": partial(harmonics.synthesise_dense, grid, coefficients),
        "change_grid": partial(harmonics.change_grid, grid, image, gauss, degree),
        "rotate": partial(harmonics.rotate, coefficients, turn),
        "rotate_by_angles": partial(harmonics.rotate_by_angles, coefficients, *angles),
        "rotation_matrices": partial(harmonics.rotation_matrices, turn, degree),
        "small_d": partial(harmonics.small_d, angles, degree),
        "representation": partial(harmonics.representation, *angles, degree),
        "synthesise_rotations": partial(harmonics.synthesise_rotations, rotations, tensor),
        "convolve_rotations": partial(harmonics.convolve_rotations, tensor, tensor),
        "exit_cosine_transfer": partial(spectra.exit_cosine_transfer, glossy, cosines, degree),
        "exit_cosine_transfer, ggx": partial(spectra.exit_cosine_transfer, ggx, cosines, degree),
        "normal_exitance_transfer": partial(
            spectra.normal_exitance_transfer, glossy, cosines, degree
        ),
        "gaussian_transfer": partial(spectra.gaussian_transfer, glossy, cosines, degree),
        "transfer_of_samples": partial(
            spectra.transfer_of_samples, glossy, samples.exit_cosines, degree
        ),
        "azimuthal_transfer_of_samples": partial(
            spectra.azimuthal_transfer_of_samples, glossy, samples.exit_cosines, degree
        ),
        "phong_transfer": partial(spectra.phong_transfer, 30.0, degree),
        "light_coefficients": partial(spectra.light_coefficients, environment, degree),
        "light_coefficients, sources": partial(spectra.light_coefficients, sources, degree),
        "spectrum_of, numeric": partial(
            spectra.spectrum_of, Phong(np.full(3, 0.1), np.full(3, 0.2), 30.0), degree, numeric=True
        ),
        "outgoing_coefficients": partial(spectra.outgoing_coefficients, glossy, cosines, degree),
        "isotropic_coefficients": partial(spectra.isotropic_coefficients, glossy, (degree, few)),
        "central_spectrum": partial(
            spectra.central_spectrum, lobe, (degree, 3), *lobe.extent, weighted=True
        ),
        "central_spectrum_of": partial(
            spectra.central_spectrum_of, glossy, (degree, 3), weighted=True
        ),
        "local_shrm": partial(reflection.local_shrm, coefficients, spectrum, fine),
        "global_shrm": partial(reflection.global_shrm, local),
        "LocalShrm.at": partial(local.at, samples.reflected, samples.outgoing),
        "mirror_light and its column": lambda: reflection.reflect_mirror_light(
            glossy,
            samples.exit_cosines,
            reflection.mirror_light(samples, coefficients, 4),
            view,
        ),
        "irradiance": partial(reflection.irradiance, coefficients, normals),
        "quadratic_irradiance": partial(reflection.quadratic_irradiance, matrix, normals),
        "reflection_maps": partial(
            reflection.reflection_maps, image, np.ones((4, degree + 1)), grid
        ),
        "convolve_isotropic": partial(reflection.convolve_isotropic, coefficients + 0j, isotropic),
        "evaluate_isotropic": lambda: reflection.evaluate_isotropic(
            reflection.convolve_isotropic(coefficients + 0j, isotropic), points
        ),
        "reflect_slow_light": partial(reflection.reflect_slow_light, glossy, samples, coefficients),
        "reflect_by_facets": partial(reflection.reflect_by_facets, glossy, samples, coefficients),
        "integral_columns": partial(
            reflection.integral_columns, glossy, samples, environment.nodes()
        ),
        "dual_columns": partial(reflection.dual_columns, glossy, samples, dual),
        "roughness_table": partial(reflection.roughness_table, glossy, samples, dual, (0.1, 0.4)),
        "render_samples": partial(
            reflection.render_samples, glossy, samples, reflection.DualForward(dual)
        ),
    }


def seconds_of_fit(config: str, folder: Path, cache: Path) -> dict[str, float]:
    """Fit in a new process and read the seconds that its result states."""
    command = [sys.executable, "-m", "jaxrender", "fit", f"configs/{config}.yaml", "--force"]
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(cache)}
    command.append(f"output={folder / config}")
    subprocess.run(command, env=environment, check=True, capture_output=True)
    return json.loads((folder / config / "result.json").read_text(encoding="utf-8"))["seconds"]


def time_fits(warm: int):
    """Print what whole fits spend on compiling, and how long they take."""
    print(f"{'compile, whole run (s)':24s}{'cold':>16s}{'warm':>16s}{'demanded':>10s}")
    for config, demanded in CONFIGS.items():
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            seconds_of_fit(config, folder, folder / "rendering")
            runs = [seconds_of_fit(config, folder, folder / "cache") for _ in range(warm + 1)]
        cold, *others = [(run["compile"], run["total"]) for run in runs]
        medians = [statistics.median(values) for values in zip(*others)]
        texts = ["{:.2f}, {:.2f}".format(*pair) for pair in (cold, medians)]
        print(f"{config:24s}{texts[0]:>16s}{texts[1]:>16s}{demanded:10g}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--degree", type=int, default=30)
    parser.add_argument("--only", nargs="+", default=[])
    parser.add_argument("--fits", type=int, default=0, metavar="WARM")
    options = parser.parse_args()
    if options.fits:
        time_fits(options.fits)
        return
    jax.config.update("jax_enable_x64", True)
    listener = Listener()
    every = {
        name: call
        for name, call in calls(options.degree).items()
        if not options.only or name in options.only
    }
    print(f"{'':32s}{'compile s':>10s}{'first s':>9s}{'warm s':>9s}")
    worst, slowest = "", 0.0
    for name, call in every.items():
        jax.clear_caches()
        before, start = listener.seconds, time.perf_counter()
        jax.block_until_ready(call())
        first, compiling = time.perf_counter() - start, listener.seconds - before
        warm = []
        for _ in range(3):
            start = time.perf_counter()
            jax.block_until_ready(call())
            warm.append(time.perf_counter() - start)
        compiling = min(compiling, first)
        print(f"{name:32s}{compiling:10.2f}{first:9.2f}{min(warm):9.4f}", flush=True)
        if compiling > slowest:
            worst, slowest = name, compiling
    verdict = "met" if slowest <= DEMANDED else "NOT met"
    print(f"longest: {worst}, {slowest:.2f} s; demanded {DEMANDED:g}: {verdict}")


if __name__ == "__main__":
    main()
