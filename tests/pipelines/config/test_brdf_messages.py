"""What is said back of a material that is wrong, and what its model's name says.

- Numbers, bounds, starts and priors that contradict each other, or the model, are named by key.
- A model of physics has the Fresnel term and the masking that are its own, unless others are said.
"""

from pathlib import Path

import pytest
from config_texts import GOOD, RECIPE, brdf_message, recipe, run_config

from jaxrender.pipelines.config import load_run_config, resolved_yaml

MATERIALS = {
    "{kd: -1}": "brdf.kd: found -1; every value here must be at least 0",
    "{ks: {bounds: [-1, 1]}}": "brdf.ks: found -1; every value here must be at least 0",
    "{kd: {start: [1, 1, -2]}}": "brdf.kd: found -2; every value here must be at least 0",
    "{sigma: 0}": "brdf.sigma: found 0; every value here must be above 0",
    "{sigma: {bounds: [0, 1]}}": "brdf.sigma: found 0; every value here must be above 0",
    "{mu: 1}": "brdf.mu: found 1; every value here must be above 1",
    "{mu: {bounds: [1, 2]}}": "brdf.mu: found 1; every value here must be above 1",
    "{mu: {start: 0.5}}": "brdf.mu: found 0.5; every value here must be above 1",
    "{mu: [2, 2, 2]}": (
        "brdf.mu: found fixed [2, 2, 2]; this parameter is one number for all channels"
    ),
    "{sigma: {start: [2, 2, 2]}}": (
        "brdf.sigma: found start [2, 2, 2]; this parameter is one number for all channels"
    ),
    "{kd: {fixed: 1, bounds: [0, 2]}}": (
        "brdf.kd: a fixed value needs no bounds, no start and no prior; remove them, or 'fixed'"
    ),
    "{kd: {fixed: 1, start: 1}}": (
        "brdf.kd: a fixed value needs no bounds, no start and no prior; remove them, or 'fixed'"
    ),
    "{kd: {fixed: 1, prior: [1, 0.1]}}": (
        "brdf.kd: a fixed value needs no bounds, no start and no prior; remove them, or 'fixed'"
    ),
    "{kd: {prior: [1, 0]}}": "brdf.kd: prior standard deviation 0; it must be above 0",
    "{sigma: {bounds: [0.1, 0.2], prior: [0.3, 0.1]}}": (
        "brdf.sigma: prior mean 0.3 lies outside the bounds [0.1, 0.2]"
    ),
    "{kd: {bounds: [2, 1]}}": ("brdf.kd: found bounds [2, 1]; the first must be the smaller one"),
    "{kd: {bounds: [1, 1]}}": ("brdf.kd: found bounds [1, 1]; the first must be the smaller one"),
    "{kd: {bounds: [1, 2], start: 3}}": "brdf.kd: start 3 lies outside the bounds [1, 2]",
    "{ks: [1, 2, 3]}": (
        "brdf: ks has three values; add 'ks_per_channel: true', or give one number"
    ),
    "{model: ggx, sigma: {bounds: [0.1, 2]}}": (
        "brdf: found sigma 2 with model ggx, where it is above 0 and at most 1; "
        "give another, or choose another model"
    ),
    "{model: lambertian, ks: 1}": (
        "brdf.ks: found 1, but model lambertian (kd) has no ks; remove it, or choose another model"
    ),
}


@pytest.mark.parametrize("entries", MATERIALS)
def test_materials_that_contradict_themselves(entries):
    assert brdf_message(entries) == MATERIALS[entries]


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        ("model: microfacet", ("exit", "none")),
        ("model: ggx", ("half", "smith")),
        ("model: beckmann", ("half", "smith")),
        ("model: ggx, masking: none", ("half", "none")),
        ("fresnel: exit, model: ggx", ("exit", "smith")),
    ],
)
def test_models_of_physics_have_their_own_defaults(entries, expected):
    config = run_config(GOOD + f"brdf: {{{entries}}}\n")
    stated = recipe(RECIPE.replace("mu: 1.5", f"mu: 1.5, {entries}"))
    for brdf in (config.brdf, stated.brdf):
        assert (brdf.fresnel, brdf.masking) == expected
    again = resolved_yaml(config)
    Path("again.yaml").write_text(again)
    assert load_run_config("again.yaml") == config


def test_a_model_named_on_the_command_line_has_its_defaults_too():
    brdf = run_config(GOOD, "brdf.model=ggx").brdf
    assert (brdf.model, brdf.fresnel, brdf.masking) == ("ggx", "half", "smith")


def test_a_lambertian_needs_no_more_than_kd():
    assert run_config(GOOD + "brdf: {model: lambertian, kd: 0.2}\n").brdf.kd.fixed == 0.2
