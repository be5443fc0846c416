"""Procedural paint: a known K_d and K_s at every place of an object.

Paint depends on the direction from the middle of the object, as latitude and longitude.  These are
a sphere's texture coordinates.  Each place has a part t of the second paint,
K = (1 - t) K_1 + t K_2.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import Shape, SurfacePlaces, SurfaceSamples, SurfaceView
from jaxrender.geometry.texels import sphere_coordinates
from jaxrender.harmonics import coefficient_count, real_basis
from jaxrender.pipelines.config.recipe import RecipeConfig, RecipePaintConfig
from jaxrender.reflection import ForwardModel, ShadowedModel, render_view, render_widths
from jaxrender.shapes import Float

# Blotches of unit variance go from one paint to the other over so many standard deviations.
_CONTRAST = 2.0


class Painted(NamedTuple):
    """K_d and K_s of places, and sigma where it varies."""

    kd: Float[np.ndarray, "place channel"]
    ks: Float[np.ndarray, "place"]
    sigma: Float[np.ndarray, "place"] | None = None


def painted(recipe: RecipeConfig, directions: Float[np.ndarray, "place 3"]) -> Painted:
    """Look the paint of a recipe up in directions (unit vectors) from the middle of the object."""
    first = np.array(recipe.brdf.number("kd"), float), float(recipe.brdf.number("ks")[0])
    if recipe.texture is None:
        part, second = np.zeros(len(directions)), first
    else:
        part = _PATTERNS[recipe.texture.pattern](recipe.texture, directions)
        second = np.array(recipe.texture.kd, float), float(recipe.texture.ks)
    kd = first[0] + part[:, None] * (second[0] - first[0])
    ks = first[1] + part * (second[1] - first[1])
    return Painted(kd, ks, _sigma(recipe, directions))


def _sigma(
    recipe: RecipeConfig, directions: Float[np.ndarray, "place 3"]
) -> Float[np.ndarray, "place"] | None:
    """Go from one roughness at the bottom to another at the top, evenly in its logarithm."""
    if recipe.texture is None or recipe.texture.sigma_above is None:
        return None
    low, high = np.log(recipe.brdf.number("sigma")), np.log(recipe.texture.sigma_above)
    return np.asarray(np.exp(low + (high - low) * (1 + directions[:, 2]) / 2))


def render_painted(
    recipe: RecipeConfig,
    lobe: Parametric,
    view: SurfaceView,
    shape: Shape,
    light: ForwardModel | ShadowedModel,
) -> Float[np.ndarray, "row column channel"]:
    """Render B = K_d(x) D + K_s(x) S (T 6.13) of a painted shape under a light.

    The lobe is the same everywhere, except for a sigma that varies.
    """
    channels = len(recipe.brdf.number("kd"))
    none, full = np.zeros(channels), np.ones(channels)
    specular_lobe = lobe.with_amplitudes(none, full)
    diffuse = render_view(lobe.with_amplitudes(full, none), view, light)
    middle = np.asarray(shape.bounds()).mean(axis=0)
    away = view.points[view.hit] - middle
    paint = painted(recipe, away / np.linalg.norm(away, axis=1, keepdims=True))
    if paint.sigma is None:
        specular = render_view(specular_lobe, view, light)[view.hit]
    else:
        samples = SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])
        places = SurfacePlaces.of_views([view])
        assert isinstance(specular_lobe, Glossy)
        specular = render_widths(specular_lobe, paint.sigma, samples, light, places)
    image = np.zeros_like(diffuse)
    image[view.hit] = paint.kd * diffuse[view.hit] + np.asarray(paint.ks)[:, None] * specular
    return image


def _checker(
    paint: RecipePaintConfig, directions: Float[np.ndarray, "place 3"]
) -> Float[np.ndarray, "place"]:
    u, v = sphere_coordinates(directions).T
    row = np.clip(np.floor((1 - v) * paint.cells), 0, paint.cells - 1)
    column = np.floor((u % 1) * 2 * paint.cells)
    return (row + column) % 2


def _noise(
    paint: RecipePaintConfig, directions: Float[np.ndarray, "place 3"]
) -> Float[np.ndarray, "place"]:
    """Sum random harmonics; by the addition theorem their variance is the same everywhere."""
    count = coefficient_count(paint.cells)
    weights = np.random.default_rng(paint.seed).normal(size=count) * np.sqrt(4 * np.pi / count)
    values = np.asarray(real_basis(jnp.asarray(directions), paint.cells)) @ weights
    return np.clip(0.5 + values / (2 * _CONTRAST), 0, 1)


_PATTERNS = {"checker": _checker, "noise": _noise}
