"""The material model of a fit, and what is known of its numbers.

The keys are the numbers of all models in the catalogue.  A new model there needs no change here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Strict,
    Tag,
    create_model,
    model_validator,
)

from jaxrender.catalogue import MODELS, NAMES, Interval, Number, described, numbers_named
from jaxrender.pipelines.config.parameter import Parameter, numbers_inside, one_number
from jaxrender.pipelines.config.stated import Case
from jaxrender.pipelines.config.values import Accepts, Section, Switch, auto_or_several

if TYPE_CHECKING:
    Model = str
    Compared = Literal["auto"] | tuple[str, ...]
else:
    Model = Literal[tuple(MODELS)]
    Compared = auto_or_several(Model)
Fresnel = Literal["exit", "half"]
Masking = Literal["none", "smith"]
MultipleScattering = Literal["none", "facets"]
Gauge = Literal["per-channel", "dielectric", "metal"]

# What compare: auto tries, from simple to rich; and the model that stands for them in a config.
LADDER = ("lambertian", "ggx", "two-ggx", "bank")
_OF_LADDER = "ggx"

# Those of facets, which have a choice of Fresnel angle and masking.
FACET_MODELS = tuple(name for name, model in MODELS.items() if "fresnel" in model.options)
# glTF's, whose numbers a texture may have as maps.
METALLIC = "metallic-roughness"
# Every key that belongs to some models alone.
_CHOICES = ("fresnel", "masking", "multiple_scattering")
_KEYS_OF_SOME = (*NAMES, "ks_per_channel", *_CHOICES)


def _keys(model: str) -> tuple[str, ...]:
    """List the keys that a model has."""
    entry = MODELS[model]
    return (
        *entry.names("amplitude", "searched", "stated"),
        *entry.options,
        *["ks_per_channel"] * ("ks" in entry.names("amplitude")),
    )


def anywhere(name: str) -> Interval:
    """Join the intervals in which a number lies in the models that have it."""
    inside = [number.domain for number in numbers_named(name).values()]
    low = min(inside, key=lambda one: (one.low, one.text[0] == "("))
    high = max(inside, key=lambda one: (one.high, one.text[-1] == "]"))
    return Interval(f"{low.text[0]}{low.low}, {high.high}{high.text[-1]}")


def _entry(name: str) -> tuple[Any, Any]:
    """Make the type of a key, and its default with what it means."""
    number, domain = next(iter(numbers_named(name).values())), anywhere(name)
    text = described(name)
    if number.part == "stated":
        return stated(name), Field(default=number.typical, description=text)
    return _known(number, domain), Field(default=Parameter(), description=text)


def stated(name: str) -> Any:
    """Make the type of a key that is a plain number in the interval of its models."""
    domain = anywhere(name)
    ends: dict[str, Any] = {"gt" if domain.text[0] == "(" else "ge": domain.low}
    if domain.high < float("inf"):
        ends["lt" if domain.text[-1] == ")" else "le"] = domain.high
    bounds = Field(allow_inf_nan=False, **ends)
    return Annotated[float, Strict(), bounds, Accepts(f"a number {domain.words}")]


def _known(number: Number, domain: Interval) -> Any:
    """Make the type of a key that says what is known of a number."""
    inside = AfterValidator(numbers_inside(domain))
    if number.part == "amplitude":
        return Annotated[Parameter, inside]
    words = f"a number {domain.words}, {{fixed}}, or {{bounds, start, prior}}"
    single = Annotated[Parameter, AfterValidator(one_number), inside]
    if not number.may_be_none:
        return Annotated[single, Accepts(f"'free', {words}")]
    return Annotated[
        Annotated[Literal["none"], Tag("<none>")] | Annotated[single, Tag("<parameter>")],
        Discriminator(lambda value: "<none>" if value == "none" else "<parameter>"),
        Accepts(f"'free', 'none', {words}"),
        BeforeValidator(none_for_nothing),
    ]


def none_for_nothing(value: Any) -> Any:
    """Read null as the word none."""
    return "none" if value is None else value


class _Brdf(Section):
    """The material: K_d plus K_s times a lobe, and what is known of its numbers."""

    model: Model = "microfacet"
    """The model: microfacet is the thesis's Gaussian (T 6.2); renderers use ggx and beckmann."""
    compare: Compared = ()
    """Other models to fit as well.  auto: lambertian, ggx, two-ggx and bank in turn, until the next
    gains nothing.  The simplest that explains held-out photographs as well as the best is kept."""
    ks_per_channel: Switch = False
    """Whether each channel has its own specular weight."""
    fresnel: Fresnel = "exit"
    """Angle of the Fresnel term: exit (default of microfacet) or half (of ggx and beckmann)."""
    masking: Masking = "none"
    """Masking of facets by each other: none (default of microfacet) or smith (of the others)."""
    multiple_scattering: MultipleScattering = "none"
    """Light that facets hand on to one another: none, or facets (it is added)."""
    table: Switch = False
    """Whether a table over half and difference angles corrects the model where the photographs ask
    for it.  Its nodes have errors of their own, and the model stands where nothing was seen."""
    gauge: Gauge = "per-channel"
    """Under unknown light: the convention that separates light from reflectance in each channel."""

    @property
    def models(self) -> tuple[str, ...]:
        """The model, and after it those that it is compared with, each once."""
        if self.compare == "auto":
            return LADDER
        return tuple(dict.fromkeys((self.model, *self.compare)))

    def known(self, name: str) -> Parameter | None:
        """Return what is known of a number; None where it is absent, as a metal's index."""
        value = getattr(self, name)
        return None if value == "none" else value

    def chosen(self) -> dict[str, Any]:
        """Return the stated numbers and options of the model, which no fit changes."""
        entry = MODELS[self.model]
        return {name: getattr(self, name) for name in (*entry.names("stated"), *entry.options)}

    def as_model(self, model: str) -> BrdfConfig:
        """Take another model, and keep what is known of the numbers that both have.

        What the other model has settled stays so.  Options are kept if both models have the same
        defaults.  An amplitude is kept if it weighs the same thing.
        """
        mine, other = MODELS[self.model], MODELS[model]
        kept = ({*_keys(self.model)} | self.model_fields_set) & {*_keys(model)}
        if mine.options != other.options:
            kept -= set(other.options)
        for name in set(mine.names("amplitude")) & set(other.names("amplitude")):
            if mine.number(name).weighs != other.number(name).weighs:
                kept -= {name}
        fields = {key: getattr(self, key) for key in kept}
        return BrdfConfig.model_validate({**fields, "model": model, "gauge": self.gauge})

    @model_validator(mode="wrap")
    @classmethod
    def _complete(cls, given: Any, make: Callable[[Any], Any]) -> Any:
        return with_defaults_of_model(given, make)

    @model_validator(mode="after")
    def _agrees_with_its_model(self) -> _Brdf:
        for model in self.models:
            for name in MODELS[model].names("searched"):
                known = self.known(name)
                refuse_outside(model, name, () if known is None else known.numbers)
        ks = self.known("ks")
        assert ks is not None
        if not self.ks_per_channel and any(isinstance(v, tuple) for v in (ks.fixed, ks.start)):
            raise ValueError("ks has three values; add 'ks_per_channel: true', or give one number")
        return self


if TYPE_CHECKING:
    BrdfConfig = _Brdf
else:
    BrdfConfig = create_model(
        "BrdfConfig",
        __base__=_Brdf,
        __doc__=_Brdf.__doc__,
        **{name: _entry(name) for name in NAMES},
    )


def foreign_keys(models_of: Callable[[Any], Iterable[str]]) -> tuple[Case, ...]:
    """Make a case of each key that only some models have, for a root that names models so."""

    def models(config: Any) -> str:
        return " and ".join(
            f"{model} ({', '.join(key for key in _keys(model) if key != 'ks_per_channel')})"
            for model in models_of(config)
        )

    return tuple(
        Case(
            lambda config: f"model {models(config)}",
            lambda config, key=key: not any(key in _keys(model) for model in models_of(config)),
            {f"brdf.{key}": f"has no {key}"},
            instead="choose another model",
        )
        for key in _KEYS_OF_SOME
    )


def with_defaults_of_model(given: Any, make: Callable[[Any], Any]) -> Any:
    """Make a section with the default options of its model, and the numbers that it has settled."""
    if not isinstance(given, dict):
        return make(given)
    stated = {"model": _OF_LADDER, **given} if given.get("compare") == "auto" else given
    model = MODELS.get(str(stated.get("model")))
    if model is None:
        return make(given)
    made = make({**model.options, **model.settled, **stated})
    # Nobody has stated these.
    made.model_fields_set.intersection_update(given)
    return made


def refuse_outside(model: str, name: str, values: Iterable[float]) -> None:
    """Refuse what lies outside the interval that a number has in one model."""
    domain = MODELS[model].number(name).domain
    for value in values:
        # What lies outside in every model is refused at the key itself.
        if anywhere(name).holds(value) and not domain.holds(value):
            raise ValueError(
                f"found {name} {value:g} with model {model}, where it is {domain.words}; "
                "give another, or choose another model"
            )
