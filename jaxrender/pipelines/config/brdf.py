"""Which material model is fitted, and what is known of its parameters."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Strict, Tag, model_validator

from jaxrender.pipelines.config.parameter import (
    Parameter,
    numbers_above,
    numbers_at_least,
    numbers_at_most,
    one_number,
)
from jaxrender.pipelines.config.values import Accepts, Positive, Section, Switch

Model = Literal[
    "microfacet",
    "ggx",
    "beckmann",
    "torrance-sparrow",
    "cook-torrance",
    "ward",
    "phong",
    "blinn-phong",
    "lafortune",
    "he-torrance",
    "anisotropic-ward",
    "kajiya-kay",
    "poulin-fournier",
    "oren-nayar",
    "lambertian",
]
Fresnel = Literal["exit", "half"]
Masking = Literal["none", "smith"]
Gauge = Literal["per-channel", "dielectric", "metal"]

# The models of physics, and what they are when nothing else is said; microfacet is the thesis's.
PHYSICAL_MODELS = ("ggx", "beckmann")
_PHYSICAL = {"fresnel": "half", "masking": "smith"}
# Where sigma of these models ends; what is rougher has no highlight to speak of.
_ROUGHEST = 1.0
# What a material without gloss is told to be instead.
GLOSSY = "microfacet, ggx or beckmann"

# The parameters of each model beside kd; the glossy ones have the first two in common.
_GLOSS = ("ks", "ks_per_channel")
_FACETS = (*_GLOSS, "sigma", "mu", "fresnel", "masking")
_KEYS = {
    **dict.fromkeys(("microfacet", "ggx", "beckmann"), _FACETS),
    "torrance-sparrow": (*_GLOSS, "roughness", "mu"),
    "cook-torrance": (*_GLOSS, "roughness", "mu"),
    "ward": (*_GLOSS, "roughness"),
    "phong": (*_GLOSS, "exponent"),
    "blinn-phong": (*_GLOSS, "exponent"),
    "lafortune": (*_GLOSS, "exponent", "c_z"),
    "he-torrance": (*_GLOSS, "roughness", "mu", "deviation"),
    "anisotropic-ward": (*_GLOSS, "roughness", "roughness_y"),
    "kajiya-kay": (*_GLOSS, "exponent"),
    "poulin-fournier": (*_GLOSS, "exponent", "spacing", "height"),
    "oren-nayar": ("sigma",),
    "lambertian": (),
}
# Those without gloss.
MATT = ("lambertian", "oren-nayar")
# Those whose lobe is not about the reflected direction: the exact integral alone fits them.
BY_INTEGRAL = ("anisotropic-ward", "kajiya-kay", "poulin-fournier", "oren-nayar")
FACET_MODELS = tuple(model for model, keys in _KEYS.items() if keys == _FACETS)
# What ks is a weight of, where it is not about the lobe's albedo.
_KS_WEIGHS = {
    "torrance-sparrow": "reflectance",
    "cook-torrance": "reflectance",
    "he-torrance": "reflectance",
    "lafortune": "cosine",
    "kajiya-kay": "cosine",
}
# What is chosen, not searched for.
_STATED = ("c_z", "deviation", "spacing", "height")
_CHOICES = ("ks_per_channel", "fresnel", "masking", *_STATED)
_SPECULAR_KEYS = tuple(dict.fromkeys(key for keys in _KEYS.values() for key in keys))


def _kind(value: Any) -> str:
    return "<none>" if value == "none" else "<parameter>"


Reflectance = Annotated[Parameter, AfterValidator(numbers_at_least(0.0))]
Roughness = Annotated[
    Parameter,
    AfterValidator(one_number),
    AfterValidator(numbers_above(0.0)),
    Accepts("'free', a number above 0, {fixed}, or {bounds, start}"),
]
Spacing = Annotated[
    float, Strict(), Field(ge=2, allow_inf_nan=False), Accepts("a number, at least 2")
]
Height = Annotated[
    float, Strict(), Field(gt=0, le=1, allow_inf_nan=False), Accepts("a number above 0, up to 1")
]
_SlopeRoughness = Annotated[Roughness, AfterValidator(numbers_at_most(1.0))]
Exponent = Annotated[
    Parameter,
    AfterValidator(one_number),
    AfterValidator(numbers_above(0.0)),
    Accepts("'free', a number above 0, {fixed}, or {bounds, start}"),
]
_Index = Annotated[Parameter, AfterValidator(one_number), AfterValidator(numbers_above(1.0))]
RefractiveIndex = Annotated[
    Annotated[Literal["none"], Tag("<none>")] | Annotated[_Index, Tag("<parameter>")],
    Discriminator(_kind),
    Accepts("'free', 'none', a number above 1, {fixed}, or {bounds, start}"),
]


class BrdfConfig(Section):
    """The material: T 6.2, K_d + K_s F D G / (4 cos cos), with what is known of it."""

    model: Model = "microfacet"
    """The family: microfacet is the thesis's Gaussian, ggx and beckmann are what renderers use."""
    compare: tuple[Model, ...] = ()
    """Other models to fit as well; the one that best explains held-out pixels is the result."""
    kd: Reflectance = Parameter()
    """Diffuse BRDF value (albedo / pi) of the channels, 1/sr."""
    ks: Reflectance = Parameter()
    """Specular weight: times the Fresnel reflectance of torrance-sparrow, cook-torrance and
    he-torrance (1 for a clean surface), times the power of lafortune's and kajiya-kay's cosine
    (in 1/sr)."""
    sigma: Roughness = Parameter()
    """Surface roughness (root mean square slope), above 0; of ggx what is called alpha, up to 1;
    of oren-nayar the deviation of the grooves' angle, in radians."""
    roughness: _SlopeRoughness = Parameter()
    """Of ward, cook-torrance and he-torrance the slopes' deviation times the root of 2, of
    torrance-sparrow the facets' angle in radians at 1/e; of anisotropic-ward along the tangent,
    which is the meridian about +Z.  Above 0 and at most 1."""
    roughness_y: _SlopeRoughness = Parameter()
    """Of anisotropic-ward the roughness across the tangent; above 0 and at most 1."""
    exponent: Exponent = Parameter()
    """Exponent of phong and lafortune (cosine to R), blinn-phong and poulin-fournier (cosine to the
    half vector), kajiya-kay (cosine to the cone into which a fibre along the meridian reflects)."""
    c_z: Positive = 1.0
    """C_z of lafortune's lobe (-1, -1, C_z): 1 is about R, less is nearer to the horizon."""
    deviation: Positive = 0.5
    """Of he-torrance the deviation of the surface's heights, in wavelengths."""
    spacing: Spacing = 2.0
    """Of poulin-fournier the distance between the cylinders' axes in radii, at least 2."""
    height: Height = 1.0
    """Of poulin-fournier how far the cylinders rise, in radii: 1 is half a cylinder."""
    mu: RefractiveIndex = Parameter()
    """Refractive index, above 1; none for metals (F = 1)."""
    ks_per_channel: Switch = False
    """Whether each channel has its own specular weight."""
    fresnel: Fresnel = "exit"
    """Fresnel at the exit angle (default of microfacet) or to the half vector (ggx, beckmann)."""
    masking: Masking = "none"
    """Masking and shadowing between facets: none (default of microfacet) or smith (the others')."""
    gauge: Gauge = "per-channel"
    """Under unknown light: how light and reflectance of the channels are told apart."""

    @property
    def models(self) -> tuple[str, ...]:
        """The model, and after it those that it is compared with, each once."""
        return tuple(dict.fromkeys((self.model, *self.compare)))

    def as_model(self, model: str) -> BrdfConfig:
        """Take another model, with what is said of the parameters that it has.

        Fresnel angle and masking go along where both are the thesis's or both are of physics, and
        ks where it is the weight of the same thing.
        """
        same_kind = (model in PHYSICAL_MODELS) == (self.model in PHYSICAL_MODELS)
        kept = {"kd", *_KEYS[model]} - (set() if same_kind else {"fresnel", "masking"})
        if _KS_WEIGHS.get(model) != _KS_WEIGHS.get(self.model):
            kept -= {"ks"}
        fields = {key: getattr(self, key) for key in kept}
        return BrdfConfig.model_validate({**fields, "model": model, "gauge": self.gauge})

    @model_validator(mode="before")
    @classmethod
    def _complete(cls, given: Any) -> Any:
        return with_defaults_of_model(given)

    @model_validator(mode="after")
    def _agrees_with_its_model(self) -> BrdfConfig:
        refuse_foreign_keys(self)
        sigma = self.sigma
        for model in self.models:
            refuse_roughest(model, sigma.fixed, sigma.start, *(sigma.bounds or ()))
        has_three = isinstance(self.ks.fixed, tuple) or isinstance(self.ks.start, tuple)
        if has_three and not self.ks_per_channel:
            raise ValueError("ks has three values; add 'ks_per_channel: true', or give one number")
        return self


def refuse_foreign_keys(section: Section) -> None:
    """Refuse settings that none of a section's models has."""
    models = getattr(section, "models", (getattr(section, "model", "microfacet"),))
    known = {key for model in models for key in _KEYS[model]}
    fields = type(section).model_fields
    given = [key for key in _SPECULAR_KEYS if key in fields and key not in known]
    changed = [key for key in given if getattr(section, key) != fields[key].get_default()]
    if not changed:
        return
    found = f"found {', '.join(changed)} with model {' and '.join(models)}, which"
    if models == ("lambertian",):
        raise ValueError(f"{found} has only kd; remove the key or choose model {GLOSSY}")
    own = [key for key in _SPECULAR_KEYS if key in known and key != "ks_per_channel"]
    raise ValueError(f"{found} has kd, {', '.join(own)}; remove the key, or choose another model")


def numbers_of(model: str) -> tuple[str, ...]:
    """List the numbers beside kd that make up a material of a model."""
    return tuple(key for key in _KEYS[model] if key not in _CHOICES)


def chosen_numbers_of(model: str) -> tuple[str, ...]:
    """List the numbers of a model that a config states and no fit searches for."""
    return tuple(key for key in _KEYS[model] if key in _STATED)


def with_defaults_of_model(given: Any) -> Any:
    """Fill in Fresnel angle and masking where a model of physics is named without them."""
    if isinstance(given, dict) and given.get("model") in PHYSICAL_MODELS:
        return {**_PHYSICAL, **given}
    return given


def refuse_roughest(model: str, *sigmas: Any) -> None:
    """Refuse a roughness that a model of physics has not got."""
    if model not in PHYSICAL_MODELS:
        return
    for sigma in sigmas:
        if isinstance(sigma, int | float) and sigma > _ROUGHEST:
            raise ValueError(
                f"found sigma {sigma} with model {model}, whose roughness is at most 1; "
                "give less or choose model microfacet"
            )


def distribution_of(model: str) -> str:
    """Name the distribution of facets that a model has; one without gloss has the default."""
    return model if model in PHYSICAL_MODELS else "gaussian"
