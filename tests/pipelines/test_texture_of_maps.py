"""``task: texture`` with a sigma and a normal of every texel.

- Both are found, and written as maps with errors, by which predictions and renderings go.
- Where nobody saw a highlight sigma is marked, and its error says that it may be anything.
- A coloured K_s is found, written as a map with errors and marks, shown, rendered and exported.
- What maps cannot be combined with is refused in words.
"""

import numpy as np
import OpenImageIO as oiio
import pytest
from painted_captures import CHECKER, NOISE, texel_paint, write_config, write_painted
from small_captures import SIGMA
from texture_runs import ROWS, arrays, off_photograph, run

from jaxrender.errors import InputError
from jaxrender.pipelines import load_run_config
from jaxrender.pipelines.exporting.contents import contents_of
from jaxrender.pipelines.result import read_run

LEANING = CHECKER._replace(growth=0.25, tilt=0.06)
MAPS = "task: texture\ntexture: {size: 16, sigma: map, normals: map}\n"
TASK = (
    f"{MAPS}brdf: {{sigma: {{bounds: [0.05, 0.6]}}}}\n"
    "solve: {starts: 1, diagnose: false, noise: {relative: 0.01, floor: 0.0005}}\n"
)


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    capture = write_painted(tmp_path_factory.mktemp("maps") / "capture", LEANING)
    return capture, *run(capture, TASK)


def places():
    """Points in the middle of the texels."""
    polar, azimuth = np.meshgrid(
        (np.arange(ROWS) + 0.5) * np.pi / ROWS,
        (np.arange(2 * ROWS) + 0.5) * np.pi / ROWS,
        indexing="ij",
    )
    x, y = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth)
    return np.stack([x, y, np.cos(polar)], axis=-1).reshape(-1, 3)


def pixels_of(path):
    """Read an image as it is: normals have negative parts, which no photograph has."""
    return np.atleast_3d(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT))


@pytest.mark.slow
def test_sigma_and_normals_are_maps(mapped):
    _, folder, result = mapped
    maps = arrays(folder)
    true = SIGMA * np.exp(LEANING.growth * places()[:, 2]).reshape(maps["sigma"].shape)
    sure = maps["sigma_error"] < 0.05 * true
    assert sure.sum() > 60
    # A texel is 11 degrees wide, over which sigma changes by 5 %.
    assert np.median(np.abs(maps["sigma"][sure] / true[sure] - 1)) < 0.02
    unsure = (maps["seen"] > 0) & (maps["sigma_error"] > 0.2 * true)
    assert unsure.any()
    assert np.all(np.abs(np.log(maps["sigma"] / true))[unsure] < 1)
    leaning = LEANING.normals_of(places(), places()) - places()
    away = np.linalg.norm(maps["normal_offset"].reshape(-1, 3) - leaning, axis=1)
    good = np.degrees(maps["normal_error"].ravel()) < 0.5
    assert good.sum() > 80
    # Over a texel the tilt itself changes by a third of a degree.
    assert np.degrees(np.median(away[good])) < 0.5
    assert np.degrees(np.median(np.linalg.norm(leaning[good], axis=1))) > 2
    unseen = maps["seen"] == 0
    assert np.isnan(maps["normal"][unseen]).all()
    assert np.isinf(maps["normal_error"][unseen]).all()
    texture = result["texture"]
    assert texture["sigma_marked"] > 0
    assert texture["tilt_degrees"] > 1
    assert result["residual"]["relative_rms"] < 1.5 * NOISE


@pytest.mark.slow
def test_the_texture_is_found_with_them(mapped):
    _, folder, _ = mapped
    maps = arrays(folder)
    kd, _ = texel_paint(ROWS, LEANING)
    good = (maps["seen"].ravel() > 2) & (maps["kd_marked"].ravel() == 0)
    assert good.sum() > 80
    found = maps["kd"].reshape(-1, 3)[good]
    assert np.median(np.abs(found / kd[good] - 1)) < 0.02


@pytest.mark.slow
def test_maps_are_written_and_shown(mapped):
    _, folder, result = mapped
    maps = arrays(folder)
    for name in ("sigma", "sigma_error", "normal", "normal_error"):
        path = f"textures/{name}.exr"
        assert result["texture"]["files"][name] == path
        image = pixels_of(folder / path)
        known = maps["seen"] > 0
        shaped = maps[name].reshape(*known.shape, -1)
        np.testing.assert_allclose(
            image[known][:, : shaped.shape[2]], shaped[known], rtol=1e-3, atol=1e-3
        )
    for name in ("sigma_marked", "normal_marked"):
        shown = pixels_of(folder / result["texture"]["files"][name])[..., 0] > 0.5
        np.testing.assert_array_equal(shown, maps[name] > 0)
        assert np.count_nonzero(shown & (maps["seen"] > 0)) == result["texture"][name]
        # What nothing tells is not to be trusted.
        assert shown[~np.isfinite(maps[name.replace("marked", "error")])].all()
        assert not shown.all()
    page = (folder / "report.html").read_text()
    assert "white: sigma is unreliable" in page
    assert "Every place has a σ of its own" in page
    assert "One σ and one μ" not in page
    assert "standard error of sigma" in page
    assert "normal: x, y and z from -1 to 1" in page


@pytest.mark.slow
def test_maps_render_again(mapped, tmp_path):
    """Prediction and rendering both go by the maps: the photograph, to the noise."""
    capture, folder, _ = mapped
    assert off_photograph(capture, folder, tmp_path / "again") < 1.5 * NOISE


# A checker of plastic and metal.
METALS = CHECKER._replace(ks=np.array([[0.06, 0.06, 0.06], [0.2, 0.14, 0.06]]))


@pytest.fixture(scope="module")
def coloured(tmp_path_factory):
    capture = write_painted(tmp_path_factory.mktemp("colour") / "capture", METALS)
    task = TASK.replace("sigma: map, normals: map", "ks: color")
    return capture, *run(capture, task, "brdf.mu=1.5")


@pytest.mark.slow
def test_a_coloured_ks_is_found_and_written(coloured):
    """Quick sisters: ``test_texture_task.py`` and ``tests/inverse/test_texture_estimate.py``."""
    _, folder, result = coloured
    maps, (_, ks) = arrays(folder), texel_paint(ROWS, METALS)
    assert maps["ks"].shape == (ROWS, 2 * ROWS, 3)
    seen = maps["seen"].ravel() > 0
    sure = seen & (maps["ks_marked"].ravel() == 0) & (maps["ks_colour_marked"].ravel() == 0)
    assert sure.sum() > 80
    found, error = (maps[name].reshape(-1, 3) for name in ("ks", "ks_error"))
    assert np.median(np.abs(found / ks - 1)[sure]) < 0.07
    # Pixels along the edges of the checker show two paints: by one K_s a texel it is 3.1.
    assert 0.5 < np.quantile(np.abs(found - ks)[sure] / error[sure], 0.683) < 2.5
    texture = result["texture"]
    assert texture["ks_colour_marked"] == np.count_nonzero(maps["ks_colour_marked"].ravel()[seen])
    assert 0 < texture["ks_colour_marked"] < seen.sum()
    assert result["brdf"]["ks"][0] > 1.2 * result["brdf"]["ks"][2]
    image = pixels_of(folder / texture["files"]["ks"])
    np.testing.assert_allclose(image.reshape(-1, 3)[seen], found[seen], rtol=1e-3, atol=1e-4)
    marks = pixels_of(folder / texture["files"]["ks_colour_marked"])[..., 0] > 0.5
    np.testing.assert_array_equal(marks, maps["ks_colour_marked"] > 0)
    page = (folder / "report.html").read_text()
    assert "K_s in sRGB, with its colour" in page
    assert "white: the colour of K_s is unreliable" in page


@pytest.mark.slow
def test_a_coloured_ks_renders_again_and_leaves(coloured, tmp_path):
    capture, folder, _ = coloured
    assert off_photograph(capture, folder, tmp_path / "again") < 1.5 * NOISE
    maps = contents_of(read_run(folder)).contents.maps
    assert maps.ks.shape == (ROWS, 2 * ROWS, 3)
    np.testing.assert_allclose(maps.ks, np.nan_to_num(arrays(folder)["ks"]))


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("solve.refine=off", "maps of sigma or normals is found on the integral"),
        ("brdf.sigma={fixed: 0.2}", "brdf.sigma.fixed: found 0.2, but texture.sigma: map finds"),
        ("brdf={model: lambertian}", "maps of sigma or normals needs a specular lobe"),
        ("solve.free=[camera]", "takes the capture as it is told"),
        ("texture.sigma=varying", "knows no sigma that varies slowly"),
        ("texture={ks: color, sigma: varying}", "texture.ks: color knows no sigma that varies"),
        ("texture={ks: color}; solve.refine=off", "texture.ks: color is found on the integral"),
    ],
)
def test_what_maps_cannot_be_combined_with(tmp_path, override, words):
    path = write_config(tmp_path, MAPS)
    with pytest.raises(InputError, match=words):
        load_run_config(path, override.split("; "))
