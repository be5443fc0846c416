"""The keys that have no effect in a task, and why.

All other keys have an effect; a test changes every key of every task to prove it.  Missing and
contradictory keys are refused in :mod:`.run` and in the sections.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from jaxrender.catalogue import MODELS
from jaxrender.pipelines.config.brdf import FACET_MODELS, foreign_keys
from jaxrender.pipelines.config.parameter import Parameter
from jaxrender.pipelines.config.solve import SolveConfig
from jaxrender.pipelines.config.stated import Case
from jaxrender.pipelines.config.wording import joined

if TYPE_CHECKING:
    from jaxrender.pipelines.config.run import RunConfig

_LIT, _DARK = "texture under known light", "texture under unknown light"
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
    "solve.interreflection": "leaves out bounced light",
}
_UNKNOWN_LIGHT = (
    _NO_SECTION
    | _OF_KNOWN_LIGHT
    | {
        "lighting": _RECOVERS_LIGHT,
        "solve.method": "has one search",
        "solve.starts": "has one start",
        "solve.refine_samples": "refines on all samples",
        "brdf.kd.bounds": "finds only the ratio of kd and ks",
        "brdf.ks.bounds": "finds only the ratio of kd and ks",
    }
)
_TEXTURE = _OF_KNOWN_LIGHT | {
    "spectrum": _NO_SECTION["spectrum"],
    "solve.loss": "counts squared residuals",
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
    _LIT: _TEXTURE
    | {
        "solve.band_limit": "uses all degrees that the lobe passes",
        "lighting.split": "splits the light as finely as its model needs",
        "lighting.free_scale": "uses the light as given",
        "texture.prior": "knows the light, so it needs no prior",
        "brdf.gauge": _NO_GAUGE,
    },
    _DARK: _TEXTURE
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
_AS_IT_IS: Mapping[str, tuple[Any, ...]] = {
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


def task_of(config: RunConfig) -> str:
    """Name the task of a config as ``TASKS`` does."""
    if config.task == "texture":
        return _LIT if config.knows_light else _DARK
    return config.task


def honouring(key: str) -> tuple[str, ...]:
    """List the tasks in which a key has an effect."""
    return tuple(
        task
        for task, keys in TASKS.items()
        if not any(f"{key}.".startswith(f"{other}.") for other in keys)
    )


def _of_tasks() -> tuple[Case, ...]:
    """Make a case of each task and key."""
    return tuple(
        Case(
            f"task {task}",
            lambda config, task=task: task_of(config) == task,
            {key: why},
            {} if task == "brdf-spectrum" else _AS_IT_IS,
            f"choose task: {joined(honouring(key))}" if honouring(key) else "",
        )
        for task, keys in TASKS.items()
        for key, why in keys.items()
    )


def _has_mirror_lobe(config: RunConfig) -> bool:
    """Tell whether any model has a specular lobe about the reflected direction."""
    return any(MODELS[m].about_mirror and MODELS[m].has_gloss for m in config.brdf.models)


def _by_integral(config: RunConfig) -> list[str]:
    return [name for name in config.brdf.models if not MODELS[name].about_mirror]


def _ks(config: RunConfig) -> Any:
    known = config.brdf.known("ks")
    return None if known is None else known.fixed


def _varies(config: RunConfig) -> bool:
    return config.texture is not None and config.texture.sigma == "varying"


def _is_matt_texture(config: RunConfig) -> bool:
    return config.task == "texture" and config.brdf.model == "lambertian"


_NO_VIEW = "has no frequency view of its lobe"
_NO_DEGREES = "has no degrees of light"
_OF_SETTINGS = (
    Case(
        "a fit",
        lambda config: True,
        {
            f"brdf.{name}.start": f"solves for {name} directly, without a start"
            for name in ("kd", "ks")
        },
    ),
    Case(
        "solve.refine: off",
        lambda config: config.solve.refine == "off",
        {
            "solve.refine_samples": "leaves out the refinement",
            "solve.variants": "leaves out the refinement that compares variants",
            "solve.interreflection": "leaves out the refinement that adds bounced light",
        },
        instead="choose solve.refine: exact",
    ),
    Case(
        "solve.model: dual",
        lambda config: config.solve.model == "dual",
        {"solve.view_degree": "has no degree of the viewer"},
        instead="choose solve.model: azimuthal or shrm",
    ),
    Case(
        lambda config: f"solve.model: {config.solve.model}",
        lambda config: config.solve.model != "dual",
        {"solve.transfer": "has a filter of its own"},
        instead="choose solve.model: dual",
    ),
    Case(
        "a run without brdf.compare",
        lambda config: not config.brdf.compare,
        {"solve.held_out": "holds nothing out"},
        instead="name models in brdf.compare",
    ),
    Case(
        "lighting.free_scale",
        lambda config: config.lighting.free_scale,
        {"solve.interreflection": "leaves open the albedo that bounced light needs"},
        instead="remove lighting.free_scale",
    ),
    Case(
        "light of sources alone",
        lambda config: (
            config.task == "brdf" and config.lighting.given and not config.lighting.environment
        ),
        {
            "lighting.split": "has nothing to split",
            "solve.band_limit": _NO_DEGREES,
            "solve.transfer": _NO_DEGREES,
            "solve.model": _NO_DEGREES,
        },
        instead="give lighting.environment",
    ),
    Case(
        lambda config: f"model {_by_integral(config)[0]}",
        lambda config: bool(_by_integral(config)),
        {
            "solve.interreflection": "is not a lobe over a Lambertian base",
            "solve.model": "has no lobe about the reflected direction",
        },
        {"solve.model": ("dual",)},
        instead="choose another model",
    ),
    Case(
        "a material without a lobe about the reflected direction",
        lambda config: config.task == "brdf" and not _has_mirror_lobe(config),
        {"solve.transfer": _NO_VIEW, "solve.model": _NO_VIEW},
        instead="choose another model",
    ),
    Case(
        "a material that the integral alone fits",
        lambda config: len(_by_integral(config)) == len(config.brdf.models),
        {"lighting.split": "uses the whole light"},
        instead="choose another model",
    ),
    Case(
        "a model that is not of facets",
        lambda config: not set(config.brdf.models) & set(FACET_MODELS),
        {"solve.variants": "has no variants"},
        instead="choose another model",
    ),
    Case(
        "the light of an object without a lobe about the reflected direction",
        lambda config: config.task in ("lighting", "factorize") and not _has_mirror_lobe(config),
        {"solve.refine": "is always found by the integral"},
    ),
    Case(
        "a diffuse texture",
        _is_matt_texture,
        {
            "solve.refine": "is found without refinement",
            "solve.refine_samples": "is found without refinement",
            "solve.method": "is found without a search",
            "solve.starts": "is found without a search",
        },
    ),
    Case(
        "a texture with varying sigma or the simplex",
        lambda config: (
            config.task == "texture" and (_varies(config) or config.solve.method == "simplex")
        ),
        {"solve.refine_samples": "has no refinement with its own samples"},
    ),
    Case(
        "texture.sigma: even",
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
        },
        {
            "solve.refine": ("exact",),
            "solve.method": ("variable-projection",),
            "brdf.model": FACET_MODELS,
        },
        instead="choose texture.sigma: even",
    ),
    Case(
        "a specular texture",
        lambda config: not _is_matt_texture(config),
        {"texture.prior": "is fixed by how it changes with the view, not by a prior"},
        instead="choose model: lambertian",
    ),
    Case(
        "a diffuse model",
        lambda config: not all(MODELS[m].has_gloss for m in config.brdf.models),
        {"brdf.gauge": "has no ks for all channels to share"},
        {"brdf.gauge": ("per-channel", "metal")},
    ),
    Case(
        "task factorize",
        lambda config: config.task == "factorize" and _ks(config) is None,
        {"brdf.ks_per_channel": "takes the channels of ks from the gauge"},
        instead="state brdf.gauge",
    ),
    Case(
        "one number for ks",
        lambda config: isinstance(_ks(config), float),
        {"brdf.ks_per_channel": "serves all channels"},
        instead="give three",
    ),
    Case(
        "a metal",
        lambda config: config.brdf.known("mu") is None,
        {"brdf.fresnel": "reflects the same at all angles"},
    ),
    Case(
        "a recipe",
        lambda config: config.capture.recipe is not None,
        {
            "capture.images": "has photographs of its own",
            "capture.allow_outside": "has photographs of its own",
        },
        instead="give capture.transforms",
    ),
)

CASES = (*_of_tasks(), *foreign_keys(lambda config: config.brdf.models), *_OF_SETTINGS)
