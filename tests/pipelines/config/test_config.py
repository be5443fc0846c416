"""What a config file may say.

- Every default and every shorthand of the schema; configs are immutable.
- YAML 1.2: 1e-6 is a number, ``no`` and ``off`` are words.
- A config written out in full is read back equal.
"""

import json
import os
import re
from pathlib import Path

import pydantic
import pytest
from config_texts import (
    CAPTURE,
    FULL,
    GOOD,
    RECIPE,
    recipe,
    run_config,
)

from jaxrender.catalogue import LIGHTS
from jaxrender.errors import InputError
from jaxrender.pipelines.config import (
    BrdfConfig,
    CurveConfig,
    NoiseConfig,
    Parameter,
    RecipeConfig,
    RunConfig,
    json_schema,
    load_run_config,
    resolved_yaml,
)

# The numbers of free facets.
FREE_FACETS = (
    *("tail", "wave_2", "wave_3", "wave_4"),
    *("rise_45", "rise_60", "rise_75", "rise_90"),
)
# The numbers of renderers' materials.
LAYERS = (
    *("base_color", "interface", "metallic", "ior", "sheen", "clearcoat", "specular"),
    *("clearcoat_gloss", "specular_roughness", "base_metalness", "specular_ior"),
    *("specular_color", "specular_roughness_anisotropy", "tangent_rotation", "coat_weight"),
    *("coat_color", "coat_roughness", "coat_ior", "fuzz_weight", "fuzz_roughness"),
)


def test_defaults():
    config = run_config(GOOD)
    assert config.task == "brdf"
    assert config.output is None
    assert config.capture.model_dump(exclude={"transforms"}) == {
        "recipe": None,
        "images": None,
        "geometry": {
            "sphere": {"center": (0.0, 0.0, 0.0), "radius": 1.0},
            "mesh": None,
            "scale": 1.0,
            "rotation": (0.0, 0.0, 0.0),
            "translation": (0.0, 0.0, 0.0),
        },
        "camera_axes": "opengl",
        "mirrored": False,
        "response": "linear",
        "invalid": "refuse",
        "saturation": None,
        "saturation_grow": 0,
        "black_level": 0.0,
        "erode": 2,
        "exposure": "given",
        "allow_outside": False,
    }
    assert config.lighting.environment.model_dump(exclude={"path"}) == {
        "convention": "z-up",
        "mirrored": False,
        "yaw": 0.0,
        "scale": 1.0,
        "height": None,
    }
    assert config.lighting.model_dump(exclude={"environment"}) == {
        **{name: () if kind.many else None for name, kind in LIGHTS.items()},
        "per_frame": None,
        "per_frame_irradiance": None,
        "split": "auto",
        "free_scale": False,
    }
    assert config.brdf.model_dump() == {
        "model": "microfacet",
        "compare": (),
        "kd": "free",
        "ks": "free",
        "sigma": "free",
        "roughness": "free",
        "roughness_y": "free",
        "exponent": "free",
        "c_z": 1.0,
        "deviation": 0.5,
        "spacing": 2.0,
        "height": 1.0,
        "ks_broad": "free",
        "spread": "free",
        **dict.fromkeys((*LAYERS, *FREE_FACETS), "free"),
        "mu": "free",
        "ks_per_channel": False,
        "fresnel": "exit",
        "masking": "none",
        "multiple_scattering": "none",
        "table": False,
        "gauge": "per-channel",
    }
    assert config.samples.model_dump() == {"min_cosine": 0.15, "count": 12000, "seed": 0}
    assert config.solve.model_dump() == {
        "band_limit": "auto",
        "model": "dual",
        "view_degree": 4,
        "transfer": "exit-cosine",
        "refine": "exact",
        "refine_samples": 2000,
        "method": "variable-projection",
        "loss": "auto",
        "noise": "estimate",
        "starts": 8,
        "free_exposure": False,
        "most_sources": 48,
        "variants": True,
        "free": (),
        "diagnose": True,
        "held_out": 0.2,
        "interreflection": False,
    }


def test_every_key_is_read():
    config = run_config(FULL)
    assert config.capture.response == CurveConfig(curve=Path("curve.txt").absolute())
    assert config.capture.saturation == 0.98
    assert config.capture.black_level == 1e-6
    assert config.lighting.environment.height == 64
    assert config.lighting.directional[0].irradiance == (1.0, 2.0, 3.0)
    assert config.lighting.split == 0.5
    assert config.brdf.kd == Parameter(fixed=(0.1, 0.2, 0.3))
    assert config.brdf.ks == Parameter(bounds=(0.0, 1.0))
    assert config.brdf.sigma == Parameter(bounds=(0.1, 1.0), start=0.2)
    assert config.brdf.mu == Parameter(fixed=1.5)
    assert config.samples.count == 10000
    assert config.solve.refine_samples == 100
    assert config.solve.noise == NoiseConfig(relative=0.01, floor=0.0)
    assert config.solve.variants is False


LIGHT_TASKS = {
    "task: factorize\n": None,
    "task: factorize\nbrdf: {model: lambertian}\n": None,
    "task: lighting\nbrdf: {model: lambertian, kd: 0.2}\n": None,
    "task: lighting\nbrdf: {model: lambertian}\n": (
        "task lighting needs a known material; fix kd, or choose task: factorize"
    ),
    "task: factorize\nbrdf: {model: lambertian, kd: 0.2}\n": (
        "under unknown light a diffuse object shows only the product of light and kd; "
        "leave kd free, or choose task: lighting"
    ),
    "task: factorize\nbrdf: {ks: 0.1}\n": (
        "under unknown light only the ratio of kd and ks is identifiable; fix both or none"
    ),
    "task: factorize\nbrdf: {sigma: {bounds: [0.3, 0.5], start: 0.4}}\n": None,
    "task: lighting\nbrdf: {kd: 0.1, sigma: 0.1}\n": (
        "task lighting needs a known material; fix ks, mu, or choose task: factorize"
    ),
    "task: lighting\nbrdf: {kd: 0.1, ks: 0.2, sigma: 0.1, mu: none}\n": None,
    "task: factorize\nsolve: {free: [exposure, camera]}\n": None,
    "task: factorize\nsolve: {free: auto}\n": None,
    "task: factorize\nsolve: {free: [lamps, exposure, nearness]}\n": (
        "solve.free: lamps, nearness cannot be freed, because the light is not told but found; "
        "leave it out, or give the light"
    ),
}


@pytest.mark.parametrize("text", LIGHT_TASKS)
def test_tasks_whose_light_is_unknown(text):
    text += "capture: {transforms: a.json, geometry: {sphere: {}}}\n"
    message = LIGHT_TASKS[text.rsplit("capture", 1)[0]]
    if message is None:
        assert run_config(text).task in ("factorize", "lighting")
        return
    with pytest.raises(InputError, match=re.escape(message)):
        run_config(text)


def test_recipe_defaults():
    config = recipe(RECIPE)
    assert config.views.model_dump() == {
        "count": 60,
        "step_degrees": 3.0,
        "start_degrees": 0.0,
        "axis": (0.0, 0.0, 1.0),
        "elevation_degrees": 0.0,
        "distance": 12.0,
        "field_of_view_degrees": 12.0,
        "width": 96,
        "height": 96,
    }
    assert config.noise.model_dump() == {"relative": 0.01, "floor": 0.0}
    assert (config.environment_height, config.seed) == (128, 0)
    assert config.brdf.kd == (0.1, 0.1, 0.1)
    assert config.lighting.directional[0].irradiance == (3.0, 3.0, 3.0)
    ellipsoid = recipe(RECIPE.replace("{sphere: {}}", "{ellipsoid: {radii: [1, 2, 3]}}")).geometry
    assert ellipsoid.ellipsoid.radii == (1.0, 2.0, 3.0)
    assert ellipsoid.ellipsoid.subdivisions == 5


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("free", Parameter()),
        ("0.3", Parameter(fixed=0.3)),
        ("1", Parameter(fixed=1.0)),
        ("[1, 2, 3]", Parameter(fixed=(1.0, 2.0, 3.0))),
        ("{fixed: 0.3}", Parameter(fixed=0.3)),
        ("{fixed: [1, 2, 3]}", Parameter(fixed=(1.0, 2.0, 3.0))),
        ("{bounds: [0.1, 2]}", Parameter(bounds=(0.1, 2.0))),
        ("{start: 0.3}", Parameter(start=0.3)),
        ("{bounds: [0.1, 2], start: 0.3}", Parameter(bounds=(0.1, 2.0), start=0.3)),
    ],
)
def test_parameter_shorthands(text, expected):
    name = "sigma" if "start" in text else "kd"
    parameter = getattr(run_config(GOOD + f"brdf: {{{name}: {text}}}\n").brdf, name)
    assert parameter == expected
    assert parameter.free == (expected.fixed is None)


def test_python_takes_the_same_shorthands():
    config = BrdfConfig.model_validate({"kd": (0.1, 0.2, 0.3), "mu": "none", "sigma": 0.1})
    assert config.kd.fixed == (0.1, 0.2, 0.3)
    assert config.sigma == Parameter(fixed=0.1)
    assert config.mu == "none"


def test_configs_are_immutable_and_hashable():
    config = run_config(FULL)
    with pytest.raises(pydantic.ValidationError, match="frozen"):
        config.samples.count = 3
    assert hash(config) == hash(run_config(FULL))


def test_recipe_needs_neither_geometry_nor_light():
    config = run_config("task: brdf\ncapture: {recipe: teflon.yaml}\n")
    assert config.capture.geometry is None
    assert not config.lighting.given
    assert run_config(GOOD).lighting.given


def test_an_empty_section_counts_as_left_out():
    assert run_config(GOOD + "brdf:\n  # kd: free\nsolve:\n") == run_config(GOOD)


def test_yaml_1_2_scalars():
    config = run_config(GOOD.replace("probe.exr", "no"), "capture.black_level=1e-6", "output=012a")
    assert config.lighting.environment.path.name == "no"
    assert config.capture.black_level == 1e-6
    assert run_config(GOOD, "output=2024-01-01").output.name == "2024-01-01"
    assert run_config(GOOD, "lighting.split=off").lighting.split == "off"


def test_anchors_are_allowed():
    config = run_config(
        CAPTURE + "lighting:\n  directional: [&a {direction: [0, 0, 1], irradiance: 1}, *a]"
    )
    assert config.lighting.directional[0] == config.lighting.directional[1]


@pytest.mark.parametrize("text", [GOOD, FULL, "task: brdf\ncapture: {recipe: 'a: b.yaml'}\n"])
def test_a_run_config_written_out_is_read_back_equal(text):
    config = run_config(text)
    again = resolved_yaml(config)
    (Path("elsewhere")).mkdir()
    Path("elsewhere/again.yaml").write_text(again)
    assert load_run_config("elsewhere/again.yaml") == config
    assert resolved_yaml(load_run_config("elsewhere/again.yaml")) == again


def test_a_recipe_written_out_is_read_back_equal():
    config = recipe(RECIPE + "  area: [{direction: [1, 0, 0], width_degrees: 9, radiance: 1e-7}]\n")
    assert recipe(resolved_yaml(config)) == config


def test_defaults_are_written_out():
    text = resolved_yaml(run_config(GOOD))
    assert "min_cosine: 0.15" in text
    assert "center: [0.0, 0.0, 0.0]" in text
    assert f"transforms: {os.getcwd()}/photos/transforms.json" in text


@pytest.mark.parametrize("root", [RunConfig, RecipeConfig])
def test_schema_names_every_key_with_a_description(root):
    schema = json.loads(json.dumps(json_schema(root)))
    assert schema["additionalProperties"] is False
    assert list(schema["properties"]) == list(root.model_fields)
    for name, section in {"root": schema, **schema["$defs"]}.items():
        for key, entry in section.get("properties", {}).items():
            assert entry.get("description"), (name, key)


def test_schema_knows_the_shorthands():
    schema = json_schema()
    forms = schema["$defs"]["Parameter"]["anyOf"]
    assert {"const": "free"} in forms
    assert {"type": "number"} in forms
    irradiance = schema["$defs"]["DirectionalConfig"]["properties"]["irradiance"]
    assert {entry["type"] for entry in irradiance["anyOf"]} == {"number", "array"}
