"""White teflon as T 6.4 measures it: one ball under complex light, and under a source that moves.

Shared by ``figure_6_2.py`` and ``figure_6_3.py``.  Photographs are the exact integral with noise;
the material, the lights and the noise are those of ``data_synth/teflon.yaml``.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Orthographic, Sphere, SurfaceSamples, SurfaceView, look_at, observe
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Observations
from jaxrender.inverse.brdf_table.moving_source import brdf_samples
from jaxrender.inverse.brdf_table.table import BRDFTable, HalfAngleGrid, tabulate
from jaxrender.lighting import DirectionalSources, SmoothLobes
from jaxrender.pipelines import load_recipe
from jaxrender.pipelines.synth import cameras_of
from jaxrender.reflection import ExactForward, render_samples

RECIPE = Path(__file__).parent.parent / "data_synth" / "teflon.yaml"
# T 6.4.2 draws so many pixels at random.
SAMPLES = 12000
MIN_COSINE = 0.15
# The source's angles from the camera: along an arc, as far as an arm reaches round.
SOURCE_DEGREES = np.arange(6.0, 156.0, 4.0)
FINE = HalfAngleGrid()


class Scene(NamedTuple):
    """The material, both lights, and the noise."""

    material: Microfacet
    area: SmoothLobes
    source: DirectionalSources
    noise: NoiseModel

    def light(self, with_source: bool = True) -> ExactForward:
        """Light the ball with the area source, and the source."""
        source = self.source if with_source else DirectionalSources.none()
        return ExactForward(source.nodes(), self.area)


def teflon() -> Scene:
    """Read the recipe."""
    recipe = load_recipe(RECIPE)
    area, directional = recipe.lighting.area, recipe.lighting.directional
    return Scene(
        Microfacet(
            np.array(recipe.brdf.kd, float),
            np.full(3, np.mean(recipe.brdf.ks)),
            float(np.mean(recipe.brdf.sigma)),
            float(recipe.brdf.mu),
        ),
        SmoothLobes(
            np.array([lobe.direction for lobe in area], float),
            np.radians([lobe.width_degrees for lobe in area]),
            np.array([lobe.radiance for lobe in area], float),
        ),
        DirectionalSources(
            np.array([source.direction for source in directional], float),
            np.array([source.irradiance for source in directional], float),
        ),
        NoiseModel(float(recipe.noise.relative), float(recipe.noise.floor)),
    )


def under_complex_light(scene: Scene, views: int, seed: int = 0) -> Observations:
    """Draw pixels from ``views`` photographs along the recipe's arc."""
    config = load_recipe(RECIPE).views
    step = config.step_degrees * config.count / views
    changed = config.model_copy(update={"count": views, "step_degrees": step})
    seen = [observe(camera, ball()) for camera in cameras_of(changed, np.zeros(3))]
    normals, outgoing = (
        np.concatenate([getattr(view, name)[view.hit] for view in seen])
        for name in ("normals", "outgoing")
    )
    frame = np.repeat(np.arange(views), [np.count_nonzero(view.hit) for view in seen])
    usable = np.flatnonzero(np.sum(normals * outgoing, axis=1) > MIN_COSINE)
    rng = np.random.default_rng(seed)
    kept = rng.choice(usable, min(SAMPLES, len(usable)), replace=False)
    samples = SurfaceSamples(normals[kept], outgoing[kept])
    exact = render_samples(scene.material, samples, scene.light())
    return Observations(samples, scene.noise.add(exact, rng), frame[kept])


def moving_source_table(
    scene: Scene, size: int = 160, grid: HalfAngleGrid = FINE, seed: int = 1
) -> BRDFTable:
    """Photograph the ball under one source after the other, and tabulate the BRDF."""
    view = portrait(np.array([1.0, 0, 0]), size)
    samples = SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])
    rng = np.random.default_rng(seed)
    sources, photographs = [], []
    for angle in np.radians(SOURCE_DEGREES):
        towards = np.array([[np.cos(angle), np.sin(angle), 0]])
        sources.append(DirectionalSources(towards, np.ones((1, 3))))
        exact = render_samples(scene.material, samples, ExactForward(sources[-1].nodes()))
        photographs.append(scene.noise.add(exact, rng))
    every = SurfaceSamples(*(np.tile(a, (len(sources), 1)) for a in samples))
    frame = np.repeat(np.arange(len(sources)), len(samples.normals))
    observations = Observations(every, np.concatenate(photographs), frame)
    return tabulate(brdf_samples(observations, sources, scene.noise), grid)


def portrait(towards: np.ndarray, size: int) -> SurfaceView:
    """See the ball from one side, orthographically."""
    pose = look_at(3 * towards, np.zeros(3), np.array([0.0, 0, 1]))
    return observe(Orthographic(size, size, pose, scale=2.05 / size), ball())


def ball() -> Sphere:
    """The unit sphere."""
    return Sphere(np.zeros(3), 1.0)
