"""How paint changes along the surface: what a pixel sees that looks a little beside its site.

Derivatives of K_d and K_s by place are those of planes through a site and its nearest neighbours in
space, which are texels or vertices alike.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from jaxrender.inverse.models import Columns
from jaxrender.inverse.texture.site_sums import by_channel
from jaxrender.inverse.texture.texture import Texture
from jaxrender.shapes import Float, Int

# Neighbours that tell how paint changes.
_NEIGHBOURS = 8
# A direction in which they spread by less than this part of the longest, in squares, tells nothing.
_ALONG = 0.05


class PaintSlopes(NamedTuple):
    """Where sites lie, and derivatives of their K_d and K_s by place.

    Sites whose neighbours are not known have none: their derivatives are zero.
    """

    places: Float[np.ndarray, "site 3"]
    kd: Float[np.ndarray, "site channel 3"]
    ks: Float[np.ndarray, "site channel_or_one 3"]

    @classmethod
    def of(
        cls,
        texture: Texture,
        places: Float[np.ndarray, "all 3"],
        chosen: Int[np.ndarray, "site"],
    ) -> "PaintSlopes":
        """Differentiate some sites' paint; ``places`` are those of all, NaN where unseen."""
        paint = np.concatenate([texture.kd, by_channel(texture.ks)], axis=1)
        known = np.flatnonzero(np.isfinite(paint).all(axis=1) & np.isfinite(places).all(axis=1))
        near = min(_NEIGHBOURS + 1, len(known))
        _, found = cKDTree(places[known]).query(places[chosen], k=np.arange(1, near + 1))
        others = known[found]
        away = places[others] - places[chosen][:, None]
        change = paint[others] - paint[chosen][:, None]
        squares, axes = np.linalg.eigh(np.einsum("sni,snj->sij", away, away))
        # The least is that across the surface.
        told = squares > _ALONG * squares[:, -1:]
        told[:, 0] = False
        inverse = np.where(told, 1 / np.where(told, squares, 1), 0)
        across = np.einsum("snc,sni,sij->scj", change, away, axes)
        slopes = np.einsum("scj,sj,sij->sci", across, inverse, axes)
        slopes *= _smooth(change, np.einsum("sci,sni->snc", slopes, away))[:, :, None]
        channels = texture.kd.shape[1]
        return cls(places[chosen], slopes[:, :channels], slopes[:, channels:])

    def of_samples(
        self, columns: Columns, site: Int[np.ndarray, "sample"]
    ) -> Float[np.ndarray, "sample channel 3"]:
        """Differentiate the radiance of samples by place, at fixed normals."""
        diffuse, specular = np.asarray(columns.diffuse), np.asarray(columns.specular)
        by_kd = self.kd[site] * diffuse[:, :, None]
        return by_kd + self.ks[site] * specular[:, :, None]

    def beside(
        self,
        columns: Columns,
        site: Int[np.ndarray, "sample"],
        points: Float[np.ndarray, "sample 3"],
    ) -> Float[np.ndarray, "sample channel"]:
        """Say what radiance samples have beyond that of their site's paint, as they lie beside."""
        aside = points - self.places[site]
        return np.einsum("sci,si->sc", self.of_samples(columns, site), aside)


def _smooth(
    change: Float[np.ndarray, "site neighbour channel"],
    planes: Float[np.ndarray, "site neighbour channel"],
) -> Float[np.ndarray, "site channel"]:
    """Say how far paint is smooth: 1 where neighbours lie in a plane, 0 at an edge of two paints.

    Beside an edge a plane explains half of the squares, as one side is as the site itself.
    """
    squares = np.sum(change**2, axis=1)
    explained = 1 - np.sum((change - planes) ** 2, axis=1) / np.where(squares > 0, squares, 1)
    return np.clip(2 * explained - 1, 0, 1)
