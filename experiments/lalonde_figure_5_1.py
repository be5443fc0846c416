"""L fig. 5.1: the three luminaires, as traced, without any light field.

    python experiments/lalonde_figure_5_1.py [--out FOLDER] [--width 400]

L prints pictures only.  Draws ``lalonde_figure_5_1.png``.
"""

import argparse
from pathlib import Path

import matplotlib
import numpy as np
from lalonde_luminaires import MODELS, OUT, shown, view

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--width", type=int, default=400)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(1, 3, figsize=(12, 4.3))
    for axis, (name, make) in zip(axes, MODELS.items()):
        model = make()
        radiance = model.radiance(*view(model, args.width))
        print(f"{name:12s} mean radiance {radiance.mean():.3f}, brightest {radiance.max():.2f}")
        axis.imshow(np.asarray(shown(radiance, args.width)))
        axis.set_title(name)
        axis.axis("off")
    figure.tight_layout()
    figure.savefig(args.out / "lalonde_figure_5_1.png", dpi=100)


if __name__ == "__main__":
    main()
