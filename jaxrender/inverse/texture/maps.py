"""Site values as images: row 0 at the top, NaN where nothing is known, and borders filled in."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt

from jaxrender.io import write_image
from jaxrender.shapes import Bool, Float


def image_of_sites(
    values: Float[np.ndarray, "site *channel"],
    image: tuple[int, int],
    known: Bool[np.ndarray, "site"] | None = None,
) -> Float[np.ndarray, "row column channel"]:
    """Lay the values of texels out as an image of (rows, columns), NaN where not ``known``.

    Single numbers become one channel.  Raises ``ValueError`` where the numbers do not match.
    """
    rows, columns = image
    if len(values) != rows * columns:
        raise ValueError(f"{len(values)} sites do not make {columns} x {rows} texels")
    laid = np.array(values, np.float64).reshape(rows, columns, -1)
    if known is not None:
        laid[~known.reshape(image)] = np.nan
    return laid


def write_maps(
    folder: Path,
    files: Mapping[str, str],
    images: Mapping[str, Float[np.ndarray, "row column _"]],
    marks: Mapping[str, Float[np.ndarray, "row column _"]],
    reach: int,
    wrap: bool,
) -> None:
    """Write images of sites, continued ``reach`` texels beyond what is known, and marks."""
    for name, image in images.items():
        write_image(folder / files[name], np.nan_to_num(dilated(image, reach, wrap)))
    for name, image in marks.items():
        write_image(folder / files[name], image)


def dilated(
    image: Float[np.ndarray, "row column channel"], texels: int, wrap: bool = False
) -> Float[np.ndarray, "row column channel"]:
    """Give unknown texels (NaN) the value of the nearest known one, up to ``texels`` away.

    So that who looks a texture up between texels finds no hole along its seams.  With ``wrap``
    the columns go round.
    """
    columns = image.shape[1]
    known = np.isfinite(image).all(axis=-1)
    if not known.any() or known.all() or texels < 1:
        return image.copy()
    side = min(texels, columns) if wrap else 0
    wide = np.pad(known, ((0, 0), (side, side)), mode="wrap")
    row, column = np.asarray(
        distance_transform_edt(~wide, return_distances=False, return_indices=True)
    )
    away = np.hypot(row - np.arange(wide.shape[0])[:, None], column - np.arange(wide.shape[1]))
    inside = slice(side, side + columns)
    nearest = image[row[:, inside], (column[:, inside] - side) % columns]
    near = np.asarray(away[:, inside] <= texels) & ~known
    return np.where(near[..., None], nearest, image)
