"""Two captures of one ball in two lights, fitted alone and together.

    python experiments/two_lights.py [--seeds 20] [--paints FILE ... --probes FILE FILE]

A ball of T 6.2 is photographed by twelve cameras in a room, and again by six of them under a sky
with a lamp, with 1 % noise.  Each capture is fitted alone, then both together.  The table shows the
error that each fit states (median over seeds), the true error (rms over seeds), and the error that
was foreseen for both.  Then the same with something wrong: the second light turned by 3 degrees,
its exposures off by 4 %, and a ball of two lobes.  There the largest error is shown in units of the
one stated, for the fit of both.

Measured paints are found as a ``bank``, from twelve photographs in one light, in the other, and
from six in each.  Each is relit by a third light.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import ball_worlds
import jax
import numpy as np
from ball_worlds import TRUE, VIEWS, World, clean, photographs
from measured import photographed, table
from relit_balls import (
    NOISE,
    PIXELS,
    around,
    ball,
    columns,
    fitted,
    found_by,
    lamp,
    pictures,
    probes,
    relit,
)
from scipy.spatial.transform import Rotation

from jaxrender.brdf import Microfacet, lobe_named
from jaxrender.geometry import SurfacePlaces, SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import BRDFFit, FitSettings, KnownLight, Observations, fit_brdf, unknowns_of
from jaxrender.inverse.forecast import Situation, Supposed, forecast_material, foresee_draw
from jaxrender.lighting import DirectionalSources

NUMBERS = ("kd", "ks", "sigma", "mu")
# Every so many cameras photograph the ball again under the second light.
EVERY = 2
KIND = Microfacet(np.zeros(3), np.zeros(3), 0.1, 1.5)


class Captures(NamedTuple):
    """Photographs in two lights, each with its light, and both."""

    first: tuple[Observations, KnownLight]
    second: tuple[Observations, KnownLight]

    @property
    def both(self) -> tuple[Observations, KnownLight]:
        """Put both together."""
        (one, first), (other, second) = self
        return joined(one, other), KnownLight.joined([first, second], [one.frames, other.frames])


def joined(one: Observations, other: Observations) -> Observations:
    """Put the photographs of two captures behind each other."""

    def both(a, b):
        return None if a is None else np.concatenate([np.asarray(a), np.asarray(b)])

    places = None
    if one.places is not None and other.places is not None:
        places = SurfacePlaces(*map(both, one.places, other.places))
    return Observations(
        SurfaceSamples(*map(both, one.samples, other.samples)),
        both(one.radiance, other.radiance),
        both(one.frame, np.asarray(other.frame) + one.frames),
        places,
        pixel=both(one.pixel, other.pixel),
        eyes=both(one.eyes, other.eyes),
    )


def worlds(seed: int) -> tuple[World, World]:
    """Make a room without a lamp, and a sky with one, about the same ball."""
    room, sky = clean(seed, "interior"), clean(100 + seed, "sky")
    few = slice(None, None, EVERY)
    return (
        room._replace(irradiance=np.full(3, 1e-9)),
        sky._replace(cameras=sky.cameras[few], gains=sky.gains[few]),
    )


def told(world: World) -> KnownLight:
    sources = DirectionalSources(world.lamp[None], world.irradiance[None])
    return KnownLight(world.environment, sources)


def captures(seed: int, wrong: str = "") -> Captures:
    """Photograph the ball in both lights, with something wrong that the fit is not told."""
    room, sky = worlds(seed)
    true_room, true_sky = room, sky
    if wrong == "second light turned":
        turn = Rotation.from_rotvec(np.radians([0.0, 0.0, 3.0])).as_matrix()
        true_sky = sky._replace(turn=turn, lamp=turn @ sky.lamp)
    elif wrong == "second exposures off":
        rng = np.random.default_rng(seed)
        true_sky = sky._replace(gains=np.exp(0.04 * rng.standard_normal(len(sky.gains))))
    elif wrong == "two lobes":
        two = lobe_named("two-ggx").with_numbers({"sigma": 0.08, "spread": 4.0, "mu": 1.5})
        two = two.with_amplitudes(np.asarray(TRUE.kd), np.full(3, 0.05), np.full(3, 0.05))
        true_room, true_sky = (one._replace(material=two) for one in (room, sky))
    return Captures(
        (photographs(true_room, room, seed), told(room)),
        (photographs(true_sky, sky, 1000 + seed), told(sky)),
    )


def samples_of(light: KnownLight) -> int:
    """Refine each capture with as many samples."""
    return FitSettings().refine_samples * (2 if light.varies else 1)


def found(observations: Observations, light: KnownLight, seed: int) -> BRDFFit:
    settings = FitSettings(seed=seed, refine_samples=samples_of(light))
    shape = clean(0).shape
    unknowns = unknowns_of(KIND)
    return fit_brdf(observations, light, unknowns, KIND, settings, shape=shape, pool=observations)


def listed(parameters) -> np.ndarray:
    """List kd of the first channel, ks, sigma and mu."""
    return np.array([float(np.ravel(np.asarray(parameters.of(name)))[0]) for name in NUMBERS])


TRUTH = np.array([TRUE.kd[0], TRUE.ks[0], TRUE.sigma, TRUE.mu])


def foreseen(observations: Observations, light: KnownLight) -> np.ndarray:
    """Foresee the errors of a fit, for the samples that its last step takes."""
    situation = Situation(observations.samples, np.asarray(observations.frame), light)
    supposed = Supposed(TRUE, NoiseModel(ball_worlds.NOISE, 0.0))
    count = samples_of(light)
    forecast = forecast_material(foresee_draw(situation, supposed, count), explain=False)
    return listed(forecast.parameters.standard_error)


def right_model(seeds: int):
    """Print stated, true and foreseen errors where the model is right."""
    rows = {name: [] for name in ("first", "second", "both")}
    expected = []
    for seed in range(seeds):
        made = captures(seed)
        for name in rows:
            fit = found(*getattr(made, name), seed)
            stated, value = fit.parameters.standard_error, fit.parameters.value
            rows[name].append((listed(stated), listed(value) / TRUTH - 1))
        expected.append(foreseen(*made.both))
    print(f"errors in per cent, {seeds} seeds: stated, true")
    print(f"{'':8s}" + "".join(f"{name:>18s}" for name in NUMBERS))
    for name, every in rows.items():
        stated = np.median([one for one, _ in every], axis=0) / TRUTH
        true = np.sqrt(np.mean([off**2 for _, off in every], axis=0))
        cells = "".join(f"{100 * a:10.3f} {100 * b:7.3f}" for a, b in zip(stated, true))
        print(f"{name:8s}{cells}")
    cells = "".join(f"{100 * one:10.3f} {'':7s}" for one in np.median(expected, axis=0) / TRUTH)
    print(f"foreseen{cells}")


def wrong_models(seeds: int):
    """Print how far the truth is from what both captures tell, where something is wrong."""
    print("something is wrong: off in stated errors (median, largest), and what is named first")
    for wrong in ("second light turned", "second exposures off", "two lobes"):
        off, named = [], []
        for seed in range(max(1, seeds // 4)):
            fit = found(*captures(seed, wrong).both, seed)
            stated, value = fit.parameters.standard_error, fit.parameters.value
            # Two lobes have no ks and sigma of one.
            kept = slice(0, 1) if wrong == "two lobes" else slice(None)
            off.append(np.max((np.abs(listed(value) - TRUTH) / listed(stated))[kept]))
            named.append(fit.diagnosis[0].cause if fit.diagnosis else fit.outcome.value)
        counts = ", ".join(f"{name} {named.count(name)}" for name in dict.fromkeys(named))
        print(f"  {wrong:22s} {np.median(off):5.1f} {np.max(off):5.1f}   {counts}")


def paints(files: list[Path], images: list[Path], convention: str):
    """Print how well paints are relit, from one light, the other, and both."""
    one, other = probes(images, convention)
    lights = {
        "first": KnownLight(one, lamp([1.0, -1.0, 1.2], 1.5)),
        "second": KnownLight(other, lamp([-1.0, -0.6, 0.8], 1.5)),
    }
    third = KnownLight(one.turned(np.diag([-1.0, -1.0, 1.0])), lamp([0.2, -1.0, 0.4], 3.0))
    for path in files:
        truth = table(str(path))
        view, frame = pictures(1)
        expected = photographed(truth, view, frame, third)
        taken = {}
        for name, light in lights.items():
            samples, number = ball(around(VIEWS), PIXELS, 0)
            exact = photographed(truth, samples, number, light)
            noise = np.random.default_rng(2).standard_normal(exact.shape)
            taken[name] = Observations(samples, exact * (1 + NOISE * noise), number)
        half = {
            name: own.take(np.flatnonzero(np.asarray(own.frame) % 2 == at))
            for at, (name, own) in enumerate(taken.items())
        }
        halves = [own._replace(frame=np.asarray(own.frame) // 2) for own in half.values()]
        both = KnownLight.joined([*lights.values()], [VIEWS // 2, VIEWS // 2])
        tried = {name: (taken[name], light) for name, light in lights.items()}
        tried["six each"] = (joined(*halves), both)
        for name, (observations, light) in tried.items():
            fit = fitted("bank", observations, light)
            again = relit(fit, expected, columns(found_by(fit), view, frame, third))
            print(
                f"{path.stem}, {name:8s}: left {100 * fit.final.relative_rms:5.2f} %, relit "
                f"{again.rms:5.1f} % rms, {again.median:5.1f} % median, over stated "
                f"{again.stated:4.1f}"
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--paints", nargs="*", type=Path, default=[])
    parser.add_argument("--probes", type=Path, nargs=2, default=[])
    parser.add_argument("--convention", default="cross")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    right_model(options.seeds)
    wrong_models(options.seeds)
    paints(options.paints, options.probes, options.convention)


if __name__ == "__main__":
    main()
