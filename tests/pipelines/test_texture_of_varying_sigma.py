"""``task: texture`` with a sigma that varies over the ball.

- A sigma that varies over the ball is a map with errors, by which predictions and renderings go.
- The texture is found with it.
- What a varying sigma cannot be combined with is refused in words.
"""

import numpy as np
import pytest
from painted_captures import CHECKER, NOISE, texel_paint, write_config, write_painted
from small_captures import MU, SIGMA
from texture_runs import ROWS, arrays, off_photograph, run

from jaxrender.errors import InputError
from jaxrender.io import read_image
from jaxrender.pipelines import load_run_config

CHECKER_GROWING = CHECKER._replace(growth=0.25)
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
    assert off_photograph(capture, folder, tmp_path / "again") < 1.5 * NOISE


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
def test_what_a_varying_sigma_cannot_be_combined_with(tmp_path, override, words):
    path = write_config(tmp_path, "task: texture\ntexture: {sigma: varying}\n")
    with pytest.raises(InputError, match=words):
        load_run_config(path, [override])


def test_a_varying_sigma_needs_light(tmp_path):
    path = write_config(tmp_path, "task: texture\ntexture: {sigma: varying}\n", lighting="")
    with pytest.raises(InputError, match="or choose task: texture under known light"):
        load_run_config(path)
