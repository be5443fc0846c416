"""The root of a run's config: one file says everything about a fit."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from jaxrender.catalogue import MODELS
from jaxrender.pipelines.config.brdf import FACET_MODELS, GLOSSY, BrdfConfig
from jaxrender.pipelines.config.capture import CaptureConfig
from jaxrender.pipelines.config.lighting import LightingConfig
from jaxrender.pipelines.config.samples import SamplesConfig
from jaxrender.pipelines.config.solve import SolveConfig
from jaxrender.pipelines.config.texture import SpectrumConfig, TextureConfig
from jaxrender.pipelines.config.values import ConfigPath, Section

_UNDER_KNOWN_LIGHT = ("brdf", "brdf-spectrum")
# Settings that a recovery of the light has no use for, and why.
_OF_KNOWN_LIGHT = {
    "solve.method": "has one search",
    "solve.transfer": "filters by exit cosine",
    "solve.starts": "has one start",
    "solve.refine_samples": "refines on all samples",
    "lighting.split": "has no light to split",
    "lighting.free_scale": "finds the scale of the light",
}


class RunConfig(Section):
    """A fit: what is known, what is asked, and how it is found."""

    task: Literal["brdf", "lighting", "factorize", "texture", "brdf-spectrum"]
    """What is recovered: the material, the light, both, a material for every texel (with the light
    known or, where none is given, unknown), or the BRDF as coefficients."""
    capture: CaptureConfig
    """The photographs and the shape."""
    lighting: LightingConfig = LightingConfig()
    """The known light; left out where it is recovered, or with a recipe, whose own is then used."""
    brdf: BrdfConfig = BrdfConfig()
    """The material model."""
    samples: SamplesConfig = SamplesConfig()
    """Which pixels take part."""
    solve: SolveConfig = SolveConfig()
    """How the unknowns are found."""
    texture: TextureConfig | None = None
    """The texture of task texture."""
    spectrum: SpectrumConfig | None = None
    """The coefficients of task brdf-spectrum."""
    output: ConfigPath | None = None
    """Result folder; taken relative to the working directory."""

    @property
    def knows_light(self) -> bool:
        """Whether the light is known, from the config or from its recipe."""
        if self.task == "texture":
            unknown = self.texture is not None and self.texture.unknown_light
            return not unknown and (self.lighting.given or self.capture.recipe is not None)
        return self.task in _UNDER_KNOWN_LIGHT

    @model_validator(mode="after")
    def _has_light(self) -> RunConfig:
        if self.task == "texture":
            return self
        recovers_light = self.task not in _UNDER_KNOWN_LIGHT
        if recovers_light and self.lighting.given:
            raise ValueError(
                f"task {self.task} recovers the light; remove lighting, or choose task: brdf"
            )
        if not recovers_light and self.capture.recipe is None and not self.lighting.given:
            raise ValueError(
                "no light given; lighting needs one of environment, directional, per_frame"
            )
        return self

    @model_validator(mode="after")
    def _asks_of_known_light_what_it_alone_can(self) -> RunConfig:
        if self.solve.interreflection and self.lighting.free_scale:
            raise ValueError(
                "bounced light tells by the albedo, which an unknown scale of the light leaves "
                "open; remove solve.interreflection or lighting.free_scale"
            )
        if self.task == "brdf":
            return self
        if self.solve.model != "dual":
            raise ValueError(
                f"solve.model: {self.solve.model} is for a material under known light, not task "
                f"{self.task}; remove it, or choose task: brdf"
            )
        if self.task == "texture" and self.brdf.model not in (*FACET_MODELS, "lambertian"):
            raise ValueError(
                f"model {self.brdf.model} is fitted to one material for the whole surface, not "
                f"task texture; choose model {GLOSSY}, or lambertian"
            )
        if self.brdf.compare and self.task != "factorize":
            raise ValueError("brdf.compare is for task: brdf or factorize; remove it")
        if self.solve.interreflection:
            raise ValueError("solve.interreflection is for task: brdf; remove it")
        return self

    @model_validator(mode="after")
    def _knows_what_its_task_needs(self) -> RunConfig:
        brdf = self.brdf
        for key, task in (("texture", "texture"), ("spectrum", "brdf-spectrum")):
            if getattr(self, key) is not None and self.task != task:
                raise ValueError(f"found {key} with task {self.task}; remove it, or task: {task}")
        by_integral = [name for name in brdf.models if not MODELS[name].about_mirror]
        if by_integral and (self.solve.interreflection or self.solve.model != "dual"):
            key = "interreflection" if self.solve.interreflection else "model"
            raise ValueError(
                f"solve.{key} is for a lobe about the reflected direction over a Lambertian base; "
                f"remove it, or choose another model than {by_integral[0]}"
            )
        if self.task == "texture":
            _refuse_for_texture(self)
        if self.task == "brdf-spectrum":
            _refuse_for_spectrum(self)
        if self.task not in ("lighting", "factorize"):
            return self
        _refuse_for_unknown_light(self)
        if self.solve.free_exposure:
            raise ValueError(f"task {self.task} needs known exposures; remove solve.free_exposure")
        model = MODELS[brdf.model]
        known = {name: brdf.known(name) for name in model.names("amplitude", "searched")}
        given = {name: value is None or not value.free for name, value in known.items()}
        if self.task == "lighting" and not all(given.values()):
            missing = ", ".join(name for name, is_given in given.items() if not is_given)
            raise ValueError(
                f"task lighting needs a known material; fix {missing}, or choose task: factorize"
            )
        if self.task == "factorize" and given["kd"] and not model.has_gloss:
            raise ValueError(
                "of a matt body under unknown light the product of light and kd shows, not kd; "
                "leave kd free, or choose task: lighting"
            )
        if self.task == "factorize" and given["kd"] != given.get("ks", given["kd"]):
            raise ValueError(
                "under unknown light only the ratio of kd and ks means anything; fix both or none"
            )
        return self


def _refuse_for_unknown_light(config: RunConfig) -> None:
    """Refuse what a recovery of the light would not honour."""
    for key, why in _OF_KNOWN_LIGHT.items():
        section, name = key.split(".")
        own = getattr(config, section)
        # By value, since a config written out in full names every key.
        if getattr(own, name) != type(own).model_fields[name].default:
            raise ValueError(f"task {config.task} {why}; remove {key}, or choose task: brdf")
    for name in ("kd", "ks"):
        parameter = config.brdf.known(name)
        assert parameter is not None
        if parameter.bounds is not None or parameter.start is not None:
            raise ValueError(
                f"task {config.task} finds only the ratio of kd and ks, without bounds or start; "
                f"leave brdf.{name} free, or fix both"
            )


def _refuse_for_texture(config: RunConfig) -> None:
    """Refuse what a material for every texel cannot be combined with."""
    brdf, solve, lighting = config.brdf, config.solve, config.lighting
    if not all(_is_free(brdf, name) for name in ("kd", "ks")):
        raise ValueError("kd and ks are the texture that is sought; leave both free")
    faults = {
        "brdf.ks_per_channel": (brdf.ks_per_channel, "has one ks for all channels"),
        "solve.free_exposure": (solve.free_exposure, "needs known exposures"),
        "lighting.free_scale": (lighting.free_scale, "takes the light as given"),
        "solve.loss": (solve.loss not in ("auto", "squares"), "counts squared residuals"),
    }
    for key, (found, why) in faults.items():
        if found:
            raise ValueError(f"task texture {why}; remove {key}")
    if config.texture is not None and config.texture.sigma == "varying":
        _refuse_for_varying_sigma(config)
    if config.texture is not None and config.texture.unknown_light and lighting.given:
        raise ValueError("found lighting with texture.unknown_light; remove one of them")


def _is_free(brdf: BrdfConfig, name: str) -> bool:
    known = brdf.known(name)
    return known is not None and known.free


def _refuse_for_varying_sigma(config: RunConfig) -> None:
    """Refuse what a sigma that varies over the surface cannot be combined with."""
    brdf, solve = config.brdf, config.solve
    assert config.texture is not None
    faults = {
        "texture.unknown_light": (config.texture.unknown_light, "needs a light that is known"),
        "brdf.model": (brdf.model == "lambertian", "needs a model that has gloss"),
        "brdf.sigma": (not _is_free(brdf, "sigma"), "leaves sigma free"),
        "solve.refine": (solve.refine != "exact", "is found on the integral"),
        "solve.method": (solve.method != "variable-projection", "is more than the simplex finds"),
    }
    for key, (found, why) in faults.items():
        if found:
            raise ValueError(f"texture.sigma varying {why}; remove {key}, or texture.sigma")
    if config.texture.control_points < 2:
        raise ValueError("texture.control_points is 1, with which sigma cannot vary; give more")


def _refuse_for_spectrum(config: RunConfig) -> None:
    """Refuse what is linear recovery's no part of: a model, and unknown factors."""
    solve, lighting = config.solve, config.lighting
    if config.brdf != BrdfConfig():
        raise ValueError("task brdf-spectrum fits no model; remove brdf")
    if solve.free_exposure or lighting.free_scale:
        key = "solve.free_exposure" if solve.free_exposure else "lighting.free_scale"
        raise ValueError(f"task brdf-spectrum needs absolute radiance; remove {key}")
    if lighting.per_frame is not None:
        raise ValueError(
            "task brdf-spectrum is for light that all photographs share; found lighting.per_frame: "
            "choose task: brdf"
        )
