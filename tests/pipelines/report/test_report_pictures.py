"""The report's pictures, curves and words.

- Pictures are right: sign and scale of the residual, one exposure for all, Lambert's cosine on the
  sphere; circles lie where their sources are, with areas in proportion to energy.
- Curves are right: percentiles by exit angle; a source's energy by degree is E^2 (2l + 1) / 4 pi.
- Numbers of any kind become words.
"""

import base64
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from report_samples import (
    ONE_CODE,
    lambertian,
    source,
)

from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import SRGB
from jaxrender.inverse import KnownLight, Observations
from jaxrender.inverse.prepared_light import PreparedLight
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.pipelines.report import FramePictures
from jaxrender.pipelines.report.light import direction_discs, environment_map
from jaxrender.pipelines.report.material import spheres
from jaxrender.pipelines.report.photographs import gallery
from jaxrender.pipelines.report.residuals import binned, half_angles, normal_cells
from jaxrender.pipelines.report.spectra import energy_by_degree
from jaxrender.pipelines.report.wording import numbers, percent, seconds, shown
from jaxrender.spectra import light_coefficients


def pixels(uri):
    data = base64.b64decode(uri.removeprefix("data:image/png;base64,"))
    return np.asarray(Image.open(io.BytesIO(data))).astype(float)


def flat_frame(photograph, predicted):
    covered = np.ones((10, 12), bool)
    covered[:, :6] = False
    usable = covered.copy()
    usable[5:] = False
    fill = np.ones((10, 12, 3))
    return FramePictures("flat", photograph * fill, predicted * fill, usable, covered)


def test_the_residual_has_the_sign_of_photograph_less_prediction():
    # 4 % and -4 % of a mean radiance of 1; the scale ends at the next 1, 2 or 5 times 10^k.
    shown_ = gallery((flat_frame(1.04, 1.0), flat_frame(0.96, 1.0)))
    assert shown_.limit == 5
    brighter, darker = (pixels(frame.residual) for frame in shown_.frames)
    assert brighter[2, 6, 0] > brighter[2, 6, 2] + 50
    assert darker[2, 6, 2] > darker[2, 6, 0] + 50
    assert shown_.frames[0].rms == pytest.approx(0.04 / 1.04)


def test_the_residual_is_faint_where_unused_and_absent_where_uncovered():
    residual = pixels(gallery((flat_frame(1.04, 1.0),)).frames[0].residual)
    used, unused = residual[2, -1, 3], residual[8, -1, 3]
    assert used == 255
    assert 0 < unused < 128
    assert residual[2, 0, 3] == 0


def test_all_photographs_share_one_exposure():
    bright, dark = gallery((flat_frame(1.0, 1.0), flat_frame(0.25, 0.25))).frames
    linear = [
        SRGB().linearise(pixels(uri)[2, -1] / 255)
        for uri in (bright.photograph, dark.photograph, dark.predicted)
    ]
    np.testing.assert_allclose(linear[1] / linear[0], 0.25, atol=2 * ONE_CODE)
    np.testing.assert_array_equal(linear[1], linear[2])


def test_a_diffuse_sphere_follows_lamberts_cosine(light):
    contents = lambertian(light)
    picture = pixels(spheres(contents).source)
    linear = SRGB().linearise(picture[..., 0] / 255)
    size = len(linear)
    rows, columns = np.mgrid[:size, :size]
    x, y = (columns + 0.5) * 2 / size - 1, 1 - (rows + 0.5) * 2 / size
    inside = np.hypot(x, y) < 0.95
    z = np.sqrt(1 - np.where(inside, x**2 + y**2, 0))
    toward = np.array([-0.45, 0.55, 0.70])
    toward /= np.linalg.norm(toward)
    cosine = np.maximum(x * toward[0] + y * toward[1] + z * toward[2], 0)[inside]
    scale = linear[inside] @ cosine / (cosine @ cosine)
    np.testing.assert_allclose(linear[inside], scale * cosine, atol=2 * ONE_CODE)


def test_circles_lie_where_their_sources_are(light):
    given = DirectionalSources(
        np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 1.0]]), np.array([[4.0] * 3, [1.0] * 3])
    )
    own = KnownLight(Environment(np.ones((8, 16, 3))), given)
    first, second = environment_map(own, PreparedLight(None, None, None)).given
    # Azimuth and polar angle in degrees; area in proportion to energy.
    assert first[:2] == (90, 90)
    assert second[:2] == (180, 45)
    assert first.radius == pytest.approx(2 * second.radius)


def test_discs_are_equal_area_projections():
    own = KnownLight(
        None,
        DirectionalSources.none(),
        (source([0, 0, 1], 1), source([1, 0, 1], 4), source([0, 1, -1], 1)),
    )
    upper, lower = direction_discs(own)
    # The cap down to polar angle t has the share (1 - cos t) of the half sphere.
    ring = np.sqrt(1 - np.cos(np.pi / 4))
    np.testing.assert_allclose([c[:2] for c in upper.circles], [[0, 0], [ring, 0]], atol=1e-4)
    np.testing.assert_allclose(lower.circles[0][:2], [0, -ring], atol=1e-4)
    assert [c.label for c in upper.circles] == ["1", "2"]
    assert upper.circles[1].radius == pytest.approx(2 * upper.circles[0].radius, rel=1e-3)


def test_a_source_has_the_energy_of_the_addition_theorem():
    found = energy_by_degree(light_coefficients(source([1, 2, 3], 3), 6))
    np.testing.assert_allclose(found, 9 * (2 * np.arange(7) + 1) / (4 * np.pi), rtol=1e-12)


def test_percentiles_by_exit_angle():
    # One angle in each of the fourteen bins.
    angles = np.repeat(np.linspace(0, 65, 14), 101)
    values = np.tile(np.linspace(-1, 1, 101), 14) + angles
    bins = binned(angles, values[:, None])
    np.testing.assert_allclose(bins.angles, np.arange(0, 70, 5), atol=1e-9)
    np.testing.assert_allclose(bins.middle, bins.angles, atol=1e-9)
    np.testing.assert_allclose(bins.high - bins.low, 1.8, atol=1e-9)


def test_bins_with_few_samples_are_left_out():
    angles = np.concatenate([np.zeros(100), [80.0]])
    assert len(binned(angles, np.zeros((101, 1))).angles) == 1


def test_half_angles_are_to_the_nearest_source_that_a_sample_faces():
    # Seen along z.  The source at 60 degrees has its half vector at 30 degrees.
    towards = np.array([[np.sin(np.pi / 3), 0, np.cos(np.pi / 3)]])
    tilts = np.radians([30.0, 20.0, -45.0])
    normals = np.stack([np.sin(tilts), 0 * tilts, np.cos(tilts)], axis=1)
    outgoing = np.tile([0.0, 0.0, 1.0], (3, 1))
    samples = SurfaceSamples(normals, outgoing)
    seen = Observations(samples, np.ones((3, 3)), np.array([0, 0, 1]))
    one = KnownLight(None, DirectionalSources(towards, np.ones((1, 3))))
    # The third sample faces away from the source: 105 degrees.
    np.testing.assert_allclose(half_angles(seen, one), [0, 10, np.nan], atol=1e-6)
    beside = DirectionalSources(np.array([[0.0, 0.0, 1.0]]), np.ones((1, 3)))
    np.testing.assert_allclose(half_angles(seen, one, beside), [0, 10, 45], atol=1e-6)
    # Each photograph has its own.
    own = KnownLight(None, DirectionalSources.none(), (one.directional, beside))
    np.testing.assert_allclose(half_angles(seen, own), [0, 10, 45], atol=1e-6)
    sky = KnownLight(Environment(np.ones((4, 8, 3))), DirectionalSources.none())
    assert half_angles(seen, sky) is None


def test_cells_of_the_sphere_of_normals_lie_where_their_normals_point():
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(60_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    counts = [normal_cells(normals[:count], np.ones((count, 3))) for count in (60_000, 3)]
    # All cells have one area: each has about 200 of them.
    assert np.all(counts[0] == 1)
    assert np.all(np.isnan(counts[1]))
    heights = normal_cells(normals, normals[:, 2:])[:, 0]
    np.testing.assert_allclose(heights, 1 - (np.arange(12) + 0.5) / 6, atol=0.02)
    east = normal_cells(normals, (normals[:, 1:2] > 0).astype(float))
    assert np.all(east[:, :12] == 1)
    assert np.all(east[:, 12:] == 0)


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        (percent(0.1234), "12\u00a0%"),
        (percent(-0.00123, sign=True), "−0.12\u00a0%"),
        (percent(1e-7), "under 0.001\u00a0%"),
        (percent(0.0), "0.0\u00a0%"),
        (percent(None), "–"),
        (percent(float("inf")), "–"),
        (shown(0.19), "0.1900"),
        (shown(-1.23456e-5, 2), "−1.2\u202f×\u202f10⁻⁵"),
        (shown(0.0), "0"),
        (shown(True), "–"),
        (seconds(1e-5), "under 1 ms"),
        (seconds(250.4), "250 s"),
    ],
)
def test_numbers_as_words(written, expected):
    assert written == expected


def test_numbers_of_anything():
    assert numbers([[0.1, 2], None, "none", 3]) == [0.1, 2.0, 3.0]
    assert numbers(None) == []


def test_the_template_travels_with_the_package():
    folder = Path(__import__("jaxrender.pipelines.report", fromlist=["x"]).__file__).parent
    assert (folder / "report.html.j2").is_file()
    assert (folder / "report.css").is_file()
