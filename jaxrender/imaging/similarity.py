"""How alike a prediction and a photograph are, by the measures of benchmarks.

The protocol is that of Stanford-ORB (Kuang and others, 2023): the mask shrinks by two pixels, one
scale a channel takes the prediction to the photograph, and what lies outside the mask is zero in
both.  PSNR-H compares radiance: made as bright as sRGB shows it, and clipped at 4.  PSNR-L
compares what a display shows: clipped at 1, in sRGB.  Both are means over the *whole* picture, so
they depend on how much of it the object covers; ``share`` says how much.  Where the benchmark does
not let a prediction be worse than flat grey, these do.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxrender.imaging.masks import erode
from jaxrender.imaging.response import SRGB
from jaxrender.shapes import checked

Picture = Float[np.ndarray, "row column channel"]

# Half the side, without its middle, of the square that the benchmark's mask is eroded by.
_MARGIN = 2
# Radiance at which PSNR-H clips.
_BRIGHTEST = 4.0
# The window of SSIM (Wang and others, 2004): a Gaussian of this deviation, 11 pixels wide.
_WINDOW = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
_WINDOW_PIXELS = 11


class Similarity(NamedTuple):
    """PSNR-H and PSNR-L in dB, SSIM of what a display shows, and the rms relative to the truth's.

    ``scale`` is the factor a channel that the prediction was multiplied by, ``share`` the part of
    the picture that was compared.  The relative rms is of the compared pixels alone.
    """

    psnr_hdr: float
    psnr_ldr: float
    ssim: float
    relative_rms: float
    scale: Float[np.ndarray, "channel"]
    share: float


@checked
def similarity(
    predicted: Picture,
    truth: Picture,
    mask: Bool[np.ndarray, "row column"],
    *,
    scaled: bool = True,
    exposure: float | int = 1.0,
) -> Similarity:
    """Compare linear radiance inside a mask; ``scaled`` allows a factor for each channel.

    ``exposure`` times the radiance is what a display shows: 1 is white.
    Raises ValueError for pictures smaller than the window of SSIM, for a mask of which nothing is
    left, and for values inside it that are not finite.
    """
    if min(truth.shape[:2]) < _WINDOW_PIXELS:
        raise ValueError(
            f"a picture of {truth.shape[1]} x {truth.shape[0]} pixels: SSIM needs at least "
            f"{_WINDOW_PIXELS} x {_WINDOW_PIXELS}"
        )
    inside = erode(mask, _MARGIN)
    if not inside.any():
        raise ValueError(
            f"nothing is left of the mask ({int(mask.sum())} pixels) when {_MARGIN} pixels are "
            "taken from its rim: give a larger picture of the object"
        )
    if not (np.isfinite(predicted[inside]).all() and np.isfinite(truth[inside]).all()):
        raise ValueError("values inside the mask are not finite: take them out of the mask")
    ours = np.where(inside[..., None], exposure * predicted, 0.0)
    theirs = np.where(inside[..., None], exposure * np.maximum(truth, 0), 0.0)
    scale = _scales(ours, theirs) if scaled else np.ones(theirs.shape[-1])
    ours = scale * ours
    bright = _brightness(theirs)
    shown, shown_truth = _displayed(ours), _displayed(theirs)
    return Similarity(
        psnr_hdr=_psnr(
            np.clip(bright * ours, 0, _BRIGHTEST), np.clip(bright * theirs, 0, _BRIGHTEST)
        ),
        psnr_ldr=_psnr(shown, shown_truth),
        ssim=_ssim(shown, shown_truth),
        relative_rms=_relative_rms(ours[inside], theirs[inside]),
        scale=scale,
        share=float(inside.mean()),
    )


def _scales(predicted: Picture, truth: Picture) -> Float[np.ndarray, "channel"]:
    """Find the factor of each channel by least squares; 1 where nothing was predicted."""
    energy = np.sum(predicted**2, axis=(0, 1))
    common = np.sum(predicted * truth, axis=(0, 1))
    return np.where(energy > 0, common / np.where(energy > 0, energy, 1), 1.0)


def _brightness(truth: Picture) -> float:
    """Tell how much brighter sRGB shows a picture than linear radiance is, in the mean."""
    linear = np.clip(truth, 0, 1)
    mean = float(linear.mean())
    return float(SRGB().encode(linear).mean()) / mean if mean > 0 else 1.0


def _displayed(radiance: Picture) -> Picture:
    return SRGB().encode(np.clip(radiance, 0, 1))


def _psnr(predicted: Picture, truth: Picture) -> float:
    """Ten times the logarithm of 1 / mean squared difference; infinite where there is none."""
    error = float(np.mean((predicted - truth) ** 2))
    return float("inf") if error == 0 else -10 * float(np.log10(error))


def _ssim(predicted: Picture, truth: Picture) -> float:
    # A quarter of a second, which nothing else needs.
    from skimage.metrics import structural_similarity

    alike = structural_similarity(truth, predicted, data_range=1.0, channel_axis=-1, **_WINDOW)
    # It gives more, a gradient or a map, where these are asked for.
    assert isinstance(alike, float)
    return float(alike)


def _relative_rms(
    predicted: Float[np.ndarray, "pixel channel"], truth: Float[np.ndarray, "pixel channel"]
) -> float:
    energy = float(np.sum(truth**2))
    left = float(np.sum((predicted - truth) ** 2))
    return float(np.sqrt(left / energy)) if energy > 0 else float("nan")
