"""``task: texture`` from config to result folder; photographs by T 6.13 in plain NumPy, 1 % noise.

- Under known light sigma, mu, K_d and K_s of every texel come out within their standard errors;
  maps, marks, arrays, predictions and the page are written, and agree with each other.
- Unseen texels are counted and marked; the maps go on beyond the seam and are 0 further off.
- The result renders again, to the noise; a K_s of each channel counts in its own channel.
- A glossy texture under unknown light: sigma, mu and texture within their errors, up to one scale.
- Bad input is refused in words.
"""

import shutil

import h5netcdf
import h5py
import numpy as np
import pytest
from painted_captures import NOISE, soft_light, texel_paint, write_config, write_painted
from small_captures import MU, SIGMA, jaxrender
from texture_runs import ROWS, TASK, arrays, run

from jaxrender.errors import InputError
from jaxrender.io import read_image, write_image
from jaxrender.pipelines import load_run_config
from jaxrender.pipelines.exporting.contents import contents_of
from jaxrender.pipelines.render import render_config
from jaxrender.pipelines.result import read_run

WITHIN = 3.5
SOFT_TASK = "task: texture\ntexture: {size: 16}\nsolve: {noise: {relative: 0.01}}\n"


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    return write_painted(tmp_path_factory.mktemp("painted") / "capture")


@pytest.fixture(scope="module")
def found(ball):
    return run(ball, TASK)


def test_sigma_and_mu_are_within_their_intervals(found):
    _, result = found
    assert (result["task"], result["outcome"]) == ("texture", "converged")
    for name, truth in (("sigma", SIGMA), ("mu", MU)):
        error = result["standard_error"][name]
        assert abs(result["brdf"][name] - truth) < WITHIN * error
        low, high = result["interval90"][name]
        assert low < result["brdf"][name] < high
    assert result["identifiable"] == {"sigma": True, "mu": True}
    assert result["noise"]["relative"] == pytest.approx(NOISE, rel=0.1)
    assert result["residual"]["relative_rms"] < 1.1 * NOISE


def test_every_texel_is_within_its_error(found):
    folder, _ = found
    texture = arrays(folder)
    kd, ks = texel_paint(ROWS)
    good = (texture["seen"].ravel() > 2) & (texture["kd_marked"].ravel() == 0)
    off = (texture["kd"].reshape(-1, 3) - kd) / texture["kd_error"].reshape(-1, 3)
    assert good.sum() > 100
    # Errors of a texel's channels go together through its K_s: some 100 count for themselves.
    assert 0.8 < np.sqrt(np.mean(off[good] ** 2)) < 1.2
    sure = good & (texture["ks_marked"].ravel() == 0)
    off = (texture["ks"].ravel() - ks) / texture["ks_error"].ravel()
    assert 0.75 < np.sqrt(np.mean(off[sure] ** 2)) < 1.3


def test_maps_are_the_arrays_and_unseen_texels_are_marked(found):
    folder, result = found
    texture, said = arrays(folder), result["texture"]
    seen = texture["seen"] > 0
    assert said["sentence"] == "32 x 16 texels by latitude and longitude of the sphere"
    assert (said["seen"], said["unseen"]) == (seen.sum(), (~seen).sum())
    assert said["unseen"] > 0
    assert said["kd_marked"] == (texture["kd_marked"][seen] > 0).sum()
    image = read_image(folder / said["files"]["kd"]).pixels
    lit = np.isfinite(texture["kd_error"]).all(axis=-1)
    np.testing.assert_allclose(image[lit], texture["kd"][lit], rtol=1e-6)
    # Two texels further than what was seen, and no more: the camera's far side is black.
    near = image.sum(axis=-1) > 0
    assert lit.sum() < near.sum() < near.size
    marks = read_image(folder / said["files"]["marks"]).pixels > 0.5
    np.testing.assert_array_equal(marks[..., 2], ~seen)
    np.testing.assert_array_equal(marks[..., 0], texture["kd_marked"] > 0)
    error = read_image(folder / said["files"]["kd_error"]).pixels
    np.testing.assert_allclose(error[lit], texture["kd_error"][lit], rtol=1e-6)


def test_predictions_and_page(found, ball):
    folder, _ = found
    photograph, predicted = (
        read_image(path).pixels
        for path in (ball / "images/1.exr", folder / "images/1_predicted.exr")
    )
    inside = photograph.sum(axis=-1) > 0.2 * photograph.max()
    assert np.median(np.abs(predicted[inside] / photograph[inside] - 1)) < 1.5 * NOISE
    page = (folder / "report.html").read_text()
    for words in ("Texture recovered from photographs", "K_d is unreliable", "One σ and one μ"):
        assert words in page
    assert page.count('class="texture"') == 5


def test_the_result_renders_again(found, ball, tmp_path):
    out = render_config(found[0], tmp_path / "again")
    photograph, again = (read_image(p).pixels for p in (ball / "images/1.exr", out / "1.exr"))
    inside = photograph.sum(axis=-1) > 0.2 * photograph.max()
    assert np.median(np.abs(again[inside] / photograph[inside] - 1)) < 1.5 * NOISE
    # The errors of a texture are maps of their own.
    assert not list(out.glob("*_deviation.exr"))


def test_a_coloured_ks_renders_and_leaves(found, tmp_path):
    """Half of K_s in blue takes half of what K_s = 0 would take there, and nothing elsewhere."""

    def rendered(name, colour):
        folder = shutil.copytree(found[0], tmp_path / name)
        grey, coloured = arrays(found[0])["ks"], ("row", "column", "channel")
        with h5py.File(folder / "result.nc", "r+") as file:
            del file["texture/ks"]
        with h5netcdf.File(folder / "result.nc", "r+") as file:
            file["texture"].create_variable("ks", coloured, data=grey[..., None] * colour)
        image = read_image(render_config(folder, tmp_path / f"{name}_again") / "1.exr").pixels
        return image[..., :3], contents_of(read_run(folder)).contents.maps.ks, grey

    (whole, maps, grey), (half, halved, _), (none, _, _) = (
        rendered(name, np.array(colour))
        for name, colour in (("whole", [1, 1, 1.0]), ("half", [1, 1, 0.5]), ("none", [1, 1, 0.0]))
    )
    again = read_image(render_config(found[0], tmp_path / "grey") / "1.exr").pixels[..., :3]
    np.testing.assert_allclose(whole, again, rtol=1e-6)
    np.testing.assert_array_equal(half[..., :2], whole[..., :2])
    np.testing.assert_allclose(half[..., 2], (whole + none)[..., 2] / 2, rtol=1e-5)
    np.testing.assert_allclose(maps, np.nan_to_num(np.repeat(grey[..., None], 3, axis=2)))
    np.testing.assert_allclose(halved[..., 2], 0.5 * maps[..., 2])


def test_what_is_left_is_said_and_nothing_is_named_where_nothing_is_wrong(found):
    _, result = found
    assert result["diagnosis"] == []
    assert result["residual"]["misfit"]["noise"] == pytest.approx(NOISE, rel=0.15)
    low, high = result["interval90"]["sigma"]
    exact_low, exact_high = result["interval90_if_exact"]["sigma"]
    assert low <= exact_low < exact_high <= high


@pytest.mark.slow
def test_a_glossy_texture_under_unknown_light(tmp_path):
    """T 6.1.1, class 7: what moves with the view tells light, sigma and mu, and so the texture."""
    capture = write_painted(tmp_path / "capture", views=10, sources=soft_light())
    folder, result = run(capture, SOFT_TASK, lighting="")
    # Light that ends at some degree leaves little beside the noise.
    assert (result["outcome"], result["diagnosis"]) == ("converged", [])
    assert result["residual"]["misfit"]["rms"] < 0.5 * NOISE
    for name, truth in (("sigma", SIGMA), ("mu", MU)):
        assert abs(result["brdf"][name] - truth) < WITHIN * result["standard_error"][name]
        assert result["standard_error"][name] < 0.05 * truth
    texture = arrays(folder)
    kd, ks = texel_paint(ROWS)
    good = texture["seen"].ravel() > 4
    assert good.sum() > 60
    found = texture["kd"].reshape(-1, 3)[good]
    scale = np.sum(kd[good]) / np.sum(found)
    off = (scale * found - kd[good]) / (scale * texture["kd_error"].reshape(-1, 3)[good])
    assert np.sqrt(np.mean(off**2)) < 1.4
    found = scale * np.mean(texture["ks"].ravel()[good])
    assert found == pytest.approx(np.mean(ks[good]), rel=0.1)


def test_bad_input_is_refused_in_words(ball, tmp_path):
    single = write_painted(tmp_path / "single", views=1)
    with pytest.raises(InputError, match=r"no site is seen more than once"):
        run(single, TASK, "texture.size=300")
    write_image(tmp_path / "noise.png", np.random.default_rng(0).uniform(size=(16, 32, 3)))
    with pytest.raises(InputError, match=r"512 colours; .* one flat colour for each"):
        run(ball, TASK, f"texture.regions={tmp_path / 'noise.png'}")
    with pytest.raises(InputError, match=r"gone\.png: no such image file"):
        run(ball, TASK, f"texture.regions={tmp_path / 'gone.png'}")
    with pytest.raises(InputError, match=r"nowhere\.exr"):
        run(ball, TASK, lighting="lighting: {environment: {path: nowhere.exr}}\n")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "task: texture\nsolve: {free: [exposure, camera, lamps]}\n",
            "camera, lamps cannot be freed with a texture under unknown light; choose of "
            "exposure, black, response, normals, or give the light",
        ),
        (
            "task: texture\nbrdf: {model: lambertian}\nsolve: {free: [exposure]}\n",
            "a diffuse texture under unknown light takes the capture as it is told",
        ),
        (
            "task: texture\nbrdf: {model: lambertian}\nsolve: {diagnose: true}\n",
            "a diffuse texture under unknown light names no causes",
        ),
    ],
)
def test_what_is_not_freed_under_unknown_light_is_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        load_run_config(write_config(tmp_path, text, lighting=""))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("task: texture\nbrdf: {kd: 0.1}\n", "known light finds kd of every site"),
        (
            "task: texture\nbrdf: {ks_per_channel: true}\n",
            "has one ks for all channels",
        ),
        ("task: texture\nsolve: {free_exposure: true}\n", "needs known exposures"),
        ("task: texture\nsolve: {loss: huber}\n", "counts squared residuals"),
        (
            "task: texture\ntexture: {unknown_light: true}\n",
            "lighting: found .* recovers the light",
        ),
        ("task: texture\ntexture: {size: 0}\n", "texture.size: found 0, accepted: 'auto' or"),
        ("task: texture\ntexture: {prio: variance}\n", "did you mean 'prior'"),
        (
            "task: brdf\ntexture: {size: 4}\n",
            "texture: found {size: 4}, but task brdf finds no texture",
        ),
        ("task: textur\n", "did you mean 'texture'"),
        (
            "task: brdf-spectrum\nbrdf: {model: ggx}\n",
            "brdf: found {model: 'ggx'}, but task brdf-spectrum fits no model",
        ),
        ("task: brdf-spectrum\nsolve: {free_exposure: true}\n", "solves one linear system"),
    ],
)
def test_configs_that_ask_for_what_cannot_be(tmp_path, text, message):
    path = write_config(tmp_path, text)
    with pytest.raises(InputError, match=message):
        load_run_config(path)


def test_schema_and_dry_run_know_the_task(ball, capsys):
    assert jaxrender("schema") == 0
    assert '"unknown_light"' in capsys.readouterr().out
    path = write_config(ball, TASK)
    assert jaxrender("fit", path, "--dry-run", "texture.size=auto") == 0
    assert "would recover the material of 32 x 16 texels" in capsys.readouterr().out
    assert jaxrender("fit", path, "--dry-run", "texture.regions=gone.png") != 0
    assert "no such image file" in capsys.readouterr().err
