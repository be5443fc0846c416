"""Light of any kind and material from photographs alone: is the truth inside, from any start?

    python experiments/any_light.py [--seeds 2] [--starts 0.06 0.25] [--windows]

A ball is photographed from twelve sides by the integral over all texels, with 1 % noise.  The light
is of degree 0 to 4 with none to three sources; with ``--windows`` it is a room of wide windows and
no source (``scenes.py``).  Sigma is drawn from .08 to .3 (.06 to .35 with ``--windows``), kd is
.12, .17, .21, ks .1 and mu 1.5.  Neither light nor material is told.  Each world is fitted from
every start of sigma.

Printed for each fit: sigma, mu and ks / (kd + ks) in standard errors off the truth, the sources
found and there, what is left, and how it ended.  Demanded: below 3.5 standard errors in 99 % of the
fits under smooth light with sources, in 95 % of those under windows; or not identifiable.
"""

import argparse
import time
from typing import NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import ball_worlds  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import scenes  # noqa: E402

from jaxrender.brdf import WIDTH_BOUNDS, Microfacet  # noqa: E402
from jaxrender.geometry import world_from_local  # noqa: E402
from jaxrender.harmonics import LatLongGrid, coefficient_count, evaluate  # noqa: E402
from jaxrender.inverse import Observations, Unknown  # noqa: E402
from jaxrender.inverse.factorization import Factorization, Known, factorize  # noqa: E402
from jaxrender.inverse.leverage import draw, sharpness  # noqa: E402
from jaxrender.lighting import Environment  # noqa: E402

SAMPLES = 12_000
MOST_OFF = 3.5
DEMANDED = {"smooth": 0.99, "windows": 0.95}


class World(NamedTuple):
    """What is photographed: its name, slow light, sources and material."""

    name: str
    environment: Environment
    directions: np.ndarray
    irradiance: np.ndarray
    material: Microfacet


def material(sigma: float) -> Microfacet:
    return Microfacet(np.array([0.12, 0.17, 0.21]), np.full(3, 0.1), sigma, 1.5)


def smooth_world(degree: int, sources: int, seed: int) -> World:
    """Draw positive light of a degree, and sources at least 45 degrees apart."""
    rng = np.random.default_rng([degree, sources, seed])
    directions = LatLongGrid(ball_worlds.ROWS, 2 * ball_worlds.ROWS).directions()
    light = np.zeros((*directions.shape[:-1], 3))
    if degree:
        count = coefficient_count(degree)
        coefficients = rng.normal(size=(count, 1)) + 0.3 * rng.normal(size=(count, 3))
        coefficients[0] = 0
        light = np.asarray(evaluate(coefficients, directions))
        light = light / np.abs(light).max() * rng.uniform(0.5, 0.95)
    towards: list[np.ndarray] = []
    while len(towards) < sources:
        one = scenes.unit(rng.normal(size=3) + np.array([0, 0, 1.0]))
        if all(one @ other < np.cos(np.radians(45)) for other in towards):
            towards.append(one)
    colour = np.array([1, 0.9, 0.8])
    return World(
        f"degree {degree}, {sources} sources",
        Environment((1 + light) * colour),
        np.array(towards).reshape(-1, 3),
        rng.uniform(1, 3, (sources, 1)) * colour,
        material(float(np.exp(rng.uniform(np.log(0.08), np.log(0.3))))),
    )


def window_world(seed: int) -> World:
    """Draw a room of wide windows."""
    environment = scenes.probe("soft boxes", seed, ball_worlds.ROWS)
    radiance = np.asarray(environment.radiance)
    sigma = float(np.exp(np.random.default_rng(seed).uniform(np.log(0.06), np.log(0.35))))
    none = np.zeros((0, 3))
    return World("windows", Environment(radiance / radiance.mean()), none, none, material(sigma))


def photographed(world: World, seed: int) -> Observations:
    """Photograph a world from twelve sides, with noise."""
    plain = ball_worlds.clean(seed)._replace(
        environment=world.environment, material=world.material, irradiance=np.zeros(3)
    )
    pool = ball_worlds.photographs(plain, plain, seed)
    assert pool.places is not None
    normals, outgoing = (np.asarray(part) for part in pool.samples)
    exact = ball_worlds.integrated(plain, world.material, pool.places.points, normals, outgoing)
    frames = np.asarray(world_from_local(jnp.asarray(normals)))
    seen = np.einsum("sji,sj->si", frames, outgoing)
    for direction, irradiance in zip(world.directions, world.irradiance):
        incoming = np.einsum("sji,j->si", frames, direction)
        rho = np.asarray(world.material.evaluate(jnp.asarray(incoming), jnp.asarray(seen)))
        exact = exact + rho * np.maximum(incoming[:, 2:], 0) * irradiance
    rng = np.random.default_rng([3000, seed])
    return pool._replace(radiance=exact * (1 + ball_worlds.NOISE * rng.normal(size=exact.shape)))


class Fit(NamedTuple):
    """How far a fit is off, in standard errors, and what it says."""

    world: World
    start: float | None
    found: Factorization
    seconds: float

    @property
    def judged(self) -> ball_worlds.Judged:
        """The fit beside the truth."""
        return ball_worlds.Judged(self.found, self.world.material)

    @property
    def honest(self) -> bool:
        """Whether it states no error that is much too small."""
        return self.judged.honest(MOST_OFF)

    def line(self) -> str:
        """Say it in a line."""
        off, true = self.judged.off, self.world.material
        return (
            f"{self.world.name:22s} start {self.start or 0:4.2f}  sigma {true.sigma:.3f} "
            f"{float(self.found.brdf.sigma):.4f}  off {off['sigma']:5.1f} {off['mu']:5.1f} "
            f"{off['ks']:5.1f}  sources {len(self.found.scene.sources.directions):2d} of "
            f"{len(self.world.directions)}  left {100 * self.found.relative_rms:.2f} %  "
            f"{self.found.outcome.value}{'' if self.honest else '  WRONG'}  {self.seconds:.1f} s"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--starts", type=float, nargs="*", default=[0.06, 0.25])
    parser.add_argument("--windows", action="store_true")
    asked = parser.parse_args()
    if asked.windows:
        worlds = [(window_world(seed), seed) for seed in range(asked.seeds)]
    else:
        worlds = [
            (smooth_world(degree, sources, seed), seed)
            for degree in range(5)
            for sources in range(4)
            for seed in range(asked.seeds)
        ]
    fits = []
    for world, seed in worlds:
        pool = photographed(world, seed)
        some = draw(pool, sharpness(pool), SAMPLES, 0).observations
        for start in asked.starts:
            begun = time.perf_counter()
            known = Known(sigma=Unknown(None, *WIDTH_BOUNDS, start=start))
            found = factorize(some, world.material, known=known, pool=pool)
            fits.append(Fit(world, start, found, time.perf_counter() - begun))
            print(fits[-1].line(), flush=True)
    kind = "windows" if asked.windows else "smooth"
    honest = np.mean([fit.honest for fit in fits])
    same = [fit for fit in fits if len(fit.found.scene.sources.directions) == len(fit.world[2])]
    print(f"the truth within {MOST_OFF} standard errors, or not identifiable:")
    print(f"  {100 * honest:.0f} % of {len(fits)} (demanded {100 * DEMANDED[kind]:.0f} %)")
    print(f"  as many sources found as there are: {len(same)} of {len(fits)}")
    print(f"  median seconds {np.median([fit.seconds for fit in fits]):.1f}")


if __name__ == "__main__":
    main()
