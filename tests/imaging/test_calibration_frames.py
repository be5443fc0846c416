"""Pinned down: dark frames, black levels and flat fields undo what camera and lens did.

- Dark frames: the level is their mean, the readout noise their spread, and full scale stays 1.
- A lens that darkens as cos^4 is found from a noisy, dusty flat field, and its pictures are evened.
- What is no such frame is refused.
"""

import numpy as np
import pytest

from jaxrender.imaging import above_black, dark_of, fit_vignetting, flat_field_gain

SHAPE = (60, 90, 3)


def test_dark_frames():
    rng = np.random.default_rng(0)
    level = 0.05 + 0.02 * rng.uniform(size=SHAPE)
    dark = dark_of([level + 0.003 * rng.normal(size=SHAPE) for _ in range(16)])
    assert dark.read_noise == pytest.approx(0.003, rel=0.02)
    assert np.abs(dark.level - level).max() < 5 * 0.003 / 4
    truth = rng.uniform(size=SHAPE)
    np.testing.assert_allclose(dark.subtracted(level + (1 - level) * truth), truth, atol=5e-3)
    assert dark.subtracted(level - 0.01).max() < 0


def test_a_black_level():
    values = np.array([[[0.1, 0.55, 1.0]]])
    np.testing.assert_allclose(above_black(values, 0.1), [[[0, 0.5, 1]]], atol=1e-15)


def lens(rows, columns):
    """cos^4 of the angle off the axis, half the diagonal being 35 degrees."""
    down, across = (np.arange(n) + 0.5 - n / 2 for n in (rows, columns))
    radius = np.hypot(down[:, None], across[None, :]) / (np.hypot(rows, columns) / 2)
    return np.cos(np.arctan(radius * np.tan(np.radians(35)))) ** 4


def test_the_fall_off_of_a_lens():
    rng = np.random.default_rng(1)
    true = lens(60, 90)
    flat = 0.8 * true[..., None] * (1 + 0.01 * rng.normal(size=SHAPE))
    flat[20:23, 30:33] *= 0.6
    found = fit_vignetting(flat)
    assert np.abs(found.fall_off(60, 90) / true - 1).max() < 8e-3
    # The noise of three channels, where the lens darkens less of it.
    assert found.rms == pytest.approx(0.01 / np.sqrt(3) * true.mean(), rel=0.1)
    np.testing.assert_allclose(found.corrected(true[..., None] * np.ones(SHAPE)), 1, atol=8e-3)
    # A picture of another size has the same fall-off.
    assert fit_vignetting(flat).fall_off(60, 90).shape == (60, 90)


def test_a_flat_field_evens_out_any_shape():
    rows, columns = np.meshgrid(np.linspace(-1, 1, 120), np.linspace(-1, 1, 160), indexing="ij")
    true = np.stack([1 - 0.3 * (rows - 0.3) ** 2 - 0.2 * columns**2 + 0.1 * columns] * 3, axis=-1)
    noisy = true * (1 + 0.01 * np.random.default_rng(2).normal(size=true.shape))
    evened = true * flat_field_gain(noisy)
    assert np.std(evened) / np.mean(evened) < 4e-3
    assert flat_field_gain(noisy).min() == 1


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: dark_of([np.zeros(SHAPE)]), "1 dark frames: give 2 or more"),
        (lambda: dark_of([np.zeros(SHAPE), np.zeros((1, 1, 3))]), "they must be alike"),
        (lambda: dark_of([np.ones(SHAPE)] * 2), "put the lens cap on"),
        (
            lambda: dark_of([np.zeros(SHAPE)] * 2).subtracted(np.zeros((1, 1, 3))),
            "take both with the same camera",
        ),
        (lambda: above_black(np.zeros(SHAPE), 1.0), "black_level=1.0"),
        (lambda: fit_vignetting(np.eye(60)[..., None] + 0 * np.ones(SHAPE)[:, :60]), "is black at"),
        (lambda: fit_vignetting(1.5 - lens(*SHAPE[:2])[..., None] * np.ones(3)), "brightest away"),
        (lambda: flat_field_gain(np.zeros(SHAPE)), "is black at"),
    ],
)
def test_what_is_no_such_frame(call, message):
    with pytest.raises(ValueError, match=message):
        call()
