"""T table 5.2, measured: five forms of one reflected light field B(R, o).

    python experiments/table_5_2.py [PROBE --convention cross] [--sigma 0.2]

The simplified microfacet of T 5.34 (F = 12, P = 3) under a light cut at F.  Beside the thesis's yes
and no stand bytes in float32 (*compact*), microseconds a pixel (*rendering*), seconds to compute
the form from light and BRDF (*speed*; a compressed or factored form needs the dense table first)
and the relative rms error, against the sum over all texels of the light, of pixels seen from
directions that no table holds.  *Analysis* is whether the error was known before the dense light
field was.

Tabular: 10 x 10 viewers, bilinear between them.  Compressed: that table by vector quantisation,
256 viewer vectors (k-means).  Factored: its four strongest principal components.  Coefficients:
L_lm rho_lpq alone, summed at each pixel.  SHRM: the global map.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scenes import unit
from scipy.cluster.vq import kmeans2

from jaxrender.geometry import world_from_local
from jaxrender.harmonics import LatLongGrid, analyse, looked_up, over_poles, real_basis, synthesise
from jaxrender.io import read_environment
from jaxrender.reflection import (
    LocalShrm,
    central_coefficients,
    global_shrm,
    local_shrm,
)
from jaxrender.spectra import FacetLobe, central_spectrum

F, P, ROWS, VIEWERS, CODES, COMPONENTS = 12, 3, 64, 10, 256, 4
THESIS = {
    "tabular": "Yes No Yes No No",
    "compressed": "No Yes Maybe * No",
    "factored": "Yes Yes Yes * No",
    "coefficients": "Yes Yes No Yes Yes",
    "SHRM": "Yes Yes Yes Yes Yes",
}


def timed(call: Callable, runs: int = 5):
    """The result, and the median of the warm runs in seconds."""
    found = jax.block_until_ready(call())
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return found, float(np.median(times))


class EvenViewers(eqx.Module):
    """A table over viewers on an even grid of polar angle and azimuth, bilinear in both."""

    values: jax.Array  # [viewer row, viewer column, row, column, channel]

    def at(self, centres: jax.Array, outgoing: jax.Array) -> jax.Array:
        """Interpolate between the four nearest viewers."""
        local = LocalShrm.viewer(_PLAIN, centres, outgoing)
        rows, columns = self.values.shape[:2]
        place = jnp.arccos(jnp.clip(local[:, 2], -1, 1)) * (rows / np.pi) - 0.5
        upper = jnp.clip(jnp.floor(place), 0, rows - 2)
        down = jnp.clip(place - upper, 0, 1)[:, None]
        turn = jnp.arctan2(local[:, 1], local[:, 0]) * (columns / (2 * np.pi))
        left = jnp.floor(turn)
        right = (turn - left)[:, None]
        found = jnp.zeros((len(centres), self.values.shape[-1]), self.values.dtype)
        flat = self.values.reshape(rows * columns, *self.values.shape[2:])
        texels = jnp.stack([looked_up(over_poles(one), centres) for one in flat])
        each = np.arange(len(centres))
        for row, share in ((upper, 1 - down), (upper + 1, down)):
            for column, part in ((left, 1 - right), (left + 1, right)):
                index = row.astype(int) * columns + column.astype(int) % columns
                found = found + share * part * texels[index, each]
        return found


_PLAIN = LocalShrm(np.zeros((2, 2, 1, 1)), LatLongGrid(2, 2), 0)


def even_viewers() -> np.ndarray:
    polar = (np.arange(VIEWERS) + 0.5) * np.pi / VIEWERS
    azimuth = np.arange(VIEWERS) * 2 * np.pi / VIEWERS
    polar, azimuth = np.meshgrid(polar, azimuth, indexing="ij")
    sine = np.sin(polar)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)], axis=-1)


def truth(light, samples, sigma: float) -> np.ndarray:
    """Sum over the texels of a fine image of the light: T 5.34 with its horizon."""
    grid = LatLongGrid(96, 192)
    radiance = np.asarray(synthesise(grid, light), float).reshape(-1, 3)
    nodes = grid.directions().reshape(-1, 3)
    energy = grid.weights().reshape(-1, 1) * radiance
    centres, outgoing = samples
    normals = unit(centres + outgoing)
    found = np.empty((len(centres), 3))
    for k, (normal, view) in enumerate(zip(normals, outgoing)):
        half = unit(nodes + view)
        lobe = np.exp(-((np.arccos(np.clip(half @ normal, -1, 1)) / sigma) ** 2))
        found[k] = np.where(nodes @ normal > 0, lobe, 0) @ energy / (4 * np.pi * sigma**2)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("probe", type=Path, nargs="?")
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--sigma", type=float, default=0.2)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    if options.probe is None:
        directions = LatLongGrid(128, 256).directions()
        image = 0.2 + 5 * np.exp((directions @ [0.6, 0.48, 0.64] - 1) * 40)[..., None]
        image = image * [1.0, 0.9, 0.8]
    else:
        image = np.asarray(read_environment(options.probe, options.convention).radiance)
    image = jnp.asarray(image, jnp.float32)
    grid, lobe = LatLongGrid(ROWS, 2 * ROWS), FacetLobe(jnp.float32(options.sigma))

    @eqx.filter_jit
    def spectrum():
        return central_spectrum(lobe, (F, P), *lobe.extent, weighted=True)

    rho = spectrum()
    # T 5.34 is the weighted transfer itself: not divided by the exit cosine again.
    rho = type(rho)(rho.coefficients, rho.energy, False)

    @eqx.filter_jit
    def coefficients(image):
        return analyse(LatLongGrid(*image.shape[:2]), image, F)

    light = coefficients(image)
    centres, outgoing = unit(rng.standard_normal((2, 4000, 3)))
    samples = tuple(jnp.asarray(a, jnp.float32) for a in (centres, outgoing))
    exact = truth(np.asarray(light, float), (centres, outgoing), options.sigma)

    @eqx.filter_jit
    def prefiltered(image):
        return local_shrm(coefficients(image), rho, grid)

    basis = jnp.asarray(real_basis(jnp.asarray(even_viewers()), P), jnp.float32)

    @eqx.filter_jit
    def dense(image):
        return jnp.einsum("tfk,rckd->tfrcd", basis, prefiltered(image).maps)

    local, shrm_s = timed(lambda: prefiltered(image))
    whole, turned_s = timed(lambda: global_shrm(local))
    table, dense_s = timed(lambda: dense(image))
    rows = np.moveaxis(np.asarray(table), (2, 3), (0, 1)).reshape(ROWS * 2 * ROWS, -1)
    start = time.perf_counter()
    codes, labels = kmeans2(rows, CODES, iter=8, minit="points", seed=1)
    quantised_s = dense_s + time.perf_counter() - start
    shape = (ROWS, 2 * ROWS, *np.asarray(table).shape[:2], 3)
    quantised = np.moveaxis(codes[labels].reshape(shape), (0, 1), (2, 3))
    start = time.perf_counter()
    by_viewer = np.moveaxis(rows.reshape(-1, VIEWERS**2, 3), 1, 2).reshape(-1, VIEWERS**2)
    kept = np.linalg.eigh(by_viewer.T @ by_viewer)[1][:, -COMPONENTS:]
    factored_s = dense_s + time.perf_counter() - start
    rebuilt = ((by_viewer @ kept) @ kept.T).reshape(-1, 3, VIEWERS**2).swapaxes(1, 2)
    factored = np.moveaxis(rebuilt.reshape(shape), (0, 1), (2, 3))

    def frames(centres):
        return world_from_local(centres)

    def by_coefficients(centres, outgoing):
        turned = frames(centres)
        maps = central_coefficients(light, rho, turned)
        around = real_basis(jnp.einsum("xij,xi->xj", turned, outgoing), P)
        return jnp.einsum("xkc,xk->xc", maps, around)

    texels, number = ROWS * 2 * ROWS * 3, 4
    forms = {
        "tabular": (VIEWERS**2 * texels, dense_s, EvenViewers(table).at),
        "compressed": (
            codes.size + len(labels) / number,
            quantised_s,
            EvenViewers(jnp.asarray(quantised)).at,
        ),
        "factored": (
            COMPONENTS * (texels + VIEWERS**2),
            factored_s,
            EvenViewers(jnp.asarray(factored)).at,
        ),
        "coefficients": (light.size + rho.coefficients.size, 0.0, by_coefficients),
        "SHRM": ((P + 1) ** 2 * texels, shrm_s + turned_s, whole.at),
    }
    _, light_s = timed(lambda: coefficients(image))
    _, brdf_s = timed(spectrum)
    print(f"F = {F}, P = {P}, {ROWS} x {2 * ROWS} texels, sigma {options.sigma}")
    print(
        f"light's coefficients {1e3 * light_s:.1f} ms, BRDF's {1e3 * brdf_s:.1f} ms, in all forms"
    )
    print(
        f"{'':14s}{'simple compact render analysis speed':>38s}{'KiB':>9s}{'us a pixel':>12s}"
        f"{'seconds':>10s}{'error %':>9s}  error known before"
    )
    for name, (size, seconds, at) in forms.items():
        call = eqx.filter_jit(at)
        found, each = timed(lambda call=call: call(*samples))
        error = np.sqrt(np.sum((np.asarray(found) - exact) ** 2) / np.sum(exact**2))
        thesis = "".join(f"{word:>7s}" for word in THESIS[name].split())
        before = "yes" if name in ("coefficients", "SHRM") else "no"
        print(
            f"{name:14s}{thesis:>38s}{size * number / 1024:9.0f}{1e6 * each / len(centres):12.2f}"
            f"{seconds:10.4f}{100 * error:9.2f}  {before}"
        )


if __name__ == "__main__":
    main()
