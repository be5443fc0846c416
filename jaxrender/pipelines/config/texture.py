"""The settings of a recovered texture, and of a BRDF as coefficients."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from jaxrender.pipelines.config.values import ConfigPath, Count, Section, Switch, WholeNumber


class TextureConfig(Section):
    """The settings of a texture: K_d and K_s of every texel or vertex (T 6.13)."""

    size: Literal["auto"] | Count = "auto"
    """Rows of the texture.  It is square for a mesh, and twice as wide for a sphere.  auto gives
    every texel a dozen pixels on average.  A mesh without texture coordinates uses its vertices."""
    regions: ConfigPath | None = None
    """A picture over the texture coordinates.  Each colour is a material with its own sigma and
    mu."""
    sigma: Literal["even", "varying", "map"] = "even"
    """even: one sigma for each material.  varying: sigma varies slowly over the surface.  map: each
    texel or vertex has its own."""
    control_points: Count = 24
    """Number of places where a varying sigma is fitted; it is smooth between them."""
    normals: Literal["shape", "map"] = "shape"
    """shape: the normals are those of the shape.  map: each texel or vertex has its own."""
    unknown_light: Switch = False
    """Whether the light is unknown although the recipe states it."""
    prior: Literal["total-variation", "variance"] = "total-variation"
    """The prior of a diffuse texture under unknown light: paint of few colours, or even paint."""
    dilate: WholeNumber = 2
    """Texels by which the maps continue beyond seen texels, so that seams do not show."""

    @model_validator(mode="after")
    def _can_vary(self) -> TextureConfig:
        if self.sigma == "varying" and self.control_points < 2:
            raise ValueError("control_points is 1, so sigma cannot vary; give more")
        return self


class SpectrumConfig(Section):
    """A BRDF as coefficients rho_lpq about the normal (T 2.53, 6.4.2)."""

    order: WholeNumber = 6
    """Highest degrees l and p."""
    reciprocal: Switch = True
    """Whether the fit imposes rho~_lpq = rho~_plq, which halves the unknowns."""
