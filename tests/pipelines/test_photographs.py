"""Photographs into observations: every pixel is radiance, or is left out and accounted for.

- Response, exposure factors and exposure metadata give back the radiance that was photographed.
- Silhouettes, edges of the object, alpha, masks, saturation, black level, broken pixels and grazing
  views are left out; the account adds up.
- Cameras that see nothing, and photographs without usable pixels, are skipped with a warning.
- A camera that stays where it was sees the same surface: it is traced once.
- Where photographs are clipped is found by itself (`auto`) and said; what rounding to integers adds
  is known.
- Integer pictures need a stated response; a measured curve must cover what is used, and no more.
"""

import json

import numpy as np
import pytest
import trimesh
from small_captures import Ball, edit_json, write_ball

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Sphere, contours
from jaxrender.imaging import SRGB, dilate, erode, response_named
from jaxrender.inverse import photographs as photographs_module
from jaxrender.inverse.photographs import (
    Listener,
    observations_of,
    read_photographs,
    trace_photographs,
)
from jaxrender.io import read_image, write_image
from jaxrender.pipelines.captures import capture_of, reading_of
from jaxrender.pipelines.config import RunConfig

BALL = Sphere(np.zeros(3), 1.0)
# A half step of 8 bits, through the steepest part of the sRGB curve (slope 2.3 at 1).
HALF_STEP = 0.5 / 255 * 2.3
# EXR holds float32.
FLOAT32 = 1e-6
# Below the ball, looking down.
LOOKING_AWAY = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -50], [0, 0, 0, 1]]


@pytest.fixture
def capture(tmp_path):
    """Three photographs of 24 x 24 pixels without noise."""
    write_ball(tmp_path / "capture", Ball(views=3, size=24, noise=0))
    return tmp_path / "capture"


def load(folder, min_cosine=0.15, shape=BALL, **given):
    capture = {"transforms": folder / "transforms.json", "geometry": {"sphere": {}}, **given}
    config = RunConfig.model_validate({"task": "factorize", "capture": capture})
    said, frames, reading = [], capture_of(config.capture), reading_of(config.capture, min_cosine)
    listener = Listener(said.append)
    images = read_photographs(frames, reading, listener)
    return trace_photographs(frames, images, shape, reading, listener), said


def truth(folder, number):
    """The radiance that photograph ``number`` was written with, and its coverage."""
    image = read_image(folder / f"images/{number}.exr")
    return image.pixels, image.alpha > 0.5


def change_frame(folder, number, **keys):
    edit_json(folder / "transforms.json", lambda content: content["frames"][number].update(keys))


def test_photographs_are_read_as_radiance(capture):
    photographs, said = load(capture)
    assert [photograph.frame.name for photograph in photographs] == ["0", "1", "2"]
    for number, photograph in enumerate(photographs):
        radiance, covered = truth(capture, number)
        np.testing.assert_allclose(photograph.radiance, radiance, atol=FLOAT32)
        np.testing.assert_array_equal(photograph.covered, covered)
    assert said == []


def test_the_account_adds_up(capture):
    for photograph in load(capture, min_cosine=0.8)[0]:
        selection = photograph.selection
        assert selection.considered == photograph.view.hit.sum()
        assert selection.considered == selection.usable.sum() + sum(selection.removed.values())
        assert selection.removed["silhouette"] > 0
        assert selection.removed["grazing"] > 0
        assert (photograph.view.exit_cosines[selection.usable] >= 0.8).all()
        inside = erode(photograph.covered, 2)
        assert not (selection.usable & ~inside).any()
        # A ball has none but its rim.
        assert selection.removed["contour"] == 0


def test_erosion_may_be_turned_off(capture):
    photograph = load(capture, erode=0)[0][0]
    assert photograph.selection.removed["silhouette"] == 0


def test_pixels_along_the_edges_of_the_object_are_left_out(capture):
    """A cube within the picture of the ball, so that no silhouette is near."""
    box = trimesh.creation.box((0.8, 0.8, 0.8))
    box.unmerge_vertices()
    cube = Mesh(np.asarray(box.vertices), np.asarray(box.faces), box.vertex_normals)
    removed = []
    for erosion in (0, 1, 3):
        photograph = load(capture, shape=cube, erode=erosion)[0][0]
        edges = contours(photograph.view)
        inner = edges & erode(photograph.view.hit, 1)
        near = dilate(inner, erosion - 1) if erosion else np.zeros_like(edges)
        assert not np.any(photograph.selection.usable & near)
        removed.append(photograph.selection.removed["contour"])
    assert removed[0] == 0
    assert removed[1] > 0


def test_given_exposures_are_divided_out(capture):
    radiance, _ = truth(capture, 1)
    alpha = read_image(capture / "images/1.exr").alpha
    write_image(capture / "images/1.exr", np.concatenate([4 * radiance, alpha[..., None]], axis=-1))
    change_frame(capture, 1, exposure=4)
    photographs, _ = load(capture)
    np.testing.assert_allclose(photographs[1].radiance, radiance, atol=4 * FLOAT32)


def test_exposures_from_metadata(capture, monkeypatch):
    read = read_image

    def with_exposure(path, invalid="refuse", **given):
        image = read(path, invalid, **given)
        return image._replace(metadata={**image.metadata, "exposure_time": 0.25})

    monkeypatch.setattr("jaxrender.io.captures.capture.read_image", with_exposure)
    photographs, _ = load(capture, exposure="metadata")
    np.testing.assert_allclose(photographs[0].radiance, 4 * truth(capture, 0)[0], atol=FLOAT32)
    # Not asked for, not used.
    photographs, _ = load(capture)
    np.testing.assert_allclose(photographs[0].radiance, truth(capture, 0)[0], atol=FLOAT32)


def test_exposures_missing_from_metadata(capture):
    with pytest.raises(InputError, match=r"0\.exr: no exposure time in its metadata; give"):
        load(capture, exposure="metadata")


def to_png(folder, number, factor, opaque=False):
    """Replace an EXR by an 8-bit sRGB picture, exposed ``factor`` times as long; clips at 1."""
    radiance, covered = truth(folder, number)
    values = SRGB().encode(factor * radiance).clip(0, 1)
    alpha = np.ones_like(covered) if opaque else covered
    write_image(
        folder / f"images/{number}.png", np.concatenate([values, alpha[..., None]], axis=-1)
    )
    change_frame(folder, number, file_path=f"images/{number}.png", exposure=factor)
    return factor * radiance, covered


@pytest.mark.parametrize("opaque", [False, True])
def test_8_bit_pictures_with_saturation(capture, opaque):
    brightest = truth(capture, 0)[0].max()
    exposed, covered = to_png(capture, 0, 1.6 / brightest, opaque)
    photograph = load(capture, response="srgb")[0][0]
    usable = photograph.selection.usable
    np.testing.assert_array_equal(photograph.covered, covered)
    assert photograph.selection.removed["saturated"] > 5
    assert usable.sum() > 50
    # Nothing that clipped is used, and what is used is the radiance to half a step.
    assert exposed[usable].max() < 1
    found = photograph.radiance[usable] * 1.6 / brightest
    np.testing.assert_allclose(found, exposed[usable], atol=HALF_STEP)


def test_saturation_is_found(capture):
    radiance, covered = truth(capture, 0)
    level = float(np.quantile(radiance[covered].max(axis=-1), 0.9))
    pixels = np.concatenate([np.minimum(radiance, level), covered[..., None]], axis=-1)
    write_image(capture / "images/0.exr", pixels)
    photographs, said = load(capture, saturation="auto")
    assert not (photographs[0].selection.usable & (radiance >= level).any(axis=-1)).any()
    assert photographs[0].selection.removed["saturated"] > 20
    assert photographs[1].selection.removed["saturated"] == 0
    assert said[0].endswith(
        f"pixels from the value {level:.4g} on are left out, in 1 of 3 photographs"
    )
    assert np.isinf(load(capture)[0][0].saturation).all()


def test_full_scale_of_integers_is_left_out_by_auto_as_well(capture):
    to_png(capture, 0, 1.6 / truth(capture, 0)[0].max())
    removed = [
        load(capture, response="srgb", **given)[0][0].selection.removed["saturated"]
        for given in ({}, {"saturation": "auto"})
    ]
    assert removed[0] == removed[1] > 5


@pytest.mark.parametrize("response", ["srgb", "linear"])
def test_rounding_is_known(capture, response):
    """Decoded values lie as far from the truth, in the usual pixel, as is said."""
    radiance, _ = truth(capture, 0)
    factor = 0.9 / radiance.max()
    stored = response_named(response).encode(factor * radiance).clip(0, 1)
    write_image(capture / "images/0.png", stored)
    change_frame(capture, 0, file_path="images/0.png", exposure=factor)
    photograph = load(capture, response=response)[0][0]
    usable = photograph.selection.usable
    off = np.abs(photograph.radiance - radiance)[usable]
    # Of errors that are even between two bounds, half are below sqrt(12) / 4 deviations.
    assert photograph.rounding == pytest.approx(np.median(off) * 4 / 12**0.5, rel=0.25)
    assert observations_of([photograph]).rounding == pytest.approx(photograph.rounding)
    assert load(capture, response=response)[0][1].rounding == 0


def test_integer_pictures_need_a_stated_response(capture):
    to_png(capture, 0, 1.0)
    with pytest.raises(InputError, match=r"0\.png: integer pixel .* state capture\.response: srgb"):
        load(capture)
    load(capture, response="linear")


def test_saturation_and_black_level_are_in_pixel_values(capture):
    radiance, covered = truth(capture, 0)
    level = float(np.quantile(radiance[covered].max(axis=-1), 0.9))
    low = float(np.quantile(radiance[covered].min(axis=-1), 0.3))
    change_frame(capture, 0, exposure=100.0)
    photograph = load(capture, saturation=level, black_level=low)[0][0]
    usable = photograph.selection.usable
    assert photograph.selection.removed["saturated"] > 0
    assert photograph.selection.removed["black"] > 0
    assert radiance[usable].max() < level
    assert radiance[usable].min() >= low


def test_masks_leave_pixels_out(capture):
    half = np.zeros((24, 24, 3))
    half[:, :12] = 1
    write_image(capture / "mask.png", half)
    change_frame(capture, 1, mask_path="mask.png")
    photographs, _ = load(capture)
    covered = truth(capture, 1)[1]
    np.testing.assert_array_equal(photographs[1].covered, covered & (half[..., 0] > 0.5))
    assert not photographs[1].selection.usable[:, 10:].any()
    assert photographs[0].selection.usable[:, 12:].any()


def test_broken_pixels_are_masked_and_counted(capture):
    picture = read_image(capture / "images/2.exr")
    row, column = 12, 11
    pixels = np.concatenate([picture.pixels, picture.alpha[..., None]], axis=-1)
    pixels[row, column, 1] = -1
    write_image(capture / "images/2.exr", pixels)
    photographs, said = load(capture, invalid="mask")
    assert photographs[2].selection.removed["silhouette"] > 0
    assert not photographs[2].selection.usable[row, column]
    assert len(said) == 1
    assert said[0].endswith("2.exr: masked 1 of 576 pixels that are negative or not finite")
    with pytest.raises(InputError, match=r"2\.exr: channel G, pixel \(row 12, column 11\)"):
        load(capture)


def test_a_camera_that_sees_nothing_is_skipped(capture):
    change_frame(capture, 1, transform_matrix=LOOKING_AWAY)
    photographs, said = load(capture)
    assert [photograph.frame.name for photograph in photographs] == ["0", "2"]
    assert len(said) == 1
    assert "1.exr: warning: its camera does not see the object; skipped" in said[0]
    observations = observations_of(photographs)
    assert set(observations.frame.tolist()) == {0, 1}


def test_a_camera_that_stays_is_traced_once(capture, monkeypatch):
    asked, own = [], photographs_module.observe
    monkeypatch.setattr(
        photographs_module, "observe", lambda *told: asked.append(told) or own(*told)
    )
    load(capture)
    assert len(asked) == 3
    pose = json.loads((capture / "transforms.json").read_text())["frames"][0]["transform_matrix"]
    change_frame(capture, 1, transform_matrix=pose)
    asked.clear()
    first, second, third = (photograph.view.normals for photograph in load(capture)[0])
    assert len(asked) == 2
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(second, third)


def test_a_photograph_without_usable_pixels_is_skipped(capture):
    write_image(capture / "mask.png", np.zeros((24, 24, 3)))
    change_frame(capture, 0, mask_path="mask.png")
    photographs, said = load(capture)
    assert [photograph.frame.name for photograph in photographs] == ["1", "2"]
    assert "0.exr: warning: no pixel is usable (removed: silhouette" in said[0]


def test_no_usable_pixel_at_all_is_refused_with_the_account(capture):
    with pytest.raises(
        InputError, match=r"no pixel is usable; removed: silhouette \d+, black \d+; loosen"
    ):
        load(capture, black_level=1e9)


def test_a_measured_curve(capture):
    (capture / "curve.txt").write_text("# value radiance\n0 0\n0.5 1\n1 4\n")
    photograph = load(capture, response={"curve": capture / "curve.txt"})[0][0]
    radiance, covered = truth(capture, 0)
    np.testing.assert_allclose(
        photograph.radiance[covered],
        np.interp(radiance[covered], [0, 0.5, 1], [0, 1, 4]),
        atol=4 * FLOAT32,
    )


def test_a_curve_must_cover_what_is_used_and_no_more(capture):
    radiance, covered = truth(capture, 0)
    low = float(np.quantile(radiance[covered].min(axis=-1), 0.3))
    (capture / "curve.txt").write_text(f"{low} 0.1\n2 3\n")
    curve = {"curve": capture / "curve.txt"}
    with pytest.raises(
        InputError,
        match=r"0\.exr: pixel \(row \d+, column \d+\): the values \[.*\] leave the response curve",
    ):
        load(capture, response=curve)
    # The background is black, and so is what the black level leaves out.
    photograph = load(capture, response=curve, black_level=low)[0][0]
    assert photograph.selection.usable.any()


def test_observations_keep_pixels_and_photographs_together(capture):
    photographs, _ = load(capture)
    observations = observations_of(photographs)
    counts = [int(photograph.selection.usable.sum()) for photograph in photographs]
    assert observations.count == sum(counts)
    np.testing.assert_array_equal(np.bincount(observations.frame), counts)
    for number, photograph in enumerate(photographs):
        usable, of_frame = photograph.selection.usable, observations.frame == number
        for found, image in (
            (observations.radiance, photograph.radiance),
            (observations.samples.normals, photograph.view.normals),
            (observations.samples.outgoing, photograph.view.outgoing),
        ):
            np.testing.assert_array_equal(found[of_frame], image[usable])
