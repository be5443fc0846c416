"""What a model of a material is, and each of its numbers: a name, its part in a fit, its interval.

``amplitude``
    enters linearly: how much of one of the model's lobes there is, in each channel
``searched``
    shapes a lobe: a fit looks for it unless it is fixed
``stated``
    is stated by whoever names the model, and no fit looks for it
``sum``
    is what a fit says of several lobes together, and nobody states
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from jaxrender.catalogue.interval import Interval

Part = Literal["amplitude", "searched", "stated", "sum"]


class Number(NamedTuple):
    """One number of a model.

    ``symbol`` is a letter and, after an underscore, its index.  ``weighs`` says of an amplitude
    what it is times, so that it means the same in two models if that is the same; what is typical
    of one is an albedo (of kd over π).  ``settled`` is what a number is that nobody states or calls
    free; None: it is free then.
    """

    name: str
    symbol: str
    meaning: str
    domain: Interval
    typical: float
    part: Part = "searched"
    may_be_none: bool = False
    weighs: str = ""
    settled: float | None = None

    @property
    def letter(self) -> str:
        """The symbol without its index."""
        return self.symbol.partition("_")[0]

    @property
    def index(self) -> str:
        """The symbol's index, or ''."""
        return self.symbol.partition("_")[2]


class Model(NamedTuple):
    """A model by its name, and the surface that it stands for.

    ``home`` is the module and class below ``jaxrender.brdf`` that holds it for a fit.  ``fixed`` is
    what makes the class this model, ``options`` what may be chosen otherwise.  ``about_mirror``
    says that its lobe is about the reflected direction, so that it has a frequency view.
    ``is_stated`` says that its numbers tell the whole material: a recipe can state it.
    """

    name: str
    surface: str
    home: str
    numbers: tuple[Number, ...]
    fixed: Mapping[str, Any] = MappingProxyType({})
    options: Mapping[str, str] = MappingProxyType({})
    about_mirror: bool = True
    is_stated: bool = True

    def names(self, *parts: Part) -> tuple[str, ...]:
        """Name the numbers that have one of these parts in a fit."""
        return tuple(number.name for number in self.numbers if number.part in parts)

    def number(self, name: str) -> Number:
        """Find a number by its name; ``KeyError`` if the model has none of that name."""
        for number in self.numbers:
            if number.name == name:
                return number
        raise KeyError(name)

    @property
    def settled(self) -> dict[str, float]:
        """What the numbers are that nobody states or calls free."""
        return {one.name: one.settled for one in self.numbers if one.settled is not None}

    @property
    def has_one_lobe(self) -> bool:
        """Whether there is a base and a lobe, or one of the two, of two numbers at most."""
        few = self.is_stated and len(self.names("searched")) <= 2
        return few and {*self.names("amplitude")} <= {"kd", "ks"}

    @property
    def has_specular(self) -> bool:
        """Whether the model has more than a diffuse lobe."""
        return self.names("amplitude", "sum") != ("kd",)


FROM_0, TO_1 = Interval("[0, inf)"), Interval("(0, 1]")


def amplitude(name: str, symbol: str, meaning: str, typical: float, weighs: str) -> Number:
    """Make an amplitude of at least 0."""
    return Number(name, symbol, meaning, FROM_0, typical, "amplitude", weighs=weighs)
