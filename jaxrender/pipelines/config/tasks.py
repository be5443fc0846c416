"""The tasks: what each recovers, under which light, and the keys that it cannot use, and why.

A new task is an entry in ``TASKS`` and a module of ``pipelines/tasks`` that the entry names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jaxrender.catalogue import MODELS
from jaxrender.pipelines.config.brdf import FACET_MODELS, METALLIC
from jaxrender.pipelines.config.parameter import Parameter
from jaxrender.pipelines.config.solve import SolveConfig

if TYPE_CHECKING:
    from jaxrender.pipelines.config.run import RunConfig

# Values that ask for what most tasks do anyway.
_AS_IT_IS: Mapping[str, tuple[Any, ...]] = {
    "solve.model": ("dual",),
    "solve.transfer": ("exit-cosine",),
    "solve.loss": ("auto", "squares"),
    "solve.band_limit": ("auto",),
    "lighting.split": ("auto",),
    "brdf.model": (*FACET_MODELS, "lambertian", METALLIC),
    "brdf.compare": ((),),
    "brdf.kd": (Parameter(),),
    "brdf.ks": (Parameter(),),
    "brdf.base_color": (Parameter(),),
    "brdf.interface": (Parameter(fixed=1.0),),
    "texture.sigma": ("even",),
    "texture.normals": ("shape",),
    "texture.ks": ("single",),
}


@dataclass(frozen=True)
class TaskEntry:
    """What a config knows of a task.

    ``home`` is its module in ``pipelines/tasks``.  ``lit`` and ``dark`` are the keys that it cannot
    use under known and under unknown light, each with the reason.  One of them is None where the
    task needs the other light.  ``section`` is a section of its own, which all other tasks refuse
    with these words.  ``done_anyway`` are values that are not refused.  ``check`` raises
    ``ValueError`` for what is missing or contradicts itself.
    """

    recovers: str
    home: str
    lit: Mapping[str, str] | None = None
    dark: Mapping[str, str] | None = None
    section: Mapping[str, str] = field(default_factory=dict)
    done_anyway: Mapping[str, tuple[Any, ...]] = field(default_factory=lambda: _AS_IT_IS)
    check: Callable[[RunConfig], None] = lambda config: None


_NO_GAUGE = "knows the light, so no gauge is open"
_RECOVERS_LIGHT = "recovers the light itself"
# Nuisances of a light that is told.
_OF_LIGHT = ("environment", "lamps", "nearness")
# Nuisances that a texture does not free: its light is distant, and each pixel shows one site.
_NOT_OF_TEXTURES = ("nearness", "blur")
# What is freed with a texture and its light, both unknown.
_WITH_TEXTURE_AND_LIGHT = ("exposure", "black", "response", "normals")
_OF_KNOWN_LIGHT = {
    "solve.model": "has one frequency model",
    "solve.view_degree": "has one frequency model",
    "solve.transfer": "always filters by exit cosine",
    "solve.free_exposure": "needs known exposures",
    "solve.variants": "compares no variants of a model",
    "solve.interreflection": "leaves out bounced light",
}
_NO_PRIORS = {
    f"brdf.{number.name}.prior": "counts bounds alone"
    for model in MODELS.values()
    for number in model.numbers
    if number.part != "stated"
}
_UNKNOWN_LIGHT = (
    _OF_KNOWN_LIGHT
    | _NO_PRIORS
    | {
        "lighting": _RECOVERS_LIGHT,
        "captures": "finds one light, that of all photographs",
        "solve.method": "has one search",
        "solve.starts": "has one start",
        "solve.refine_samples": "refines on all samples",
        "brdf.table": "finds only the ratio of light and material at each pair of angles",
        "brdf.kd.bounds": "finds only the ratio of kd and ks",
        "brdf.ks.bounds": "finds only the ratio of kd and ks",
    }
)
_TEXTURE = {
    "captures": "takes one set of photographs",
    **_OF_KNOWN_LIGHT,
    **_NO_PRIORS,
    "solve.loss": "counts squared residuals",
    "solve.most_sources": "looks for no sources",
    "brdf.model": "fits facets (microfacet, ggx, beckmann), lambertian or metallic-roughness",
    "brdf.compare": "fits one model",
    "brdf.table": "has a material at each site, of which a few directions are seen",
    "brdf.kd": "finds kd of every site",
    "brdf.ks": "finds ks of every site",
    "brdf.base_color": "finds base_color of every site",
    "brdf.interface": "knows the light, so that the interface is as bright as its index says",
    "brdf.ks_per_channel": "has one ks for all channels (texture.ks: color: one each)",
}


def _given(config: RunConfig) -> dict[str, bool]:
    """Tell of each number of the material whether it is known."""
    known = {
        name: config.brdf.known(name)
        for name in MODELS[config.brdf.model].names("amplitude", "searched")
    }
    return {name: value is None or not value.free for name, value in known.items()}


def _names(config: RunConfig) -> tuple[str, ...]:
    """List the nuisances that are freed by name."""
    return () if isinstance(config.solve.free, str) else config.solve.free


def _frees_no_light(config: RunConfig) -> None:
    light = [name for name in _names(config) if name in _OF_LIGHT]
    if light:
        raise ValueError(
            f"solve.free: {', '.join(light)} cannot be freed, because the light is not told but "
            "found; leave it out, or give the light"
        )


def _frees_what_textures_can(config: RunConfig) -> None:
    refused = [name for name in _names(config) if name in _NOT_OF_TEXTURES and config.knows_light]
    if refused:
        raise ValueError(
            f"solve.free: {', '.join(refused)} cannot be freed with a texture, whose light is "
            "distant and whose pixels show one texel each; leave it out"
        )
    if config.knows_light:
        return
    refused = [name for name in _names(config) if name not in _WITH_TEXTURE_AND_LIGHT]
    if refused:
        raise ValueError(
            f"solve.free: {', '.join(refused)} cannot be freed with a texture under unknown light; "
            f"choose of {', '.join(_WITH_TEXTURE_AND_LIGHT)}, or give the light"
        )


def _has_one_lobe(config: RunConfig) -> None:
    several = [name for name in config.brdf.models if not MODELS[name].has_one_lobe]
    if several:
        raise ValueError(
            f"brdf.model: the lobes of {several[0]} are found under known light alone; give the "
            "light, or choose a model of one lobe"
        )


def _knows_material(config: RunConfig) -> None:
    _has_one_lobe(config)
    _frees_no_light(config)
    given = _given(config)
    if not all(given.values()):
        missing = ", ".join(name for name, is_given in given.items() if not is_given)
        raise ValueError(
            f"task lighting needs a known material; fix {missing}, or choose task: factorize"
        )


def _leaves_a_ratio(config: RunConfig) -> None:
    _has_one_lobe(config)
    _frees_no_light(config)
    given = _given(config)
    if given["kd"] and not MODELS[config.brdf.model].has_specular:
        raise ValueError(
            "under unknown light a diffuse object shows only the product of light and kd; "
            "leave kd free, or choose task: lighting"
        )
    if given["kd"] != given.get("ks", given["kd"]):
        raise ValueError(
            "under unknown light only the ratio of kd and ks is identifiable; fix both or none"
        )


TASKS: Mapping[str, TaskEntry] = {
    "brdf": TaskEntry(
        recovers="the material",
        home="material",
        lit={
            "solve.most_sources": "knows the sources of the light",
            "brdf.gauge": _NO_GAUGE,
        },
    ),
    "lighting": TaskEntry(
        recovers="the light",
        home="light",
        dark=_UNKNOWN_LIGHT
        | {
            "brdf.compare": "knows the material",
            "brdf.gauge": "has the units of the known material",
        },
        check=_knows_material,
    ),
    "factorize": TaskEntry(
        recovers="both",
        home="light",
        dark=_UNKNOWN_LIGHT,
        check=_leaves_a_ratio,
    ),
    "texture": TaskEntry(
        recovers="a material for every texel, under known or unknown light",
        home="texture",
        section={"texture": "finds no texture"},
        lit=_TEXTURE
        | {
            "solve.band_limit": "uses all degrees that the lobe passes",
            "lighting.split": "splits the light as finely as its model needs",
            "lighting.free_scale": "uses the light as given",
            "texture.prior": "knows the light, so it needs no prior",
            "brdf.gauge": _NO_GAUGE,
        },
        check=_frees_what_textures_can,
        dark=_TEXTURE
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
            "texture.normals": "takes the normals of the shape",
            "texture.ks": "has one ks for all channels",
        },
    ),
    "brdf-spectrum": TaskEntry(
        recovers="the BRDF as coefficients",
        home="brdf_spectrum",
        section={"spectrum": "finds no coefficients of a BRDF"},
        lit={
            "brdf": "fits no model",
            "captures": "needs one light for all photographs",
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
        done_anyway={},
    ),
}


def situation(name: str, knows_light: bool) -> str:
    """Name a task; with its light where it has use for both, known and unknown."""
    task = TASKS[name]
    if task.lit is None or task.dark is None:
        return name
    return f"{name} under {'known' if knows_light else 'unknown'} light"


def _unused() -> dict[str, Mapping[str, str]]:
    found = {}
    for name, task in TASKS.items():
        foreign = {
            key: why
            for other, entry in TASKS.items()
            if other != name
            for key, why in entry.section.items()
        }
        for knows_light, keys in ((True, task.lit), (False, task.dark)):
            if keys is not None:
                found[situation(name, knows_light)] = {**foreign, **keys}
    return found


# The keys that have no effect, for each task, and for either light where a task may have either.
UNUSED: Mapping[str, Mapping[str, str]] = _unused()
