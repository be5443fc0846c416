"""Objects made from configs: shape, material, light and unknowns.

Configs are plain data.  Where a class refuses their values by ``ValueError``, this module raises
``InputError`` with the place in the config.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from jaxrender.brdf import (
    PARAMETRIC,
    Parametric,
    lobe_named,
    material_named,
)
from jaxrender.catalogue import MODELS
from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Placement, Shape, Sphere
from jaxrender.geometry.sculpture import sculpture
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import FitSettings, KnownLight, UnknownMaterial, Unknowns
from jaxrender.inverse.stated import Prior, Stated
from jaxrender.io import (
    read_environment,
    read_mesh,
    read_per_frame_lights,
)
from jaxrender.lighting import (
    DirectionalSources,
    Environment,
    Light,
    LightSum,
    light_of,
    to_latlong,
)
from jaxrender.pipelines.config import RecipeConfig, RunConfig
from jaxrender.pipelines.config.brdf import BrdfConfig
from jaxrender.pipelines.config.geometry import GeometryConfig, RecipeGeometryConfig
from jaxrender.pipelines.config.lighting import (
    CaptureLightingConfig,
    EnvironmentConfig,
    RecipeLightingConfig,
)
from jaxrender.pipelines.config.recipe import RecipeBrdfConfig
from jaxrender.pipelines.result import ARRAYS, RESULT


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
            mesh = read_mesh(geometry.mesh, geometry.scale)
            if not (any(geometry.rotation) or any(geometry.translation)):
                return mesh
            turn, shift = np.array(geometry.rotation, float), np.array(geometry.translation, float)
            return Placement.of_degrees(1.0, turn, shift).mesh(mesh)
        assert isinstance(geometry, RecipeGeometryConfig)
        if geometry.sculpture is not None:
            return sculpture(geometry.sculpture.subdivisions, geometry.sculpture.seed)
        assert geometry.ellipsoid is not None
        radii, subdivisions = geometry.ellipsoid.radii, geometry.ellipsoid.subdivisions
        return Mesh.ellipsoid(np.array(radii, float), subdivisions)


def true_material(brdf: RecipeBrdfConfig) -> Parametric:
    """Build the material that a recipe states by its numbers."""
    with fault_of("brdf"):
        return material_named(brdf.model, dict(brdf))


def lobe_of(brdf: BrdfConfig) -> Parametric:
    """Build the lobe of the model to be fitted; its numbers do not matter."""
    kind = PARAMETRIC.get(brdf.model)
    metal = kind is not None and kind.has_index() and brdf.known(kind.index.name) is None
    return lobe_named(brdf.model, metal=metal, **brdf.chosen())


def material_of(config: RunConfig) -> UnknownMaterial:
    """Translate what is known of the material; ``InputError`` for what cannot be."""
    brdf, model = config.brdf, MODELS[config.brdf.model]
    known = {name: brdf.known(name) for name in model.names("amplitude", "searched")}
    stated = {
        name: Stated(
            parameter.fixed,
            parameter.bounds,
            None if parameter.start is None else float(np.mean(parameter.start)),
            None if parameter.prior is None else Prior(*parameter.prior),
        )
        for name, parameter in known.items()
        if parameter is not None
    }
    material = UnknownMaterial(model.name, lobe_of(brdf), stated, brdf.ks_per_channel)
    try:
        material.unknowns()
    except ValueError as error:
        raise InputError(f"brdf.{error}") from error
    return material


def unknowns_of(config: RunConfig, photographs: int) -> Unknowns:
    """Translate which parameters are free into the solver's unknowns."""
    gains = photographs if config.solve.free_exposure else 0
    return material_of(config).unknowns(gains, config.lighting.free_scale)


def settings_of(config: RunConfig) -> FitSettings:
    """Make the settings of the fit."""
    solve = config.solve
    noise = None
    if solve.noise != "estimate":
        noise = NoiseModel(float(solve.noise.relative), float(solve.noise.floor))
    return FitSettings(
        split=config.lighting.split,
        band_limit=None if solve.band_limit == "auto" else solve.band_limit,
        transfer=solve.transfer_name,
        refine=solve.refine == "exact",
        refine_samples=config.refine_count,
        method=solve.method,
        loss="squares" if solve.loss == "auto" else solve.loss,
        noise=noise,
        starts=solve.starts,
        seed=config.samples.seed,
        interreflection=solve.interreflection,
        diagnose=solve.diagnose,
        free=solve.free,
    )


def environment_of(given: EnvironmentConfig) -> Environment:
    """Read an environment from its file, as it is told."""
    return read_environment(
        given.path,
        given.convention,
        given.scale,
        given.height,
        yaw=float(given.yaw),
        mirrored=given.mirrored,
    )


def lights_of(lighting: CaptureLightingConfig | RecipeLightingConfig) -> tuple[Light, ...]:
    """Make the lights that all photographs share; an environment is read from its file, as it is.

    They come in the order of the catalogue, the environment last.
    """
    found: list[Light] = []
    for name, entries in lighting.stated().items():
        with fault_of(f"lighting.{name}"):
            found.append(light_of(name, entries))
    if lighting.environment is not None:
        given = lighting.environment
        found.append(environment_of(given))
    return tuple(found)


def known_light(
    lighting: CaptureLightingConfig, frame_names: list[str], shape: Shape | None
) -> KnownLight:
    """Make or read the light that a config names; ``shape`` says how near its sources are."""
    per_frame = None
    if lighting.per_frame is not None:
        per_frame = read_per_frame_lights(
            lighting.per_frame, frame_names, lighting.per_frame_irradiance
        )
    lights = lights_of(lighting) or (DirectionalSources.none(),)
    environment = lighting.environment and lighting.environment.path
    files = ", ".join(str(path) for path in (environment, lighting.per_frame) if path)
    with fault_of(f"lighting ({files})" if files else "lighting"):
        return KnownLight.of(LightSum(lights), per_frame, shape=shape)


def light_for_fit(recipe: RecipeConfig, shape: Shape) -> KnownLight:
    """Make the light that a fit of a recipe's photographs is given: sources and a coarser image."""
    height = recipe.environment_height
    lights = [
        Environment(to_latlong(np.asarray(light.radiance), "z-up", height))
        if isinstance(light, Environment)
        else light
        for light in lights_of(recipe.lighting)
    ]
    with fault_of("lighting"):
        return KnownLight.of(LightSum(tuple(lights)), height=height, shape=shape)


def input_files(config: RunConfig | RecipeConfig) -> list[Path]:
    """List the files that a config names and that exist: what its fingerprint hashes.

    The folder of a result stands for the files that its numbers are read from.
    """
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
    inside = [path / name for path in found for name in (RESULT, ARRAYS)]
    return [path for path in (*found, *inside) if path.is_file()]
