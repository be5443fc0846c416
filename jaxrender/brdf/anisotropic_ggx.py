"""GGX facets of brushed metal: of one width along the tangent, and of another across it.

rho = kd + ks F(w_i . h) / F(1) D(h) G(w_i, w_o) / (4 cos t_i cos t_o)

D is that of Trowbridge and Reitz, G is Smith's for both directions together (Heitz 2014).  The
tangent is the meridian about +Z, turned about the normal by ``tangent_rotation``.
"""

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.distributions import TrowbridgeReitz
from jaxrender.brdf.facets import facet_transfer
from jaxrender.brdf.fresnel import largest_fresnel_ratio, normalised_fresnel
from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    as_scalar_or_none,
    matching,
    refuse_outside,
    share_of_energy_is_bounded,
)
from jaxrender.brdf.parametric import Parametric, Searched, ShapeParameter
from jaxrender.brdf.tangents import TANGENT_ROTATION, in_tangent_frame
from jaxrender.catalogue import MODELS
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

_MODEL = "anisotropic-ggx"
# The width across the tangent is searched from here; that along it begins elsewhere.
_FIRST_ACROSS = 0.3


class AnisotropicGGX(Parametric):
    """GGX facets of the widths ``roughness`` along the tangent and ``roughness_y`` across it.

    ``mu=None`` is a metal.  ``tangent_rotation`` is in radians; a quarter of a turn more, with both
    widths exchanged, is the same surface.  Raises, outside traced functions,
    ``ValueError`` for numbers outside the catalogue's intervals.
    """

    shape: ClassVar[ShapeParameter] = ShapeParameter("roughness")

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    roughness: Scalar = eqx.field(converter=as_scalar)
    roughness_y: Scalar = eqx.field(converter=as_scalar)
    mu: Scalar | None = eqx.field(converter=as_scalar_or_none)
    tangent_rotation: Scalar = eqx.field(converter=as_scalar, default=0.0)

    def __check_init__(self):
        for number in MODELS[_MODEL].numbers:
            value = getattr(self, number.name)
            if value is not None:
                domain = number.domain.text
                refuse_outside(number.name, value, domain, f"it is the {number.meaning}")

    @property
    def sigma(self) -> Scalar:
        """The width along the tangent."""
        return self.roughness

    @property
    def width(self) -> Scalar:
        """The smaller of both widths."""
        return jnp.minimum(self.roughness, self.roughness_y)

    @property
    def searched(self) -> tuple[Searched, ...]:
        """Both widths, how the tangent is turned, and the index unless there is none."""
        along = self.shape.searched
        across = along._replace(name="roughness_y", start=_FIRST_ACROSS)
        numbers = (along, across, TANGENT_ROTATION)
        return numbers if self.mu is None else (*numbers, self.index.searched)

    @property
    def settled(self) -> Mapping[str, float]:
        """The tangent is the meridian unless somebody says otherwise."""
        return MODELS[_MODEL].settled

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def isotropic(self) -> bool:
        """Where both widths are the same."""
        return bool(np.asarray(self.roughness) == np.asarray(self.roughness_y))

    @property
    def conserves_energy(self) -> bool:
        """When pi kd + ks times the Fresnel ratio's largest value is at most 1."""
        ratio = largest_fresnel_ratio(self.mu)
        return share_of_energy_is_bounded(np.pi * self.kd, self.ks * ratio)

    @property
    def fresnel_is_factor(self) -> bool:
        """Of a metal, whose ratio is one everywhere."""
        return self.mu is None

    @property
    def energy(self) -> float:
        """One: ks is about the lobe's albedo at normal exitance."""
        return 1.0

    def as_metal(self) -> "AnisotropicGGX":
        """Drop the Fresnel ratio."""
        return dataclasses.replace(self, mu=None)

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Evaluate the clamped cosine, and the lobe times the clamped cosine."""
        visible = are_visible(incoming, outgoing)
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        facets = TrowbridgeReitz(
            *(matching(one, incoming.z) for one in (self.roughness, self.roughness_y))
        )
        sides = (in_tangent_frame(side, self.tangent_rotation) for side in (incoming, outgoing))
        lobe, cosine = facet_transfer(facets, "smith", *sides)
        mu = None if self.mu is None else matching(self.mu, cosine)
        lobe = lobe * normalised_fresnel(mu, cosine)
        return jnp.where(visible, incoming.z, 0), jnp.where(visible, lobe, 0)
