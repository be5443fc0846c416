"""The concave sculpture of T 6.5's experiments: its scene, its photographs, its exact pictures.

What ``data_synth/sculpture.yaml`` states, photographed by the exact integral with visibility at
directions that are those of no image.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import (
    Camera,
    Mesh,
    SurfacePlaces,
    SurfaceSamples,
    SurfaceView,
    fibonacci_sphere,
    observe,
    sculpture,
)
from jaxrender.harmonics import LatLongGrid, analyse, real_basis
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.inverse.observations import random_subset
from jaxrender.lighting import DirectionalSources, LightNodes, SmoothLobes
from jaxrender.pipelines.config import RecipeConfig
from jaxrender.pipelines.scene import lights_of, true_material
from jaxrender.pipelines.synth import cameras_of
from jaxrender.reflection import ShadowedForward, render_samples, render_view
from jaxrender.shapes import Float

LOWEST_COSINE = 0.15
NEW_LIGHT = DirectionalSources(np.array([[0.25, 0.1, 0.96]]), np.full((1, 3), 2.0))
# Directions of the area source that carry less than this of its peak are left out.
_DARK = 1e-5
_ROWS = 96


class Stage(NamedTuple):
    """The object, its material and light, three cameras and a new one."""

    mesh: Mesh
    material: Microfacet
    area: SmoothLobes
    sources: DirectionalSources
    cameras: Sequence[Camera]


class Pictures(NamedTuple):
    """An input view, the new view, and that under the new light: exact or by a recovered scene."""

    seen: Float[np.ndarray, "row column 3"]
    new_view: Float[np.ndarray, "row column 3"]
    new_light: Float[np.ndarray, "row column 3"]


def stage_of(recipe: RecipeConfig, size: int) -> Stage:
    """Build the recipe's scene, with one view more, between two others and from higher up."""
    given = recipe.geometry.sculpture
    assert given is not None
    mesh = sculpture(given.subdivisions, given.seed)
    centre = np.asarray(mesh.bounds()).mean(axis=0)
    views = recipe.views.model_copy(update={"width": size, "height": size})
    turned = views.start_degrees + 0.5 * views.step_degrees
    aside = {"count": 1, "start_degrees": turned, "elevation_degrees": 35.0}
    cameras = cameras_of(views, centre) + cameras_of(views.model_copy(update=aside), centre)
    sources, area = lights_of(recipe.lighting)
    assert isinstance(area, SmoothLobes)
    assert isinstance(sources, DirectionalSources)
    return Stage(mesh, true_material(recipe.brdf), area, sources, cameras)


def fine_nodes(stage: Stage, count: int) -> LightNodes:
    """The area source at evenly spread directions, and the two sources."""
    directions = fibonacci_sphere(count)
    radiance = np.asarray(stage.area.radiance(directions))
    lit = radiance.max(axis=1) > _DARK * radiance.max()
    area = LightNodes(directions[lit], 4 * np.pi / count * radiance[lit])
    return joined(area, stage.sources)


def joined(nodes: LightNodes, sources: DirectionalSources) -> LightNodes:
    """Put directional sources beside other nodes."""
    both = zip(nodes, sources.nodes())
    return LightNodes(*(jnp.concatenate([jnp.asarray(a) for a in pair]) for pair in both))


def measure(stage: Stage, nodes: LightNodes, count: int, noise: NoiseModel) -> Observations:
    """Photograph: draw pixels of the three views and integrate what they see, with noise."""
    parts = []
    for number, camera in enumerate(stage.cameras[:3]):
        view = observe(camera, stage.mesh)
        usable = view.hit & (view.exit_cosines > LOWEST_COSINE)
        arrays = (view.normals, view.outgoing, view.points, view.geometric_normals)
        parts.append([a[usable] for a in arrays] + [np.full(usable.sum(), number)])
    normals, outgoing, points, flat, frame = (np.concatenate(arrays) for arrays in zip(*parts))
    every = Observations(
        SurfaceSamples(normals, outgoing),
        np.zeros_like(normals),
        frame,
        SurfacePlaces(points, flat),
    )
    some = random_subset(every, count, 0)
    model = ShadowedForward(stage.mesh, nodes)
    exact = render_samples(stage.material, some.samples, model, some.places)
    noisy = np.maximum(noise.add(exact, np.random.default_rng(0)), 0)
    return some._replace(radiance=noisy)


def pictures(
    stage: Stage, brdf: Microfacet, nodes: LightNodes, scale: np.ndarray | float = 1.0
) -> Pictures:
    """Render the views by the exact integral; the new light's energies times ``scale``."""
    traced = [observe(camera, stage.mesh) for camera in (stage.cameras[0], stage.cameras[3])]
    new = NEW_LIGHT.nodes()
    new = LightNodes(jnp.asarray(new.directions), jnp.asarray(new.irradiance) * scale)
    lights = (nodes, nodes, new)

    def rendered(view: SurfaceView, light: LightNodes) -> np.ndarray:
        return np.maximum(render_view(brdf, view, ShadowedForward(stage.mesh, light)), 0)

    return Pictures(*map(rendered, (traced[0], traced[1], traced[1]), lights))


def true_coefficients(stage: Stage, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """The area source's coefficients, and those of the two sources, in radiance."""
    grid = LatLongGrid(_ROWS, 2 * _ROWS)
    area = np.asarray(stage.area.to_environment(_ROWS).radiance)
    directions = jnp.asarray(stage.sources.nodes().directions)
    sources = np.asarray(real_basis(directions, degree)).T @ np.asarray(stage.sources.irradiance)
    return np.asarray(analyse(grid, jnp.asarray(area), degree)), sources


def total_of(stage: Stage) -> np.ndarray:
    """kd + ks of each channel: what the light of a factorization is larger by."""
    return np.asarray(stage.material.kd) + np.asarray(stage.material.ks)


def off_by(image: np.ndarray, truth: np.ndarray) -> float:
    """Compare two pictures: rms difference over rms, per cent."""
    return 100 * float(np.linalg.norm(image - truth) / np.linalg.norm(truth))
