"""A real glossy ball: do halves of its photographs agree about its roughness, as far as they say?

    python experiments/real_halves.py FOLDER [--pairs 10] [--model ggx]

FOLDER holds the 48 photographs, the mask and the lights of ``configs/glossy_ball.yaml``.  They are
divided at random, and each half is fitted by itself.  Printed for each: how it ended, the causes
named, sigma and its 90 % interval; then in how many pairs each half's sigma is inside the other's
interval.
"""

import argparse
import time
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

import jaxrender as jr  # noqa: E402
from jaxrender.brdf import lobe_named  # noqa: E402
from jaxrender.inverse import KnownLight, fit_brdf, unknowns_of  # noqa: E402
from jaxrender.io.lights import read_per_frame_lights  # noqa: E402

TRANSFORMS = Path(__file__).parents[1] / "configs" / "glossy_ball" / "transforms.json"
CENTRE, RADIUS, SAMPLES = np.array([2.370, -8.368, 0.0]), 70.751, 60_000


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--model", default="ggx")
    options = parser.parse_args()
    capture = jr.load_capture(TRANSFORMS, options.folder, response="linear")
    shape = jr.Sphere(center=CENTRE, radius=RADIUS)
    every = capture.observations(shape)
    names = [Path(frame.image_path).name for frame in capture.capture.frames]
    files = (options.folder / f"light_{what}.txt" for what in ("directions", "intensities"))
    lights = read_per_frame_lights(next(files), names, next(files))
    rng, model, agreeing = np.random.default_rng(0), lobe_named(options.model), 0

    def fitted(part: np.ndarray) -> tuple[float, float, float]:
        """Fit some of the photographs: sigma, and the ends of its interval."""
        begun, kept = time.perf_counter(), np.flatnonzero(np.isin(every.frame, part))
        pool = every.take(kept)._replace(
            frame=np.searchsorted(part, np.asarray(every.frame)[kept]),
            eyes=None if every.eyes is None else np.asarray(every.eyes)[part],
        )
        light = KnownLight(None, jr.DirectionalSources.none(3), tuple(lights[k] for k in part))
        some = pool.take(np.sort(rng.choice(pool.count, min(SAMPLES, pool.count), replace=False)))
        fit = fit_brdf(some, light, unknowns_of(model), model, shape=shape, pool=pool)
        found = tuple(
            float(one.of("sigma"))
            for one in (fit.parameters.value, fit.parameters.lower, fit.parameters.upper)
        )
        causes = ", ".join(one.cause for one in fit.diagnosis) or "nothing"
        print(
            f"  {fit.outcome.value:12s} sigma {found[0]:.4f} ({found[1]:.4f} to {found[2]:.4f})  "
            f"named: {causes}  {time.perf_counter() - begun:.1f} s",
            flush=True,
        )
        return found

    for _ in range(options.pairs):
        order = rng.permutation(len(lights))
        one, other = (fitted(np.sort(half)) for half in np.array_split(order, 2))
        agree = other[1] <= one[0] <= other[2] and one[1] <= other[0] <= one[2]
        print("agree" if agree else "disagree")
        agreeing += agree
    print(f"{agreeing} of {options.pairs} pairs agree (demanded 9 of 10)")


if __name__ == "__main__":
    main()
