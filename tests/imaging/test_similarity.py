"""Measures of benchmarks: against formulas typed apart, and by what must not change them.

- PSNR-H, PSNR-L and SSIM are those of the formulas, on pictures with highlights.
- Noise of a known deviation has the PSNR that it must have.
- A scale of each channel is free, or not; exposure and radiance trade.
- The rim, what lies outside, and brightness beyond the clip do not count; the inside does.
- Pictures that cannot be compared are refused.
"""

import numpy as np
import pytest
from scipy import ndimage

from jaxrender.imaging import similarity

SIDE = 48


@pytest.fixture
def pictures():
    """A truth with a highlight, a prediction that is a little wrong, and the mask of a disc."""
    rng = np.random.default_rng(3)
    rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5
    distance = np.hypot(rows - SIDE / 2, columns - SIDE / 2)
    slow = 0.2 + 0.4 * columns / SIDE + 3 * np.exp(-(((rows - 15) ** 2 + (columns - 20) ** 2) / 18))
    truth = slow[..., None] * np.array([1.0, 0.7, 0.4])
    predicted = truth * (1 + 0.1 * np.sin(rows / 4))[..., None] + 0.01 * rng.normal(
        size=truth.shape
    )
    return np.maximum(predicted, 0), truth, distance < 20


def srgb(linear):
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def by_formulas(predicted, truth, mask):
    """PSNR-H, PSNR-L and SSIM as published, in loops over channels."""
    inside = ndimage.minimum_filter(mask, size=5, mode="constant", cval=0)[..., None]
    ours, theirs = predicted * inside, truth * inside
    ours = np.stack(
        [
            ours[..., c] * np.sum(ours[..., c] * theirs[..., c]) / np.sum(ours[..., c] ** 2)
            for c in range(3)
        ],
        axis=-1,
    )
    brightness = srgb(theirs.clip(0, 1)).mean() / theirs.clip(0, 1).mean()
    radiance = [(brightness * one).clip(0, 4) for one in (ours, theirs)]
    shown = [srgb(one.clip(0, 1)) for one in (ours, theirs)]
    psnr = [-10 * np.log10(np.mean((a - b) ** 2)) for a, b in (radiance, shown)]
    similar = []
    for c in range(3):
        a, b = (one[..., c] for one in shown)

        def mean(x):
            return ndimage.gaussian_filter(x, 1.5, truncate=3.5, mode="reflect")

        across = mean(a * b) - mean(a) * mean(b)
        spread = mean(a * a) - mean(a) ** 2 + mean(b * b) - mean(b) ** 2
        middle = mean(a) ** 2 + mean(b) ** 2
        each = (2 * mean(a) * mean(b) + 1e-4) * (2 * across + 9e-4)
        each /= (middle + 1e-4) * (spread + 9e-4)
        # Five pixels along the border are left out, as the window does not fit there.
        similar.append(each[5:-5, 5:-5].mean())
    return [*psnr, np.mean(similar)]


def test_it_is_the_published_formulas(pictures):
    found = similarity(*pictures)
    expected = by_formulas(*pictures)
    assert [found.psnr_hdr, found.psnr_ldr, found.ssim] == pytest.approx(expected, rel=1e-9)
    # The two differ where a highlight is clipped at 1 and not at 4.
    assert abs(found.psnr_hdr - found.psnr_ldr) > 1


def test_noise_has_the_psnr_of_its_deviation():
    rng = np.random.default_rng(0)
    truth, whole = np.full((200, 200, 3), 0.5), np.ones((200, 200), bool)
    found = similarity(truth + 0.01 * rng.normal(size=truth.shape), truth, whole, scaled=False)
    # Linear radiance is shown srgb(.5) / .5 times as bright; its slope there is that of the power.
    brighter, slope = srgb(0.5) / 0.5, 1.055 / 2.4 * 0.5 ** (1 / 2.4 - 1)
    share = (196 / 200) ** 2
    assert found.share == pytest.approx(share)
    for psnr, factor in ((found.psnr_hdr, brighter), (found.psnr_ldr, slope)):
        assert psnr == pytest.approx(-20 * np.log10(0.01 * factor * np.sqrt(share)), abs=0.05)
    assert found.relative_rms == pytest.approx(0.02, rel=0.02)


def test_a_scale_of_each_channel_is_free_or_not(pictures):
    predicted, truth, mask = pictures
    tinted = predicted * np.array([2.0, 0.5, 3.0])
    free, same = similarity(tinted, truth, mask), similarity(predicted, truth, mask)
    assert free[:4] == pytest.approx(same[:4], rel=1e-9)
    np.testing.assert_allclose(free.scale * [2.0, 0.5, 3.0], same.scale)
    bound = similarity(tinted, truth, mask, scaled=False)
    np.testing.assert_array_equal(bound.scale, 1)
    assert bound.psnr_hdr < same.psnr_hdr - 5


def test_exposure_and_radiance_trade(pictures):
    predicted, truth, mask = pictures
    dark = similarity(predicted / 50, truth / 50, mask, exposure=50)
    assert dark[:4] == pytest.approx(similarity(predicted, truth, mask)[:4], rel=1e-9)


def test_what_counts_and_what_does_not(pictures):
    predicted, truth, mask = pictures

    def after(row, column, value, scaled=False):
        changed = predicted.copy()
        changed[row, column] = value
        return similarity(changed, truth, mask, scaled=scaled)

    unscaled = similarity(predicted, truth, mask, scaled=False)
    edge = int(np.flatnonzero(mask[24])[0])
    assert after(0, 0, np.nan)[:4] == unscaled[:4]
    assert after(24, edge + 1, 9.0)[:4] == unscaled[:4]
    assert after(24, edge + 2, 9.0).psnr_hdr < unscaled.psnr_hdr
    # A negative truth is black: it can be nothing else.
    negative = truth.copy()
    negative[24, 24] = -1.0
    black = truth.copy()
    black[24, 24] = 0.0
    assert similarity(predicted, negative, mask)[:4] == similarity(predicted, black, mask)[:4]
    # Far beyond the clip brighter is no worse.
    beyond = after(24, 24, 50.0), after(24, 24, 500.0)
    assert beyond[0][:3] == beyond[1][:3]


def test_equal_pictures_are_infinitely_alike(pictures):
    _, truth, mask = pictures
    found = similarity(truth, truth, mask)
    assert found.psnr_hdr == found.psnr_ldr == np.inf
    assert (found.ssim, found.relative_rms) == (1, 0)


def test_what_cannot_be_compared_is_refused(pictures):
    predicted, truth, mask = pictures
    with pytest.raises(ValueError, match="48 x 8 pixels: SSIM needs at least 11 x 11"):
        similarity(predicted[:8], truth[:8], mask[:8])
    small = np.zeros_like(mask)
    small[20:24, 20:24] = True
    with pytest.raises(ValueError, match=r"nothing is left of the mask \(16 pixels\)"):
        similarity(predicted, truth, small)
    predicted[24, 24, 1] = np.inf
    with pytest.raises(ValueError, match="values inside the mask are not finite"):
        similarity(predicted, truth, mask)
    # Nothing predicted is no division by zero.
    assert similarity(np.zeros_like(truth), truth, mask).relative_rms == 1
