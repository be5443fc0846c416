"""How long a pixel takes by nested traversal and by the fast paths; shared by scripts."""

import time
from typing import NamedTuple

import jax
import numpy as np

from jaxrender.reflection.wavelet_shading.shading import reflected_radiance
from jaxrender.reflection.wavelet_shading.traversal import traverse
from jaxrender.wavelets.tree import CoefficientTree


class Costs(NamedTuple):
    """Seconds, and what the traversal visits, each for a pixel."""

    nested: float
    pairs: float
    shared: float
    """One direction for all pixels."""
    own: float
    """A direction for each pixel."""


def measured(light: CoefficientTree, brdf: CoefficientTree, side: int, nested: int = 4) -> Costs:
    """Time an image of ``side`` x ``side`` pixels of the whole wall, warm, and a few pixels."""
    centre = (np.arange(side) + 0.5) / side
    places = np.stack(np.meshgrid(centre, centre, indexing="ij"), axis=-1).reshape(-1, 2)
    # A camera 2.5 wall widths in front of the middle.
    towards = np.append(0.5 - places, np.full((len(places), 1), 2.5), axis=1)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    directions = (towards[:, :2] + 1) / 2
    straight = np.array([[0.5 + 0.01, 0.5 + 0.01]])
    few = np.random.default_rng(0).integers(len(places), size=nested)
    traverse(light, brdf, places[0], straight[0])
    start = time.perf_counter()
    found = [traverse(light, brdf, places[i], straight[0]) for i in few]
    slow = (time.perf_counter() - start) / nested
    fast = np.asarray(reflected_radiance(light, brdf, places, straight))
    scale = np.abs(fast).max()
    for i, one in zip(few, found):
        np.testing.assert_allclose(one.radiance, fast[i], atol=1e-9 * scale)
    return Costs(
        slow,
        float(np.mean([one.coefficients for one in found])),
        _seconds(lambda: reflected_radiance(light, brdf, places, straight)) / len(places),
        _seconds(lambda: reflected_radiance(light, brdf, places, directions)) / len(places),
    )


def _published(value: float, unit: str) -> str:
    return "-" if np.isnan(value) else f"{value:.{0 if value > 10 else 1}f}{unit}"


def _seconds(program, repeats: int = 3) -> float:
    jax.block_until_ready(program())
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(program())
        best = min(best, time.perf_counter() - start)
    return best


def print_costs(names: list[str], published: list[float], costs: list[Costs]):
    """Print a row for each representation, and how many times faster than the first it is.

    Milliseconds that are not a number were not published.
    """
    print(
        f"\n{'':34s} {'L':>9s} {'pairs':>11s} {'nested':>11s} {'one view':>11s} {'own views':>11s}"
    )
    for name, ms, cost in zip(names, published, costs):
        theirs = _published(ms, " ms")
        print(
            f"{name:34s} {theirs:>9s} {cost.pairs:11.0f} {1e3 * cost.nested:8.1f} ms "
            f"{1e6 * cost.shared:8.2f} us {1e6 * cost.own:8.2f} us"
        )
    first = costs[0]
    for name, ms, cost in list(zip(names, published, costs))[1:]:
        gains = [a / b for a, b in zip(first, cost)]
        print(
            f"{'  gain of ' + name:34s} {_published(published[0] / ms, 'x'):>9s} {gains[1]:10.1f}x "
            f"{gains[0]:10.1f}x {gains[2]:10.1f}x {gains[3]:10.1f}x"
        )
