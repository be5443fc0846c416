"""Sums over sites, of which the systems for K_d and K_s are made; and what these are solved for."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxrender.inverse.models import Columns
from jaxrender.inverse.texture.measurements import SiteData
from jaxrender.shapes import AnyArray, Array, Float

# What is left of S'S without D, below this part of it, is rounding: K_s is then not determined.
ROUNDING = {"float64": 1e-11, "float32": 1e-5}


class SiteSums(NamedTuple):
    """Weighted inner products of the columns D and S and the measurement B over each site."""

    dd: Float[Array, "site channel"]
    ds: Float[Array, "site channel"]
    ss: Float[Array, "site channel"]
    db: Float[Array, "site channel"]
    sb: Float[Array, "site channel"]


class SiteMaterial(NamedTuple):
    """K_d and K_s of every site; K_s of every channel where it has a colour."""

    kd: Float[AnyArray, "site channel"]
    ks: Float[AnyArray, "site *channel"]


def site_sums(data: SiteData, columns: Columns) -> SiteSums:
    """Add up the inner products of each site's observations."""
    squares = jnp.asarray(data.weights) ** 2
    diffuse, specular, radiance = columns.diffuse, columns.specular, jnp.asarray(data.radiance)
    pairs = (
        (diffuse, diffuse),
        (diffuse, specular),
        (specular, specular),
        (diffuse, radiance),
        (specular, radiance),
    )
    products = jnp.stack([squares * a * b for a, b in pairs], axis=1)
    sums = over_sites(products, data)
    return SiteSums(*(sums[:, k] for k in range(len(pairs))))


def over_sites(values: Float[Array, "sample *rest"], data: SiteData) -> Float[Array, "site *rest"]:
    """Add up the rows of each site."""
    return jax.ops.segment_sum(
        values, jnp.asarray(data.site), num_segments=data.count, indices_are_sorted=True
    )


def by_channel(ks: Float[AnyArray, "site *channel"]) -> Float[AnyArray, "site channel_or_one"]:
    """Give K_s an axis of channels: its own, or one that broadcasts to them."""
    return ks if ks.ndim == 2 else ks[:, None]


def quotient(a: Float[Array, "*#any"], b: Float[Array, "*#any"]) -> Float[Array, "*#any"]:
    """Divide, with 0 for a division by 0."""
    return jnp.where(b > 0, a / jnp.where(b > 0, b, 1), 0)
