"""T figure 4.3: the nine basis images of an object, and what editing a coefficient does.

    python experiments/figure_4_3.py [--mesh PATH] [--out F.png]

A sphere, and a mesh where one is given (otherwise an ellipsoid); green is positive, blue negative,
all nine on one scale.  Below, the object under a light from above, and with L_1-1 reversed: lit
from below, as the thesis says.  With it, the parts of all pictures' variance that the principal
components of each view explain.
"""

import argparse
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

from jaxrender.geometry import Mesh, Orthographic, Sphere, look_at, observe
from jaxrender.io import read_mesh
from jaxrender.reflection import basis_images, principal_components, relit

SIZE = 160
NAMES = ("00", "1-1", "10", "11", "2-2", "2-1", "20", "21", "22")
# In the thesis's axes y is up and the viewer looks along -z.
LIGHT = np.array([1.0, 0.8, 0.1, 0.15, 0.0, -0.1, -0.15, 0.05, -0.1])


def view_of(shape, radius: float, centre: np.ndarray):
    """See a shape from +z, y up."""
    pose = look_at(centre + np.array([0, 0, 4 * radius]), centre, np.array([0.0, 1, 0]))
    scale = 2.1 * radius / SIZE
    return observe(Orthographic(SIZE, SIZE, pose, scale=scale), shape)


def coloured(values: np.ndarray, scale: float) -> np.ndarray:
    """Green for positive, blue for negative, white for nothing there."""
    share = np.clip(np.abs(values) / scale, 0, 1)
    picture = np.zeros((*values.shape, 3))
    picture[..., 1] = np.where(values > 0, share, 0)
    picture[..., 2] = np.where(values < 0, share, 0)
    return picture


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path)
    parser.add_argument("--out", type=Path, default=Path("experiments/out/figure_4_3.png"))
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    mesh = (
        read_mesh(arguments.mesh)
        if arguments.mesh
        else Mesh.ellipsoid(np.array([1.0, 0.7, 0.6]), 5)
    )
    low, high = np.min(mesh.vertices, axis=0), np.max(mesh.vertices, axis=0)
    shapes = {
        "sphere": (Sphere(np.zeros(3), 1.0), 1.0, np.zeros(3)),
        "object": (mesh, float(np.max(high - low)) / 2, (low + high) / 2),
    }
    figure, axes = plt.subplots(3, 9, figsize=(15, 5.4))
    for row, (name, (shape, radius, centre)) in zip(axes, shapes.items()):
        view = view_of(shape, radius, centre)
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
    view = view_of(*shapes["object"])
    images = basis_images(view.normals[view.hit])[..., None]
    for place, (title, sign) in zip(axes[2], (("from above", 1), ("L1-1 reversed", -1))):
        light = LIGHT.copy()
        light[1] *= sign
        picture = np.ones((SIZE, SIZE))
        picture[view.hit] = np.clip(relit(images, light[:, None])[:, 0] / 2.5, 0, 1)
        place.imshow(picture, cmap="gray", vmin=0, vmax=1)
        place.set_title(title, fontsize=9)
    for place in axes.ravel():
        place.set_axis_off()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.out, dpi=100, bbox_inches="tight")
    print(f"picture: {arguments.out}")


if __name__ == "__main__":
    main()
