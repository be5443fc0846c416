"""Recipes that cannot be rendered: no camera sees the object, the light is zero, a file is missing.

The message names the file and the key.
"""

import json
import re

import pytest
from small_captures import write_json
from spoilt_captures import refused, working_directory

RECIPE = {
    "geometry": {"sphere": {}},
    "brdf": {"kd": 0.1, "ks": 0.1, "sigma": 0.2, "mu": 1.5},
    "lighting": {"directional": [{"direction": [0, 0, 1], "irradiance": 1}]},
    "views": {"count": 2, "width": 8, "height": 8},
}
AREA = {"direction": [0, 0, 1], "width_degrees": 20, "radiance": 0}


@pytest.fixture
def work(tmp_path, monkeypatch):
    return working_directory(tmp_path, monkeypatch)


@pytest.mark.parametrize(
    ("section", "value", "message"),
    [
        ("views", {"elevation_degrees": 90}, r"r\.json: views\.elevation_degrees 90: "),
        ("views", {"distance": 0.5}, r"r\.json: views: no camera sees the object; change distance"),
        ("lighting", {"directional": [], "area": [AREA]}, r"r\.json: lighting: the light is zero;"),
        ("lighting", {"environment": {"path": "e.exr"}}, r"work/e\.exr: no such image file; mend"),
        ("geometry", {"sphere": None, "mesh": "m.ply"}, r"work/m\.ply: no such mesh file; mend"),
        ("brdf", {"sigma": -0.1}, r"r\.json:\d+:\d+: brdf\.sigma: found -0\.1, accepted: a number"),
    ],
)
def test_recipes_that_cannot_be_rendered(work, capsys, section, value, message):
    recipe = json.loads(json.dumps(RECIPE))
    recipe[section] |= value
    # JSON is YAML.
    write_json(work / "r.json", {k: v for k, v in recipe.items() if v is not None})
    said = refused(work, capsys, ["synth", "r.json", "--out", "capture"])
    assert re.search(message, said), said
