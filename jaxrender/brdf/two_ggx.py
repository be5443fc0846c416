"""A Lambertian base under two GGX lobes, a narrow and a broad one, of one index.

rho = kd + ks f(w_i, w_o; sigma, mu) + ks_broad f(w_i, w_o; min(spread sigma, 1), mu)

with f the GGX lobe of ``Microfacet`` with Smith's masking and Fresnel at the half angle.  What most
polished and painted surfaces have: a sharp highlight, and a haze about it.  The broad lobe's width
is told by ``spread``, how many times wider it is, so that the two cannot change places.
"""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.fresnel import largest_fresnel_ratio
from jaxrender.brdf.half_vector import are_visible
from jaxrender.brdf.microfacet import Microfacet
from jaxrender.brdf.parameters import (
    Scalar,
    as_scalar,
    as_scalar_or_none,
    is_known,
    matching,
    refuse_outside,
    share_of_energy_is_bounded,
)
from jaxrender.brdf.parametric import Parametric, Searched, ShapeParameter
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

# Where the spread is searched for, from lobes that are hardly told apart.
_LEAST_SPREAD, _MOST_SPREAD, _FIRST_SPREAD = 1.5, 30.0, 4.0


class TwoGGX(Parametric):
    """Two GGX lobes of widths ``sigma`` and ``spread`` times that, at most 1.

    Raises, outside traced functions, ``ValueError`` for sigma outside (0, 1], spread <= 1, mu <= 1.
    """

    shape: ClassVar[ShapeParameter] = ShapeParameter("sigma")
    amplitude_names: ClassVar[tuple[str, ...]] = ("kd", "ks", "ks_broad")

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    ks_broad: Float[AnyArray, "channel"]
    sigma: Scalar = eqx.field(converter=as_scalar)
    spread: Scalar = eqx.field(converter=as_scalar)
    mu: Scalar | None = eqx.field(converter=as_scalar_or_none)

    def __check_init__(self):
        refuse_outside("sigma", self.sigma, "(0, 1]", "for a rougher surface use gaussian facets")
        if is_known(self.spread) and not np.asarray(self.spread) > 1:
            raise ValueError(
                f"spread={self.spread}: the broad lobe must be wider than the narrow one, above 1"
            )
        if self.mu is not None and is_known(self.mu) and not np.asarray(self.mu) > 1:
            raise ValueError(
                f"mu={self.mu}: the refractive index must be above 1, or None for a metal"
            )

    @property
    def searched(self) -> tuple[Searched, ...]:
        """The narrow lobe's width, the spread, and the index unless there is none."""
        spread = Searched("spread", _LEAST_SPREAD, _MOST_SPREAD, _FIRST_SPREAD, 1.0)
        numbers = (self.shape.searched, spread)
        return numbers if self.mu is None else (*numbers, self.index.searched)

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """When pi kd + (ks + ks_broad) times the Fresnel ratio's largest value is at most 1."""
        ratio = largest_fresnel_ratio(self.mu)
        return share_of_energy_is_bounded(
            np.pi * self.kd, self.ks * ratio, np.asarray(self.ks_broad) * ratio
        )

    @property
    def fresnel_is_factor(self) -> bool:
        """Of a metal, whose ratio is one everywhere."""
        return self.mu is None

    @property
    def energy(self) -> float:
        """One: ks is about the lobe's albedo at normal exitance."""
        return 1.0

    def as_metal(self) -> "TwoGGX":
        """Drop the Fresnel ratio."""
        return dataclasses.replace(self, mu=None)

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate the clamped cosine, the narrow lobe and the broad one."""
        visible = are_visible(incoming, outgoing)
        sigma, spread = (matching(one, incoming.z) for one in (self.sigma, self.spread))
        widths = (sigma, jnp.minimum(spread * sigma, 1))
        none = np.zeros(1)
        facets = (Microfacet(none, none, w, self.mu, "half", "smith", "ggx") for w in widths)
        lobes = (one.specular_transfer(incoming, outgoing) for one in facets)
        return (
            jnp.where(visible, incoming.z, 0),
            *(jnp.where(visible, lobe, 0) for lobe in lobes),
        )
