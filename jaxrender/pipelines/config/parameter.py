"""One number of the material in a fit: free, free within bounds, or fixed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar

from pydantic import GetJsonSchemaHandler, model_serializer, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from jaxrender.catalogue import Interval as Domain
from jaxrender.pipelines.config.values import Accepts, Number, Section

Triple = tuple[Number, Number, Number]
Values = Annotated[Number | Triple, Accepts("a number or three numbers")]
Interval = Annotated[tuple[Number, Number], Accepts("two numbers [lowest, highest]")]
Normal = Annotated[tuple[Number, Number], Accepts("two numbers [mean, standard deviation]")]


def _numbers(value: float | tuple[float, ...] | None) -> tuple[float, ...]:
    """Return all numbers of one entry; none if it is absent."""
    if value is None:
        return ()
    return value if isinstance(value, tuple) else (value,)


class Parameter(Section):
    """An unknown: ``free``, ``{fixed: v}``, or some of bounds, start and prior.

    These are ``{bounds: [low, high], start: v, prior: [mean, standard deviation]}``.  A bare
    number, or three of them for the channels, means ``fixed``.
    """

    accepts: ClassVar[str] = "'free', a number, three numbers, {fixed}, or {bounds, start, prior}"

    fixed: Values | None = None
    """The known value: a number, or three for the channels."""
    bounds: Interval | None = None
    """The interval [lowest, highest] of the search."""
    start: Values | None = None
    """Where the search starts."""
    prior: Normal | None = None
    """What is known of the value beforehand: the mean and standard deviation of a normal
    distribution."""

    @property
    def free(self) -> bool:
        """Whether the fit searches for the value."""
        return self.fixed is None

    @property
    def numbers(self) -> tuple[float, ...]:
        """All numbers that the config states for this parameter."""
        mean = () if self.prior is None else self.prior[:1]
        return _numbers(self.fixed) + (self.bounds or ()) + _numbers(self.start) + mean

    @model_validator(mode="before")
    @classmethod
    def _from_shorthand(cls, value: Any) -> Any:
        if isinstance(value, str) and value == "free":
            return {}
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return {"fixed": value} if is_number or isinstance(value, list | tuple) else value

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Parameter:
        others = (self.bounds, self.start, self.prior)
        if self.fixed is not None and any(other is not None for other in others):
            raise ValueError(
                "a fixed value needs no bounds, no start and no prior; remove them, or 'fixed'"
            )
        if self.prior is not None and not self.prior[1] > 0:
            raise ValueError(f"prior standard deviation {self.prior[1]:g}; it must be above 0")
        if self.bounds is None:
            return self
        low, high = self.bounds
        if not low < high:
            raise ValueError(f"found bounds [{low:g}, {high:g}]; the first must be the smaller one")
        outside = [value for value in _numbers(self.start) if not low <= value <= high]
        if outside:
            raise ValueError(f"start {outside[0]:g} lies outside the bounds [{low:g}, {high:g}]")
        if self.prior is not None and not low <= self.prior[0] <= high:
            raise ValueError(
                f"prior mean {self.prior[0]:g} lies outside the bounds [{low:g}, {high:g}]"
            )
        return self

    @model_serializer
    def _to_plain(self) -> Any:
        entries = {name: getattr(self, name) for name in ("fixed", "bounds", "start", "prior")}
        given = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in entries.items()
            if value is not None
        }
        return given or "free"

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Give editors the section and its shorthands."""
        number = {"type": "number"}
        triple = {"type": "array", "items": number, "minItems": 3, "maxItems": 3}
        values = {"anyOf": [number, triple]}
        pair = {"type": "array", "items": number, "minItems": 2, "maxItems": 2}
        section = {
            "type": "object",
            "additionalProperties": False,
            "properties": {"fixed": values, "bounds": pair, "start": values, "prior": pair},
        }
        shorthands: list[Mapping[str, Any]] = [{"const": "free"}, number, triple, section]
        return {"anyOf": shorthands, "description": cls.__doc__}


def numbers_inside(domain: Domain) -> Callable[[Parameter], Parameter]:
    """A check that every number named for a parameter lies in an interval."""

    def check(parameter: Parameter) -> Parameter:
        wrong = [number for number in parameter.numbers if not domain.holds(number)]
        if wrong:
            raise ValueError(f"found {wrong[0]:g}; every value here must be {domain.words}")
        return parameter

    return check


def one_number(parameter: Parameter) -> Parameter:
    """Refuse three values where the material has only one."""
    for name, value in (("fixed", parameter.fixed), ("start", parameter.start)):
        if isinstance(value, tuple):
            shown = ", ".join(f"{number:g}" for number in value)
            raise ValueError(
                f"found {name} [{shown}]; this parameter is one number for all channels"
            )
    return parameter
