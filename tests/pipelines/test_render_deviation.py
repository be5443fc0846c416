"""Standard deviations beside what a result renders: J C J' of the parameters' full covariance.

- Monte Carlo: materials drawn from the covariance, rendered by T 6.2 in plain NumPy, scatter as the
  map says, to the sampling error; ignoring how the errors go together would not.
- The covariance of a result has the standard errors of its parameters on the diagonal.
- Gain and scale enter as factors (against finite differences); a view of its own has no gain.
- A result without a covariance renders, and says what is missing.
"""

import shutil
from unittest import mock

import h5netcdf
import numpy as np
import pytest
import small_captures
from small_captures import MOVING, Ball, cameras, jaxrender, moving_light, read_result

from jaxrender.geometry import observe
from jaxrender.io import read_image
from jaxrender.io.netcdf import Group, write
from jaxrender.pipelines.deviation import MaterialCovariance, image_deviation, read_covariance
from jaxrender.pipelines.render import render_config
from jaxrender.pipelines.result import ARRAYS_FORMAT

DRAWS = 400


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    return moving_light(tmp_path_factory) / "out"


@pytest.fixture(scope="module")
def rendered(finished, tmp_path_factory):
    return render_config(finished, tmp_path_factory.mktemp("rendered") / "again")


def values_of(result):
    brdf = result["brdf"]
    return np.array([*brdf["kd"], brdf["ks"], brdf["ks"], brdf["ks"], brdf["mu"], brdf["sigma"]])


def test_the_diagonal_are_the_standard_errors(finished):
    covariance, error = read_covariance(finished / "result.nc"), read_result(finished)
    error = error["standard_error"]
    found = np.sqrt(np.diag(covariance.matrix))
    expected = [*error["kd"], *3 * [error["ks"]], error["mu"], error["sigma"]]
    np.testing.assert_allclose(found[:8], expected, rtol=1e-9)
    with h5netcdf.File(finished / "result.nc") as file:
        names = file["covariance"].attrs["numbers"].split()
    assert names[:8] == ["kd[0]", "kd[1]", "kd[2]", "ks[0]", "ks[1]", "ks[2]", "mu", "sigma"]


def test_materials_drawn_from_the_covariance_scatter_as_the_map_says(finished, rendered):
    rng = np.random.default_rng(0)
    matrix = read_covariance(finished / "result.nc").matrix[:8, :8]
    draws = rng.multivariate_normal(values_of(read_result(finished)), matrix, DRAWS)
    frame = 1
    view = observe(cameras(Ball())[frame], small_captures.UNIT_BALL)
    # Grazing pixels are many times as bright: the linear map is judged where the rest is.
    used = view.exit_cosines > 0.3
    images = []
    for draw in draws:
        with mock.patch.multiple(
            small_captures, KD=tuple(draw[:3]), KS=draw[3], MU=draw[6], SIGMA=draw[7]
        ):
            arguments = view.normals[used], view.outgoing[used], MOVING[frame]
            images.append(small_captures.reflected(*arguments))
    scatter = np.std(images, axis=0)
    said = read_image(rendered / f"{frame}_deviation.exr").pixels[used]
    lit = scatter > 0.05 * scatter.max()
    # 400 draws tell a standard deviation to 3.5 %, the same draws for all pixels.
    ratio = said[lit] / scatter[lit]
    assert np.median(ratio) == pytest.approx(1, abs=0.08)
    assert np.percentile(np.abs(ratio - 1), 90) < 0.15
    alone = np.sqrt(np.diag(matrix))
    loose = rng.normal(values_of(read_result(finished)), alone, (DRAWS, 8))[:, :3]
    # kd's own error without the lobe that makes up for it is not what a diffuse pixel scatters by.
    assert np.std(loose, axis=0) == pytest.approx(alone[:3], rel=0.15)


def test_what_is_not_hit_has_no_deviation(rendered):
    for number in range(4):
        image = read_image(rendered / f"{number}.exr")
        deviation = read_image(rendered / f"{number}_deviation.exr").pixels
        assert not deviation[image.alpha < 0.5].any()
        assert (deviation[image.alpha > 0.5] >= 0).all()
        assert deviation.max() < 0.2 * image.pixels.max()


def test_gain_and_scale_are_factors():
    rng = np.random.default_rng(1)
    channels, gains, amounts = 3, 2, ("kd", "ks")
    root = rng.normal(size=(2 * channels + 3 + gains, 2 * channels + 3 + gains))
    amplitudes = [f"{name}[{k}]" for name in amounts for k in range(channels)]
    names = (*amplitudes, "sigma", "mu", "gains[0]", "gains[1]", "scale")
    covariance = MaterialCovariance(root @ root.T, channels, names)
    values = rng.uniform(0.5, 1.5, len(root))
    diffuse, specular, by_sigma, by_mu = rng.uniform(0.2, 1, (4, 5, channels))

    def image(v):
        kd, ks, sigma, mu = v[:3], v[3:6], v[6] - values[6], v[7] - values[7]
        return v[9] * v[10] * (kd * diffuse + ks * (specular + sigma * by_sigma + mu * by_mu))

    step = 1e-6
    slopes = [
        (image(values + step * e) - image(values - step * e)) / (2 * step) for e in np.eye(11)
    ]
    jacobian = np.stack(slopes, axis=-1)
    expected = np.sqrt(np.einsum("pci,ij,pcj->pc", jacobian, covariance.matrix, jacobian))
    ks = values[3:6]
    parts = np.stack([diffuse, specular, ks * by_sigma, ks * by_mu], axis=1)
    radiance = values[:3] * diffuse + ks * specular
    found = image_deviation(
        covariance.of_frame(1, amounts, ("sigma", "mu")), parts, radiance, values[9], values[10]
    )
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    elsewhere = covariance.of_frame(None, amounts, ("sigma", "mu"))
    assert not elsewhere[:, 4].any()
    assert elsewhere[:, 5, 5] == pytest.approx(covariance.matrix[-1, -1])


def test_a_result_without_covariance_renders_and_says_so(finished, tmp_path, capsys):
    shutil.copytree(finished, tmp_path / "out")
    write(tmp_path / "out/result.nc", ARRAYS_FORMAT, Group())
    assert jaxrender("render", tmp_path / "out", "--out", tmp_path / "again") == 0
    assert "no standard deviations: the result has no covariance" in capsys.readouterr().err
    assert not list((tmp_path / "again").glob("*_deviation.exr"))
