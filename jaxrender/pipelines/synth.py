"""Synthetic photographs from a recipe: the exact integral, noise, and a config that fits them.

A polar quadrature about each normal integrates smooth lobes as functions.  Environment images and
sources count by their point masses.  On a concave shape every light is a sum of point masses, each
visible or not; lobes are sampled at directions evenly spread over the sphere.  Bounced light is
left out.  The frequency model of the fits is not used, and a fit gets an environment image that is
coarser than the light of the photographs.
"""

import json
import os
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from ruamel.yaml import YAML

from jaxrender.catalogue import MODELS
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
from jaxrender.lighting import Environment, LightNodes, SmoothLobes, condensed, to_latlong
from jaxrender.pipelines.config import RecipeConfig
from jaxrender.pipelines.config.recipe import ViewsConfig
from jaxrender.pipelines.output import FolderState, fingerprint, prepare, result_folder
from jaxrender.pipelines.paint import render_painted
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.scene import (
    directional_of,
    fault_of,
    input_files,
    recipe_environment,
    shape_of,
    true_material,
)
from jaxrender.reflection import ExactForward, ShadowedForward, render_view
from jaxrender.shapes import Float

# Under shadows: directions at which lobes are sampled, less those that carry next to nothing ...
_LOBE_NODES, _DARK = 2**15, 1e-5
# ... and the largest image whose texels are all asked for; cells of this angle stand for others.
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
    if recipe.lighting.area or recipe.lighting.environment:
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
    shape, material = shape_of(recipe.geometry), true_material(recipe.brdf)
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
    (folder / "images").mkdir()
    frames = []
    for number, camera in enumerate(cameras):
        name = _image_name(number)
        view = observe(camera, shape)
        if recipe.texture is None:
            exact = np.asarray(render_view(material, view, light))
        else:
            exact = render_painted(recipe, material, view, shape, light)
        write_image(folder / name, _photograph(view, exact, noise, rng))
        frames.append({"file_path": name, "transform_matrix": camera.world_from_camera.tolist()})
        progress.advance((number + 1) / len(cameras))
    first = cameras[0]
    intrinsics = {"w": first.width, "h": first.height, "fl_x": first.fl_x, "fl_y": first.fl_y}
    _write_json(folder / "transforms.json", {**intrinsics, "frames": frames})
    _write_json(folder / "truth.json", recipe.written_out())
    lighting = _write_light(recipe, folder)
    _write_config(recipe, recipe_path, folder, shape, lighting)


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


def _light_of(recipe: RecipeConfig, shape: Shape) -> ExactForward | ShadowedForward:
    parts = [directional_of(recipe.lighting.directional).nodes()]
    environment, lobes = recipe_environment(recipe), _lobes_of(recipe)
    concave = not shape.is_convex()
    if concave and lobes is not None:
        parts.append(_sampled(lobes))
    if environment is not None:
        nodes = environment.nodes()
        if concave and nodes.directions.shape[0] > _MOST_TEXELS:
            nodes = condensed(environment, _CELL_ANGLE)
        lit = np.any(np.asarray(nodes.irradiance) > 0, axis=1)
        parts.append(LightNodes(*(np.asarray(a)[lit] for a in nodes)))
    nodes = LightNodes(*(jnp.concatenate([jnp.asarray(a) for a in part]) for part in zip(*parts)))
    if concave:
        return ShadowedForward(shape, nodes)
    return ExactForward(nodes, lobes)


def _sampled(lobes: SmoothLobes) -> LightNodes:
    """Sum up smooth lobes at evenly spread directions."""
    directions = fibonacci_sphere(_LOBE_NODES)
    radiance = np.asarray(lobes.radiance(directions))
    lit = radiance.max(axis=1) > _DARK * radiance.max()
    return LightNodes(directions[lit], 4 * np.pi / _LOBE_NODES * radiance[lit])


def _energies(light: ExactForward | ShadowedForward) -> list:
    lobes = light.lobes if isinstance(light, ExactForward) else None
    return [light.nodes.irradiance] + ([] if lobes is None else [lobes.middle])


def _lobes_of(recipe: RecipeConfig) -> SmoothLobes | None:
    area = recipe.lighting.area
    if not area:
        return None
    return SmoothLobes(
        np.array([lobe.direction for lobe in area], float),
        np.radians([lobe.width_degrees for lobe in area]),
        np.array([lobe.radiance for lobe in area], float),
    )


def _write_light(recipe: RecipeConfig, folder: Path) -> dict:
    """Write the environment image that a fit is given, and return the config's lighting section."""
    lighting: dict = {}
    image = 0.0
    lobes, environment = _lobes_of(recipe), recipe_environment(recipe)
    if lobes is not None:
        image = image + np.asarray(lobes.to_environment(recipe.environment_height).radiance)
    if environment is not None:
        radiance = np.asarray(environment.radiance)
        image = image + to_latlong(radiance, "z-up", recipe.environment_height)
    if isinstance(image, np.ndarray):
        write_environment(folder / "environment.exr", Environment(image))
        lighting["environment"] = {"path": "environment.exr", "convention": "z-up"}
    if recipe.lighting.directional:
        lighting["directional"] = [
            {"direction": list(source.direction), "irradiance": list(source.irradiance)}
            for source in recipe.lighting.directional
        ]
    return lighting


def _write_config(
    recipe: RecipeConfig, recipe_path: Path, folder: Path, shape: Shape, lighting: dict
) -> None:
    """Write a config that fits the photographs, with everything free that the recipe states."""
    geometry = recipe.geometry.model_dump(mode="json", exclude_none=True, exclude={"scale"})
    if isinstance(shape, Mesh):
        write_mesh(folder / "shape.ply", shape)
        geometry = {"mesh": "shape.ply"}
    truth, model = dict(recipe.brdf), MODELS[recipe.brdf.model]
    brdf: dict = {"model": model.name}
    if model.has_specular:
        brdf["ks_per_channel"] = len(set(truth["ks"])) > 1
    brdf |= {name: truth[name] for name in (*model.options, *model.names("stated"))}
    if truth["mu"] == "none":
        # A metal reflects the same at all angles.
        brdf.pop("fresnel", None)
    brdf |= {name: "none" for name in model.names("searched") if truth[name] == "none"}
    config = {
        "task": "brdf" if recipe.texture is None else "texture",
        "capture": {"transforms": "transforms.json", "geometry": geometry},
        "lighting": lighting,
        "brdf": brdf,
        "output": f"runs/{recipe_path.stem}",
    }
    with (folder / "config.yaml").open("w", encoding="utf-8") as stream:
        YAML(typ="safe").dump(config, stream)


def _write_json(path: Path, content: dict) -> None:
    path.write_text(json.dumps(content, indent=1) + os.linesep, encoding="utf-8")
