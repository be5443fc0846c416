"""The colours of a recovered light tied together.

Each channel of the light is found by itself.  Where the photographs tell little, its errors are its
own, and the dark of a grey light is full of coloured specks.  Slow light has much the same pattern
in all channels.  So the patterns of two channels are expected to differ by a part tau of them.
Degrees 1 to 3, which are known best, tell tau.  Their errors are not taken off, so that tau is too
large rather than too small.  The most probable light then follows from its covariance, by one
linear system for all contrasts between channels.
"""

import numpy as np
import scipy.linalg

from jaxrender.harmonics import band_limit_of, degrees
from jaxrender.inverse.factorization.recovered_scene import RecoveredScene
from jaxrender.lighting import DirectionalSources
from jaxrender.shapes import Float

# Degrees that tell how far channels differ.
_TELLING = 3
# No light is taken to be as grey as this.
_LEAST = 0.02


def tied(scene: RecoveredScene) -> RecoveredScene:
    """Find the most probable light whose channels have much the same pattern.

    A light of one channel, or with one that is dark, stays as it is.  So does one that would leave
    what is known of slow light and sources together.
    """
    slow, level = scene.slow, scene.slow[0]
    count, channels = slow.shape
    if channels < 2 or count < 2 or np.any(level <= 0):
        return scene
    # Contrasts between channels, whose squares add up to the squared deviation from the mean.
    contrasts = scipy.linalg.helmert(channels) / level
    found = contrasts @ slow[1:].T
    seen = scene.covariance[:, 1:count, 1:count]
    variance = np.einsum("jc,ic,ckm->jkim", contrasts, contrasts, seen)
    size = found.size
    expected = _expected(slow / level, found)
    curvature = variance.reshape(size, size) + np.diag(np.tile(expected, channels - 1))
    factor = scipy.linalg.cho_factor(curvature, lower=True)
    across = np.einsum("jc,cpk->cpjk", contrasts, scene.covariance[:, :, 1:count])
    across = across.reshape(channels, -1, size)
    light = np.concatenate([slow, np.asarray(scene.sources.irradiance)])
    light = light - (across @ scipy.linalg.cho_solve(factor, found.ravel())).T
    covariance = np.stack(
        [
            own - part @ scipy.linalg.cho_solve(factor, part.T)
            for own, part in zip(scene.covariance, across)
        ]
    )
    sources = DirectionalSources(np.asarray(scene.sources.directions), light[count:])
    trial = scene._replace(slow=light[:count], sources=sources, covariance=covariance)
    moved = (trial.total - scene.total) / scene.total_error
    kept = np.sqrt(np.mean(moved**2)) < 1 and np.all(light[count:] >= 0)
    return trial if kept else scene


def _expected(
    patterns: Float[np.ndarray, "coefficient channel"],
    contrasts: Float[np.ndarray, "contrast other"],
) -> Float[np.ndarray, "other"]:
    """Compute the variance that is expected of every contrast: tau^2 times the pattern's power.

    The first coefficient is the colour itself, of which there is no contrast.
    """
    degree = degrees(band_limit_of(len(patterns)))
    power = np.bincount(degree, np.mean(patterns, axis=1) ** 2) / np.bincount(degree)
    telling = degree[1:] <= _TELLING
    share = np.mean(contrasts[:, telling] ** 2) / np.mean(power[degree[1:]][telling])
    # A degree without any power leaves its contrasts free in the last digits alone.
    floor = np.finfo(float).eps * power.max()
    return max(share, _LEAST**2) * np.maximum(power, floor)[degree[1:]]
