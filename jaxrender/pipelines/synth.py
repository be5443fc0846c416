"""Synthetic photographs from a recipe: the exact integral, noise, and a config that fits them.

A polar quadrature about each normal integrates smooth lobes as functions.  Environment images and
sources count by their point masses.  Skies and light of coefficients are sampled at directions
evenly spread over the sphere.  On a concave shape lobes are, too: every light is a sum of point
masses, each visible or not.  Bounced light is left out.  The frequency model of the fits is not
used, and a fit gets an environment image that is coarser than the light of the photographs.
"""

import json
import os
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from ruamel.yaml import YAML

from jaxrender.brdf import Parametric
from jaxrender.catalogue import LIGHTS, MODELS
from jaxrender.errors import InputError
from jaxrender.geometry import (
    Mesh,
    Pinhole,
    Shape,
    SurfaceView,
    fibonacci_sphere,
    look_at,
    observe,
)
from jaxrender.imaging import NoiseModel
from jaxrender.io import write_environment, write_image, write_mesh
from jaxrender.lighting import (
    DirectionalSources,
    Environment,
    FunctionLight,
    Light,
    LightNodes,
    PointSources,
    SmoothLobes,
    condensed,
)
from jaxrender.pipelines.brdf_sources import Source, source_of
from jaxrender.pipelines.config import RecipeConfig
from jaxrender.pipelines.config.recipe import ViewsConfig
from jaxrender.pipelines.exact_light import with_points
from jaxrender.pipelines.faults import Planted, planted
from jaxrender.pipelines.output import FolderState, fingerprint, prepare, result_folder
from jaxrender.pipelines.paint import render_painted
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.scene import (
    fault_of,
    input_files,
    light_for_fit,
    lights_of,
    shape_of,
    true_material,
)
from jaxrender.reflection import (
    ExactForward,
    ForwardModel,
    NearForward,
    ShadowedForward,
    ShadowedModel,
    render_view,
)
from jaxrender.shapes import Float

# Directions at which light is sampled that is a function, less those that carry next to nothing.
_NODES, _DARK = 2**15, 1e-5
# Under shadows: the largest image whose texels are all asked for; else cells of this angle.
_MOST_TEXELS, _CELL_ANGLE = 2**16, 0.014


def synthesise(
    recipe: RecipeConfig,
    recipe_path: Path,
    folder: Path,
    force: bool = False,
    progress: Progress | None = None,
) -> Path:
    """Render a recipe's photographs into ``folder`` and return it.

    Writes ``images/*.exr`` (alpha = coverage), ``transforms.json``, ``truth.json`` and a
    ``config.yaml`` that fits them; ``environment.exr`` if the light is more than sources.  An
    identical capture is reused.  Raises ``InputError``.
    """
    progress = progress or SilentProgress()
    digest = fingerprint(recipe, input_files(recipe), purpose=purpose_of(recipe))
    if prepare(folder, digest, force) is FolderState.FINISHED:
        progress.note(f"photographs of {recipe_path.name}: rendered before, in {folder}")
        return folder
    with progress.stage("render photographs"), result_folder(folder, digest, force) as into:
        _write_capture(recipe, recipe_path, into, progress)
    return folder


def purpose_of(recipe: RecipeConfig) -> str:
    """Name the purpose; that of meshes changed when concave ones got shadows."""
    return "synth" if recipe.geometry.mesh is None else "synth with shadows"


def written_files(recipe: RecipeConfig) -> list[str]:
    """List the files of a recipe's capture, relative to its folder."""
    names = [_image_name(number) for number in range(recipe.views.count)]
    names += ["transforms.json", "truth.json", "config.yaml"]
    if recipe.lighting.has_image:
        names.append("environment.exr")
    return names + (["shape.ply"] if recipe.geometry.sphere is None else [])


def cameras_of(views: ViewsConfig, centre: Float[np.ndarray, "3"]) -> list[Pinhole]:
    """Place cameras on a circle about ``axis`` through the object's centre, looking at it."""
    axis = np.array(views.axis, float)
    axis /= np.linalg.norm(axis)
    aside = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    aside /= np.linalg.norm(aside)
    ahead = np.cross(axis, aside)
    elevation = np.radians(views.elevation_degrees)
    focal = views.width / 2 / np.tan(np.radians(views.field_of_view_degrees) / 2)
    cameras = []
    for view in range(views.count):
        angle = np.radians(views.start_degrees + view * views.step_degrees)
        level = np.cos(angle) * aside + np.sin(angle) * ahead
        position = centre + views.distance * (np.cos(elevation) * level + np.sin(elevation) * axis)
        pose = look_at(position, centre, axis)
        cameras.append(Pinhole(views.width, views.height, pose, fl_x=float(focal)))
    return cameras


def _write_capture(
    recipe: RecipeConfig, recipe_path: Path, folder: Path, progress: Progress
) -> None:
    shape, source = shape_of(recipe.geometry), _source_of(recipe, progress)
    material = true_material(recipe.brdf) if source is None else source.colours
    light = _light_of(recipe, shape)
    if not any(np.any(np.asarray(energy) > 0) for energy in _energies(light)):
        raise InputError(f"{recipe_path}: lighting: the light is zero; give a radiance above 0")
    centre = np.asarray(shape.bounds()).mean(axis=0)
    # A camera straight above the circle has no upright direction; nothing else is refused here.
    with fault_of(f"{recipe_path}: views.elevation_degrees {recipe.views.elevation_degrees:g}"):
        cameras = cameras_of(recipe.views, centre)
    if not any(observe(camera, shape).hit.any() for camera in cameras):
        raise InputError(
            f"{recipe_path}: views: no camera sees the object; change distance or "
            "field_of_view_degrees"
        )
    noise = NoiseModel(float(recipe.noise.relative), float(recipe.noise.floor))
    rng = np.random.default_rng(recipe.seed)
    wrong = None if recipe.faults is None else planted(recipe, shape, len(cameras))
    if wrong is not None:
        light = _light_of(recipe, shape, wrong)
    (folder / "images").mkdir()
    frames = []
    for number, camera in enumerate(cameras):
        name = _image_name(number)
        view = observe(camera, shape) if wrong is None else wrong.view(camera, number)
        if recipe.texture is None:
            exact = np.asarray(render_view(material, view, light))
        else:
            assert isinstance(material, Parametric)
            exact = render_painted(recipe, material, view, shape, light)
        if wrong is not None:
            exact = wrong.photographed(exact, material, view, number)
        write_image(folder / name, _photograph(view, exact, noise, rng))
        frames.append({"file_path": name, "transform_matrix": camera.world_from_camera.tolist()})
        progress.advance((number + 1) / len(cameras))
    first = cameras[0]
    intrinsics = {"w": first.width, "h": first.height, "fl_x": first.fl_x, "fl_y": first.fl_y}
    _write_json(folder / "transforms.json", {**intrinsics, "frames": frames})
    truth = recipe.written_out()
    if source is not None:
        truth["material"] = {"name": source.name, "said": list(source.said)}
    _write_json(folder / "truth.json", truth if wrong is None else truth | wrong.truth())
    lighting = _write_light(recipe, shape, folder)
    _write_config(recipe, recipe_path, folder, shape, lighting)


def _source_of(recipe: RecipeConfig, progress: Progress) -> Source | None:
    """Read a material that is known by its values, and pass on what the reader says."""
    if recipe.brdf.file is None:
        return None
    with fault_of("brdf.file"):
        source = source_of(str(recipe.brdf.file))
    for sentence in source.said:
        progress.note(f"{source.name}: {sentence}")
    return source


def _image_name(number: int) -> str:
    return f"images/view_{number:03d}.exr"


def _photograph(
    view: SurfaceView,
    exact: Float[np.ndarray, "row column channel"],
    noise: NoiseModel,
    rng: np.random.Generator,
) -> Float[np.ndarray, "row column 4"]:
    image = np.zeros((*view.hit.shape, 4))
    # A sensor reads no negative light.
    image[view.hit, :3] = np.maximum(noise.add(exact[view.hit], rng), 0)
    image[..., 3] = view.hit
    return image


def _light_of(
    recipe: RecipeConfig, shape: Shape, wrong: Planted | None = None
) -> ExactForward | ShadowedForward | NearForward:
    concave, lobes, points = not shape.is_convex(), None, None
    parts = [DirectionalSources.none().nodes()]
    for light in lights_of(recipe.lighting):
        if wrong is not None:
            light = wrong.light_of(light)
        if isinstance(light, PointSources):
            points = light
        elif isinstance(light, SmoothLobes) and not concave:
            lobes = light
        else:
            parts.append(_nodes_of(light, concave))
    nodes = LightNodes(*(jnp.concatenate([jnp.asarray(a) for a in part]) for part in zip(*parts)))
    others = ShadowedForward(shape, nodes) if concave else ExactForward(nodes, lobes)
    return others if points is None else with_points(others, points, shape)


def _nodes_of(light: Light, concave: bool) -> LightNodes:
    """List the point masses of a light that are not dark; under shadows they are not too many."""
    if isinstance(light, FunctionLight):
        return _sampled(light)
    nodes = light.nodes()
    if concave and isinstance(light, Environment) and nodes.directions.shape[0] > _MOST_TEXELS:
        nodes = condensed(light, _CELL_ANGLE)
    lit = np.any(np.asarray(nodes.irradiance) > 0, axis=1)
    return LightNodes(*(np.asarray(a)[lit] for a in nodes))


def _sampled(light: FunctionLight) -> LightNodes:
    """Sum up light that is a function of direction at evenly spread directions."""
    directions = fibonacci_sphere(_NODES)
    radiance = np.asarray(light.radiance(directions))
    size = np.abs(radiance).max(axis=1)
    lit = size > _DARK * size.max()
    return LightNodes(directions[lit], 4 * np.pi / _NODES * radiance[lit])


def _energies(light: ForwardModel | ShadowedModel | None) -> list:
    if isinstance(light, NearForward):
        return [light.sources.intensity, *_energies(light.others)]
    assert isinstance(light, ExactForward | ShadowedForward)
    lobes = light.lobes if isinstance(light, ExactForward) else None
    return [light.nodes.irradiance] + ([] if lobes is None else [lobes.middle])


def _write_light(recipe: RecipeConfig, shape: Shape, folder: Path) -> dict:
    """Write the environment image that a fit is given, and return the config's lighting section."""
    lighting: dict = {}
    environment = light_for_fit(recipe, shape).environment
    if environment is not None:
        write_environment(folder / "environment.exr", environment)
        lighting["environment"] = {"path": "environment.exr", "convention": "z-up"}
    stated = recipe.lighting.stated()
    for name in (name for name in stated if not LIGHTS[name].is_image):
        lighting[name] = [
            {key: list(value) for key, value in entry.items()} for entry in stated[name]
        ]
    return lighting


def _write_config(
    recipe: RecipeConfig, recipe_path: Path, folder: Path, shape: Shape, lighting: dict
) -> None:
    """Write a config that fits the photographs, with everything free that the recipe states.

    A material that is known by its values is fitted by facets, with a ks for each channel.
    """
    geometry = recipe.geometry.model_dump(
        mode="json", exclude_none=True, exclude={"scale", "rotation", "translation"}
    )
    if isinstance(shape, Mesh):
        write_mesh(folder / "shape.ply", shape)
        geometry = {"mesh": "shape.ply"}
    brdf = _fitted_brdf(recipe)
    config = {
        "task": "brdf" if recipe.texture is None else "texture",
        "capture": {"transforms": "transforms.json", "geometry": geometry},
        "lighting": lighting,
        "brdf": brdf,
        "output": f"runs/{recipe_path.stem}",
    }
    with (folder / "config.yaml").open("w", encoding="utf-8") as stream:
        YAML(typ="safe").dump(config, stream)


def _fitted_brdf(recipe: RecipeConfig) -> dict:
    """Lay out the material of the config that fits the photographs."""
    if recipe.brdf.file is not None:
        return {"model": "ggx", "ks_per_channel": True}
    truth, model = dict(recipe.brdf), MODELS[recipe.brdf.model]
    brdf: dict = {"model": model.name}
    if model.has_specular:
        brdf["ks_per_channel"] = len(set(truth["ks"])) > 1
    brdf |= {name: truth[name] for name in (*model.options, *model.names("stated"))}
    if truth["mu"] == "none":
        # A metal reflects the same at all angles.
        brdf.pop("fresnel", None)
    brdf |= {name: "none" for name in model.names("searched") if truth[name] == "none"}
    return brdf


def _write_json(path: Path, content: dict) -> None:
    path.write_text(json.dumps(content, indent=1) + os.linesep, encoding="utf-8")
