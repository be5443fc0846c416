"""What is said back of a recipe that is wrong.

- Each message in full: file, line, column, key, value found, what is accepted.
- A recipe states its whole truth, and nothing that its model has not.
"""

from pathlib import Path

import pytest
from config_texts import RECIPE, message, recipe

RECIPES = {
    ("geometry: {sphere: {}}", "geometry: {}"): (
        "bad.yaml:1:1: geometry: found none; give exactly one of sphere, mesh, ellipsoid, sculpture"
    ),
    ("geometry: {sphere: {}}", "geometry: {ellipsoid: {radii: [1, 2, 0]}}"): (
        "bad.yaml:1:31: geometry.ellipsoid.radii: found [1, 2, 0], accepted: three numbers above 0"
    ),
    (", ks: 0.2, sigma: 0.1", ""): (
        "bad.yaml:2:1: brdf: a microfacet recipe states its whole truth; missing: ks, sigma"
    ),
    ("kd: 0.1, ", ""): (
        "bad.yaml:2:1: brdf: a microfacet recipe states its whole truth; missing: kd"
    ),
    ("mu: 1.5", "mu: 1"): "bad.yaml:2:42: brdf.mu: found 1, accepted: 'none' or a number above 1",
    ("kd: 0.1, ks: 0.2", "model: ggx, kd: 0.1"): (
        "bad.yaml:2:1: brdf: a ggx recipe states its whole truth; missing: ks"
    ),
    ("sigma: 0.1", "model: beckmann, sigma: 1.1"): (
        "bad.yaml:2:1: brdf: found sigma 1.1 with model beckmann, where it is above 0 and at most "
        "1; give another, or choose another model"
    ),
    ("kd: 0.1, ks: 0.2", "model: lambertian, kd: 0.1, ks: 0.2"): (
        "bad.yaml:2:40: brdf.ks: found 0.2, but model lambertian (kd) has no ks; remove it, or "
        "choose another model\n"
        "bad.yaml:2:52: brdf.sigma: found 0.1, but model lambertian (kd) has no sigma; remove it, "
        "or choose another model\n"
        "bad.yaml:2:61: brdf.mu: found 1.5, but model lambertian (kd) has no mu; remove it, or "
        "choose another model"
    ),
    ("kd: 0.1, ks: 0.2, sigma: 0.1, mu: 1.5", "file: paint.brdf, sigma: 0.1"): (
        "bad.yaml:2:33: brdf.sigma: found 0.1, but a material from a file brings its own values; "
        "remove it, or remove brdf.file"
    ),
    (
        "{kd: 0.1, ks: 0.2, sigma: 0.1, mu: 1.5}",
        "{file: paint.brdf}\ntexture: {kd: 0.1, ks: 0.1}",
    ): (
        "bad.yaml:3:1: texture: found {kd: 0.1, ks: 0.1}, but a material from a file "
        "has no kd and ks for paint to mix; remove it, or remove brdf.file"
    ),
    ("directional: [{direction: [0, 0, 1], irradiance: 3}]", "area: []"): (
        "bad.yaml:3:1: lighting: no light given; "
        "give at least one of environment, directional, point, area, "
        "overcast_sky, clear_sky, harmonic"
    ),
    (
        "directional: [{direction: [0, 0, 1], irradiance: 3}]",
        "area: [{direction: [0, 0, 1], width_degrees: 0, radiance: 1}]",
    ): (
        "bad.yaml:4:48: lighting.area[0].width_degrees: found 0, "
        "accepted: an angle in degrees above 0 and up to 180"
    ),
    ("geometry: {sphere: {}}", "geometry: {sphere: {}}\nviews: {field_of_view_degrees: 180}"): (
        "bad.yaml:2:32: views.field_of_view_degrees: found 180, "
        "accepted: an angle in degrees between 0 and 180"
    ),
    ("geometry: {sphere: {}}", "geometry: {sphere: {}}\nviews: {elevation_degrees: 91}"): (
        "bad.yaml:2:28: views.elevation_degrees: found 91, "
        "accepted: an angle in degrees from -90 to 90"
    ),
}


@pytest.mark.parametrize(("old", "new"), RECIPES)
def test_wrong_recipes(old, new):
    assert old in RECIPE
    assert message(RECIPE.replace(old, new), load=recipe) == RECIPES[old, new]


def test_a_recipe_of_a_file_states_nothing_else():
    """Its path is taken from the recipe's folder, and no number of a model is written out."""
    found = recipe(RECIPE.replace("kd: 0.1, ks: 0.2, sigma: 0.1, mu: 1.5", "file: paint.brdf"))
    assert found.brdf.file == Path("paint.brdf").resolve()
    assert found.written_out()["brdf"] == {"file": str(found.brdf.file)}
