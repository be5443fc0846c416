"""The page of a result, without a browser.

- It names no address, its policy allows its own script and style by their digests and nothing
  else, and what comes from outside is escaped.
- A page is reused, refused or replaced as other outputs are; results that no page can show, and
  those of other versions, are named.
"""

import base64
import hashlib
import json
import math
import re
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest
from small_captures import jaxrender, moving_light
from view_pages import BRDF, MATERIALS, SUMMARY, page, scene_of, shown

from jaxrender.brdf import material_named
from jaxrender.errors import InputError
from jaxrender.pipelines.view import view_result
from jaxrender.pipelines.view.material_table import material_table
from jaxrender.pipelines.view.page import SHADERS, script_text
from jaxrender.pipelines.view.shown import seen_from
from jaxrender.pipelines.view.sliders import sliders_of


class Elements(HTMLParser):
    """The elements of a page with their attributes, and the text of each script and style."""

    def __init__(self, text: str):
        super().__init__()
        self.found: list[tuple[str, dict]] = []
        self.texts: dict[int, str] = {}
        self.within = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        self.within = True

    def handle_endtag(self, tag):
        self.within = False

    def handle_data(self, data):
        at = len(self.found) - 1
        if self.within:
            self.texts[at] = self.texts.get(at, "") + data

    def named(self, tag: str) -> list[tuple[dict, str]]:
        return [
            (attributes, self.texts.get(at, ""))
            for at, (name, attributes) in enumerate(self.found)
            if name == tag
        ]


@pytest.fixture(scope="module")
def ball():
    what = shown()
    return what, page(what)


# ---------------------------------------------------------------- the page as a document


def test_a_page_names_no_address(ball):
    elements = Elements(ball[1])
    for tag, attributes in elements.found:
        for name in ("src", "href", "action", "srcset", "data", "poster"):
            assert attributes.get(name, "data:").startswith("data:"), (tag, attributes)
        # The policy would refuse them: a page that relied on them would be broken.
        assert "style" not in attributes
        assert not [name for name in attributes if name.startswith("on")]
    assert not re.search(r"https?://(?!www\.w3\.org)", ball[1])
    script = script_text()
    for word in ("fetch(", "XMLHttpRequest", "import(", "eval(", "WebSocket", "innerHTML"):
        assert word not in script


def test_the_policy_allows_the_pages_own_script_and_style_alone(ball):
    elements = Elements(ball[1])
    (policy,) = (
        attributes["content"]
        for attributes, _ in elements.named("meta")
        if attributes.get("http-equiv") == "Content-Security-Policy"
    )
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
    assert rules["img-src"] == "data:"
    executed = [text for attributes, text in elements.named("script") if "type" not in attributes]
    for rule, texts in (
        ("script-src", executed),
        ("style-src", [text for _, text in elements.named("style")]),
    ):
        (text,) = texts
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert rules[rule] == f"'sha256-{digest}'"
    assert {attributes.get("id") for attributes, _ in elements.named("script")} >= {
        f"shader-{name}" for name in SHADERS
    }


def test_names_are_escaped(ball):
    text = page(ball[0], title='</script><b onclick="x">"&')
    elements = Elements(text)
    assert not [attributes for tag, attributes in elements.found if tag == "b" and attributes]
    assert elements.named("h1")[0][1] == '</script><b onclick="x">"&'


def test_every_control_has_a_label(ball):
    elements = Elements(ball[1])
    labelled = {attributes.get("for") for attributes, _ in elements.named("label")}
    for attributes, _ in elements.named("input"):
        # A button to choose one of several stands inside its label.
        assert attributes["type"] in ("radio", "checkbox") or attributes["id"] in labelled
    for attributes, _ in elements.named("canvas"):
        assert attributes["aria-label"]
    assert all("alt" in attributes for attributes, _ in elements.named("img"))


def test_sliders_carry_values_and_bands(ball):
    what, _ = ball
    sliders = {one.id: one for one in sliders_of(what.brdf, what.table, SUMMARY)}
    assert sliders["base-1"].value == pytest.approx(BRDF["kd"][1])
    assert sliders["base-1"].band == (0.11, 0.13)
    assert sliders["lobe-0"].channels == (0, 1, 2)
    assert sliders["lobe-0"].band == (0.09, 0.11)
    # No interval is stated for it.
    assert sliders["width"].band is None
    assert sliders["width"].lowest < BRDF["sigma"] < sliders["width"].highest


def test_a_width_by_another_name_goes_back_and_forth():
    material = material_named("phong", MATERIALS["phong"])
    table = material_table(material, float(material.width))
    (slider,) = (one for one in sliders_of(material, table, {}) if one.part == "width")
    assert slider.value == pytest.approx(50)
    width = (slider.value / slider.scale) ** (1 / slider.power)
    assert width == pytest.approx(float(material.width))


# ---------------------------------------------------------------- the command


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    return moving_light(tmp_path_factory)


@pytest.fixture
def copied(finished, tmp_path):
    """The finished result, to be spoilt."""
    return shutil.copytree(finished / "out", tmp_path / "out")


def test_a_result_becomes_a_page(finished, tmp_path, capsys):
    out = tmp_path / "page.html"
    assert jaxrender("view", finished / "out", "--out", out) == 0
    text = out.read_text()
    scene = scene_of(text)
    assert len(scene["photographs"]) == 4
    assert all(one["deviation"] for one in scene["photographs"])
    assert "light differs between photographs" in capsys.readouterr().err
    before = out.stat().st_mtime_ns
    assert jaxrender("view", finished / "out", "--out", out) == 0
    assert out.stat().st_mtime_ns == before
    assert "reused" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [out]


def test_what_is_in_the_way_is_kept(finished, tmp_path):
    other = tmp_path / "other.html"
    other.write_text("mine")
    for force in (False, True):
        with pytest.raises(InputError, match="no page of jaxrender view"):
            view_result(finished / "out", other, force)
    assert other.read_text() == "mine"
    other.write_text(f'<meta name="jaxrender-view" content="{"1" * 64}">')
    with pytest.raises(InputError, match="--force"):
        view_result(finished / "out", other)
    with pytest.raises(InputError, match="folder is in the way"):
        view_result(finished / "out", tmp_path)
    with pytest.raises(InputError, match="make it first"):
        view_result(finished / "out", tmp_path / "none" / "page.html")


def test_results_that_no_page_can_show(copied, tmp_path):
    with pytest.raises(InputError, match="holds no finished result"):
        view_result(tmp_path)
    path = copied / "result.json"
    document = json.loads(path.read_text())
    del document["brdf"]["sigma"]
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"does not state what this version reads .*fit again"):
        view_result(copied)
    del document["brdf"]
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="holds no material"):
        view_result(copied)
    config = copied / "config.yaml"
    config.write_text(config.read_text().replace("task: brdf", "task: brdf\nolder: 1"))
    with pytest.raises(InputError, match="older"):
        view_result(copied)
    assert not (copied / "view.html").exists()


def test_angles_of_the_page_are_those_of_a_camera(ball):
    view = seen_from(ball[0], math.radians(90), 0.0, 9)
    np.testing.assert_allclose(view.outgoing[4, 4], [0, 1, 0], atol=1e-12)
    # The world's x is to the left when one looks along -y.
    assert view.normals[4, 1, 0] > 0.5
