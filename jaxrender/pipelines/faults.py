"""What is wrong with the capture of a recipe: drawn at random, and built into its photographs."""

from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.errors import InputError
from jaxrender.geometry import Camera, Shape, SurfacePlaces, SurfaceSamples, SurfaceView
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.nuisances import NUISANCES, Corrections, Told
from jaxrender.lighting import DirectionalSources, Environment, Light, PointSources
from jaxrender.pipelines.config import RecipeConfig
from jaxrender.pipelines.exact_light import with_points
from jaxrender.pipelines.scene import fault_of, light_for_fit, lights_of
from jaxrender.reflection import render_view
from jaxrender.shapes import Float


class Planted(NamedTuple):
    """How photographs are taken, where the files of their capture say something else.

    ``near`` are the sources that have a place, if any have.
    """

    corrections: Corrections
    shape: Shape
    light: KnownLight
    planted: tuple[str, ...]

    def view(self, camera: Camera, number: int) -> SurfaceView:
        """See the object as the true camera does."""
        return self.corrections.view(camera, number, self.shape)

    def light_of(self, told: Light) -> Light:
        """Correct one of the lights: sources that a fault brings near are rendered apart."""
        if isinstance(told, Environment) and self.light.turn is not None:
            return told.turned(np.asarray(self.light.turn))
        if isinstance(told, DirectionalSources):
            return self.light.far_of(0)
        if isinstance(told, PointSources):
            return self.light.points_of(0) or told
        return told

    def photographed(
        self,
        radiance: Float[np.ndarray, "row column channel"],
        material: BRDF,
        view: SurfaceView,
        number: int,
    ) -> Float[np.ndarray, "row column channel"]:
        """Add what near sources do, and make pixels of radiance."""
        points = self.light.points_of(0)
        if points is not None and "nearness" in self.planted:
            model = with_points(None, points, self.shape)
            radiance = radiance + np.asarray(render_view(material, view, model))
        found = self.corrections.photographed(radiance, number, view.hit)
        return np.where(view.hit[..., None], found, 0)

    def truth(self) -> dict[str, Any]:
        """Lay out what is wrong, in the units of the nuisances."""
        numbers = {
            name: NUISANCES[name].in_units(self.corrections.of(name)).tolist()
            for name in self.planted
        }
        return {"planted": numbers}


def planted(recipe: RecipeConfig, shape: Shape, photographs: int) -> Planted:
    """Draw what is wrong; ``InputError`` where the recipe's light has no such thing."""
    sizes = {name: float(size) for name, size in dict(recipe.faults or {}).items() if size > 0}
    lights = lights_of(recipe.lighting)
    if not any(isinstance(one, DirectionalSources | PointSources) for one in lights):
        for name in sizes.keys() & {"lamps", "nearness"}:
            raise InputError(f"faults.{name}: no source is there; give lighting.directional")
    if "nearness" in sizes and recipe.lighting.stated().get("point"):
        raise InputError("faults.nearness: lighting.point states places; remove one of the two")
    rest = [one for one in lights if not isinstance(one, DirectionalSources | PointSources)]
    if "environment" in sizes and not (rest and all(isinstance(one, Environment) for one in rest)):
        raise InputError(
            "faults.environment turns an image; give lighting.environment, and beside it nothing "
            "but lighting.directional"
        )
    if "nearness" in sizes and recipe.texture is not None:
        raise InputError("faults.nearness: near sources light one material; remove texture")
    told = Told(_nothing(photographs), light_for_fit(recipe, shape), shape)
    none = Corrections.none(told)
    rng = np.random.default_rng([recipe.seed, 1])
    corrections = none
    for name, size in sizes.items():
        nuisance, count = NUISANCES[name], len(none.of(name))
        if nuisance.lowest == 0:
            numbers = np.full(count, size)
        else:
            # As many priors as the size is of the first unit's.
            numbers = rng.normal(size=count) * nuisance.deviations(count)
            numbers *= size / nuisance.units[0].prior
        if name == "normals":
            numbers *= nuisance.units[0].prior
        corrections = corrections.moved(name, numbers)
    with fault_of("faults"):
        return Planted(corrections, shape, corrections.light(told), tuple(sizes))


def _nothing(photographs: int) -> Observations:
    """Stand for photographs that are not taken yet, of radiance 1."""
    up = np.tile([0.0, 0.0, 1.0], (photographs, 1))
    return Observations(
        SurfaceSamples(up, up),
        np.ones((photographs, 3)),
        np.arange(photographs),
        SurfacePlaces(0 * up, up),
    )
