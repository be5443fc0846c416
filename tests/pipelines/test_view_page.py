"""The page of a result, without a browser.

- It names no address, its policy allows its own script and style by their digests and nothing
  else, and what comes from outside is escaped.
- Its data are the arrays that it was made from, to the rounding of their kinds.
- The material's table, interpolated and summed over the light as the shader does it, is the exact
  integral to 2 of 255.
- A page is reused, refused or replaced as other outputs are; results that no page can show, and
  those of other versions, are named.
"""

import base64
import hashlib
import itertools
import json
import math
import re
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest
from small_captures import jaxrender, moving_light
from view_pages import BRDF, SUMMARY, egg, light, page, scene_of, shown

from jaxrender.brdf import AnisotropicWard, material_named
from jaxrender.errors import InputError
from jaxrender.geometry import Mesh
from jaxrender.imaging.display import exposed, exposure_for
from jaxrender.lighting import LightNodes
from jaxrender.pipelines.view import view_result
from jaxrender.pipelines.view.light import gathered, page_light
from jaxrender.pipelines.view.material_table import interpolated, material_table
from jaxrender.pipelines.view.packing import from_octahedral, octahedral, packed, unpacked
from jaxrender.pipelines.view.page import SHADERS, script_text
from jaxrender.pipelines.view.sliders import sliders_of
from jaxrender.pipelines.view.surface import surface_document
from jaxrender.pipelines.view.view import rendered, seen_from

# 16 bits of a direction folded onto a square; 11 bits of a half float.
DIRECTION, HALF = 1e-4, 2.0**-11
MATERIALS = {
    "microfacet": {"kd": [0.2] * 3, "ks": 0.1, "sigma": 0.12, "mu": 1.8},
    "ggx": {"kd": [0.2] * 3, "ks": 0.1, "sigma": 0.05, "mu": 1.5},
    "ward": {"kd": [0.2] * 3, "ks": 0.1, "roughness": 0.1},
    "phong": {"kd": [0.2] * 3, "ks": 0.1, "exponent": 50.0},
    "oren-nayar": {"kd": [0.2] * 3, "sigma": 0.3},
    "lambertian": {"kd": [0.2] * 3},
}


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


# ---------------------------------------------------------------- the data


def test_arrays_come_back():
    for kind in ("uint8", "int16", "uint32", "float16", "float32"):
        array = np.arange(12).reshape(3, 4).astype(kind)
        again = unpacked(json.loads(json.dumps(packed(array))))
        assert again.dtype == array.dtype
        np.testing.assert_array_equal(again, array)
    with pytest.raises(ValueError, match="float64"):
        packed(np.zeros(3))


def test_directions_come_back():
    directions = np.random.default_rng(0).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = np.concatenate([directions, np.eye(3), -np.eye(3)])
    np.testing.assert_allclose(from_octahedral(octahedral(directions)), directions, atol=DIRECTION)


def test_the_light_of_a_page_is_the_light(ball):
    what, text = ball
    stored = scene_of(text)["light"]
    for name in ("fine", "cells", "sources"):
        own: LightNodes = getattr(what.light, name)
        directions = from_octahedral(unpacked(stored[name]["directions"]))
        np.testing.assert_allclose(directions, own.directions, atol=DIRECTION)
        found = unpacked(stored[name]["irradiance"]).astype(float) * stored[name]["scale"]
        np.testing.assert_allclose(found, own.irradiance, rtol=HALF, atol=1e-6)
    np.testing.assert_array_equal(unpacked(stored["first"]), what.light.first)


def test_a_light_keeps_its_energy_and_its_sources():
    known = light()
    found = page_light(known, 0.2)
    assert known.environment is not None
    energy = [
        np.asarray(part.nodes().irradiance).sum(axis=0)
        for part in (known.environment, known.directional)
    ]
    np.testing.assert_allclose(np.sum(found.nodes.irradiance, axis=0), sum(energy), rtol=1e-12)
    np.testing.assert_allclose(np.sum(found.cells.irradiance, axis=0), energy[0], rtol=1e-12)
    np.testing.assert_allclose(np.sum(found.sources.irradiance, axis=0), energy[1], rtol=1e-12)
    # Y_00 is 1 / sqrt(4 pi).
    mean = sum(energy) / np.sqrt(4 * np.pi)
    np.testing.assert_allclose(found.coefficients[0], mean, rtol=1e-6)


def test_nodes_lie_in_their_cells():
    random = np.random.default_rng(3)
    directions = random.normal(size=(900, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    fine, cells, first = gathered(LightNodes(directions, random.uniform(size=(900, 3))))
    assert (first[0], first[-1]) == (0, 900)
    for k, (start, end) in enumerate(itertools.pairwise(first)):
        own = np.asarray(fine.directions)[start:end]
        # The shader takes this for granted.
        assert (own @ np.asarray(cells.directions)[k] > np.cos(0.3)).all()
        total = np.asarray(fine.irradiance)[start:end].sum(axis=0)
        np.testing.assert_allclose(np.asarray(cells.irradiance)[k], total)


def test_a_mesh_comes_back():
    mesh = egg()
    stored = surface_document(mesh)
    positions = unpacked(stored["positions"]) / 65535 * stored["size"] + stored["lower"]
    faces = unpacked(stored["faces"])
    assert faces.dtype == np.uint16
    np.testing.assert_allclose(positions[faces], mesh.vertices[mesh.faces], atol=2e-5)
    normals = from_octahedral(unpacked(stored["normals"]))
    np.testing.assert_allclose(normals[faces], mesh.normals[mesh.faces], atol=DIRECTION)
    assert stored["radius"] == pytest.approx(1.0, abs=1e-3)


def test_a_page_of_20_000_triangles_is_small():
    assert len(page(shown(Mesh.ellipsoid(np.array([1.0, 0.8, 0.6]), 5)))) < 6e6


# ---------------------------------------------------------------- the material


@pytest.mark.parametrize("model", MATERIALS)
def test_a_table_is_its_material(model):
    material = material_named(model, MATERIALS[model])
    assert material_table(material, float(material.width)).error < 0.01


def test_an_anisotropic_material_is_refused():
    brushed = AnisotropicWard(np.full(3, 0.2), np.full(3, 0.1), 0.1, 0.3)
    with pytest.raises(InputError, match="turns about its normal"):
        material_table(brushed, 0.1)


def test_the_shaders_sum_is_the_exact_integral(ball):
    """What ``reflected`` in table.glsl does, for every node and every pixel."""
    what, _ = ball
    view = seen_from(what, 0.7, 0.3, 24)
    exact = rendered(what, view)
    normals, outgoing = view.normals[view.hit], view.outgoing[view.hit]
    directions, irradiance = (np.asarray(part, float) for part in what.light.nodes)
    table = what.table
    incoming = normals @ directions.T
    exit_cosine = np.einsum("pi,pi->p", normals, outgoing)[:, None]
    difference = np.sqrt((1 + outgoing @ directions.T) / 2)
    half = np.minimum((incoming + exit_cosine) / (2 * difference), 1)
    sines = np.sqrt(np.maximum((1 - half**2) * (1 - difference**2), 1e-14))
    turned = np.clip((incoming - difference * half) / sines, -1, 1)
    lit = incoming > 0
    values = np.zeros((*incoming.shape, 4))
    values[lit] = interpolated(
        table.logarithms[table.fitted],
        float(table.widths[table.fitted]),
        np.arccos(half[lit]),
        difference[lit],
        turned[lit],
    )
    factor = np.broadcast_to(exit_cosine, incoming.shape) * 4 if table.weighted else 1 / incoming
    lobe = values[..., :3] / factor[..., None]
    base = (values[..., 3] * incoming)[..., None]
    columns = table.base * base + table.lobe * lobe
    found = np.zeros_like(exact)
    found[view.hit] = np.einsum("pnc,nc->pc", np.where(lit[..., None], columns, 0), irradiance)
    exposure = exposure_for(exact[view.hit])
    off = exposed(found, exposure).astype(int) - exposed(exact, exposure)
    assert np.abs(off).max() <= 2


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
