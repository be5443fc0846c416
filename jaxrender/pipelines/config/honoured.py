"""The keys that have no effect in a task, and why.

All other keys have an effect; a test changes every key of every task to prove it.  Missing and
contradictory keys are refused in :mod:`.run` and in the sections.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from jaxrender.catalogue import AMPLITUDES, MODELS
from jaxrender.pipelines.config.brdf import FACET_MODELS, foreign_keys
from jaxrender.pipelines.config.stated import Case
from jaxrender.pipelines.config.tasks import TASKS, UNUSED, situation
from jaxrender.pipelines.config.texture import CASES_OF_TEXTURES
from jaxrender.pipelines.config.wording import joined

if TYPE_CHECKING:
    from jaxrender.pipelines.config.run import RunConfig


def honouring(key: str) -> tuple[str, ...]:
    """List the tasks in which a key has an effect."""
    return tuple(
        task
        for task, keys in UNUSED.items()
        if not any(f"{key}.".startswith(f"{other}.") for other in keys)
    )


def _of_tasks() -> tuple[Case, ...]:
    """Make a case of each task and key."""
    return tuple(
        Case(
            f"task {one}",
            lambda config, one=one: situation(config.task, config.knows_light) == one,
            {key: why},
            TASKS[one.split()[0]].done_anyway,
            f"choose task: {joined(honouring(key))}" if honouring(key) else "",
        )
        for one, keys in UNUSED.items()
        for key, why in keys.items()
    )


def _has_mirror_lobe(config: RunConfig) -> bool:
    """Tell whether any model has a specular lobe about the reflected direction."""
    return any(MODELS[m].about_mirror and MODELS[m].has_specular for m in config.brdf.models)


def _by_integral(config: RunConfig) -> list[str]:
    return [name for name in config.brdf.models if not MODELS[name].about_mirror]


def _ks(config: RunConfig) -> Any:
    known = config.brdf.known("ks")
    return None if known is None else known.fixed


def _has_image(config: RunConfig) -> bool:
    """Tell whether the light of any capture is more than directional sources."""
    return any(one.has_image for one in (config.lighting, *(c.lighting for c in config.captures)))


_NO_VIEW = "has no frequency view of its lobe"
_NO_DEGREES = "has no degrees of light"


def _is_all_metal(config: Any, share: str) -> bool:
    """Whether a material is stated to be a metal through and through."""
    known = config.brdf.known(share)
    return known is not None and known.fixed == 1


_OF_SETTINGS = (
    Case(
        "a fit",
        lambda config: True,
        {
            f"brdf.{name}.start": f"solves for {name} directly, without a start"
            for name in AMPLITUDES
        },
    ),
    Case(
        "lighting.free_scale",
        lambda config: config.lighting is not None and config.lighting.free_scale,
        {
            f"brdf.{name}.prior": f"finds {name} up to a factor, of which a prior says nothing"
            for name in AMPLITUDES
        },
        instead="remove lighting.free_scale",
    ),
    Case(
        "solve.refine: off",
        lambda config: config.solve.refine == "off",
        {
            "solve.refine_samples": "leaves out the refinement",
            "solve.variants": "leaves out the refinement that compares variants",
            "solve.free": "leaves out the refinement that finds nuisances",
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
        "brdf.compare",
        lambda config: bool(config.brdf.compare),
        {"solve.free": "compares models of the capture as it is told"},
        instead="remove brdf.compare",
    ),
    *(
        Case(
            f"{share}: 1",
            lambda config, share=share: _is_all_metal(config, share),
            {f"brdf.{index}": "is all metal, which has no clear interface"},
            instead=f"leave brdf.{share} free",
        )
        for share, index in (
            ("metallic", "ior"),
            ("metallic", "specular"),
            ("base_metalness", "specular_ior"),
        )
    ),
    Case(
        "brdf.table",
        lambda config: config.brdf.table,
        {
            "solve.free": "corrects the material, and takes the capture as it is told",
            "solve.interreflection": "knows no bounced light",
        },
        instead="remove brdf.table",
    ),
    Case(
        "brdf.compare: auto",
        lambda config: config.brdf.compare == "auto",
        {"brdf.model": "chooses the models itself"},
        instead="list models in brdf.compare",
    ),
    Case(
        "brdf.compare without a known light",
        lambda config: bool(config.brdf.compare) and config.task == "factorize",
        {"solve.diagnose": "names no causes of a misfit"},
        instead="remove brdf.compare",
    ),
    Case(
        "solve.interreflection",
        lambda config: config.solve.interreflection,
        {"solve.free": "computes the bounced light of the capture as it is told"},
        instead="remove solve.interreflection",
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
        lambda config: config.task == "brdf" and config.lighting.given and not _has_image(config),
        {
            "lighting.split": "has nothing to split",
            "solve.band_limit": _NO_DEGREES,
            "solve.transfer": _NO_DEGREES,
            "solve.model": _NO_DEGREES,
        },
        instead="give lighting.environment",
    ),
    Case(
        "captures whose environments differ",
        lambda config: bool(config.captures) and _has_image(config),
        {
            "lighting.split": "are fitted by the integral",
            "solve.transfer": "are fitted by the integral",
            "solve.model": "are fitted by the integral",
        },
        {"solve.model": ("dual",)},
        instead="remove captures",
    ),
    Case(
        lambda config: f"model {_by_integral(config)[0]}",
        lambda config: bool(_by_integral(config)),
        {"solve.model": "has no lobe about the reflected direction"},
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
        "model bank",
        lambda config: "bank" in config.brdf.models,
        {"solve.interreflection": "is fitted once, before there is light that bounces"},
        instead="choose another model",
    ),
    Case(
        "model bank",
        lambda config: set(config.brdf.models) == {"bank"},
        {
            "solve.starts": "has one minimum, whatever the start",
            "solve.method": "has no number to search for",
            "solve.refine": "is always fitted by the integral",
        },
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
    *CASES_OF_TEXTURES,
    Case(
        "a diffuse model",
        lambda config: not all(MODELS[m].has_specular for m in config.brdf.models),
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
            "capture.camera_axes": "has cameras of its own",
            "capture.mirrored": "has photographs of its own",
        },
        instead="give capture.transforms",
    ),
)

CASES = (*_of_tasks(), *foreign_keys(lambda config: config.brdf.models), *_OF_SETTINGS)
