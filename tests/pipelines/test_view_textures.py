"""The page of a texture: its maps as data.

- The maps are those of the result, to the steps of 8 bits; unseen texels have a code of their own.
- A texture of vertices is laid out in texels: corners have what the vertices have.
- A page of 20,000 triangles with maps of 512 x 512 stays under 6 MB, whatever its noise.
"""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from stated_textures import smooth_maps, texel_places, write_result
from view_pages import scene_of

from jaxrender.geometry import Mesh, Sphere
from jaxrender.geometry.texels import texel_sites
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


def linear(part, mean):
    codes = unpacked(part["codes"]) / 255
    ratio = np.where(codes > 0.04045, ((codes + 0.055) / 1.055) ** 2.4, codes / 12.92)
    return ratio * part["scale"] * np.array(mean)


def test_vertices_are_laid_out_in_texels(tmp_path):
    """At its corners the page's object has what the vertices have, errors and normals too."""
    ball = Mesh.icosphere(3)
    stated = smooth_maps(ball.vertices, 3, True)
    kd = stated.kd * np.random.default_rng(0).uniform(0.5, 1, (len(ball.vertices), 1))
    page = view_result(write_result(tmp_path / "cat", stated._replace(kd=kd), ball))
    scene = scene_of(page.read_text(encoding="utf-8"))
    texture, surface = scene["texture"], scene["surface"]
    lower, size = (np.array(surface[name]) for name in ("lower", "size"))
    corners = lower + unpacked(surface["positions"]) / 65535 * size
    # A little inside of a face from each of its corners: where a chart ends it has few texels.
    places, faces = unpacked(surface["coordinates"]), unpacked(surface["faces"]).astype(int)
    inside = 0.8 * places[faces] + 0.1 * (places[faces].sum(axis=1, keepdims=True) - places[faces])
    vertex = cKDTree(ball.vertices).query(corners[faces.ravel()])[1]
    rows, columns = texture["kd"]["codes"]["shape"][:2]
    texel = texel_sites(inside.reshape(-1, 2).astype(float), (rows, columns))

    def at(image):
        return image.reshape(rows * columns, -1)[texel]

    found = at(linear(texture["kd"], scene["material"]["base"]))
    wrong = np.abs(found - kd[vertex]).max(axis=1) > 0.02 * kd.max()
    assert wrong.mean() < 0.001
    codes = at(unpacked(texture["offset"]["codes"])).astype(float)
    offset = (codes - 128) / 127 * texture["offset"]["scale"]
    assert (np.abs(offset - stated.offset[vertex]).max(axis=1) > 2e-3).mean() < 0.001
    assert {one["id"] for one in texture["overlays"]} == {"sigma", "normal-error"}


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
