"""Configuration into objects: shape, material, light and unknowns.

Configs are data that know no run-time class; here is where they meet.  What a class refuses by
``ValueError`` is, at this boundary, the config's fault, and said so as ``InputError``.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.brdf import (
    SIMPLE_PARAMETRIC,
    Microfacet,
    Parametric,
    ShapeParameter,
    simple_parametric_named,
)
from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Shape, Sphere
from jaxrender.geometry.sculpture import sculpture
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import FitSettings, KnownLight, MicrofacetUnknowns, Unknown
from jaxrender.inverse.unknowns import index_bounds, mu_unknown, sigma_unknown
from jaxrender.io import read_environment, read_mesh, read_per_frame_lights
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.pipelines.config import RecipeConfig, RunConfig
from jaxrender.pipelines.config.brdf import (
    BrdfConfig,
    chosen_numbers_of,
    distribution_of,
)
from jaxrender.pipelines.config.geometry import GeometryConfig, RecipeGeometryConfig
from jaxrender.pipelines.config.lighting import DirectionalConfig, LightingConfig
from jaxrender.pipelines.config.parameter import Parameter
from jaxrender.pipelines.config.recipe import RecipeBrdfConfig

# The index that the lobe of a fit is made with does not matter.
_ANY_INDEX = 1.5


@contextmanager
def fault_of(place: str) -> Iterator[None]:
    """Report misuse inside the block as bad input at ``place``."""
    try:
        yield
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{place}: {error}") from error


def shape_of(geometry: GeometryConfig) -> Shape:
    """Build the object's shape; a mesh is read from its file."""
    with fault_of("geometry"):
        if geometry.sphere is not None:
            return Sphere(np.array(geometry.sphere.center, float), float(geometry.sphere.radius))
        if geometry.mesh is not None:
            return read_mesh(geometry.mesh, geometry.scale)
        assert isinstance(geometry, RecipeGeometryConfig)
        if geometry.sculpture is not None:
            return sculpture(geometry.sculpture.subdivisions, geometry.sculpture.seed)
        assert geometry.ellipsoid is not None
        radii, subdivisions = geometry.ellipsoid.radii, geometry.ellipsoid.subdivisions
        return Mesh.ellipsoid(np.array(radii, float), subdivisions)


def true_material(brdf: RecipeBrdfConfig) -> Parametric:
    """Build the material that a recipe states; Lambertian is a microfacet without specular part."""
    if brdf.model in SIMPLE_PARAMETRIC:
        return simple_material(brdf.model, dict(brdf))
    mu = None if brdf.mu == "none" else float(brdf.mu)
    with fault_of("brdf"):
        return Microfacet(
            np.array(brdf.kd, float),
            np.array(brdf.ks, float),
            float(brdf.sigma),
            mu,
            brdf.fresnel,
            brdf.masking,
            distribution_of(brdf.model),
        )


def lobe_of(brdf: BrdfConfig) -> Parametric:
    """Build the lobe of any model that is to be fitted; its numbers do not matter."""
    if brdf.model not in SIMPLE_PARAMETRIC:
        return variant_of(brdf)
    chosen = {name: getattr(brdf, name) for name in chosen_numbers_of(brdf.model)}
    lobe = simple_parametric_named(brdf.model, **chosen)
    metal = getattr(brdf, lobe.index.name) == "none"
    return lobe.with_roughness(lobe.sigma, None if metal else _ANY_INDEX)


def simple_material(model: str, numbers: Mapping[str, Any]) -> Parametric:
    """Build a material of a model without variants from its own numbers by name."""
    chosen: dict[str, Any] = {name: float(numbers[name]) for name in chosen_numbers_of(model)}
    lobe = simple_parametric_named(model, **chosen)
    width = lobe.shape.width_of(float(numbers[lobe.shape.name]))
    second = numbers[lobe.index.name] if lobe.has_index() else None
    known = second not in (None, "none")
    lobe = lobe.with_roughness(width, lobe.index.index_of(float(second)) if known else None)
    shape = np.shape(numbers["kd"])
    kd, ks = (
        np.zeros(shape) if name is None else np.broadcast_to(np.array(numbers[name], float), shape)
        for name in lobe.amplitude_names
    )
    return lobe.with_amplitudes(kd, ks)


def variant_of(brdf: BrdfConfig) -> Microfacet:
    """Build the microfacet lobe that is to be fitted; its numbers do not matter."""
    mu = None if brdf.mu == "none" or brdf.model == "lambertian" else _ANY_INDEX
    choices = brdf.fresnel, brdf.masking, distribution_of(brdf.model)
    return Microfacet(np.zeros(3), np.zeros(3), 0.1, mu, *choices)


def unknowns_of(config: RunConfig, photographs: int) -> MicrofacetUnknowns:
    """Translate which parameters are free into the solver's unknowns."""
    brdf, free_gains = config.brdf, photographs if config.solve.free_exposure else 0
    if brdf.model == "lambertian":
        return MicrofacetUnknowns(
            kd=_unknown("kd", brdf.kd, Unknown),
            ks=Unknown(fixed=(0.0,)),
            sigma=Unknown(fixed=(0.1,)),
            mu=None,
            free_gains=free_gains,
            free_scale=config.lighting.free_scale,
        )
    model = SIMPLE_PARAMETRIC.get(brdf.model, Microfacet)
    kd, ks = (
        Unknown(fixed=(0.0,)) if name is None else _unknown(name, getattr(brdf, name), Unknown)
        for name in model.amplitude_names
    )
    shape = model.shape
    width = _as_width(getattr(brdf, shape.name), shape)
    second = getattr(brdf, model.index.name) if model.has_index() else "none"
    return MicrofacetUnknowns(
        kd=kd,
        ks=ks,
        sigma=_unknown(shape.name, width, sigma_unknown),
        mu=None if second == "none" else _second_unknown(second, model),
        # What the model itself calls kd has a value for each channel.
        ks_per_channel=brdf.ks_per_channel or model.amplitude_names[1] == "kd",
        free_gains=free_gains,
        free_scale=config.lighting.free_scale,
    )


def settings_of(config: RunConfig) -> FitSettings:
    """Translate how the fit is to be done."""
    solve = config.solve
    noise = None
    if solve.noise != "estimate":
        noise = NoiseModel(float(solve.noise.relative), float(solve.noise.floor))
    return FitSettings(
        split=config.lighting.split,
        band_limit=None if solve.band_limit == "auto" else solve.band_limit,
        transfer=solve.transfer_name,
        refine=solve.refine == "exact",
        refine_samples=solve.refine_samples,
        method=solve.method,
        loss="squares" if solve.loss == "auto" else solve.loss,
        noise=noise,
        starts=solve.starts,
        seed=config.samples.seed,
        interreflection=solve.interreflection,
    )


def known_light(lighting: LightingConfig, frame_names: list[str]) -> KnownLight:
    """Read the light that a config names."""
    environment, files = None, []
    if lighting.environment is not None:
        given = lighting.environment
        files.append(str(given.path))
        environment = read_environment(given.path, given.convention, given.scale, given.height)
    per_frame = None
    if lighting.per_frame is not None:
        files.append(str(lighting.per_frame))
        per_frame = read_per_frame_lights(
            lighting.per_frame, frame_names, lighting.per_frame_irradiance
        )
    with fault_of(f"lighting ({', '.join(files)})" if files else "lighting"):
        return KnownLight(environment, directional_of(lighting.directional), per_frame)


def sources_of_frame(light: KnownLight, frame: int) -> DirectionalSources:
    """Join the sources that all photographs share and those of one photograph, if any."""
    if light.per_frame is None:
        return light.directional
    parts = (light.directional, light.per_frame[frame])
    return DirectionalSources(
        np.concatenate([part.directions for part in parts]),
        np.concatenate([part.irradiance for part in parts]),
    )


def directional_of(sources: tuple[DirectionalConfig, ...]) -> DirectionalSources:
    """Build directional sources."""
    with fault_of("lighting.directional"):
        if not sources:
            return DirectionalSources.none()
        return DirectionalSources(
            np.array([source.direction for source in sources], float),
            np.array([source.irradiance for source in sources], float),
        )


def recipe_environment(recipe: RecipeConfig) -> Environment | None:
    """Read a recipe's environment image at its full resolution."""
    given = recipe.lighting.environment
    if given is None:
        return None
    return read_environment(given.path, given.convention, given.scale, given.height)


def input_files(config: RunConfig | RecipeConfig) -> list[Path]:
    """List the files that a config names and that exist: what its fingerprint hashes."""
    found: list[Path] = []

    def collect(value: object) -> None:
        if isinstance(value, Path):
            found.append(value)
        elif isinstance(value, dict):
            for item in value.values():
                collect(item)
        elif isinstance(value, list | tuple):
            for item in value:
                collect(item)

    collect(config.model_dump(exclude={"output"}))
    return [path for path in found if path.is_file()]


def _as_width(parameter: Parameter, shape: ShapeParameter) -> Parameter:
    """Say what is known of a model's own number as what is known of its lobe's width."""
    if shape.scale == shape.power == 1:
        return parameter

    given = parameter.model_dump()
    if given == "free":
        return parameter
    widths = {
        key: float(shape.width_of(float(value))) for key, value in given.items() if key != "bounds"
    }
    ends = sorted(float(shape.width_of(float(bound))) for bound in given.get("bounds", ()))
    return Parameter.model_validate(widths | ({"bounds": tuple(ends)} if ends else {}))


def _second_unknown(parameter: Parameter, model: type[Parametric]) -> Unknown:
    """Say what is known of a model's own second number as what is known of an index."""
    ends = () if model.index.highest is None else index_bounds(model)
    if parameter.free and parameter.bounds is None and parameter.start is None:
        return mu_unknown(*ends)
    given = {
        key: [float(model.index.index_of(float(number))) for number in np.atleast_1d(value)]
        for key, value in parameter.model_dump().items()
        if value is not None
    }
    if ends and "start" in given and "bounds" not in given:
        given["bounds"] = list(ends)
    shown = {key: value[0] if len(value) == 1 else tuple(value) for key, value in given.items()}
    return _unknown(model.index.name, Parameter.model_validate(shown), mu_unknown)


def _unknown(name: str, parameter: Parameter, make) -> Unknown:
    if parameter.fixed is not None:
        return Unknown(fixed=tuple(float(value) for value in np.atleast_1d(parameter.fixed)))
    given = {}
    if parameter.bounds is not None:
        given["lower"], given["upper"] = (float(bound) for bound in parameter.bounds)
    if parameter.start is not None:
        given["start"] = float(np.mean(parameter.start))
    with fault_of(f"brdf.{name}"):
        return make(**given)
