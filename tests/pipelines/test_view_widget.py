"""The object as a widget of a notebook, without a browser.

- Its traits begin at the fit; what cannot be shown is refused, and the chosen material comes back.
- Its module is the page's own scripts, and names no address.
- In Node the module's own reader gives every array of the scene as it was, byte for byte.
- An estimate is shown on any shape and in other lights; the missing extra is named.
"""

import base64
import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from small_captures import moving_light
from view_pages import BRDF, SUMMARY, egg, light, shown

import jaxrender as jr
from jaxrender.errors import InputError
from jaxrender.geometry import Sphere
from jaxrender.inverse import Estimate
from jaxrender.inverse.outcomes import Outcome
from jaxrender.pipelines.view.layout import Facts
from jaxrender.pipelines.view.light import page_light_of
from jaxrender.pipelines.view.page import module_text, script_text
from jaxrender.pipelines.view.widget import Viewer

NODE = shutil.which("node")
SHARED = ("class Viewer", "class Renderer", "class Material", "function dragged", "function opened")


def widget(shape=None, brdf=BRDF) -> Viewer:
    return Viewer(shown(shape, brdf), Facts("a <b>ball</b>", "", SUMMARY, False, None))


@pytest.fixture
def ball():
    return widget()


# ---------------------------------------------------------------- traits


def test_traits_begin_at_the_fit(ball):
    np.testing.assert_allclose(ball.base, BRDF["kd"], rtol=1e-6)
    np.testing.assert_allclose(ball.lobe, BRDF["ks"], rtol=1e-6)
    assert ball.roughness == pytest.approx(BRDF["sigma"])
    assert (ball.light, ball.shown, ball.lamp, ball.stops) == ("result", "picture", None, 0)
    assert (ball.azimuth, ball.elevation) == pytest.approx((40, 20))
    state = ball.get_state()
    for name in ("base", "roughness", "lamp", "coefficients", "turn", "zoom"):
        json.dumps(state[name])


def test_what_was_chosen_is_a_material(ball):
    ball.base, ball.lobe, ball.roughness = np.array([0.3, 0.2, 0.1]), [0.05, 0.06, 0.07], 0.1
    chosen = ball.brdf
    np.testing.assert_allclose(chosen.kd, [0.3, 0.2, 0.1])
    np.testing.assert_allclose(chosen.ks, [0.05, 0.06, 0.07])
    assert float(chosen.sigma) == pytest.approx(0.1)
    assert float(chosen.mu) == pytest.approx(BRDF["mu"])


def test_what_cannot_be_shown_is_refused(ball):
    ball.turn = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    before = ball.get_state()
    for name, value, remedy in (
        ("roughness", 9, "a number from 0.05 to 0.8"),
        ("roughness", None, "a number"),
        ("base", [1, 2], r"an array of shape \(3,\)"),
        ("base", [1, 2, -1], "from 0"),
        ("lobe", [1, np.nan, 1], "all finite"),
        ("coefficients", np.zeros((4, 3)), r"shape \(9, 3\)"),
        ("lamp", "bright", r"shape \(3,\)"),
        ("lamp", [0, 0, -1], "a strength, the third number, from 0"),
        ("zoom", 100, "from 0.3 to 8"),
        ("light", "moon", "choose one of result, harmonics, uniform, dark"),
        ("shown", "kd", "choose one of picture"),
        ("turn", np.ones((3, 3)), "matrix of a rotation"),
        ("turn", -np.eye(3), "matrix of a rotation"),
    ):
        with pytest.raises(ValueError, match=rf"(?s){name}=.*{remedy}"):
            setattr(ball, name, value)
    assert ball.get_state() == before


def test_a_material_without_a_width_has_no_roughness():
    matt = widget(brdf={"model": "lambertian", "kd": [0.2, 0.3, 0.4]})
    assert matt.roughness is None
    with pytest.raises(ValueError, match="has no roughness"):
        matt.roughness = 0.2
    matt.base = [0.1, 0.1, 0.1]
    np.testing.assert_allclose(matt.brdf.amplitudes[0], np.full(3, 0.1))


# ---------------------------------------------------------------- the module


def test_the_module_is_the_pages_own_scripts():
    module, script = module_text(), script_text()
    for name in SHARED:
        assert module.count(name) == script.count(name) == 1
    start = module.index("// Arrays out of text")
    shared = module[start : module.index("// The object in a notebook")].strip()
    assert shared in script
    assert "function start" not in module


def test_the_module_names_no_address(ball):
    words = ("http:", "https:", "fetch(", "XMLHttpRequest", "import(", "eval(", "WebSocket")
    for text in (module_text(), ball._markup):
        assert not [word for word in (*words, "innerHTML", "url(") if word in text]
    assert not re.search(r"^\s*(import|export .* from)\b", module_text(), re.M)
    assert "a &lt;b&gt;ball&lt;/b&gt;" in ball._markup


@pytest.mark.skipif(NODE is None, reason="no Node is installed")
def test_arrays_arrive_byte_for_byte(tmp_path):
    scene = widget(egg())._scene
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    module = tmp_path / "module.mjs"
    module.write_text(
        module_text()
        + """
import { readFileSync } from "node:fs";
const found = {};
const walk = (value, path) => {
  if (value === null || typeof value !== "object") return;
  if (!value.kind || !value.data)
    return Object.entries(value).forEach(([key, own]) => walk(own, [...path, key]));
  const numbers = unpacked(value);
  found[path.join(".")] = value.kind === "float16" ? Array.from(numbers)
    : Buffer.from(numbers.buffer).toString("base64");
};
walk(JSON.parse(readFileSync(process.argv[2])), []);
console.log(JSON.stringify(found));
"""
    )
    command = [str(NODE), str(module), str(tmp_path / "scene.json")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    arrays = {}

    def walk(value, path):
        for key, own in value.items() if isinstance(value, dict) else ():
            if isinstance(own, dict) and "data" in own:
                arrays[".".join([*path, key])] = own
            walk(own, [*path, key])

    walk(scene, [])
    assert len(arrays) >= 10
    assert set(found) == set(arrays)
    for name, stored in arrays.items():
        raw = base64.b64decode(stored["data"])
        if stored["kind"] == "float16":
            np.testing.assert_array_equal(found[name], np.frombuffer(raw, "<f2").astype(float))
        else:
            assert base64.b64decode(found[name]) == raw


# ---------------------------------------------------------------- what is shown


def estimate() -> Estimate:
    """What a fit would return."""
    what, known = shown(), light()
    values = {
        "model": "ggx",
        "material": what.brdf,
        "light": known.environment + known.directional,
        "values": {"sigma": np.array(0.2)},
        "interval90": {"sigma": np.array([0.19, 0.22])},
        "outcome": Outcome.CONVERGED,
    }
    return tuple.__new__(Estimate, (dict.fromkeys(Estimate._fields) | values).values())


def test_an_estimate_is_shown_on_any_shape_and_in_other_lights():
    found = jr.view(estimate(), egg(), {"sky": jr.OvercastSky(np.full(3, 0.5))})
    assert found._scene["surface"]["kind"] == "mesh"
    assert found.lights == ("result", "sky", "harmonics", "uniform", "dark")
    found.light = "sky"
    assert 'value="sky"' in found._markup
    (slider,) = (one for one in found._scene["sliders"] if one["part"] == "width")
    assert tuple(slider["band"]) == (0.19, 0.22)
    np.testing.assert_allclose(found.base, BRDF["kd"], rtol=1e-6)
    for name in ("result", "dark", ""):
        with pytest.raises(ValueError, match="choose another name"):
            jr.view(estimate(), lights={name: jr.OvercastSky(np.full(3, 0.5))})


def test_a_dark_light_is_shown_by_a_source():
    dark = estimate()._replace(light=jr.DirectionalSources(np.eye(3)[:1], np.zeros((1, 3))))
    assert np.sum(jr.view(dark).coefficients) != 0


def test_light_that_rings_is_shown_nowhere_negative():
    coefficients = np.zeros((9, 3))
    coefficients[0], coefficients[6] = 1.0, 0.9
    found = page_light_of(jr.HarmonicLight(coefficients), Sphere(), 0.3)
    assert np.min(np.asarray(found.nodes.irradiance)) >= 0
    np.testing.assert_allclose(found.coefficients[0], coefficients[0], rtol=0.03)


def test_a_finished_result_is_shown(tmp_path_factory):
    folder = moving_light(tmp_path_factory) / "out"
    found = jr.view(folder)
    summary = json.loads((folder / "result.json").read_text())
    np.testing.assert_allclose(found.base, summary["brdf"]["kd"], rtol=1e-5)
    assert found._scene["photographs"] == []
    with pytest.raises(ValueError, match="leave the shape out"):
        jr.view(folder, Sphere())
    with pytest.raises(InputError, match="holds no finished result"):
        jr.view(folder.parent)


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    monkeypatch.delitem(sys.modules, "jaxrender.pipelines.view.widget")
    monkeypatch.delattr("jaxrender.pipelines.view.widget")
    with pytest.raises(InputError, match=r"anywidget: pip install 'jaxrender\[notebook\]'"):
        jr.view(estimate())
