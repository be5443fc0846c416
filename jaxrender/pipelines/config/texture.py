"""What a material that varies over the surface is sought as, and a BRDF as coefficients."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from jaxrender.pipelines.config.values import ConfigPath, Count, Section, Switch, WholeNumber


class TextureConfig(Section):
    """K_d and K_s of every texel or vertex (T 6.13), and what is told of the light."""

    size: Literal["auto"] | Count = "auto"
    """Rows of the texture, a mesh's being square and a sphere's twice as wide; auto: as many as
    leave every texel a dozen pixels on average.  A mesh without texture coordinates has its
    vertices instead."""
    regions: ConfigPath | None = None
    """A picture over the texture coordinates whose colours tell materials apart: each colour gets a
    sigma and a mu of its own."""
    sigma: Literal["even", "varying"] = "even"
    """Whether every material has one sigma, or it varies slowly over the surface."""
    control_points: Count = 24
    """Places at which a varying sigma is sought; between them it is smooth."""
    unknown_light: Switch = False
    """Whether the light is unknown although a recipe could tell it."""
    prior: Literal["total-variation", "variance"] = "total-variation"
    """What picks a matte object's texture under unknown light: paint of few colours, or even."""
    dilate: WholeNumber = 2
    """Texels by which the maps are continued beyond what was seen, so that seams do not show."""

    @model_validator(mode="after")
    def _can_vary(self) -> TextureConfig:
        if self.sigma == "varying" and self.control_points < 2:
            raise ValueError("control_points is 1, with which sigma cannot vary; give more")
        return self


class SpectrumConfig(Section):
    """A BRDF as coefficients rho_lpq about the normal (T 2.53, 6.4.2)."""

    order: WholeNumber = 6
    """Highest degrees l and p."""
    reciprocal: Switch = True
    """Whether rho~_lpq = rho~_plq is imposed, which halves the unknowns."""
