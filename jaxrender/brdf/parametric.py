"""A BRDF that a fit can recover: two amplitudes, the width of a lobe, perhaps a second number.

rho = kd f_1(w_i, w_o) + ks f_2(w_i, w_o; sigma, mu)

kd and ks enter linearly and are eliminated.  The lobe's shape is searched as its *width* sigma,
whatever the model's own number for it is: ``ShapeParameter`` says how the two are related, so that
one set of bounds serves every model.  A second number is searched as an index mu above 1, and
``IndexParameter`` says what the model makes of it.

A new model becomes one that can be fitted by being ``Parametric``: no other file needs to know it
by more than its name.  Its exact integral is all that a fit then asks of it; a ``Glossy`` one has
its lobe about the reflected direction, and the frequency view besides.
"""

import abc
import dataclasses
from typing import ClassVar, NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.parameters import Scalar
from jaxrender.shapes import AnyArray, Float, checked

Same = TypeVar("Same", bound="Parametric")


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


class IndexParameter(NamedTuple):
    """A model's own second number: value = mu - offset; by default the refractive index itself.

    What only has to be positive has the offset 1, as mu lies above 1.  ``highest`` is the largest
    value that the model takes; None: there is none.
    """

    name: str = "mu"
    offset: float = 0.0
    highest: float | None = None

    def of_index(self, mu):
        """Turn an index into the model's own number."""
        return mu - self.offset

    def index_of(self, value):
        """Turn the model's own number into an index."""
        return value + self.offset


class Parametric(BRDF):
    """Amplitudes kd and ks per channel, a lobe of width sigma, perhaps with an index mu.

    ``sigma`` and ``mu`` may be properties: what the model's own numbers stand for.
    """

    kd: eqx.AbstractVar[Float[AnyArray, "channel"]]
    ks: eqx.AbstractVar[Float[AnyArray, "channel"]]
    sigma: eqx.AbstractVar[Scalar]
    mu: eqx.AbstractVar[Scalar | None]
    # The field that holds the lobe's shape, and what it says of the width.
    shape: eqx.AbstractClassVar[ShapeParameter]
    # The field that holds the second number, where there is one, and what it says of the index.
    index: ClassVar[IndexParameter] = IndexParameter()
    # What the model itself calls the two amplitudes; None: it has no such part, which stays black.
    amplitude_names: ClassVar[tuple[str | None, str | None]] = ("kd", "ks")

    @classmethod
    def has_index(cls) -> bool:
        """Whether there is a second number, which may be None."""
        return any(field.name == cls.index.name for field in dataclasses.fields(cls))

    @classmethod
    def called(cls, name: str) -> str | None:
        """Say what the model itself calls kd, ks, sigma or mu; None: it has no such thing."""
        kd, ks = cls.amplitude_names
        return {"kd": kd, "ks": ks, "sigma": cls.shape.name, "mu": cls.index.name}[name]

    @property
    @abc.abstractmethod
    def fresnel_is_factor(self) -> bool:
        """Whether mu enters by a factor of the exit angle alone, which leaves the lobe as it is."""

    @property
    @abc.abstractmethod
    def energy(self) -> Scalar:
        """About the lobe's albedo at normal exitance: 1 for a metal where ks is an albedo."""

    @abc.abstractmethod
    def as_metal(self: Same) -> Same:
        """Drop the Fresnel ratio, where it is a factor that the caller multiplies by himself."""

    @property
    def width(self) -> Scalar:
        """How wide (radians) the finest detail of the lobe is: light need be no finer."""
        return self.sigma

    @property
    def amplitudes(self) -> Float[AnyArray, "2 channel"]:
        """The base's and the lobe's: kd and ks."""
        return jnp.stack([jnp.asarray(self.kd), jnp.asarray(self.ks)])

    @checked
    def with_roughness(self: Same, sigma: Scalar, mu: Scalar | None = None) -> Same:
        """Replace the lobe's width, and the index where the model has one; keep the rest."""
        changed: dict = {self.shape.name: self.shape.of_width(sigma)}
        if self.has_index():
            changed[self.index.name] = None if mu is None else self.index.of_index(mu)
        return dataclasses.replace(self, **changed)

    @checked
    def with_amplitudes(
        self: Same, kd: Float[AnyArray, "channel"], ks: Float[AnyArray, "channel"]
    ) -> Same:
        """Replace kd and ks and keep the lobe."""
        return dataclasses.replace(self, kd=kd, ks=ks)


class WithoutIndex(Parametric):
    """A model of one number for its lobe, and no Fresnel term."""

    @property
    def mu(self) -> None:
        """None."""
        return None

    @property
    def fresnel_is_factor(self) -> bool:
        """Of a ratio that is one everywhere."""
        return True

    def as_metal(self: Same) -> Same:
        """Have no Fresnel ratio to drop."""
        return self


class ByOwnNumber(WithoutIndex):
    """One whose number goes by another name than sigma."""

    @property
    def sigma(self) -> Scalar:
        """The width that the model's own number stands for."""
        return self.shape.width_of(getattr(self, self.shape.name))
