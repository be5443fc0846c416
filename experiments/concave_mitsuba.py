"""Concave objects photographed by Mitsuba 3; material recovered, light known or unknown.

    python experiments/concave_mitsuba.py [--meshes FILE ...] [--probes FILE ...] [--unknown]
                                          [--distribution ggx] [--spp 4096]

Every mesh under every probe (vertical crosses); without ``--meshes`` the object is the project's
sculpture, without ``--probes`` the light is drawn by ``scenes.py``.  Four photographs are rendered
with direct light only (``mitsuba_scenes.py``) under an image of 256 rows.  Given are mesh, cameras
and photographs, and under known light 128 rows of the image; what is fitted is the model that was
rendered, and that the two are the same is checked first.  With ``--unknown`` the light is found as
well.  Demanded: roughness within 10 %, albedo within 3 %: pi kd + ks of each channel under known
light; kd / (kd + ks) under unknown light, where each channel's scale is a gauge.  The fit without
shadows is printed beside it.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import mitsuba_scenes
import numpy as np
import scenes

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Shape, SurfacePlaces, SurfaceSamples, SurfaceView, observe
from jaxrender.geometry.sculpture import sculpture
from jaxrender.imaging import erode
from jaxrender.inverse import FitSettings, KnownLight, Observations, fit_brdf, unknowns_of
from jaxrender.inverse.factorization import FactorSettings, factorize
from jaxrender.inverse.observations import random_subset
from jaxrender.io import read_environment, read_mesh
from jaxrender.lighting import DirectionalSources, Environment

DEMANDED_ROUGHNESS, DEMANDED_ALBEDO = 0.10, 0.03
SAMPLES, UNKNOWN_LIGHT_SAMPLES, LOWEST_COSINE = 8000, 4000, 0.15


class Row(NamedTuple):
    """One fit: of what, how, its relative errors and residual, and what it said."""

    what: str
    how: str
    roughness: float
    albedo: float
    residual: float
    said: str
    seconds: float

    @property
    def met(self) -> bool:
        """Whether both errors are within what is demanded."""
        return self.roughness <= DEMANDED_ROUGHNESS and self.albedo <= DEMANDED_ALBEDO


def observations(what: mitsuba_scenes.Object, images: list[np.ndarray]) -> Observations:
    """Trace the pixels and gather those that are usable."""
    parts = []
    for number, (camera, image) in enumerate(zip(mitsuba_scenes.cameras(what.mesh), images)):
        view = observe(camera, what.mesh)
        usable = erode(view.hit, 2) & (view.exit_cosines > LOWEST_COSINE) & _smooth(view)
        arrays = (view.normals, view.outgoing, image, view.points, view.geometric_normals)
        parts.append([a[usable] for a in arrays] + [np.full(usable.sum(), number)])
    normals, outgoing, radiance, points, geometric, frame = (
        np.concatenate(arrays) for arrays in zip(*parts)
    )
    places = SurfacePlaces(points, geometric)
    return Observations(SurfaceSamples(normals, outgoing), radiance, frame, places)


def _smooth(view: SurfaceView) -> np.ndarray:
    """Leave out pixels across which one part of the object ends before another."""
    jump = np.zeros(view.hit.shape)
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(view.points, axis=axis), axis=-1)
        pad = [(0, 0), (0, 0)]
        for side in ((1, 0), (0, 1)):
            pad[axis] = side
            jump = np.maximum(jump, np.pad(step, pad))
    usual = np.median(jump[view.hit])
    return erode(view.hit & (jump < 6 * usual), 1)


def known_light(
    what: mitsuba_scenes.Object, seen: Observations, shape: Shape | None
) -> tuple[Microfacet, float, str]:
    """Fit the material under the probe, halved in resolution.

    A pixel across which a shadow ends is the mean of what its middle is not: losses that outliers
    do not rule.
    """
    light = KnownLight(scenes.coarser(what.light), DirectionalSources.none())
    truth = mitsuba_scenes.material(what.distribution)
    unknowns = unknowns_of(truth, ks_per_channel=True)
    some = random_subset(seen, SAMPLES, 0)
    settings = FitSettings(starts=4, loss="huber")
    fit = fit_brdf(some, light, unknowns, truth, settings, shape=shape)
    assert isinstance(fit.brdf, Microfacet)
    return fit.brdf, fit.final.relative_rms, fit.outcome.value


def unknown_light(
    what: mitsuba_scenes.Object, seen: Observations, shape: Shape | None
) -> tuple[Microfacet, float, str]:
    """Find light and material together."""
    truth = mitsuba_scenes.material(what.distribution)
    some = random_subset(seen, UNKNOWN_LIGHT_SAMPLES, 0)
    found = factorize(some, truth, FactorSettings(), shape=shape)
    said = "; ".join([found.outcome.value, *found.reasons])
    assert isinstance(found.brdf, Microfacet)
    return found.brdf, found.relative_rms, said


def albedo(brdf: Microfacet) -> np.ndarray:
    """What is reflected of light in all directions: pi kd + ks, as the thesis's ks has it."""
    return np.pi * np.asarray(brdf.kd) + np.asarray(brdf.ks)


def share(brdf: Microfacet) -> np.ndarray:
    """What no light's scale changes: kd / (kd + ks)."""
    kd, ks = np.asarray(brdf.kd), np.asarray(brdf.ks)
    return kd / (kd + ks)


WAYS: dict[str, tuple[Callable, Callable]] = {
    "known": (known_light, albedo),
    "unknown": (unknown_light, share),
}


def fits(what: mitsuba_scenes.Object, seen: Observations, name: str, ways: list[str]) -> list[Row]:
    """Fit with and without shadows in every way asked for."""
    truth, rows = mitsuba_scenes.material(what.distribution), []
    for way in ways:
        fit, compared = WAYS[way]
        for shape, suffix in ((what.mesh, ""), (None, ", no shadows")):
            start = time.perf_counter()
            found, residual, said = fit(what, seen, shape)
            taken = time.perf_counter() - start
            rough = abs(float(found.sigma) / mitsuba_scenes.ROUGHNESS - 1)
            off = float(np.max(np.abs(compared(found) / compared(truth) - 1)))
            rows.append(Row(name, way + suffix, rough, off, residual, said, taken))
            print(line(rows[-1]), flush=True)
    return rows


def line(row: Row) -> str:
    """One row of the table."""
    verdict = "" if "no shadows" in row.how else ("met" if row.met else "MISSED")
    return (
        f"{row.what:34s} {row.how:20s} {row.roughness:8.1%} {row.albedo:8.1%} "
        f"{row.residual:9.2%} {row.seconds:5.0f}  {verdict:6s} {row.said[:70]}"
    )


def report(rows: list[Row]) -> None:
    """Print all rows again, with what is demanded above them."""
    print(f"\n{'':34s} {'light':20s} {'rough':>8s} {'albedo':>8s} {'residual':>9s} {'s':>5s}")
    print(f"{'demanded':55s} {DEMANDED_ROUGHNESS:8.1%} {DEMANDED_ALBEDO:8.1%}")
    for row in rows:
        print(line(row))
    judged = [row for row in rows if "no shadows" not in row.how]
    print(f"{sum(row.met for row in judged)} of {len(judged)} fits within what is demanded")


def meshes_of(paths: list[Path]) -> dict:
    """Meshes by name."""
    return {path.stem: read_mesh(path) for path in paths} or {"sculpture": sculpture(5)}


def lights_of(paths: list[Path]) -> dict[str, Environment]:
    """Probes by name, of mean radiance one."""
    found = {}
    for path in paths:
        light = read_environment(path, "cross", height=scenes.FINE_ROWS)
        mean = float(np.mean(np.asarray(light.radiance)))
        found[path.stem] = Environment(np.asarray(light.radiance) / mean)
    return found or {"interior": scenes.probe("interior", 3)}


def main() -> None:
    """Render, fit and print."""
    parser = argparse.ArgumentParser(description="Mitsuba photographs, jaxrender fits")
    parser.add_argument("--meshes", type=Path, nargs="*", default=[])
    parser.add_argument("--probes", type=Path, nargs="*", default=[])
    parser.add_argument("--distribution", choices=("beckmann", "ggx"), default="ggx")
    parser.add_argument("--unknown", action="store_true", help="find the light as well")
    parser.add_argument("--spp", type=int, default=4096)
    given = parser.parse_args()
    try:
        import mitsuba as mi
    except ImportError:
        print("skipped: Mitsuba 3 is not installed (extra 'peers')")
        return
    mi.set_variant("scalar_rgb")
    jax.config.update("jax_enable_x64", True)
    mitsuba_scenes.check_directions(mi)
    same, masked = mitsuba_scenes.check_material(mi, given.distribution)
    print(
        f"our {given.distribution} off Mitsuba's by {same:.1e}, Smith's masking in Mitsuba's form,"
    )
    print(f"and by {masked:.1%} at worst in ours")
    ways, rows = ["known"] + ["unknown"] * given.unknown, []
    for mesh_name, mesh in meshes_of(given.meshes).items():
        for light_name, light in lights_of(given.probes).items():
            what = mitsuba_scenes.Object(mesh, light, given.distribution)
            seen = observations(what, mitsuba_scenes.photographs(mi, what, given.spp))
            rows += fits(what, seen, f"{mesh_name} under {light_name}", ways)
    report(rows)


if __name__ == "__main__":
    main()
