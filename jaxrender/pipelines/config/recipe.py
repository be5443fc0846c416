"""A recipe: synthetic photographs with a known answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, create_model, model_validator

from jaxrender.catalogue import MODELS, NAMES, STATED, described, numbers_named
from jaxrender.pipelines.config.brdf import (
    Fresnel,
    Masking,
    MultipleScattering,
    foreign_keys,
    none_for_nothing,
    refuse_outside,
    stated,
    with_defaults_of_model,
)
from jaxrender.pipelines.config.geometry import RecipeGeometryConfig
from jaxrender.pipelines.config.lighting import RecipeLightingConfig
from jaxrender.pipelines.config.nuisances import FaultsConfig
from jaxrender.pipelines.config.stated import Case, Root
from jaxrender.pipelines.config.values import (
    ConfigPath,
    Count,
    Direction,
    Elevation,
    FieldOfView,
    NonNegative,
    Number,
    Positive,
    Rgb,
    Section,
    WholeNumber,
)

if TYPE_CHECKING:
    TrueModel = str
else:
    TrueModel = Literal[STATED]


class _RecipeBrdf(Section):
    """The true material.  A model with a specular lobe needs all its numbers."""

    file: ConfigPath | None = None
    """A material that is known by its values, in the place of a model: a file of measurements, a
    table or a tree, or the folder of a result."""
    model: TrueModel = "microfacet"
    """The model: microfacet is the thesis's Gaussian (T 6.2); renderers use ggx and beckmann."""
    fresnel: Fresnel = "exit"
    """Angle of the Fresnel term: exit (default of microfacet) or half (of ggx and beckmann)."""
    masking: Masking = "none"
    """Masking of facets by each other: none (default of microfacet) or smith (of the others)."""
    multiple_scattering: MultipleScattering = "none"
    """Light that facets hand on to one another: none, or facets (it is added)."""

    def number(self, name: str) -> Any:
        """Look a number up: of an amplitude one for each channel, or the word none."""
        return getattr(self, name)

    @model_validator(mode="wrap")
    @classmethod
    def _defaults(cls, given: Any, make: Callable[[Any], Any]) -> Any:
        return with_defaults_of_model(given, make)

    @model_validator(mode="after")
    def _complete(self) -> _RecipeBrdf:
        if self.file is not None:
            return self
        entry = MODELS[self.model]
        for name in entry.names("searched"):
            value = self.number(name)
            refuse_outside(self.model, name, () if value == "none" else (value,))
        needed = {*entry.names("amplitude", "searched")} - {*entry.settled}
        missing = needed - self.model_fields_set
        if missing:
            names = ", ".join(sorted(missing))
            raise ValueError(f"a {self.model} recipe states its whole truth; missing: {names}")
        return self


def _truth(name: str) -> tuple[Any, Any]:
    """Make the type of a key that states a number, and its default with what it means."""
    number, text = next(iter(numbers_named(name).values())), described(name)
    if number.part == "amplitude":
        return Rgb, Field(default=(0.0, 0.0, 0.0), description=text)
    kind = stated(name)
    if number.may_be_none:
        kind = Annotated[Literal["none"] | kind, BeforeValidator(none_for_nothing)]
    return kind, Field(default=number.typical, description=text)


if TYPE_CHECKING:
    RecipeBrdfConfig = _RecipeBrdf
else:
    RecipeBrdfConfig = create_model(
        "RecipeBrdfConfig",
        __base__=_RecipeBrdf,
        __doc__=_RecipeBrdf.__doc__,
        **{name: _truth(name) for name in NAMES},
    )


class RecipePaintConfig(Section):
    """Paint that depends on the direction from the centre: it mixes brdf's kd and ks with these."""

    pattern: Literal["checker", "noise"] = "checker"
    """checker: sharp cells of latitude and longitude.  noise: soft blotches."""
    cells: Count = 8
    """Cells from pole to pole, with twice as many around; for noise its highest degree."""
    kd: Rgb
    """Diffuse BRDF value of the other paint, 1/sr."""
    ks: NonNegative
    """Specular weight of the other paint, one for all channels."""
    sigma_above: Positive | None = None
    """Roughness at the top, if it varies with height; at the bottom it is that of brdf."""
    seed: WholeNumber = 0
    """Seed of the blotches."""


class ViewsConfig(Section):
    """Cameras on a circle about the object."""

    count: Count = 60
    """Number of photographs."""
    step_degrees: Number = 3.0
    """Angle from one camera to the next."""
    start_degrees: Number = 0.0
    """Angle of the first camera."""
    axis: Direction = (0.0, 0.0, 1.0)
    """Axis of the circle."""
    elevation_degrees: Elevation = 0.0
    """Angle of the cameras above the plane of the circle."""
    distance: Positive = 12.0
    """Distance from the middle of the object, world units."""
    field_of_view_degrees: FieldOfView = 12.0
    """Horizontal field of view."""
    width: Count = 96
    """Columns of a photograph."""
    height: Count = 96
    """Rows of a photograph."""


class RecipeNoiseConfig(Section):
    """Noise added to the photographs: standard deviation sqrt((relative radiance)^2 + floor^2)."""

    relative: NonNegative = 0.01
    """Part proportional to radiance."""
    floor: NonNegative = 0.0
    """Constant part, in radiance."""


class RecipeConfig(Root):
    """Everything that made a set of synthetic photographs."""

    cases = (
        Case(
            "a material from a file",
            lambda recipe: recipe.brdf.file is not None,
            {
                **{
                    f"brdf.{key}": "brings its own values"
                    for key in RecipeBrdfConfig.model_fields
                    if key != "file"
                },
                "texture": "has no kd and ks for paint to mix",
            },
            instead="remove brdf.file",
        ),
        *foreign_keys(lambda recipe: [recipe.brdf.model]),
        Case(
            "a metal",
            lambda recipe: recipe.brdf.number("mu") == "none",
            {"brdf.fresnel": "reflects the same at all angles"},
        ),
        Case(
            "a pattern of checks",
            lambda recipe: recipe.texture is not None and recipe.texture.pattern == "checker",
            {"texture.seed": "is not drawn"},
            instead="choose texture.pattern: noise",
        ),
        Case(
            "light of sources alone",
            lambda recipe: not recipe.lighting.has_image,
            {"environment_height": "needs no image"},
        ),
    )

    geometry: RecipeGeometryConfig
    """The shape."""
    brdf: RecipeBrdfConfig
    """The true material."""
    texture: RecipePaintConfig | None = None
    """Paint that varies over the surface.  Default: one material everywhere."""
    lighting: RecipeLightingConfig
    """The true light."""
    views: ViewsConfig = ViewsConfig()
    """The cameras."""
    noise: RecipeNoiseConfig = RecipeNoiseConfig()
    """The noise."""
    faults: FaultsConfig | None = None
    """What is wrong with the capture.  Default: nothing."""
    environment_height: Count = 128
    """Rows of the environment image that the fit gets."""
    seed: WholeNumber = 0
    """Seed of the noise, and of what is wrong."""

    @model_validator(mode="after")
    def _can_be_painted(self) -> RecipeConfig:
        brdf, paint = self.brdf, self.texture
        # With a file texture is refused as a key without effect.
        if paint is None or brdf.file is not None:
            return self
        model = MODELS[brdf.model]
        if len(set(brdf.number("ks"))) > 1:
            raise ValueError("a painted material has one ks for all channels; give brdf.ks once")
        if not model.about_mirror:
            raise ValueError(
                f"found texture with model {brdf.model}; choose a model with a lobe about the "
                "reflected direction"
            )
        if not model.has_specular and paint.ks:
            raise ValueError(f"found texture.ks with model {brdf.model}, which has only kd; give 0")
        if paint.sigma_above is not None:
            if "sigma" not in model.names("searched"):
                raise ValueError(
                    f"found texture.sigma_above with model {brdf.model}, which has no sigma; "
                    "remove it"
                )
            refuse_outside(brdf.model, "sigma", (paint.sigma_above,))
        return self
