"""The page of a texture: its maps as data.

- The maps are those of the result, to the steps of 8 bits; unseen texels have a code of their own.
- A page of 20,000 triangles with maps of 512 x 512 stays under 6 MB, whatever its noise.
"""

import numpy as np
import pytest
from stated_textures import smooth_maps, texel_places, write_result
from view_pages import scene_of

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Sphere
from jaxrender.io.exports import mesh_of
from jaxrender.pipelines.view import view_result
from jaxrender.pipelines.view.packing import unpacked


def made(folder, shape, rows=16, channels=1, varying=True):
    maps = smooth_maps(texel_places(rows), channels, varying)
    result = write_result(folder / "cat", maps, shape)
    return maps, result, view_result(result)


def test_maps_are_in_the_page(tmp_path):
    maps, _, page = made(tmp_path, Sphere(), channels=3)
    scene = scene_of(page.read_text(encoding="utf-8"))
    texture, material = scene["texture"], scene["material"]
    for name, mean in (("kd", material["base"]), ("ks", material["lobe"])):
        codes = unpacked(texture[name]["codes"]) / 255
        linear = np.where(codes > 0.04045, ((codes + 0.055) / 1.055) ** 2.4, codes / 12.92)
        found = linear * texture[name]["scale"] * np.array(mean)
        np.testing.assert_allclose(found, getattr(maps, name), atol=0.01 * found.max())
    share, ratios = unpacked(texture["sigma"]) / 255, np.array(material["ratios"])
    width = material["widths"][material["fitted"]]
    sigma = width * ratios[0] * (ratios[-1] / ratios[0]) ** share
    np.testing.assert_allclose(sigma, maps.widths, rtol=3e-3)
    codes = unpacked(texture["offset"]["codes"])
    offset = (codes.astype(float) - 128) / 127 * texture["offset"]["scale"]
    np.testing.assert_allclose(offset, maps.offset, atol=1e-3)
    shown = {one["id"]: one for one in texture["overlays"]}
    assert set(shown) == {"sigma", "normal-error"}
    assert shown["sigma"]["high"] == pytest.approx(maps.widths.max(), rel=0.02)


def test_vertices_are_refused_in_words(tmp_path):
    ball = Mesh.icosphere(1)
    result = write_result(tmp_path / "cat", smooth_maps(ball.vertices), ball)
    with pytest.raises(InputError, match=r"one of vertices.*give the mesh texture coordinates"):
        view_result(result)


@pytest.mark.slow
def test_a_large_page_is_small(tmp_path):
    rng = np.random.default_rng(0)
    globe = mesh_of(Sphere(), textured=True)
    faces = np.concatenate([globe.faces, globe.faces[:3872]])
    assert len(faces) == 20_000
    moved = np.concatenate([globe.faces, globe.faces[:3872] + len(globe.vertices)])
    coordinates = globe.texture_coordinates[np.r_[: len(globe.faces), :3872]]
    shape = Mesh(np.concatenate([globe.vertices, 1.1 * globe.vertices]), moved, None, coordinates)
    maps = smooth_maps(np.ones((512, 512, 3)), 3, True)
    noisy = {
        name: value * rng.uniform(0.5, 1, value.shape)
        for name, value in maps._asdict().items()
        if np.ndim(value) > 1
    }
    page = view_result(write_result(tmp_path / "cat", maps._replace(**noisy), shape))
    assert len(shape.faces) == 20_000
    assert page.stat().st_size < 6e6
