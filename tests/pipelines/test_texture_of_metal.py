"""``task: texture`` of glTF's material: base colour, roughness and metalness of every texel.

- All three are found, and written as maps with errors and marks; the report shows them.
- Predictions and renderings go by the maps.
- They leave as glTF's own textures: roughness in green, metalness in blue.
- What cannot be combined with them is refused in words.
"""

import io
import json
import struct

import numpy as np
import OpenImageIO as oiio
import pytest
from metallic_captures import COLORS, LIGHTING, METALLIC, ROUGHNESS, write_metallic
from painted_captures import NOISE, texel_paint, write_config
from PIL import Image
from texture_runs import ROWS, arrays, off_photograph, run

from jaxrender.errors import InputError
from jaxrender.pipelines import load_run_config
from jaxrender.pipelines.exporting import export
from jaxrender.pipelines.view import view_result

TASK = (
    "task: texture\ntexture: {size: 16, roughness: map, metalness: map}\n"
    "brdf: {model: metallic-roughness}\nsamples: {count: 2000}\n"
)


@pytest.fixture(scope="module")
def metal(tmp_path_factory):
    capture = write_metallic(tmp_path_factory.mktemp("metal") / "capture")
    return capture, *run(capture, TASK, lighting=LIGHTING)


def which():
    """Number the paint of each texel."""
    kd, _ = texel_paint(ROWS)
    return (kd[:, 2] > 0.1).astype(int).reshape(ROWS, 2 * ROWS)


def test_all_three_are_maps(metal):
    _, folder, result = metal
    maps, paint = arrays(folder), which()
    for name, truth, most in (
        ("base_color", COLORS, 0.02),
        ("roughness", ROUGHNESS, 0.05),
        ("metallic", METALLIC, 0.03),
    ):
        value, error, marked = (maps[f"{name}{end}"] for end in ("", "_error", "_marked"))
        sure = (maps["seen"] > 0) & (marked == 0)
        off = np.abs(value - truth[paint])
        off = off if name == "metallic" else off / truth[paint]
        assert sure.sum() > 100
        assert np.median(off[sure]) < most
        assert np.isinf(error[maps["seen"] == 0]).all()
        assert marked[maps["seen"] == 0].all()
        texture = result["texture"]
        assert texture[f"{name}_marked"] == np.count_nonzero(marked[maps["seen"] > 0])
    assert 0.3 < texture["metals"] < 0.7
    assert texture["metallic_range"][0] < 0.05
    assert texture["metallic_range"][1] > 0.95
    assert result["brdf"]["model"] == "metallic-roughness"
    assert result["brdf"]["ior"] == 1.5
    assert result["identifiable"] == {}
    assert result["residual"]["relative_rms"] < 3 * NOISE


def test_maps_are_written_and_shown(metal):
    _, folder, result = metal
    maps, files = arrays(folder), result["texture"]["files"]
    known = maps["seen"] > 0
    for name in ("base_color", "roughness", "metallic", "metallic_error"):
        image = np.atleast_3d(oiio.ImageBuf(str(folder / files[name])).get_pixels(oiio.FLOAT))
        shaped = maps[name].reshape(*known.shape, -1)
        np.testing.assert_allclose(
            image[known][:, : shaped.shape[2]], shaped[known], rtol=1e-3, atol=1e-3
        )
    for name in ("base_color_marked", "metallic_marked", "roughness_marked"):
        shown = oiio.ImageBuf(str(folder / files[name])).get_pixels(oiio.FLOAT)[..., 0] > 0.5
        np.testing.assert_array_equal(shown, maps[name] > 0)
    page = (folder / "report.html").read_text()
    assert "base colour in sRGB" in page
    assert "standard error of metalness" in page
    assert "white: metalness is unreliable" in page
    assert "are more metal than not" in page


def test_maps_render_again(metal, tmp_path):
    """Prediction and rendering both go by the maps: the photograph, to the noise."""
    capture, folder, _ = metal
    assert off_photograph(capture, folder, tmp_path / "again") < 1.5 * NOISE


def test_they_leave_as_textures_of_gltf(metal, tmp_path):
    _, folder, _ = metal
    export(folder, "glb", tmp_path / "out", lossy=True)
    data = (tmp_path / "out/scene.glb").read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    (material,) = document["materials"]
    numbers = material["pbrMetallicRoughness"]
    assert numbers["metallicFactor"] == numbers["roughnessFactor"] == 1
    assert "extensions" not in material
    texture = document["textures"][numbers["metallicRoughnessTexture"]["index"]]
    view = document["bufferViews"][document["images"][texture["source"]]["bufferView"]]
    start = view.get("byteOffset", 0)
    picture = np.asarray(Image.open(io.BytesIO(binary[start : start + view["byteLength"]]))) / 255
    maps = arrays(folder)
    seen = maps["seen"] > 0
    np.testing.assert_allclose(picture[..., 1][seen], maps["roughness"][seen], atol=3e-3)
    np.testing.assert_allclose(picture[..., 2][seen], maps["metallic"][seen], atol=3e-3)


@pytest.mark.slow
def test_page_and_mitsuba_take_them(metal, tmp_path):
    _, folder, _ = metal
    page = view_result(folder, tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Standard deviation of metalness" in page
    done = export(folder, "mitsuba", tmp_path / "out")
    assert "metal is a plugin" in (done.folder / "README.txt").read_text()


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("texture.normals=map", "takes the normals of the shape"),
        ("texture.sigma=map", "has a roughness \\(texture.roughness\\)"),
        ("texture.ks=color", "as bright as its index says"),
        ("texture.regions=paint.png", "has maps in the place of regions"),
        ("brdf.metallic=1", "texture.metalness: map finds metallic"),
        ("brdf.roughness=0.4", "texture.roughness: map finds roughness"),
        ("brdf.base_color=0.4", "finds base_color of every site"),
        ("brdf.interface=0.5", "as bright as its index says"),
        ("brdf.model=ggx", "a texture of ggx knows no share of metal"),
        ("solve.free=[camera]", "takes the capture as it is told"),
        ("solve.refine=off", "is found on the integral"),
        ("solve.diagnose=true", "names no causes of a misfit"),
        ("texture.unknown_light=true", "a texture under unknown light fits facets"),
    ],
)
def test_what_maps_cannot_be_combined_with(tmp_path, override, words):
    path = write_config(tmp_path, TASK)
    with pytest.raises(InputError, match=words):
        load_run_config(path, [override])
