"""``jaxrender prefilter``: what it writes, in whose axes, and what it refuses.

- A probe lit from one direction of its own: the coefficients are that direction's harmonics, in the
  order and the axes that the file states; ``--axes world`` turns them.
- The matrix and the maps agree with the coefficients; the cube is the map, seen face by face.
- A window lifts what a lobe sharper than the probe throws below zero, and is named in the file.
- Nothing is written for a wrong convention, an unknown model, a parameter out of range, or a probe
  that is too small; an identical run is reused.
"""

import json

import numpy as np
import OpenImageIO
import pytest

from jaxrender.cli import main
from jaxrender.harmonics import LatLongGrid, analyse, evaluate, explicit_basis
from jaxrender.io import read_image, write_image
from jaxrender.lighting.layouts import Cross


@pytest.fixture
def probe(tmp_path):
    """A cross of faces of 16 x 16 texels, uniform but for a source straight up (own +y)."""
    layout = Cross()
    directions = layout.directions(64)
    pixels = np.where(layout.covers(64), 0.2, 0.0)[..., None] * np.ones(3)
    pixels[directions[..., 1] > 0.97] = [40, 30, 20]
    write_image(tmp_path / "probe.hdr", pixels)
    return tmp_path / "probe.hdr"


def prefilter(probe, *arguments, out="out"):
    folder = probe.parent / out
    code = main(["prefilter", str(probe), "--out", str(folder), *arguments])
    return code, folder


def document_of(folder):
    return json.loads((folder / "irradiance.json").read_text())


def test_coefficients_are_in_the_probes_own_axes(probe):
    code, folder = prefilter(probe, "--convention", "cross", "--brdf", "lambertian")
    assert code == 0
    document = document_of(folder)
    assert document["convention"] == "cross"
    assert document["order"] == ["00", "1-1", "10", "11", "2-2", "2-1", "20", "21", "22"]
    found = np.array(document["coefficients"])
    up = np.asarray(explicit_basis(np.array([[0, 1.0, 0]])))[0]
    source = found - 0.2 * np.sqrt(4 * np.pi) * (np.arange(9) == 0)[:, None]
    # The source is 14 degrees wide, so degree 2 falls short of a point's by some percent.
    np.testing.assert_allclose(source / source[0], (up / up[0])[:, None] * np.ones(3), atol=0.1)
    assert source[1, 0] / source[1, 2] == pytest.approx(39.8 / 19.8, rel=0.01)


def test_world_axes_turn_the_probe_upright(probe):
    _, folder = prefilter(probe, "--convention", "cross", "--axes", "world", "--brdf", "lambertian")
    found = np.array(document_of(folder)["coefficients"])
    assert found[2, 0] > 10 * abs(found[1, 0])


def test_the_matrix_is_the_irradiance_map(probe):
    _, folder = prefilter(probe, "--convention", "cross", "--brdf", "lambertian")
    document, latlong = document_of(folder), read_image(folder / "lambertian.exr").pixels
    normals = LatLongGrid(*latlong.shape[:2]).directions()
    extended = np.concatenate([normals, np.ones_like(normals[..., :1])], -1)
    quadratic = np.einsum("rci,kij,rcj->rck", extended, np.array(document["matrix"]), extended)
    # The map has the degrees above 2 as well: under a source at most 9.4 % of its light.
    np.testing.assert_allclose(quadratic, latlong, atol=0.094 * latlong.max())


def test_the_cube_shows_the_same_map(probe):
    _, folder = prefilter(probe, "--convention", "cross", "--brdf", "phong:exponent=6")
    latlong = read_image(folder / "phong_exponent_6.exr").pixels
    cube = read_image(folder / "phong_exponent_6_cube.exr").pixels
    layout, height = Cross(), cube.shape[0]
    grid = LatLongGrid(*latlong.shape[:2])
    coefficients = analyse(grid, latlong, grid.band_limit)
    covered = layout.covers(height)
    expected = evaluate(coefficients, layout.directions(height)[covered])
    np.testing.assert_allclose(cube[covered], expected, atol=1e-4 * np.abs(cube).max())
    assert (folder / "contact_sheet.png").stat().st_size > 10_000


def test_a_window_takes_the_ringing_off(probe, capsys):
    """The 14 degrees of the source are as sharp as degree 15 of the probe."""
    lowest = {}
    for window in ("none", "minimal"):
        arguments = ("--convention", "cross", "--brdf", "mirror", "--window", window)
        code, folder = prefilter(probe, *arguments, out=window)
        assert code == 0
        # Our own reader refuses pixels below zero.
        pixels = OpenImageIO.ImageBuf(str(folder / "mirror.exr")).get_pixels(OpenImageIO.FLOAT)
        lowest[window] = pixels.min() / pixels.max()
    assert lowest["none"] < -0.02
    assert 0.5 * lowest["none"] < lowest["minimal"] < 0
    said = capsys.readouterr().err
    assert (
        "mirror: degree 15, lowest value -13 % of the peak; through the window minimal -3 %" in said
    )


def test_an_identical_run_is_reused(probe, capsys):
    arguments = ("--convention", "cross", "--brdf", "lambertian")
    prefilter(probe, *arguments)
    first = (probe.parent / "out" / "irradiance.json").stat().st_mtime_ns
    code, folder = prefilter(probe, *arguments)
    assert code == 0
    assert (folder / "irradiance.json").stat().st_mtime_ns == first
    assert "reused" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--convention", "crosss"), "unknown panorama convention 'crosss'"),
        (("--convention", "angular"), "wants 1:1"),
        (("--convention", "cross", "--brdf", "phongg"), "did you mean 'phong'?"),
        (("--convention", "cross", "--brdf", "phong:exponnt=3"), "did you mean 'exponent'?"),
        (
            ("--convention", "cross", "--brdf", "phong:exponent=-3"),
            "must lie in [0, inf)",
        ),
        (("--convention", "cross", "--brdf", "ward:roughness=.1,roughness_y=.2"), "anisotropic"),
        (("--convention", "cross", "--brdf", "microfacet:sigma=x"), "sigma is 'x'; give a number"),
        (("--window", "han"), "--window han: choose one of none, hann, lanczos, minimal"),
    ],
)
def test_bad_input_writes_nothing(probe, capsys, arguments, message):
    code, folder = prefilter(probe, *arguments)
    assert code == 2
    assert message in capsys.readouterr().err
    assert not folder.exists()


def test_a_probe_of_too_few_rows(tmp_path, capsys):
    write_image(tmp_path / "tiny.hdr", np.ones((2, 4, 3)))
    code, folder = prefilter(tmp_path / "tiny.hdr")
    assert code == 2
    assert "give a probe of 6 or more rows" in capsys.readouterr().err
    assert not folder.exists()
    code, folder = prefilter(tmp_path / "none.hdr")
    assert code == 2
    assert "none.hdr" in capsys.readouterr().err


def test_non_finite_probes_are_named(tmp_path, capsys):
    pixels = np.ones((16, 32, 3), np.float32)
    pixels[3, 5, 1] = np.nan
    (tmp_path / "probe.pfm").write_bytes(b"PF\n32 16\n-1.0\n" + pixels[::-1].tobytes())
    code, folder = prefilter(tmp_path / "probe.pfm")
    message = capsys.readouterr().err
    assert code == 2
    assert "probe.pfm" in message
    assert "the value is nan" in message
    assert not folder.exists()
