"""The tasks, and tables of the keys that each cannot use, and why."""

from collections.abc import Mapping
from typing import Any

from jaxrender.catalogue import MODELS
from jaxrender.pipelines.config.brdf import FACET_MODELS
from jaxrender.pipelines.config.parameter import Parameter
from jaxrender.pipelines.config.solve import SolveConfig

LIT, DARK = "texture under known light", "texture under unknown light"
# What each task recovers.
MEANINGS: Mapping[str, str] = {
    "brdf": "the material",
    "lighting": "the light",
    "factorize": "both",
    "texture": "a material for every texel, under known or unknown light",
    "brdf-spectrum": "the BRDF as coefficients",
}
_NO_SECTION = {
    "texture": "finds no texture",
    "spectrum": "finds no coefficients of a BRDF",
}
_NO_GAUGE = "knows the light, so no gauge is open"
_RECOVERS_LIGHT = "recovers the light itself"
_OF_KNOWN_LIGHT = {
    "solve.model": "has one frequency model",
    "solve.view_degree": "has one frequency model",
    "solve.transfer": "always filters by exit cosine",
    "solve.free_exposure": "needs known exposures",
    "solve.variants": "compares no variants of a model",
    "solve.free": "takes the capture as it is told",
    "solve.interreflection": "leaves out bounced light",
}
_NO_PRIORS = {
    f"brdf.{number.name}.prior": "counts bounds alone"
    for model in MODELS.values()
    for number in model.numbers
    if number.part != "stated"
}
_UNKNOWN_LIGHT = (
    _NO_SECTION
    | _OF_KNOWN_LIGHT
    | _NO_PRIORS
    | {
        "lighting": _RECOVERS_LIGHT,
        "solve.method": "has one search",
        "solve.starts": "has one start",
        "solve.refine_samples": "refines on all samples",
        "brdf.kd.bounds": "finds only the ratio of kd and ks",
        "brdf.ks.bounds": "finds only the ratio of kd and ks",
    }
)
_TEXTURE = {
    **_OF_KNOWN_LIGHT,
    **_NO_PRIORS,
    "spectrum": _NO_SECTION["spectrum"],
    "solve.loss": "counts squared residuals",
    "solve.diagnose": "names no causes of a misfit",
    "solve.most_sources": "looks for no sources",
    "brdf.model": "fits facets (microfacet, ggx, beckmann) or lambertian",
    "brdf.compare": "fits one model",
    "brdf.kd": "finds kd of every site",
    "brdf.ks": "finds ks of every site",
    "brdf.ks_per_channel": "has one ks for all channels",
}
# For each task the keys that it cannot use.
TASKS: Mapping[str, Mapping[str, str]] = {
    "brdf": _NO_SECTION
    | {
        "solve.most_sources": "knows the sources of the light",
        "brdf.gauge": _NO_GAUGE,
    },
    "lighting": _UNKNOWN_LIGHT
    | {
        "brdf.compare": "knows the material",
        "brdf.gauge": "has the units of the known material",
    },
    "factorize": _UNKNOWN_LIGHT,
    LIT: _TEXTURE
    | {
        "solve.band_limit": "uses all degrees that the lobe passes",
        "lighting.split": "splits the light as finely as its model needs",
        "lighting.free_scale": "uses the light as given",
        "texture.prior": "knows the light, so it needs no prior",
        "brdf.gauge": _NO_GAUGE,
    },
    DARK: _TEXTURE
    | {
        "lighting": _RECOVERS_LIGHT,
        "brdf.gauge": "has a gauge of its own",
        "samples.count": "uses all pixels",
        "samples.seed": "uses all pixels",
        "solve.method": "has one search",
        "solve.starts": "has one start",
        "solve.refine_samples": "refines on all samples",
        "texture.regions": "has one lobe for the whole surface",
        "texture.sigma": "has one sigma for the whole surface",
    },
    "brdf-spectrum": {
        "texture": _NO_SECTION["texture"],
        "brdf": "fits no model",
        "lighting.per_frame": "needs one light for all photographs: an environment or "
        "directional sources",
        "lighting.split": "uses the coefficients of the whole light",
        "lighting.free_scale": "needs absolute radiance",
        **{
            f"solve.{name}": "solves one linear system of the order in spectrum"
            for name in SolveConfig.model_fields
            if name not in ("noise", "held_out")
        },
    },
}
# Values that ask for what the task does anyway are not refused.
AS_IT_IS: Mapping[str, tuple[Any, ...]] = {
    "solve.model": ("dual",),
    "solve.transfer": ("exit-cosine",),
    "solve.loss": ("auto", "squares"),
    "solve.band_limit": ("auto",),
    "lighting.split": ("auto",),
    "brdf.model": (*FACET_MODELS, "lambertian"),
    "brdf.compare": ((),),
    "brdf.kd": (Parameter(),),
    "brdf.ks": (Parameter(),),
    "texture.sigma": ("even",),
}
