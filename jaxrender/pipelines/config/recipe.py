"""A recipe: how photographs with a known answer are rendered, for trials and tests."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, Strict, model_validator

from jaxrender.pipelines.config.brdf import (
    BY_INTEGRAL,
    Fresnel,
    Height,
    Masking,
    Model,
    Spacing,
    numbers_of,
    refuse_foreign_keys,
    refuse_roughest,
    with_defaults_of_model,
)
from jaxrender.pipelines.config.geometry import RecipeGeometryConfig
from jaxrender.pipelines.config.lighting import DirectionalConfig, EnvironmentConfig
from jaxrender.pipelines.config.values import (
    Accepts,
    Count,
    Direction,
    Elevation,
    FieldOfView,
    LobeWidth,
    NonNegative,
    Number,
    Positive,
    Rgb,
    Section,
    WholeNumber,
)

TrueIndex = Annotated[
    float, Strict(), Field(gt=1, allow_inf_nan=False), Accepts("a number above 1")
]
SlopeRoughness = Annotated[
    float, Strict(), Field(gt=0, le=1, allow_inf_nan=False), Accepts("a number above 0, up to 1")
]


class RecipeBrdfConfig(Section):
    """The true material; one with gloss needs every number that its model has."""

    model: Model = "microfacet"
    """The family: microfacet is the thesis's Gaussian, ggx and beckmann are what renderers use."""
    kd: Rgb
    """Diffuse BRDF value (albedo / pi), 1/sr."""
    ks: Rgb = (0.0, 0.0, 0.0)
    """Specular weight: times the Fresnel reflectance of torrance-sparrow, cook-torrance and
    he-torrance (1 for a clean surface), times the power of lafortune's and kajiya-kay's cosine
    (in 1/sr)."""
    sigma: Positive = 0.1
    """Surface roughness; of ggx what is called alpha, up to 1; of oren-nayar the deviation of the
    grooves' angle, in radians."""
    roughness: SlopeRoughness = 0.2
    """Of ward, cook-torrance and he-torrance the slopes' deviation times the root of 2, of
    torrance-sparrow the facets' angle in radians at 1/e; of anisotropic-ward along the tangent,
    which is the meridian about +Z.  Up to 1."""
    roughness_y: SlopeRoughness = 0.2
    """Of anisotropic-ward the roughness across the tangent; up to 1."""
    exponent: Positive = 50.0
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
    mu: Literal["none"] | TrueIndex = 1.5
    """Refractive index; none for metals (F = 1)."""
    fresnel: Fresnel = "exit"
    """Fresnel at the exit angle (default of microfacet) or to the half vector (ggx, beckmann)."""
    masking: Masking = "none"
    """Masking and shadowing between facets: none (default of microfacet) or smith (the others')."""

    @model_validator(mode="before")
    @classmethod
    def _defaults(cls, given: Any) -> Any:
        return with_defaults_of_model(given)

    @model_validator(mode="after")
    def _complete(self) -> RecipeBrdfConfig:
        refuse_foreign_keys(self)
        refuse_roughest(self.model, self.sigma)
        missing = set(numbers_of(self.model)) - self.model_fields_set
        if missing:
            names = ", ".join(sorted(missing))
            raise ValueError(f"a {self.model} recipe states its whole truth; missing: {names}")
        return self


class RecipePaintConfig(Section):
    """Paint by direction from the middle of the object: from brdf's kd and ks to those here."""

    pattern: Literal["checker", "noise"] = "checker"
    """Sharp cells of latitude and longitude, or soft blotches."""
    cells: Count = 8
    """Cells from pole to pole, twice as many around; of blotches the highest degree."""
    kd: Rgb
    """Diffuse BRDF value of the other paint, 1/sr."""
    ks: NonNegative
    """Specular weight of the other paint, one for all channels."""
    sigma_above: Positive | None = None
    """Roughness at the very top, where it varies with height: below it is brdf's."""
    seed: WholeNumber = 0
    """Seed of the blotches."""


class AreaConfig(Section):
    """A smooth lobe of light."""

    direction: Direction
    """Towards the middle of the lobe; any length."""
    width_degrees: LobeWidth
    """Width of the lobe."""
    radiance: Rgb
    """Radiance in the middle of the lobe: one number or three."""


class RecipeLightingConfig(Section):
    """The true light; several kinds add up."""

    area: tuple[AreaConfig, ...] = ()
    """Smooth lobes."""
    environment: EnvironmentConfig | None = None
    """An environment image."""
    directional: tuple[DirectionalConfig, ...] = ()
    """Directional sources."""

    @model_validator(mode="after")
    def _has_light(self) -> RecipeLightingConfig:
        if not (self.area or self.environment or self.directional):
            raise ValueError("no light given; give at least one of area, environment, directional")
        return self


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


class RecipeConfig(Section):
    """Everything that made a set of synthetic photographs."""

    geometry: RecipeGeometryConfig
    """The shape."""
    brdf: RecipeBrdfConfig
    """The true material."""
    texture: RecipePaintConfig | None = None
    """Paint that varies over the surface; without it the material is the same everywhere."""
    lighting: RecipeLightingConfig
    """The true light."""
    views: ViewsConfig = ViewsConfig()
    """The cameras."""
    noise: RecipeNoiseConfig = RecipeNoiseConfig()
    """The noise."""
    environment_height: Count = 128
    """Rows of the environment image that is handed to the fit."""
    seed: WholeNumber = 0
    """Seed of the noise."""

    @model_validator(mode="after")
    def _paint_has_one_ks(self) -> RecipeConfig:
        if self.texture is not None and len(set(self.brdf.ks)) > 1:
            raise ValueError("a painted material has one ks for all channels; give brdf.ks once")
        if self.texture is not None and self.brdf.model in BY_INTEGRAL:
            raise ValueError(
                f"found texture with model {self.brdf.model}; choose a model with a lobe about the "
                "reflected direction"
            )
        if self.texture is not None and self.brdf.model == "lambertian" and self.texture.ks:
            raise ValueError("found texture.ks with model lambertian, which has only kd; give 0")
        if self.texture is not None and self.texture.sigma_above is not None:
            if "sigma" not in numbers_of(self.brdf.model):
                raise ValueError(
                    f"found texture.sigma_above with model {self.brdf.model}, which has no sigma; "
                    "remove it"
                )
            refuse_roughest(self.brdf.model, self.texture.sigma_above)
        return self
