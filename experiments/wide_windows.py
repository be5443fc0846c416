"""Rooms of wide windows and no lamp, light and material unknown: do the errors hold the truth?

    python experiments/wide_windows.py [--seeds 4] [--sigmas 0.06 0.1 0.2 0.35] [--views 6 12 24]

A ball is photographed in a dim room with three to five round windows of 5 to 15 degrees' radius,
by the integral, with 1 % noise.  A wide window and a wide gloss look alike.

Printed for each fit: sigma, mu and ks / (kd + ks) in standard errors off the truth, the sources
found (those with a width), what is left, and how it ended.  Demanded: below 3.5 standard errors in
95 %, or not identifiable.
"""

import argparse
import time
from typing import NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from ball_worlds import Judged  # noqa: E402
from scenes import unit  # noqa: E402

from jaxrender.brdf import Microfacet  # noqa: E402
from jaxrender.geometry import SurfaceSamples, fibonacci_sphere, world_from_local  # noqa: E402
from jaxrender.imaging import NoiseModel  # noqa: E402
from jaxrender.inverse import Observations  # noqa: E402
from jaxrender.inverse.factorization import Factorization, factorize  # noqa: E402
from jaxrender.lighting import DirectionalSources  # noqa: E402
from jaxrender.reflection import integral_columns, polar_columns, radiance  # noqa: E402

KD, KS, MU = np.array([0.12, 0.17, 0.21]), np.full(3, 0.1), 1.5
NOISE = NoiseModel(0.01, 0.0)
# Places photographed, each by three neighbouring pixels; nodes of a window.
PLACES, NODES = 1200, 400
MOST_OFF, DEMANDED = 3.5, 0.95


class Room(NamedTuple):
    """Round windows, in a dim room that is brighter on one side."""

    windows: DirectionalSources
    side: np.ndarray

    def dim(self, directions) -> jax.Array:
        """Evaluate the radiance beside the windows."""
        return (0.3 + 0.2 * directions @ jnp.asarray(self.side))[..., None] * jnp.ones(3)


def disc(direction: np.ndarray, radius: float) -> np.ndarray:
    """Lay out nodes of one solid angle over a cap."""
    number = np.arange(NODES) + 0.5
    cosine = 1 - (1 - np.cos(radius)) * number / NODES
    turn = np.pi * (3 - np.sqrt(5)) * number
    sine = np.sqrt(1 - cosine**2)
    local = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=1)
    return local @ np.asarray(world_from_local(jnp.asarray(direction))).T


def room(seed: int, radii: tuple[float, float] = (5.0, 15.0)) -> Room:
    """Draw a room of windows at least 50 degrees apart."""
    rng = np.random.default_rng([17, seed])
    middles: list[np.ndarray] = []
    count = int(rng.integers(3, 6))
    while len(middles) < count:
        one = unit(rng.normal(size=3) + np.array([0, 0, 0.5]))
        if all(one @ other < np.cos(np.radians(50)) for other in middles):
            middles.append(one)
    towards, energies = [], []
    for one in middles:
        radius = np.radians(rng.uniform(*radii))
        colour = rng.uniform(0.8, 1, 3) * rng.uniform(0.5, 2)
        towards.append(disc(one, radius))
        energies.append(np.tile(colour / NODES, (NODES, 1)))
    windows = DirectionalSources(np.concatenate(towards), np.concatenate(energies))
    return Room(windows, unit(rng.normal(size=3)))


def photographed(lit: Room, sigma: float, views: int, seed: int) -> Observations:
    """Photograph a ball from a ring of sides: places at random, three pixels of each."""
    rng = np.random.default_rng([18, seed])
    azimuth = 2 * np.pi * np.arange(views) / views + 0.1
    height = np.sin(np.radians(np.resize([10, 35, 60], views)))
    level = np.sqrt(1 - height**2)
    eyes = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), height], axis=1)
    frame = rng.integers(views, size=PLACES)
    outgoing = eyes[frame]
    cosine = np.sqrt(rng.uniform(0.15**2, 1, PLACES))
    normals = np.zeros((PLACES, 3))
    around = fibonacci_sphere(4 * PLACES)
    for place in range(PLACES):
        at = rng.permutation(len(around))[:200]
        normals[place] = around[at[np.argmin(np.abs(around[at] @ outgoing[place] - cosine[place]))]]
    samples = SurfaceSamples(normals, outgoing)
    truth = Microfacet(KD, KS, sigma, MU)
    columns = integral_columns(truth, samples, lit.windows.nodes())
    exact = np.asarray(radiance(truth, columns + polar_columns(truth, samples, lit.dim)))
    thrice = np.repeat(np.arange(PLACES), 3)
    pixel = np.stack([thrice, np.tile(np.arange(3), PLACES)], axis=1)
    noisy = NOISE.add(exact[thrice], rng)
    return Observations(
        SurfaceSamples(normals[thrice], outgoing[thrice]), noisy, frame[thrice], pixel=pixel
    )


class Fit(NamedTuple):
    """How far a fit is off, in standard errors, and what it says."""

    sigma: float
    views: int
    found: Factorization
    seconds: float

    @property
    def judged(self) -> Judged:
        """The fit beside the truth."""
        return Judged(self.found, Microfacet(KD, KS, self.sigma, MU))

    @property
    def honest(self) -> bool:
        """Whether it states no error that is much too small."""
        return self.judged.honest(MOST_OFF)

    def line(self) -> str:
        """Say it in a line."""
        off, found = self.judged.off, self.found
        error = 100 * float(found.parameters.standard_error.of("sigma")) / float(found.brdf.sigma)
        return (
            f"{self.views:2d} views  sigma {self.sigma:.3f} {float(found.brdf.sigma):.4f} "
            f"+- {error:4.1f} %  off {off['sigma']:5.1f} {off['mu']:5.1f} {off['ks']:5.1f}  "
            f"degree {found.rounds[-1].band_limit}  sources {len(found.scene.sources.directions)}  "
            f"left {100 * found.relative_rms:.2f} %  {found.outcome.value}"
            f"{'' if self.honest else '  WRONG'}  {self.seconds:.0f} s"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--sigmas", type=float, nargs="*", default=[0.06, 0.1, 0.2, 0.35])
    parser.add_argument("--views", type=int, nargs="*", default=[6, 12, 24])
    parser.add_argument("--radii", type=float, nargs=2, default=[5.0, 15.0])
    asked = parser.parse_args()
    fits = []
    for seed in range(asked.seeds):
        lit = room(seed, tuple(asked.radii))
        for views in asked.views:
            for sigma in asked.sigmas:
                seen = photographed(lit, sigma, views, seed)
                begun = time.perf_counter()
                found = factorize(seen, Microfacet(KD, KS, 0.2, MU), pool=seen)
                fits.append(Fit(sigma, views, found, time.perf_counter() - begun))
                print(fits[-1].line(), flush=True)
    honest = np.mean([fit.honest for fit in fits])
    print(f"the truth within {MOST_OFF} standard errors, or not identifiable:")
    print(f"  {100 * honest:.0f} % of {len(fits)} (demanded {100 * DEMANDED:.0f} %)")


if __name__ == "__main__":
    main()
