"""T figure 4.3: the nine basis images of an object, and what editing a coefficient does.

    python experiments/figure_4_3.py [--mesh PATH] [--out F.png]

The thesis shows the Stanford armadillo.  Its scan is not part of this project: the object is the
project's own sculpture, which has dents and bumps as well, or any mesh (y up, as scans are).  Green
is positive, blue negative, all nine on one scale.  Above a sphere, then two views of the object: as
in the thesis the viewer looks along +Z with y up, so that x points to the left, and from behind.

Below, the object under a light from above; with L_1-1 reversed, lit from below, as the text says;
and with L_11 large and positive, which darkens the side to our right, as the caption says: the part
by which it does is printed.  So are the parts of all pictures' variance that the principal
components of each view explain.
"""

import argparse
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

from jaxrender.geometry import Orthographic, Sphere, look_at, observe, sculpture
from jaxrender.io import read_mesh
from jaxrender.reflection import basis_images, principal_components, relit

SIZE = 160
NAMES = ("00", "1-1", "10", "11", "2-2", "2-1", "20", "21", "22")
LIGHT = np.array([1.0, 0.8, 0.1, 0.15, 0.0, -0.1, -0.15, 0.05, -0.1])
LARGE = 0.9
# Towards the viewer, in the thesis's axes: in front of the object, and behind it.
VIEWS = {"sphere": -1, "object": -1, "object, behind": 1}


def view_of(shape, towards: int):
    """See a shape from -z or +z, y up, and fill the picture with it."""
    low, high = shape.bounds()
    centre, radius = (low + high) / 2, float(np.max(high - low)) / 2
    position = centre + np.array([0, 0, 4 * radius * towards])
    pose = look_at(position, centre, np.array([0.0, 1, 0]))
    return observe(Orthographic(SIZE, SIZE, pose, scale=2.1 * radius / SIZE), shape)


def coloured(values: np.ndarray, scale: float) -> np.ndarray:
    """Green for positive, blue for negative, white for nothing there."""
    share = np.clip(np.abs(values) / scale, 0, 1)
    picture = np.zeros((*values.shape, 3))
    picture[..., 1] = np.where(values > 0, share, 0)
    picture[..., 2] = np.where(values < 0, share, 0)
    return picture


def edit(view, places: np.ndarray):
    """Draw the object under the light as it is and with two of its coefficients edited."""
    images = basis_images(view.normals[view.hit])[..., None]
    below, aside = LIGHT.copy(), LIGHT.copy()
    below[1] *= -1
    aside[3] = LARGE
    found = {}
    for place, (title, light) in zip(
        places, {"from above": LIGHT, "L1-1 reversed": below, "L11 large": aside}.items()
    ):
        picture = np.ones((SIZE, SIZE))
        values = np.maximum(relit(images, light[:, None])[:, 0], 0)
        picture[view.hit] = np.clip(values / 2.5, 0, 1)
        found[title] = picture
        place.imshow(picture, cmap="gray", vmin=0, vmax=1)
        place.set_title(title, fontsize=9)
    half = SIZE // 2
    right, top = np.s_[:, half:], np.s_[:half]
    for title, side, part in (("L1-1 reversed", "upper", top), ("L11 large", "right", right)):
        before, after = (found[name][part][view.hit[part]].mean() for name in ("from above", title))
        verdict = "met" if after < before else "NOT met"
        print(f"{title}: the {side} half has {after / before:.2f} of its light; darker: {verdict}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path)
    parser.add_argument("--out", type=Path, default=Path("experiments/out/figure_4_3.png"))
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    mesh = read_mesh(arguments.mesh) if arguments.mesh else sculpture()
    figure, axes = plt.subplots(4, 9, figsize=(15, 7.2))
    for row, (name, towards) in zip(axes, VIEWS.items()):
        view = view_of(Sphere(np.zeros(3), 1.0) if name == "sphere" else mesh, towards)
        normals = view.normals[view.hit]
        images = basis_images(normals)
        scale = np.abs(images).max()
        for place, image, title in zip(row, images, NAMES):
            picture = np.ones((SIZE, SIZE, 3))
            picture[view.hit] = coloured(image, scale)
            place.imshow(picture)
            place.set_title(f"L{title}", fontsize=9)
        explained = 100 * np.cumsum(principal_components(normals).fractions)
        listed = " ".join(f"{value:.1f}" for value in explained)
        print(f"{name}: principal components explain {listed} % of all pictures' variance")
    edit(view_of(mesh, VIEWS["object"]), axes[3])
    for place in axes.ravel():
        place.set_axis_off()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.out, dpi=100, bbox_inches="tight")
    print(f"picture: {arguments.out}")


if __name__ == "__main__":
    main()
