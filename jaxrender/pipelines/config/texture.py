"""The settings of a recovered texture and of a BRDF as coefficients, and what has no effect."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import model_validator

from jaxrender.pipelines.config.brdf import FACET_MODELS, METALLIC
from jaxrender.pipelines.config.stated import Case
from jaxrender.pipelines.config.values import ConfigPath, Count, Section, Switch, WholeNumber

if TYPE_CHECKING:
    from jaxrender.pipelines.config.run import RunConfig


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
    ks: Literal["single", "color"] = "single"
    """single: one K_s for all channels, as a dielectric has it.  color: each channel of each texel
    or vertex has its own, as metals have.  Where photographs do not tell, K_s has no color."""
    roughness: Literal["even", "map"] = "even"
    """Of model metallic-roughness: one roughness for all, or one for each texel or vertex."""
    metalness: Literal["even", "map"] = "even"
    """Of model metallic-roughness: one share of metal for all (brdf.metallic), or one for each
    texel or vertex."""
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


def _varies(config: RunConfig) -> bool:
    return config.texture is not None and config.texture.sigma == "varying"


def _has_maps(config: RunConfig) -> bool:
    """Tell whether each site has a sigma or a normal for itself."""
    asked = config.texture
    return asked is not None and "map" in (asked.sigma, asked.normals)


def _has_color(config: RunConfig) -> bool:
    return config.texture is not None and config.texture.ks == "color"


def _is_diffuse_texture(config: RunConfig) -> bool:
    return config.task == "texture" and config.brdf.model == "lambertian"


def _is_metallic(config: RunConfig) -> bool:
    return config.task == "texture" and config.brdf.model == METALLIC


# What glTF's material asks for anyway, as a texture.
_TAKEN_BY_METALLIC = {
    "texture.sigma": ("even",),
    "texture.normals": ("shape",),
    "texture.ks": ("single",),
    "solve.refine": ("exact",),
    "solve.method": ("variable-projection",),
}
# What sites that have something for themselves beside K_d and one K_s refuse, and what they take.
_REFUSED_BY_SITES = {
    "solve.refine": "is found on the integral",
    "solve.method": "is too much for the simplex",
    "brdf.model": "needs a specular lobe",
    "solve.free": "takes the capture as it is told",
}
_TAKEN_BY_SITES = {
    "solve.refine": ("exact",),
    "solve.method": ("variable-projection",),
    "brdf.model": FACET_MODELS,
}
CASES_OF_TEXTURES = (
    Case(
        "a diffuse texture",
        _is_diffuse_texture,
        {
            "solve.refine": "is found without refinement",
            "solve.refine_samples": "is found without refinement",
            "solve.method": "is found without a search",
            "solve.starts": "is found without a search",
        },
    ),
    Case(
        "a texture with varying sigma, with maps, or by the simplex",
        lambda config: (
            config.task == "texture"
            and (
                _varies(config)
                or _has_maps(config)
                or _has_color(config)
                or config.solve.method == "simplex"
            )
        ),
        {"solve.refine_samples": "has no refinement with its own samples"},
    ),
    Case(
        "texture.sigma: even or map",
        lambda config: not _varies(config),
        {"texture.control_points": "has no control points"},
        instead="choose texture.sigma: varying",
    ),
    Case(
        "texture.sigma: varying",
        _varies,
        {
            "solve.refine": "is found on the integral",
            "solve.method": "is too much for the simplex",
            "brdf.model": "needs a specular lobe",
            "brdf.sigma.fixed": "finds sigma",
            "solve.free": "takes the capture as it is told",
        },
        {
            "solve.refine": ("exact",),
            "solve.method": ("variable-projection",),
            "brdf.model": FACET_MODELS,
        },
        instead="choose texture.sigma: even",
    ),
    Case(
        "a texture with maps of sigma or normals",
        _has_maps,
        _REFUSED_BY_SITES,
        _TAKEN_BY_SITES,
        instead="choose texture.sigma: even and texture.normals: shape",
    ),
    Case(
        "texture.ks: color",
        _has_color,
        {**_REFUSED_BY_SITES, "texture.sigma": "knows no sigma that varies slowly"},
        {**_TAKEN_BY_SITES, "texture.sigma": ("even", "map")},
        instead="choose texture.ks: single",
    ),
    Case(
        "texture.sigma: map",
        lambda config: config.texture is not None and config.texture.sigma == "map",
        {"brdf.sigma.fixed": "finds sigma"},
        instead="choose texture.sigma: even",
    ),
    Case(
        "texture.normals: map",
        lambda config: config.texture is not None and config.texture.normals == "map",
        {"texture.sigma": "knows no sigma that varies slowly"},
        {"texture.sigma": ("even", "map")},
        instead="choose texture.sigma: map, or texture.normals: shape",
    ),
    Case(
        f"a texture of {METALLIC}",
        _is_metallic,
        {
            "texture.sigma": "has a roughness (texture.roughness)",
            "texture.normals": "takes the normals of the shape",
            "texture.ks": "has a clear interface, which is as bright as its index says",
            "texture.regions": "has maps in the place of regions",
            "solve.refine": "is found on the integral",
            "solve.refine_samples": "has no refinement with its own samples",
            "solve.method": "is too much for the simplex",
            "solve.starts": "has the same starts at every site",
            "solve.free": "takes the capture as it is told",
            "solve.diagnose": "names no causes of a misfit",
        },
        _TAKEN_BY_METALLIC,
        instead="choose a model of facets",
    ),
    Case(
        lambda config: f"a texture of {config.brdf.model}",
        lambda config: not _is_metallic(config),
        {
            "texture.roughness": "has no roughness of its own",
            "texture.metalness": "knows no share of metal",
        },
        {"texture.roughness": ("even",), "texture.metalness": ("even",)},
        instead=f"choose brdf.model: {METALLIC}",
    ),
    *(
        Case(
            f"texture.{key}: map",
            lambda config, key=key: (
                config.texture is not None and getattr(config.texture, key) == "map"
            ),
            {f"brdf.{name}.fixed": f"finds {name}"},
            instead=f"choose texture.{key}: even",
        )
        for key, name in (("roughness", "roughness"), ("metalness", "metallic"))
    ),
    Case(
        "a texture under unknown light",
        lambda config: config.task == "texture" and not config.knows_light,
        {"brdf.model": "fits facets (microfacet, ggx, beckmann) or lambertian"},
        {"brdf.model": (*FACET_MODELS, "lambertian")},
        instead="give the light",
    ),
    Case(
        "a diffuse texture under unknown light",
        lambda config: _is_diffuse_texture(config) and not config.knows_light,
        {
            "solve.diagnose": "names no causes of a misfit",
            "solve.free": "takes the capture as it is told",
        },
        instead="give the light, or choose a model of facets",
    ),
    Case(
        "texture.regions",
        lambda config: config.texture is not None and config.texture.regions is not None,
        {"solve.free": "has several materials, and takes the capture as it is told"},
        instead="remove texture.regions",
    ),
    Case(
        "a specular texture",
        lambda config: not _is_diffuse_texture(config),
        {"texture.prior": "is fixed by how it changes with the view, not by a prior"},
        instead="choose model: lambertian",
    ),
)
