"""Pinned down: light from photographs of a mirror ball, by the command and from Python.

The photographs are traced ray by ray, stored in 8 bits through the display's response with noise.

- Several views at several exposures: the light to degree 10 within 2 %, a lamp within 0.3 degrees
  and its irradiance, though it saturates all but the shortest exposure.
- One distant view: what it cannot see is filled, and said.
- What saturates everywhere is a lower bound, and said.
- The folder appears whole, is reused, and is not replaced by another's without force.
- A wrong exposure is said, and replaced on request; a camera that moved is refused, or moved back.
- What is missing is named with the option that gives it.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "lighting"))
from ball_photographs import cameras, photographed

from jaxrender.cli import main
from jaxrender.errors import InputError
from jaxrender.geometry import Orthographic
from jaxrender.harmonics import LatLongGrid
from jaxrender.imaging import SRGB
from jaxrender.io import Capture, Frame, read_curve, read_image, write_capture, write_image
from jaxrender.lighting import Environment, SmoothLobes
from jaxrender.pipelines.light_probe import ProbeOptions, light_probe
from jaxrender.pipelines.probe_views import Reading
from jaxrender.spectra import light_coefficients

LAMP, WIDTH = np.array([0.36, -0.48, 0.8]), np.radians(4.0)
RANDOM = np.random.default_rng(0)
MIDDLES = RANDOM.normal(size=(12, 3))
MIDDLES /= np.linalg.norm(MIDDLES, axis=1, keepdims=True)
LIGHT = SmoothLobes(
    np.concatenate([MIDDLES, LAMP[None]]),
    np.append(np.radians(RANDOM.uniform(25, 60, 12)), WIDTH),
    np.concatenate([RANDOM.uniform(0.1, 0.5, (12, 3)), [[20.0, 16.0, 12.0]]]),
)
# The integral of exp(-(1 - cos) / q) over the sphere is 2 pi q, q = 1 - cos width.
IRRADIANCE = 2 * np.pi * (1 - np.cos(WIDTH)) * np.array([20.0, 16.0, 12.0])
EXPOSURES = (1.0, 0.25, 0.05)
REFLECTANCE, ROWS = 0.65, 48


def radiance_of(directions):
    found = np.asarray(LIGHT.radiance(directions.reshape(-1, 3)))
    return REFLECTANCE * found.reshape(*directions.shape[:-1], 3)


def stored(radiance, exposure, rng):
    linear = exposure * radiance
    linear = linear + np.sqrt(2.5e-5 * linear + 2.5e-7) * rng.normal(size=linear.shape)
    return SRGB().encode(np.clip(linear, 0, 1)).clip(0, 1)


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """Three views, each at three exposures, with masks."""
    folder, rng, frames = tmp_path_factory.mktemp("ball"), np.random.default_rng(1), []
    for number, camera in enumerate(cameras(size=110, focal=260.0)):
        picture, coverage = photographed(camera, radiance_of)
        mask = folder / f"mask{number}.png"
        write_image(mask, coverage[..., None])
        for exposure in EXPOSURES:
            path = folder / f"view{number}_{exposure}.png"
            write_image(path, stored(picture, exposure, rng))
            frames.append(Frame(path.stem, camera, path, mask, exposure))
    write_capture(folder / "transforms.json", Capture(tuple(frames), folder / "transforms.json"))
    return folder


@pytest.fixture(scope="module")
def probe(capture, tmp_path_factory):
    out = tmp_path_factory.mktemp("probe") / "probe"
    options = ProbeOptions(Reading("srgb"), height=ROWS)
    done = light_probe([capture / "transforms.json"], out, options)
    return out, json.loads((out / "light.json").read_text()), done


def truth():
    fine = radiance_of(LatLongGrid(4 * ROWS, 8 * ROWS).directions()) / REFLECTANCE
    return fine.reshape(ROWS, 4, 2 * ROWS, 4, 3).mean(axis=(1, 3))


def test_several_views(probe):
    out, about, done = probe
    radiance = read_image(out / "probe.exr").pixels
    own, true = (
        np.asarray(light_coefficients(Environment(np.array(one, float)), 10))
        for one in (radiance, truth())
    )
    assert np.linalg.norm(own - true) / np.linalg.norm(true) < 0.02
    assert about["convention"] == "z-up"
    assert about["disagreement_of_views"] < 0.05
    assert about["filled_part"] == about["saturated_part"] == 0
    assert [len(view["photographs"]) for view in about["views"]] == [3, 3, 3]
    assert "3 views, which disagree by" in done.lines[1]
    for name in ("deviation.exr", "confidence.exr", "light.png"):
        assert (out / name).stat().st_size > 0
    assert not (out / "response.txt").exists()


def test_the_lamp(probe):
    lamp = probe[1]["lamps"][0]
    assert np.array(lamp["direction"]) @ LAMP > np.cos(np.radians(0.3))
    # What the slow part takes of it is little.
    np.testing.assert_allclose(lamp["irradiance"], IRRADIANCE, rtol=0.1)
    assert any(line.startswith("lamp 1: direction (0.3") for line in probe[2].lines)


def test_deviations_are_of_the_size_of_the_errors(probe):
    radiance, deviation = (
        read_image(probe[0] / name).pixels for name in ("probe.exr", "deviation.exr")
    )
    confidence = read_image(probe[0] / "confidence.exr").pixels[..., 0]
    calm = LatLongGrid(ROWS, 2 * ROWS).directions() @ LAMP < np.cos(np.radians(20))
    calm &= confidence > 0.6
    scaled = np.abs(radiance - truth())[calm] / deviation[calm]
    assert 0.3 < np.median(scaled) / 0.6745 < 1.5


@pytest.fixture(scope="module")
def one_view(tmp_path_factory):
    """A distant camera that looks along +Y, at three exposures."""
    folder, rng = tmp_path_factory.mktemp("view"), np.random.default_rng(2)
    rows, columns = np.meshgrid(np.arange(240) + 0.5, np.arange(240) + 0.5, indexing="ij")
    x, z = (columns - 125) / 90, (118 - rows) / 90
    on = x**2 + z**2 < 1
    y = -np.sqrt(np.where(on, 1 - x**2 - z**2, 1))
    normals = np.stack([x, y, z], axis=-1)
    mirrored = np.array([0.0, 1, 0]) - 2 * y[..., None] * normals
    picture = np.where(on[..., None], radiance_of(mirrored), 0.3)
    # One pixel of each block of 2 x 2 would do; their mean is what a camera sees.
    picture = picture.reshape(120, 2, 120, 2, 3).mean(axis=(1, 3))
    paths = []
    for exposure in EXPOSURES:
        paths.append(folder / f"{exposure}.png")
        write_image(paths[-1], stored(picture, exposure, rng))
    return paths


BALL = ["--ball", "59", "62.5", "45"]


def command(paths, out, *options):
    times = [w for t in EXPOSURES[: len(paths)] for w in ("--exposures", str(t))]
    return main(["light", *map(str, paths), "--out", str(out), *BALL, *times, *options])


def test_one_view_by_the_command(one_view, tmp_path, capsys):
    out = tmp_path / "probe"
    assert command(one_view, out) == 0
    said = capsys.readouterr().out
    assert "the response was recovered: one curve" in said
    assert "% of all directions were not seen: filled" in said
    about = json.loads((out / "light.json").read_text())
    # Behind the ball, from the rim's outermost pixel on, and around the camera.
    behind = np.pi - 2 * np.arcsin(44 / 45)
    expected = (1 - np.cos(behind) + 1 - np.cos(np.radians(5))) / 2
    assert about["filled_part"] == pytest.approx(expected, rel=0.15)
    lamp = np.array(about["lamps"][0]["direction"])
    assert lamp @ LAMP > np.cos(np.radians(0.5))
    curve = read_curve(out / "response.txt")
    at = np.array([0.1, 0.4, 0.8])
    np.testing.assert_allclose(curve.linearise(at), SRGB().linearise(at), rtol=0.05)
    # The same once more is reused, another is refused.
    assert command(one_view, out) == 0
    assert "made before; reused" in capsys.readouterr().err
    assert command(one_view, out, "--reflectance", "0.9") == 2
    assert "another run" in capsys.readouterr().err


def test_what_saturates_is_a_lower_bound(one_view, tmp_path, capsys):
    out = tmp_path / "probe"
    assert command(one_view[:1], out, "--response", "srgb") == 0
    assert "their light is a lower bound; add a shorter exposure" in capsys.readouterr().out
    about = json.loads((out / "light.json").read_text())
    assert 0 < about["saturated_part"] < 0.1
    radiance, deviation = (read_image(out / f"{n}.exr").pixels for n in ("probe", "deviation"))
    directions = LatLongGrid(*radiance.shape[:2]).directions()
    lit = directions @ LAMP > np.cos(np.radians(4))
    assert radiance[lit].max() < 2 / REFLECTANCE
    np.testing.assert_array_equal(deviation[lit], radiance[lit])
    assert deviation[directions @ LAMP < 0.5].max() < 0.2 * radiance[lit].max()


def off_but_for_scale(found, expected):
    """Compute the rms of what a factor does not explain, relative to what is expected."""
    scale = found @ expected / (found @ found)
    return np.linalg.norm(scale * found - expected) / np.linalg.norm(expected)


def test_exposures_that_lie(one_view, tmp_path, capsys):
    wrong = [w for t in (1.0, 0.5, 0.05) for w in ("--exposures", str(t))]
    start = ["light", *map(str, one_view), *BALL, *wrong, "--response", "srgb"]
    assert main([*start, "--out", str(tmp_path / "a")]) == 0
    assert "the pixels contradict the stated exposures (0.25.png" in capsys.readouterr().err
    assert main([*start, "--out", str(tmp_path / "b"), "--exposure", "measured"]) == 0
    found = json.loads((tmp_path / "b" / "light.json").read_text())["views"][0]["exposures"]
    assert found[1] / found[0] == pytest.approx(0.25, rel=0.02)
    # The light is that of the true exposures, but for its scale, which no pixel tells.
    true = [w for t in (1.0, 0.25, 0.05) for w in ("--exposures", str(t))]
    start = ["light", *map(str, one_view), *BALL, *true, "--response", "srgb"]
    assert main([*start, "--out", str(tmp_path / "c")]) == 0
    wrong, measured, right = (
        read_image(tmp_path / name / "probe.exr").pixels.ravel() for name in "abc"
    )
    assert off_but_for_scale(measured, right) < 0.02 < 0.05 < off_but_for_scale(wrong, right)


def test_a_camera_that_moved(one_view, tmp_path, capsys):
    moved = tmp_path / "moved.png"
    write_image(moved, np.roll(read_image(one_view[1]).pixels, (3, 0), axis=(0, 1)))
    paths = [one_view[0], moved, one_view[2]]
    assert command(paths, tmp_path / "a", "--response", "srgb") == 2
    assert "moved.png: the picture lies 3.0" in capsys.readouterr().err
    assert command(paths, tmp_path / "b", "--response", "srgb", "--align") == 0
    shifts = json.loads((tmp_path / "b" / "light.json").read_text())["views"][0]
    assert shifts["shifts_in_pixels"][1][0] == pytest.approx(3, abs=0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (ProbeOptions(Reading("linear"), ball=(59, 62, -1)), "the radius is -1"),
        (ProbeOptions(Reading("linear"), ball=(59, 62, 9)), "radius is 9 pixels"),
        (ProbeOptions(reflectance=0.0), "--reflectance is 0"),
        (ProbeOptions(sigma=2.0), "--sigma is 2"),
        (ProbeOptions(camera_angle=90.0), "--camera-angle is 90"),
        (ProbeOptions(height=3), "--height is 3"),
        (ProbeOptions(ball=(1, 1, 1), mask=Path("a")), "give one of them"),
        (ProbeOptions(Reading(exposures=(1.0,))), "1 exposures for 3 photographs"),
        (ProbeOptions(Reading("nope.txt")), "no such file"),
    ],
)
def test_what_is_missing_is_named(one_view, tmp_path, options, message):
    if options.reading.exposures is None:
        options = options._replace(reading=options.reading._replace(exposures=EXPOSURES))
    with pytest.raises(InputError, match=message):
        light_probe(one_view, tmp_path / "probe", options)
    assert not (tmp_path / "probe").exists()


def test_the_ball_is_found_by_its_edges(one_view, tmp_path):
    reading = Reading("srgb", exposures=EXPOSURES)
    done = light_probe(one_view, tmp_path / "probe", ProbeOptions(reading, height=24))
    about = json.loads((tmp_path / "probe/light.json").read_text())
    assert about["views"][0]["ball"]["row"] == pytest.approx(59, abs=0.5)
    assert about["views"][0]["ball"]["column"] == pytest.approx(62.5, abs=0.5)
    assert any("the ball was found by its edges, at row " in line for line in done.lines)
    write_image(tmp_path / "even.exr", np.full((60, 60, 3), 0.4))
    with pytest.raises(InputError, match=r"where is the ball.* give --ball ROW COLUMN RADIUS"):
        light_probe([tmp_path / "even.exr"], tmp_path / "none")


def test_photographs_that_need_more(one_view, tmp_path):
    with pytest.raises(InputError, match="no exposure time in its metadata; give --exposures"):
        light_probe(one_view, tmp_path / "probe")
    with pytest.raises(InputError, match="give --response linear, srgb or the file of a curve"):
        light_probe(one_view[:1], tmp_path / "probe", ProbeOptions(ball=(59.0, 62.5, 45.0)))
    with pytest.raises(InputError, match="no photographs"):
        light_probe([], tmp_path / "probe")


def test_a_picture_of_radiance(tmp_path):
    camera = Orthographic(80, 80, np.eye(4), scale=1.0)
    directions = camera.rays().directions + 0.5
    write_image(tmp_path / "ball.exr", np.abs(directions))
    options = ProbeOptions(ball=(40.0, 40.0, 32.0))
    done = light_probe([tmp_path / "ball.exr"], tmp_path / "probe", options)
    assert "noise is taken for 1 %" in done.lines[0]
    about = json.loads((tmp_path / "probe" / "light.json").read_text())
    assert about["views"][0]["ball"] == {"row": 40.0, "column": 40.0, "found": "as stated"}
