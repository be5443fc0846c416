"""Whole BRDFs from few measurements, by what measured materials have in common.

    python experiments/learned_materials.py (--materials FOLDER | --networks ZIP) [--held-out 20]
        [--paints FILE ...] [--components 40]

``--materials`` is a folder of MERL files; of ``--networks`` (small ones fitted to MERL) such files
are made first.  A part of the materials is held out.  Each is measured at 5, 10 and 20 pairs that
``next_pairs`` chooses, and at 20 and 200 drawn at random, half of them near the mirror direction,
with 3 % noise.  Printed are the error of the completed table (root mean square of the cube root,
cosines included: median and 90th percentile over materials and channels), the share of its entries
off by more than 1.645 stated errors (10 % for an honest one), and the error of the nearest GGX lobe
of all.  Paints are measured where the file's pairs are nearest to the chosen ones, and judged by
all others.
"""

import argparse
import tempfile
import zipfile
from pathlib import Path

import jax
import numpy as np
from measured import network
from scenes import unit

from jaxrender.brdf import BRDF, IsotropicTable
from jaxrender.brdf.tables.isotropic import half_difference, node_angles, pair_at
from jaxrender.brdf.tables.learned import LearnedMaterials, learn_materials, node_cosines
from jaxrender.brdf.tables.measurements import Measurements, errors_of
from jaxrender.geometry import Components
from jaxrender.inverse import best_models
from jaxrender.inverse.completion import complete, next_pairs
from jaxrender.io import MerlTable, read_merl, write_merl
from jaxrender.io.merl import DIMENSIONS, SCALES, map_merl
from jaxrender.pipelines.brdf_sources import measurements_of

NOISE, LOWEST_COSINE = 0.03, 0.15
Pairs = tuple[np.ndarray, np.ndarray]


def tabulated(archive: zipfile.ZipFile, folder: Path) -> None:
    """Write a MERL file of each network."""
    incoming, outgoing = pair_at(node_angles(DIMENSIONS))
    above = (incoming[..., 2] > 0) & (outgoing[..., 2] > 0)
    for name in sorted(n for n in archive.namelist() if n.endswith(".h5")):
        raw = np.full((3, *DIMENSIONS), -1.0)
        raw[:, above] = (network(archive, name)(incoming[above], outgoing[above]) / SCALES).T
        write_merl(folder / f"{Path(name).stem}.binary", MerlTable(raw))


def drawn(count: int, rng: np.random.Generator) -> Pairs:
    found = []
    for _ in range(2):
        height, azimuth = rng.uniform(LOWEST_COSINE, 1, count), rng.uniform(0, 2 * np.pi, count)
        across = np.sqrt(1 - height**2)
        found.append(np.stack([across * np.cos(azimuth), across * np.sin(azimuth), height], 1))
    incoming, outgoing = found
    near = unit(incoming * [-1, -1, 1] + 0.1 * rng.normal(size=(count, 3)))
    half = (np.arange(count) % 2 == 0) & (near[:, 2] > LOWEST_COSINE)
    return incoming, np.where(half[:, None], near, outgoing)


def values_at(brdf: BRDF, pairs: Pairs) -> np.ndarray:
    return np.asarray(jax.jit(lambda i, o: brdf.evaluate(i, o))(*pairs), float)


def held_out(learned: LearnedMaterials, files: list[Path]) -> None:
    rng = np.random.default_rng(0)
    chosen = {f"{n} chosen": next_pairs(learned, n)[:2] for n in (5, 10, 20)}
    ways = chosen | {f"{n} drawn": drawn(n, rng) for n in (20, 200)}
    cosine = node_cosines(learned.shape)[learned.known.ravel(), None]
    errors: dict[str, list[np.ndarray]] = {way: [] for way in (*ways, "nearest GGX")}
    beyond: dict[str, list[np.ndarray]] = {way: [] for way in ways}
    for file in files:
        brdf = read_merl(file).brdf()
        truth = np.asarray(brdf.values)[learned.known]
        lobe = IsotropicTable.of(best_models(brdf, ["ggx"])[0].brdf, learned.shape)
        errors["nearest GGX"].append(off(np.asarray(lobe.values)[learned.known], truth, cosine))
        for way, pairs in ways.items():
            values = values_at(brdf, pairs)
            noisy = values * (1 + NOISE * rng.normal(size=values.shape))
            found = complete(learned, Measurements(*pairs, noisy), NOISE)
            ours = np.asarray(found.brdf.values)[learned.known]
            stated = found.relative_error[learned.known] * np.maximum(ours, 1e-3 / cosine)
            errors[way].append(off(ours, truth, cosine))
            beyond[way].append(np.mean(np.abs(ours - truth) > 1.645 * stated, axis=0))
    for way, found in errors.items():
        print(
            f"{way:12s} {100 * np.median(found):5.1f} {100 * np.quantile(found, 0.9):5.1f} %"
            + (f"; beyond {100 * np.mean(beyond[way]):4.1f} %" if way in beyond else ""),
            flush=True,
        )


def off(ours: np.ndarray, truth: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    roots = [np.cbrt(values * cosine) for values in (ours, truth)]
    return np.sqrt(np.sum((roots[0] - roots[1]) ** 2, axis=0) / np.sum(roots[1] ** 2, axis=0))


def paint(learned: LearnedMaterials, path: Path) -> None:
    whole = measurements_of(str(path))
    assert whole is not None
    nearest = best_models(whole, ["ggx"], folds=0)[0].brdf
    own = np.stack(half_difference(*(Components.of(part) for part in whole[:2])), 1)
    for count in (5, 10, 20, 100):
        chosen = next_pairs(learned, count)
        wanted = np.stack(half_difference(*(Components.of(part) for part in chosen[:2])), 1)
        # Differences of the half angle matter most: a lobe is narrow in it.
        apart = (own[None] - wanted[:, None]) * [4, 1, 1]
        used = np.zeros(len(own), bool)
        for row in np.sum(apart**2, axis=2):
            used[np.argmin(np.where(used, np.inf, row))] = True
        seen, others = whole.rows(used), whole.rows(~used)
        found = complete(learned, seen)
        error = errors_of(values_at(found.brdf, others[:2]), others)["cube-root"]
        lobe = errors_of(values_at(nearest, others[:2]), others)["cube-root"]
        print(
            f"{path.stem:12s} {count:4d} of {len(own)} pairs: the others off by {100 * error:5.1f} "
            f"%; by the GGX nearest to all {100 * lobe:5.1f} %",
            flush=True,
        )


def main():
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--materials", type=Path)
    source.add_argument("--networks", type=Path)
    parser.add_argument("--held-out", type=int, default=20)
    parser.add_argument("--paints", type=Path, nargs="+", default=[])
    parser.add_argument("--components", type=int, default=40)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    with tempfile.TemporaryDirectory() as made:
        folder = options.materials
        if folder is None:
            folder = Path(made)
            with zipfile.ZipFile(options.networks) as archive:
                tabulated(archive, folder)
        files = sorted(folder.glob("*.binary"))
        order = np.random.default_rng(0).permutation(len(files))
        apart = [files[k] for k in sorted(order[: options.held_out])]
        rest = [files[k] for k in sorted(order[options.held_out :])]
        learned = learn_materials([map_merl(f) for f in rest], SCALES, options.components)
        print(f"{len(rest)} materials learnt, {len(apart)} held out; errors: median, 90 %")
        if apart:
            held_out(learned, apart)
        for path in options.paints:
            paint(learned, path)


if __name__ == "__main__":
    main()
