"""Configs as plain data, without run-time classes.

One file a noun: :mod:`.capture` (photographs, their shape :mod:`.geometry`), :mod:`.lighting`,
:mod:`.brdf` (its unknowns are :mod:`.parameter`), :mod:`.samples`, :mod:`.solve`, :mod:`.texture`;
:mod:`.run` is the root of a run, :mod:`.recipe` that of synthetic photographs.  :mod:`.values`
holds the kinds of value, :mod:`.loader` reads and writes YAML with the help of :mod:`.document`
(places), :mod:`.overrides` (``key=value``) and :mod:`.wording` (error messages).  Every stated
key has an effect or is refused (:mod:`.stated`).  :mod:`.tasks` lists the tasks with the keys that
each cannot use; :mod:`.honoured` adds those that other settings leave without effect.
:mod:`.schema` describes every key for editors.
"""

from jaxrender.pipelines.config.brdf import BrdfConfig
from jaxrender.pipelines.config.capture import CaptureConfig, CurveConfig, FurtherCaptureConfig
from jaxrender.pipelines.config.geometry import (
    EllipsoidConfig,
    GeometryConfig,
    RecipeGeometryConfig,
    SphereConfig,
)
from jaxrender.pipelines.config.lighting import (
    CaptureLightingConfig,
    EnvironmentConfig,
    LightingConfig,
    RecipeLightingConfig,
)
from jaxrender.pipelines.config.loader import (
    load_recipe,
    load_run_config,
    resolved_yaml,
)
from jaxrender.pipelines.config.parameter import Parameter
from jaxrender.pipelines.config.recipe import (
    RecipeBrdfConfig,
    RecipeConfig,
    RecipeNoiseConfig,
    ViewsConfig,
)
from jaxrender.pipelines.config.run import RunConfig
from jaxrender.pipelines.config.samples import SamplesConfig
from jaxrender.pipelines.config.schema import json_schema
from jaxrender.pipelines.config.solve import NoiseConfig, SolveConfig
from jaxrender.pipelines.config.texture import SpectrumConfig, TextureConfig

__all__ = [
    "BrdfConfig",
    "CaptureConfig",
    "CaptureLightingConfig",
    "CurveConfig",
    "EllipsoidConfig",
    "EnvironmentConfig",
    "FurtherCaptureConfig",
    "GeometryConfig",
    "LightingConfig",
    "NoiseConfig",
    "Parameter",
    "RecipeBrdfConfig",
    "RecipeConfig",
    "RecipeGeometryConfig",
    "RecipeLightingConfig",
    "RecipeNoiseConfig",
    "RunConfig",
    "SamplesConfig",
    "SolveConfig",
    "SpectrumConfig",
    "SphereConfig",
    "TextureConfig",
    "ViewsConfig",
    "json_schema",
    "load_recipe",
    "load_run_config",
    "resolved_yaml",
]
