"""A Lambertian base under one glossy lobe: what a material has to be for a fit to recover it.

rho = kd + ks f(w_i, w_o; sigma, mu)

kd and ks enter linearly and are eliminated.  The lobe's shape is one number, searched as its
*width* sigma, whatever the model's own number for it is: ``ShapeParameter`` says how the two are
related, so that one split of the light, one table and one set of bounds serve every model.  Some
models have a refractive index mu as well.

A new model becomes one that can be fitted by being a ``Glossy``: no other file needs to know it by
more than its name.
"""

import abc
import dataclasses
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.half_vector import are_visible
from jaxrender.brdf.parameters import Scalar
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

Same = TypeVar("Same", bound="Glossy")


class ShapeParameter(NamedTuple):
    """A model's own number for the width of its lobe: value = scale sigma^power.

    sigma is the half angle (radians) at which the lobe is about 1/e of its peak, as in T 6.2.  An
    exponent s of R.w_i has scale 1/2 and power -2 (T 6.7: s = 1 / (2 sigma^2)).
    """

    name: str
    scale: float = 1.0
    power: float = 1.0

    def of_width(self, sigma):
        """Turn a width into the model's own number."""
        return self.scale * sigma**self.power

    def width_of(self, value):
        """Turn the model's own number into a width."""
        return (value / self.scale) ** (1 / self.power)


class Glossy(BRDF):
    """Amplitudes kd and ks per channel, a lobe of width sigma, perhaps with an index mu.

    ``sigma`` may be a property: the width that the model's own number stands for.
    """

    kd: eqx.AbstractVar[Float[AnyArray, "channel"]]
    ks: eqx.AbstractVar[Float[AnyArray, "channel"]]
    sigma: eqx.AbstractVar[Scalar]
    mu: eqx.AbstractVar[Scalar | None]
    # The field that holds the lobe's shape, and what it says of the width.
    shape: eqx.AbstractClassVar[ShapeParameter]

    @property
    @abc.abstractmethod
    def fresnel_is_factor(self) -> bool:
        """Whether mu enters by a factor of the exit angle alone, which leaves the lobe as it is."""

    @property
    @abc.abstractmethod
    def reach(self) -> Float[Array, ""] | None:
        """The angle from R (radians) beyond which the lobe is negligible; None: it has a tail."""

    @property
    @abc.abstractmethod
    def energy(self) -> Scalar:
        """About the lobe's albedo at normal exitance: 1 for a metal where ks is an albedo."""

    @abc.abstractmethod
    def as_metal(self) -> "Glossy":
        """Drop the Fresnel ratio, where it is a factor that the caller multiplies by himself."""

    @abc.abstractmethod
    def specular_transfer(
        self, incoming: Components, outgoing: Components
    ) -> Float[Array, "*batch"]:
        """Evaluate the lobe times cos t_i for directions above the horizon (below: meaningless)."""

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Evaluate the clamped cosine, and the lobe times the clamped cosine."""
        visible = are_visible(incoming, outgoing)
        lobe = self.specular_transfer(incoming, outgoing)
        return jnp.where(visible, incoming.z, 0), jnp.where(visible, lobe, 0)

    @property
    def amplitudes(self) -> Float[AnyArray, "2 channel"]:
        """The clamped cosine's and the lobe's: kd and ks."""
        return jnp.stack([jnp.asarray(self.kd), jnp.asarray(self.ks)])

    def with_roughness(self: Same, sigma: Scalar, mu: Scalar | None = None) -> Same:
        """Replace the lobe's width, and the index where the model has one; keep the rest."""
        changed: dict = {self.shape.name: self.shape.of_width(sigma)}
        if any(field.name == "mu" for field in dataclasses.fields(self)):
            changed["mu"] = mu
        return dataclasses.replace(self, **changed)

    def with_amplitudes(
        self: Same, kd: Float[AnyArray, "channel"], ks: Float[AnyArray, "channel"]
    ) -> Same:
        """Replace kd and ks and keep the lobe."""
        return dataclasses.replace(self, kd=kd, ks=ks)


class WithoutIndex(Glossy):
    """A glossy model that has no Fresnel term."""

    @property
    def sigma(self) -> Scalar:
        """The width that the model's own number stands for."""
        return self.shape.width_of(getattr(self, self.shape.name))

    @property
    def mu(self) -> None:
        """None."""
        return None

    @property
    def fresnel_is_factor(self) -> bool:
        """Of a ratio that is one everywhere."""
        return True

    def as_metal(self) -> "WithoutIndex":
        """Have no Fresnel ratio to drop."""
        return self
