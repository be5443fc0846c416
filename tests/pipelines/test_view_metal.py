"""The page of maps of metal: base colour, metalness and roughness of every texel.

- The maps are those of the result, to the steps of 8 bits, with false colours and their errors.
- The table's parts, mixed as the shader mixes them, are glTF's material at any share of metal.
- A texture of vertices is laid out in texels.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from stated_textures import metal_maps, texel_places, write_metal_result
from view_pages import scene_of

from jaxrender.brdf import MetallicRoughness
from jaxrender.geometry import Components, Mesh, Sphere
from jaxrender.pipelines.view import view_result
from jaxrender.pipelines.view.material_table import (
    interpolated,
    metal_table,
    pair_of,
    with_amounts,
)
from jaxrender.pipelines.view.packing import unpacked


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("metal") / "cat"
    maps = metal_maps(texel_places(16))
    result = write_metal_result(folder, maps, Sphere())
    return maps, result, view_result(result).read_text(encoding="utf-8")


def linear(part, mean):
    codes = unpacked(part["codes"]) / 255
    ratio = np.where(codes > 0.04045, ((codes + 0.055) / 1.055) ** 2.4, codes / 12.92)
    return ratio * part["scale"] * mean


def test_maps_are_in_the_page(made):
    maps, _, text = made
    scene = scene_of(text)
    texture, material = scene["texture"], scene["material"]
    color = linear(texture["kd"], np.array(material["base"]))
    np.testing.assert_allclose(color, maps.base_color, atol=0.005)
    share = linear(texture["ks"], material["lobe"][0])
    np.testing.assert_allclose(share[..., 0], maps.metallic, atol=0.005)
    place, ratios = unpacked(texture["sigma"]) / 255, np.array(material["ratios"])
    width = material["widths"][material["fitted"]]
    alpha = width * ratios[0] * (ratios[-1] / ratios[0]) ** place
    np.testing.assert_allclose(np.sqrt(alpha), maps.roughness, rtol=3e-3)
    assert material["head_on"] == pytest.approx(0.04)
    assert material["parts"] == 3


def test_every_map_and_error_can_be_shown(made):
    maps, _, text = made
    overlays = {one["id"]: one for one in scene_of(text)["texture"]["overlays"]}
    errors = {"color-error", "metallic-error", "roughness-error"}
    assert set(overlays) == {"metallic", "roughness"} | errors
    for name, values in (("metallic", maps.metallic), ("roughness", maps.roughness)):
        one = overlays[name]
        found = one["low"] + unpacked(one["codes"]) / 254 * (one["high"] - one["low"])
        inside = values < one["high"]
        np.testing.assert_allclose(found[inside], values[inside], atol=0.003)
        assert f'<option value="{name}-error">' in text
    assert overlays["color-error"]["unit"] == " %"
    assert "its base colour" in text
    assert "K_s" not in text.split("<main>")[1].split("</main>")[0]


def test_sliders_are_colour_metalness_and_roughness(made):
    scene = scene_of(made[2])
    sliders = {one["label"]: one for one in scene["sliders"]}
    assert set(sliders) == {
        *(f"base_color, {channel}" for channel in ("red", "green", "blue")),
        "metallic",
        "roughness",
    }
    assert (sliders["metallic"]["lowest"], sliders["metallic"]["highest"]) == (0, 1)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_parts_mix_to_the_material(share):
    color = np.array([0.8, 0.5, 0.2])
    brdf = MetallicRoughness(color, np.ones(3), 0.6, 0.4, 1.6)
    table = metal_table(brdf)
    random = np.random.default_rng(0)
    half = np.arctan(table.width * np.abs(np.tan(random.uniform(0, 1.4, 4000))))
    difference, azimuth = random.uniform(0, 1, 4000), np.cos(random.uniform(0, np.pi, 4000))
    incoming, outgoing = pair_of(half, difference, azimuth)
    seen = (incoming[:, 2] > 0.1) & (outgoing[:, 2] > 0.1)
    incoming, outgoing = incoming[seen], outgoing[seen]
    own = with_amounts(brdf, table, color, np.full(3, share))
    assert float(own.metallic) == share
    pair = (Components.of(jnp.asarray(one)) for one in (incoming, outgoing))
    base, clear = (np.asarray(one)[:, None] for one in own.transfer(*pair))
    exact = color * base + clear
    places = half[seen], difference[seen], azimuth[seen]
    parts = interpolated(table.logarithms[table.fitted], table.width, *places)
    over = 4 * outgoing[:, 2] if table.weighted else 1 / incoming[:, 2]
    lobe, edge = parts[:, :1] / over[:, None], parts[:, 1:2] / over[:, None]
    diffuse = (parts[:, 3] * incoming[:, 2])[:, None]
    # As object.frag.glsl has it.
    found = (1 - share) * (1 - table.head_on) * color * diffuse
    found = found + (share * color + (1 - share) * table.head_on) * lobe + edge
    assert np.mean(np.abs(found - exact)) < 0.01 * np.mean(exact)


@pytest.mark.slow
def test_metal_of_vertices_is_laid_out_in_texels(tmp_path):
    """A metal half and a plastic half: as much of the image is metal as of the surface."""
    ball = Mesh.icosphere(3)
    maps = metal_maps(ball.vertices)
    metallic = (ball.vertices[:, 2] > 0.5) * 1.0
    result = write_metal_result(tmp_path / "cat", maps._replace(metallic=metallic), ball)
    scene = scene_of(view_result(result).read_text(encoding="utf-8"))
    texture, material = scene["texture"], scene["material"]
    assert material["lobe"][0] == pytest.approx(metallic.mean())
    share = linear(texture["ks"], material["lobe"][0])
    np.testing.assert_allclose(np.unique(share), [0, 1], atol=0.01)
    assert share.mean() == pytest.approx(0.25, abs=0.05)
    errors = {"color-error", "metallic-error", "roughness-error"}
    assert {one["id"] for one in texture["overlays"]} == {"metallic", "roughness"} | errors
