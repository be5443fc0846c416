"""T 5.5.2: how many texels and views an explicit form needs for each degree, S ~ 10 F, T ~ 10 P.

    python experiments/resolutions_5_5_2.py

Relative rms errors at random directions of what is interpolated bilinearly: a map of degree F with
S rows, light of equal energy in each degree, and of the fall that a lobe leaves (exp(-(l / F)^2));
and of B(o) between T x T viewers, for degree P.  Published: S ~ 10 F, by experimenting.  Linear
interpolation of a wave of degree F between texels pi / S apart is off by (pi F / S)^2 / 8 at most,
1.2 % of it at ten texels a degree.
"""

import jax
import numpy as np
from scenes import unit

from jaxrender.harmonics import (
    LatLongGrid,
    degrees,
    evaluate,
    looked_up,
    over_poles,
    synthesise,
)
from jaxrender.spectra import TEXELS_PER_DEGREE

RATIOS = (2.5, 5, 10, 20, 40)


def error(band_limit: int, rows: int, fall: bool) -> float:
    rng = np.random.default_rng(band_limit)
    degree = degrees(band_limit)
    light = rng.standard_normal(((band_limit + 1) ** 2, 1)) / np.sqrt(2 * degree + 1)[:, None]
    if fall:
        light = light * np.exp(-((degree / max(band_limit, 1)) ** 2) * 3)[:, None]
    directions = unit(rng.standard_normal((20_000, 3)))
    exact = np.asarray(evaluate(light, directions))
    image = synthesise(LatLongGrid(rows, 2 * rows), light)
    found = np.asarray(looked_up(over_poles(image), directions))
    return float(100 * np.sqrt(np.sum((found - exact) ** 2) / np.sum(exact**2)))


def main():
    jax.config.update("jax_enable_x64", True)
    print("relative rms error, %, by texels a degree; the rule is", TEXELS_PER_DEGREE)
    print(f"{'':34s}" + "".join(f"{ratio:9g}" for ratio in RATIOS))
    for what, limits in (
        ("map, S rows a degree F", (5, 12, 24)),
        ("viewers, T a degree P", (2, 3)),
    ):
        for fall in (False, True):
            for limit in limits:
                rows = [2 * int(np.ceil(ratio * limit / 2)) for ratio in RATIOS]
                cells = "".join(f"{error(limit, n, fall):9.2f}" for n in rows)
                kind = "falling" if fall else "flat"
                print(f"{what:24s}{limit:3d} {kind:>7s}{cells}")
    print(
        f"{'worst, (pi / ratio)^2 / 8':34s}"
        + "".join(f"{12.5 * (np.pi / r) ** 2:9.2f}" for r in RATIOS)
    )


if __name__ == "__main__":
    main()
