"""Pinned down: the response of a camera from photographs at several exposures.

- Three shapes of curve (the display standard, a film's S, a power with a toe), seven exposures of
  8 bits with noise: the logarithm of exposure is found to 1 % rms, with radiance 1 at full scale.
- The stated errors are of the size of the true ones.
- Channels that differ get a curve each; channels that do not, one curve.
- What the photographs do not link is not told; what cannot be told at all is refused.
- The increasing curve is the free one where that increases.
"""

import numpy as np
import pytest
from bracket_problems import bracketed, scene, stored

from jaxrender.imaging import SRGB, Bracket, Curve, measure_exposures, recover_response

EXPOSURES = 2.0 ** np.arange(-5, 2)
# Nodes of the tables that photographs are made with: far more than are found.
FINE = np.exp(np.linspace(np.log(1e-5), 0, 4001))


def table(value):
    """Make a curve of values at fine radiances, from 0 to 1."""
    value = (value - value[0]) / (value[-1] - value[0])
    return Curve(np.append(-1e-9, value), np.append(0, FINE))


FILM = table(1 / (1 + (FINE / 0.18) ** -1.3))
TOE = table(np.sqrt(FINE + 0.01))
CURVES = {"display": SRGB(), "film": FILM, "toe": TOE}


def error_of(found, response):
    """The error of ln radiance at the told values but 0, and its stated standard error."""
    told = found.curve.values > 0
    truth = np.log(response.linearise(found.curve.values[told]))
    return np.log(found.curve.radiance[told]) - truth, found.standard_error[told, 0]


@pytest.mark.parametrize("name", CURVES)
def test_three_curves_to_one_percent(name):
    # One channel will do for two of the three.
    radiance = scene(0, (60, 80)) if name == "display" else scene()[..., :1]
    brackets = bracketed(radiance, EXPOSURES, 1, CURVES[name])
    found = recover_response(brackets)
    # The channels are alike, and the whole scale is told.
    assert found.curve.radiance.ndim == 1
    assert found.curve.values[0] == 0
    assert found.curve.values[-1] == 1
    error, stated = error_of(found, CURVES[name])
    assert np.sqrt(np.mean(error**2)) < 0.01
    # Seen from the best known value the errors are few standard errors; a bend that the smooth
    # curve cannot follow, and the last dark values, may be more.
    apart = error - error[np.argmin(stated)]
    assert np.median(np.abs(apart) / np.maximum(stated, 2e-3)) < 2
    assert "one curve" in found.said
    assert "cannot be told" not in found.said
    # With it the stated exposures are confirmed.
    assert measure_exposures(brackets, found.curve).wrong == []


def test_channels_that_differ():
    truths = (SRGB(), FILM, TOE)
    each = [
        bracketed(scene(0, (60, 80))[..., :1], EXPOSURES, seed, own)
        for seed, own in enumerate(truths)
    ]
    brackets = [
        Bracket(np.concatenate([one.values for one in three], axis=-1), three[0].exposure)
        for three in zip(*each)
    ]
    found = recover_response(brackets)
    assert found.curve.radiance.shape[1] == 3
    assert "one curve for each channel" in found.said
    # The darkest values are below the noise.
    values, radiance = found.curve.values[4:], found.curve.radiance[4:]
    for channel, truth in enumerate(truths):
        error = np.log(radiance[:, channel] / truth.linearise(values))
        assert np.sqrt(np.mean(error**2)) < 0.01


def test_what_the_photographs_do_not_link():
    # No pixel is brighter than half the scale in any photograph.
    rng = np.random.default_rng(0)
    dim = np.minimum(scene(), 0.03)
    brackets = [Bracket(stored(dim, t, rng), float(t)) for t in 2.0 ** np.arange(0, 4)]
    top = max(one.values.max() for one in brackets)
    found = recover_response(brackets)
    assert top < 0.6
    assert found.curve.values[-1] < top + 0.05
    assert f"from {found.curve.values[-1]:.3g} to 1 it cannot be told" in found.said
    error, _ = error_of(found, SRGB())
    # The scale at full scale is a guess, the shape is not.
    assert np.std(error[10:]) < 0.02


def test_photographs_that_share_no_pixels():
    pair = [Bracket(np.full((8, 8, 1), v), t) for v, t in ((0.5, 1.0), (1.0, 50.0))]
    with pytest.raises(ValueError, match="0 pixels are well exposed in two photographs"):
        recover_response(pair)
    with pytest.raises(ValueError, match="one exposure alone tells no response"):
        recover_response([pair[0], pair[0]])


def test_the_free_curve_is_the_same_where_it_increases():
    brackets = bracketed(scene(0, (60, 80))[..., :1], EXPOSURES[::2])
    free, increasing = (recover_response(brackets, increasing=each) for each in (False, True))
    np.testing.assert_allclose(free.curve.radiance, increasing.curve.radiance, rtol=1e-9)


def test_a_free_curve_that_falls_is_refused_and_an_increasing_one_found():
    # An editor that turned part of the scale over: no camera does.
    rng, radiance = np.random.default_rng(0), scene(0, (60, 80))[..., :1]
    wavy = np.linspace(0, 1, 4001) + 0.12 * np.sin(np.linspace(0, 6 * np.pi, 4001))
    brackets = []
    for t in EXPOSURES:
        linear = np.clip(t * radiance, 0, 1)
        values = np.clip(np.interp(linear, np.linspace(0, 1, 4001), wavy), 0, 1)
        values = values + 0.002 * rng.normal(size=values.shape)
        brackets.append(Bracket(np.round(np.clip(values, 0, 1) * 255) / 255, float(t)))
    with pytest.raises(ValueError, match="does not increase at value 0"):
        recover_response(brackets, increasing=False)
    assert (np.diff(recover_response(brackets).curve.radiance) > 0).all()
