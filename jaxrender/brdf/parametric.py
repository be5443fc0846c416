"""A BRDF that a fit can recover: lobes with an amplitude each, and the numbers that shape them.

rho = kd f_1(w_i, w_o) + ks f_2(w_i, w_o; numbers) + ...

Amplitudes enter linearly and are eliminated; most models have two, kd of a base and ks of a lobe.
The other numbers are the model's own, and are searched as such: ``searched`` names them and says
where.  Most lobes have a width.
``ShapeParameter`` says how the width sigma follows from the model's own number, so that the
frequency view of all models is one.  ``IndexParameter`` says the same of the index mu.

A new model becomes one that can be fitted by being ``Parametric``: no other file needs to know it
by more than its name.  Its exact integral is all that a fit then asks of it; a ``Glossy`` one has
its lobe about the reflected direction, and the frequency view besides.
"""

import abc
import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.parameters import Scalar
from jaxrender.shapes import AnyArray, Float, checked

Same = TypeVar("Same", bound="Parametric")

# Where a width and an index are searched for: from nearly mirror to nearly diffuse, and from nearly
# no interface to well above diamond.  The search starts in between.
WIDTH_BOUNDS, _FIRST_WIDTH = (0.01, 1.0), 0.15
INDEX_BOUNDS, _FIRST_INDEX = (1.02, 6.0), 1.5


class Searched(NamedTuple):
    """A number that a fit looks for, by the name of its field.

    It is searched in log(value - origin), between ``lowest`` and ``highest`` and from ``start``
    unless the user says otherwise.  The bounds of a ``closed`` one are values like all others, as
    the ends of a share are.  ``expected`` are the mean and standard deviation that a fit holds it
    to, unless the photographs or the user say otherwise.
    """

    name: str
    lowest: float
    highest: float
    start: float
    origin: float = 0.0
    closed: bool = False
    expected: tuple[float, float] | None = None


class ShapeParameter(NamedTuple):
    """A model's own number for the width of its lobe: value = scale sigma^power.

    sigma is the half angle (radians) at which the lobe is about 1/e of its peak, as in T 6.2.  An
    exponent s of R.w_i has scale 1/2 and power -2 (T 6.7: s = 1 / (2 sigma^2)).
    """

    name: str
    scale: float = 1.0
    power: float = 1.0

    @property
    def searched(self) -> Searched:
        """Where the model's own number is searched for: where its width is."""
        lowest, highest = sorted(self.of_width(width) for width in WIDTH_BOUNDS)
        return Searched(self.name, lowest, highest, self.of_width(_FIRST_WIDTH))

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

    @property
    def searched(self) -> Searched:
        """Where the model's own number is searched for; what stands for 1 is the origin."""
        lowest, highest = (self.of_index(bound) for bound in INDEX_BOUNDS)
        highest = highest if self.highest is None else self.highest
        first, origin = self.of_index(_FIRST_INDEX), self.of_index(1.0)
        return Searched(self.name, lowest, highest, first, origin)

    def of_index(self, mu):
        """Turn an index into the model's own number."""
        return mu - self.offset

    def index_of(self, value):
        """Turn the model's own number into an index."""
        return value + self.offset


class Parametric(BRDF):
    """Lobes with an amplitude per channel each, of width sigma, perhaps with an index mu.

    ``sigma`` and ``mu`` may be properties: what the model's own numbers stand for.
    """

    if TYPE_CHECKING:
        # The amplitudes of most models, which their constructors take first.
        kd: Float[AnyArray, "channel"]
        ks: Float[AnyArray, "channel"]
    sigma: eqx.AbstractVar[Scalar]
    mu: eqx.AbstractVar[Scalar | None]
    # The field that holds the lobe's shape, and what it says of the width.
    shape: eqx.AbstractClassVar[ShapeParameter]
    # The field that holds the second number, where there is one, and what it says of the index.
    index: ClassVar[IndexParameter] = IndexParameter()
    # The fields that hold amplitudes, one for each lobe and in the order of the lobes.
    amplitude_names: ClassVar[tuple[str, ...]] = ("kd", "ks")
    # Those of lobes that none of the searched numbers shapes, such as a Lambertian base.
    bases: ClassVar[tuple[str, ...]] = ("kd",)
    # Those that have a value for each channel, whatever a fit is told of the others.
    coloured: ClassVar[tuple[str, ...]] = ("kd",)
    # Amplitudes that stand in for one another, by the name of their sum, which alone means
    # something.
    sums: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({})

    @classmethod
    def has_index(cls) -> bool:
        """Whether there is a second number, which may be None."""
        return any(field.name == cls.index.name for field in dataclasses.fields(cls))

    def shaped(self) -> tuple[int, ...]:
        """The places of the lobes over the bases."""
        return tuple(at for at, name in enumerate(self.amplitude_names) if name not in self.bases)

    @property
    def searched(self) -> tuple[Searched, ...]:
        """The numbers that a fit looks for: the lobe's, and the index unless there is none."""
        numbers = (self.shape.searched,)
        return numbers if self.mu is None else (*numbers, self.index.searched)

    @property
    def settled(self) -> Mapping[str, float]:
        """What amplitudes and numbers are that nobody states or frees."""
        return {}

    @property
    def closed(self) -> tuple[str, ...]:
        """The names of what may end at a bound as at any other value."""
        return tuple(one.name for one in self.searched if one.closed)

    @property
    def has_frequency_view(self) -> bool:
        """Whether the lobe is about the reflected direction, and its width and index are all."""
        return False

    @property
    def numbers(self) -> dict[str, Scalar]:
        """The values of the numbers that a fit looks for."""
        return {one.name: getattr(self, one.name) for one in self.searched}

    def with_numbers(self: Same, numbers: Mapping[str, Scalar]) -> Same:
        """Replace some of the model's own numbers and keep the rest."""
        return dataclasses.replace(self, **numbers)

    @property
    def in_use(self: Same) -> Same:
        """The same material without lobes that are black, where it can do without."""
        return self

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
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """How much there is of each lobe: of most models kd and ks."""
        return jnp.stack([jnp.asarray(getattr(self, name)) for name in self.amplitude_names])

    @property
    def base_amplitude(self) -> Float[AnyArray, "channel"]:
        """How much there is of the bases together; none of a model without one."""
        names = self.amplitude_names
        return self._total([at for at, name in enumerate(names) if name in self.bases])

    @property
    def lobe_amplitude(self) -> Float[AnyArray, "channel"]:
        """How much there is of the lobes together that numbers shape."""
        return self._total(self.shaped())

    def _total(self, places: Sequence[int]) -> Float[AnyArray, "channel"]:
        return jnp.sum(self.amplitudes[np.array(places, int)], axis=0)

    @checked
    def curves(self, angles: Float[AnyArray, "angle"]) -> Mapping[str, Float[AnyArray, "angle"]]:
        """Evaluate what all numbers describe together, over angles (radians): of most, nothing.

        The names are ``distribution``, D by the facets' tilt, and ``fresnel``, F / F(0).  Of a
        model that has them a fit judges the curves, and no number by itself.
        """
        return {}

    @checked
    def with_roughness(self: Same, sigma: Scalar, mu: Scalar | None = None) -> Same:
        """Replace the lobe's width, and the index where the model has one; keep the rest."""
        changed: dict = {self.shape.name: self.shape.of_width(sigma)}
        if self.has_index():
            changed[self.index.name] = None if mu is None else self.index.of_index(mu)
        return dataclasses.replace(self, **changed)

    @checked
    def with_amplitudes(self: Same, *amplitudes: Float[AnyArray, "channel"]) -> Same:
        """Replace the amplitudes, in the order of their names, and keep the lobes."""
        return dataclasses.replace(self, **dict(zip(self.amplitude_names, amplitudes, strict=True)))


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
