"""``task: texture`` from config to result folder; photographs by T 6.13 in plain NumPy, 1 % noise.

- Under known light sigma, mu, K_d and K_s of every texel come out within their standard errors;
  maps, marks, arrays, predictions and the page are written, and agree with each other.
- Unseen texels are counted and marked; the maps go on beyond the seam and are 0 further off.
- The result renders again, to the noise; colours of a mask are regions with a lobe each.
- Diffuse paint: a mesh file with texture coordinates gets texels, one without gets its vertices,
  and says so; under unknown light the texture is right up to what is not identifiable, which is
  said; a specular lobe that is not there is not identifiable.
- A glossy texture under unknown light: sigma, mu and texture within their errors, up to one scale.
- A sigma that varies over the ball is a map with errors, by which predictions and renderings go.
- Exposures that differ are named, and found with the paint where they are freed.
- Bad input is refused in words.
"""

import json
import shutil

import h5netcdf
import numpy as np
import pytest
from painted_captures import (
    CHECKER,
    DIFFUSE,
    KD,
    NOISE,
    Paint,
    soft_light,
    texel_paint,
    write_config,
    write_painted,
)
from small_captures import MU, SIGMA, jaxrender, read_result

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh
from jaxrender.geometry.texels import texel_coordinates
from jaxrender.io import read_image, read_mesh, write_image, write_mesh
from jaxrender.pipelines import fit, load_run_config
from jaxrender.pipelines.render import render_config

ROWS, WITHIN = 16, 3.5
TASK = "task: texture\ntexture: {size: 16}\nsolve: {starts: 1, refine: off}\n"
SOFT_TASK = "task: texture\ntexture: {size: 16}\nsolve: {noise: {relative: 0.01}}\n"
DIFFUSE_TASK = "task: texture\ntexture: {size: 16}\nbrdf: {model: lambertian}\n"


CHECKER_GROWING = CHECKER._replace(growth=0.25)


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    return write_painted(tmp_path_factory.mktemp("painted") / "capture")


@pytest.fixture(scope="module")
def diffuse(tmp_path_factory):
    return write_painted(tmp_path_factory.mktemp("diffuse") / "capture", DIFFUSE)


@pytest.fixture(scope="module")
def found(ball):
    return run(ball, TASK)


def run(capture, text, *overrides, **config):
    path = write_config(capture, text, **config)
    out = capture.parent / f"out{abs(hash((text, overrides, str(config))))}"
    fit(load_run_config(path, [*overrides, f"output={out}"]))
    return out, read_result(out)


def arrays(folder):
    with h5netcdf.File(folder / "result.nc") as file:
        group = file["texture"]
        return {name: np.asarray(group[name][:]) for name in group.variables}


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


@pytest.mark.slow
def test_a_mesh_without_coordinates_has_vertices(tmp_path):
    mesh = Mesh.icosphere(2)
    plain = Paint(np.tile(KD[:1], (2, 1)), np.zeros(2))
    folder = write_painted(tmp_path / "capture", plain, 3, mesh)
    write_mesh(folder / "ball.ply", mesh)
    with pytest.raises(InputError, match=r"texture\.size: found 16, but the mesh has no texture"):
        run(folder, DIFFUSE_TASK, shape="mesh: ball.ply")
    out, result = run(folder, DIFFUSE_TASK, "texture.size=auto", shape="mesh: ball.ply")
    said = result["texture"]
    assert said["sentence"] == (
        "162 vertices: the mesh has no texture coordinates, or not everywhere"
    )
    assert said["files"] == {"vertices": "textures/vertices.ply"}
    texture = arrays(out)
    sure = texture["kd_marked"] == 0
    off = (texture["kd"] - KD[0]) / texture["kd_error"]
    assert sure.sum() > 60
    assert 0.8 < np.sqrt(np.mean(off[sure] ** 2)) < 1.2
    assert len(read_mesh(out / "textures/vertices.ply").vertices) == 162
    assert "vertices.ply" in (out / "report.html").read_text()


class Folded(Paint):
    """Checks of x and y, alike on both sides of the ball: texels that are flat on a flat face."""

    def of(self, points):
        which = (np.floor(2 * points[:, 0]) + np.floor(2 * points[:, 1])).astype(int) % 2
        return self.kd[which], self.ks[which]


def test_a_mesh_file_with_coordinates_has_texels(tmp_path):
    """An .obj whose texture is its upper side beside its lower one: vertices between have both."""
    ball, paint = Mesh.icosphere(3), Folded(ks=np.zeros(2))
    corners = ball.vertices[ball.faces]
    lower = corners[..., 2].mean(axis=1, keepdims=True) < 0
    u, v = (corners[..., 0] + 1) / 4 + lower / 2, (corners[..., 1] + 1) / 2
    mesh = Mesh(ball.vertices, ball.faces, ball.normals, np.stack([u, v], axis=-1))
    folder = write_painted(tmp_path / "capture", paint, 3, mesh)
    write_mesh(folder / "ball.obj", mesh)
    out, result = run(folder, DIFFUSE_TASK, shape="mesh: ball.obj")
    assert result["texture"]["sentence"] == "16 x 16 texels of the mesh's texture coordinates"
    texture = arrays(out)
    u, v = texel_coordinates((16, 16)).T
    kd, _ = paint.of(np.stack([4 * u % 2 - 1, 2 * v - 1], axis=-1))
    sure = texture["kd_marked"].ravel() == 0
    off = (texture["kd"].reshape(-1, 3) - kd) / texture["kd_error"].reshape(-1, 3)
    assert sure.sum() > 60
    assert 0.8 < np.sqrt(np.mean(off[sure] ** 2)) < 1.2


@pytest.mark.slow
def test_diffuse_paint_under_unknown_light(diffuse):
    folder, result = run(diffuse, DIFFUSE_TASK, lighting="")
    assert result["outcome"] == "not_identifiable"
    assert "T 6.1.1, class 6" in result["ambiguity"]
    assert "total-variation" in result["ambiguity"]
    assert "0.18 / pi" in result["lighting"]["gauge"]
    texture = arrays(folder)
    kd, _ = texel_paint(ROWS, DIFFUSE)
    good = (texture["seen"].ravel() > 3) & np.isfinite(texture["kd"]).all(axis=-1).ravel()
    ratio = texture["kd"].reshape(-1, 3)[good] / kd[good]
    # Neighbouring cells of different paint: what varies faster than the surface is identifiable.
    within = np.abs(np.log(ratio / np.median(ratio, axis=0)))
    assert np.median(within) < 0.1
    assert (folder / "lighting.exr").is_file()
    assert "What is not identifiable" in (folder / "report.html").read_text()


@pytest.mark.slow
def test_a_glossy_texture_under_unknown_light(tmp_path):
    """T 6.1.1, class 7: what moves with the view tells light, sigma and mu, and so the texture."""
    capture = write_painted(tmp_path / "capture", views=10, sources=soft_light())
    folder, result = run(capture, SOFT_TASK, lighting="")
    assert result["outcome"] == "converged"
    for name, truth in (("sigma", SIGMA), ("mu", MU)):
        assert abs(result["brdf"][name] - truth) < WITHIN * result["standard_error"][name]
        assert result["standard_error"][name] < 0.05 * truth
    texture = arrays(folder)
    kd, ks = texel_paint(ROWS)
    good = (texture["seen"].ravel() > 4) & (texture["kd_marked"].ravel() == 0)
    assert good.sum() > 60
    found = texture["kd"].reshape(-1, 3)[good]
    scale = np.sum(kd[good]) / np.sum(found)
    off = (scale * found - kd[good]) / (scale * texture["kd_error"].reshape(-1, 3)[good])
    assert np.sqrt(np.mean(off**2)) < 1.4
    found = scale * np.mean(texture["ks"].ravel()[good])
    assert found == pytest.approx(np.mean(ks[good]), rel=0.1)


@pytest.mark.slow
def test_a_specular_lobe_that_is_not_there_is_not_identifiable(diffuse, found):
    _, result = run(diffuse, TASK)
    assert result["outcome"] in ("not_identifiable", "at_bound")
    assert any("sigma" in reason for reason in result["reasons"])


@pytest.mark.slow
def test_texels_without_end_are_marked_not_made_up(diffuse):
    _, result = run(diffuse, DIFFUSE_TASK, "texture.size=96")
    said = result["texture"]
    assert said["unseen"] > said["seen"]
    assert said["median_observations"] <= 2


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
        ("task: texture\nbrdf: {kd: 0.1}\n", "known light finds kd of every site"),
        ("task: texture\nbrdf: {ks_per_channel: true}\n", "has one ks for all channels; remove"),
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


def test_regions_are_put_together(diffuse, tmp_path):
    kd, _ = texel_paint(ROWS, CHECKER)
    which = (kd[:, 0] > 0.1).reshape(ROWS, 2 * ROWS)
    write_image(tmp_path / "mask.png", np.repeat(which[..., None] * 1.0, 3, axis=-1))
    folder, result = run(diffuse, DIFFUSE_TASK, f"texture.regions={tmp_path / 'mask.png'}")
    assert [region["name"] for region in result["regions"]] == ["#000000", "#ffffff"]
    assert sum(region["sites"] for region in result["regions"]) == result["texture"]["seen"]
    texture = arrays(folder)
    np.testing.assert_array_equal(texture["region"], which)
    good = texture["kd_marked"].ravel() == 0
    off = (texture["kd"].reshape(-1, 3) - kd) / texture["kd_error"].reshape(-1, 3)
    assert 0.8 < np.sqrt(np.mean(off[good] ** 2)) < 1.2
    assert "#ffffff" in (folder / "report.html").read_text()


VARYING_TASK = (
    "task: texture\ntexture: {size: 16, sigma: varying, control_points: 6}\n"
    "brdf: {sigma: {bounds: [0.06, 0.5]}}\nsolve: {starts: 1, noise: {relative: 0.01}}\n"
)


@pytest.fixture(scope="module")
def varying(tmp_path_factory):
    capture = write_painted(tmp_path_factory.mktemp("varying") / "capture", CHECKER_GROWING)
    return capture, *run(capture, VARYING_TASK)


@pytest.mark.slow
def test_sigma_varies_over_the_ball(varying):
    _, folder, result = varying
    maps = arrays(folder)
    height = np.cos((np.arange(ROWS) + 0.5) * np.pi / ROWS)[:, None]
    true = np.broadcast_to(SIGMA * np.exp(CHECKER_GROWING.growth * height), maps["sigma"].shape)
    sure = maps["sigma_error"] < 0.03 * true
    assert sure.mean() > 0.3
    # A texel is 11 degrees wide, over which sigma changes by 5 %.
    assert np.sqrt(np.mean((maps["sigma"][sure] / true[sure] - 1) ** 2)) < 0.03
    low, high = result["texture"]["sigma_range"]
    assert low < 0.9 * SIGMA
    assert high > 1.1 * SIGMA
    assert low < result["brdf"]["sigma"] < high
    unseen = maps["seen"] == 0
    assert unseen.any()
    assert np.isnan(maps["sigma"][unseen]).all()
    assert true[sure].max() / true[sure].min() > 1.4
    # A texel has one sigma, by which mu is off by more than its error.
    assert result["brdf"]["mu"] == pytest.approx(MU, rel=0.015)
    # With one sigma for all it is more than three times the noise.
    assert result["residual"]["relative_rms"] < 1.5 * NOISE


@pytest.mark.slow
def test_the_texture_is_found_with_its_sigma(varying):
    _, folder, _ = varying
    texture = arrays(folder)
    kd, _ = texel_paint(ROWS, CHECKER_GROWING)
    good = (texture["seen"].ravel() > 2) & (texture["kd_marked"].ravel() == 0)
    assert good.sum() > 100
    found, error = (texture[name].reshape(-1, 3)[good] for name in ("kd", "kd_error"))
    assert np.sqrt(np.mean((found / kd[good] - 1) ** 2)) < 0.03
    assert 0.8 < np.sqrt(np.mean(((found - kd[good]) / error) ** 2)) < 1.4
    unseen = texture["seen"] == 0
    assert np.isnan(texture["sigma"][unseen]).all()
    assert np.isinf(texture["sigma_error"][unseen]).all()


@pytest.mark.slow
def test_maps_of_sigma_are_written_and_shown(varying):
    _, folder, result = varying
    maps = arrays(folder)
    for name in ("sigma", "sigma_error"):
        assert result["texture"]["files"][name] == f"textures/{name}.exr"
        image = read_image(folder / f"textures/{name}.exr").pixels[..., 0]
        known = np.isfinite(maps["sigma"])
        np.testing.assert_allclose(image[known], maps[name][known], rtol=1e-3)
    page = (folder / "report.html").read_text()
    assert "standard error of sigma" in page


@pytest.mark.slow
def test_a_varying_sigma_renders_again(varying, tmp_path):
    """Prediction and rendering both go by the map: the photograph, to the noise."""
    capture, folder, _ = varying
    out = render_config(folder, tmp_path / "again")
    photograph, again = (read_image(p).pixels for p in (capture / "images/1.exr", out / "1.exr"))
    inside = photograph.sum(axis=-1) > 0.2 * photograph.max()
    predicted = read_image(folder / "images/1_predicted.exr").pixels
    for image in (again, predicted):
        assert np.median(np.abs(image[inside] / photograph[inside, :3] - 1)) < 1.5 * NOISE


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("solve.refine=off", "texture.sigma: varying is found on the integral"),
        (
            "brdf.sigma={fixed: 0.2}",
            "brdf.sigma.fixed: found 0.2, but texture.sigma: varying finds",
        ),
        (
            "brdf={model: lambertian}",
            "brdf.model: found 'lambertian', but texture.sigma: varying needs",
        ),
        ("solve.method=simplex", "is too much for the simplex"),
        ("texture.control_points=1", "control_points is 1, so sigma cannot vary"),
    ],
)
def test_what_a_varying_sigma_cannot_be_combined_with(ball, override, words):
    path = write_config(ball, "task: texture\ntexture: {sigma: varying}\n")
    with pytest.raises(InputError, match=words):
        load_run_config(path, [override])


def test_a_varying_sigma_needs_light(ball):
    path = write_config(ball, "task: texture\ntexture: {sigma: varying}\n", lighting="")
    with pytest.raises(InputError, match="or choose task: texture under known light"):
        load_run_config(path)


def test_what_is_left_is_said_and_nothing_is_named_where_nothing_is_wrong(found):
    _, result = found
    assert result["diagnosis"] == []
    assert result["residual"]["misfit"]["noise"] == pytest.approx(NOISE, rel=0.15)
    low, high = result["interval90"]["sigma"]
    exact_low, exact_high = result["interval90_if_exact"]["sigma"]
    assert low <= exact_low < exact_high <= high


GAINS = np.exp(0.08 * np.random.default_rng(1).normal(size=9))


def with_gains(ball, folder):
    """Copy a capture, and let its exposures differ."""
    shutil.copytree(ball, folder)
    for path, gain in zip(sorted((folder / "images").iterdir()), GAINS):
        image = read_image(path)
        colour = gain * image.pixels
        write_image(path, np.concatenate([colour, image.alpha[..., None]], axis=-1))
    return folder


@pytest.mark.slow
def test_exposures_that_differ_are_named(ball, tmp_path):
    capture = with_gains(ball, tmp_path / "capture")
    out, result = run(capture, TASK)
    assert result["outcome"] == "misfit"
    assert result["diagnosis"][0]["cause"] == "exposure"
    assert result["diagnosis"][0]["free"] == "solve.free: [exposure]"
    assert "exposures differ" in (out / "report.html").read_text(encoding="utf-8")
    names = arrays(out)
    assert (names["kd_error"] >= names["kd_exact_error"]).all()
    _, silent = run(capture, TASK, "solve.diagnose=false")
    assert silent["diagnosis"] == []
    assert silent["outcome"] == "misfit"


@pytest.mark.parametrize(
    ("paint", "text"),
    [
        pytest.param("ball", TASK.replace("refine: off", "free: auto"), marks=pytest.mark.slow),
        ("diffuse", DIFFUSE_TASK + "solve: {free: [exposure]}\n"),
    ],
)
def test_exposures_are_found_with_the_paint(paint, text, request, tmp_path):
    capture = with_gains(request.getfixturevalue(paint), tmp_path / "capture")
    folder, result = run(capture, text)
    assert result["outcome"] == "converged"
    exposure = np.array(result["calibration"]["nuisances"]["exposure"]["value"]) / 100
    np.testing.assert_allclose(
        exposure - exposure.mean(), np.log(GAINS) - np.log(GAINS).mean(), atol=0.01
    )
    # Predicted are the photographs as they were taken.
    photograph, predicted = (
        read_image(path).pixels
        for path in (capture / "images/2.exr", folder / "images/2_predicted.exr")
    )
    inside = photograph.sum(axis=-1) > 0.2 * photograph.max()
    assert np.median(predicted[inside] / photograph[inside]) == pytest.approx(1, abs=0.01)
    frames = json.loads((folder / "capture.json").read_text(encoding="utf-8"))["frames"]
    np.testing.assert_allclose([frame["exposure"] for frame in frames], np.exp(exposure))
    assert "What was freed" in (folder / "report.html").read_text(encoding="utf-8")


def test_what_a_texture_cannot_free_is_refused(ball):
    path = write_config(ball, "task: texture\n")
    with pytest.raises(InputError, match=r"solve\.free: blur cannot be freed"):
        load_run_config(path, ["solve.free=[exposure,blur]"])
    with pytest.raises(InputError, match=r"but texture\.regions has several"):
        load_run_config(path, ["solve.free=[exposure]", "texture.regions=mask.png"])
