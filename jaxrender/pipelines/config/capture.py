"""The photographs of a fit, their shape, and how pixels become radiance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Tag, model_validator

from jaxrender.pipelines.config.geometry import GeometryConfig
from jaxrender.pipelines.config.lighting import CaptureLightingConfig
from jaxrender.pipelines.config.values import (
    ConfigPath,
    NonNegative,
    Positive,
    Section,
    Switch,
    WholeNumber,
)


class CurveConfig(Section):
    """A measured camera response."""

    curve: ConfigPath
    """A table of pixel value and radiance."""


def _kind(value: Any) -> str:
    return "<curve>" if isinstance(value, Mapping | CurveConfig) else "<name>"


Response = Annotated[
    Annotated[Literal["linear", "srgb"], Tag("<name>")] | Annotated[CurveConfig, Tag("<curve>")],
    Discriminator(_kind),
]


CameraAxes = Literal[
    "opengl",
    "opencv",
    "pytorch3d",
    "llff",
    "ros",
    "opengl_inverted",
    "opencv_inverted",
    "pytorch3d_inverted",
    "llff_inverted",
    "ros_inverted",
]


class _Photographs(Section):
    """Photographs: exactly one of ``transforms`` (given) and ``recipe`` (rendered first)."""

    transforms: ConfigPath | None = None
    """transforms.json of the photographs: cameras, file names, exposures."""
    recipe: ConfigPath | None = None
    """A recipe whose photographs are rendered first and then fitted."""
    images: ConfigPath | None = None
    """The folder of the photographs that transforms.json names."""
    camera_axes: CameraAxes = "opengl"
    """The camera's axes in the poses of transforms.json.  opengl (Blender): x right, y up, z
    backwards; opencv (COLMAP): x right, y down, z ahead; pytorch3d: x left, y up, z ahead; llff: x
    down, y right, z backwards; ros: x ahead, y left, z up.  The _inverted ones are poses that take
    the world into the camera.  The program itself writes opengl."""
    mirrored: Switch = False
    """Whether photographs and masks are mirror images, left for right; they are turned back."""
    response: Response = "linear"
    """How pixel values become radiance: linear, srgb or {curve: path}."""
    invalid: Literal["refuse", "mask"] = "refuse"
    """What happens to NaN, infinite and negative pixels: refuse the photograph or mask them."""
    saturation: Literal["auto"] | Positive | None = None
    """Pixel value from which a pixel is left out.  Default: no limit for float formats, 0.998 for
    integer formats, whose largest value is 1.  auto finds it in each channel of each photograph:
    many pixels at one highest value are clipped."""
    saturation_grow: WholeNumber = 0
    """Pixels left out around saturated ones.  Use 1 where demosaicing or resizing mixed pixels; it
    costs the rim of a narrow highlight."""
    black_level: NonNegative = 0.0
    """Pixel value below which a pixel is left out."""
    erode: WholeNumber = 2
    """Pixels removed along silhouettes, and along the rims and sharp folds of the object itself."""
    exposure: Literal["given", "metadata"] = "given"
    """The source of exposures: given (transforms.json) or metadata (of the photographs)."""
    allow_outside: Switch = False
    """Whether transforms.json may name files outside its own folder."""

    @model_validator(mode="after")
    def _one_source(self) -> _Photographs:
        if (self.transforms is None) == (self.recipe is None):
            found = "neither" if self.transforms is None else "both"
            raise ValueError(f"found {found}; give exactly one of transforms, recipe")
        return self


class CaptureConfig(_Photographs):
    """The photographs: exactly one of ``transforms`` (given) and ``recipe`` (rendered first)."""

    geometry: GeometryConfig | None = None
    """The known shape.  With a recipe the default is that of the recipe."""

    @model_validator(mode="after")
    def _has_geometry(self) -> CaptureConfig:
        if self.transforms is not None and self.geometry is None:
            raise ValueError(
                "missing key 'geometry'; photographs need {sphere: ...} or {mesh: ...}"
            )
        return self


class FurtherCaptureConfig(_Photographs):
    """Further photographs of the same object, where it lies as in ``capture``, in another light."""

    lighting: CaptureLightingConfig = CaptureLightingConfig()
    """The light of these photographs.  With a recipe the default is that of the recipe."""

    @model_validator(mode="after")
    def _is_lit(self) -> FurtherCaptureConfig:
        if self.recipe is None and not self.lighting.given:
            raise ValueError(
                "missing key 'lighting'; each of captures needs its own: one of environment, "
                "directional, per_frame"
            )
        if self.recipe is not None:
            for name in ("images", "allow_outside", "camera_axes", "mirrored"):
                if name in self.model_fields_set:
                    raise ValueError(f"{name}: a recipe has photographs of its own; remove it")
        return self
