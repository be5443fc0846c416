"""The harmonics that a BRDF is a series of, as rows of least squares (T 6.4.2).

- The rows are the convolution theorem: beside ``reflection.convolve_isotropic``; both forms; head
  on too.
- The prior's integrals over hemispheres against a quadrature.
- Light of fewer degrees is filled up, light of more is cut.
"""

import numpy as np
import pytest
from brdf_spectrum_problems import (
    CHANNELS,
    FORMS,
    LIMIT,
    convolved,
    some_light,
    some_samples,
    some_values,
)
from inverse_problems import unit

from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import GaussLegendreGrid, degrees

ROUNDING = 1e-11


@pytest.mark.parametrize("basis", FORMS)
def test_rows_are_the_convolution_theorem(basis):
    samples, points = some_samples(300)
    light, values = some_light(), some_values(basis)
    found = np.einsum("suc,uc->sc", basis.rows(light, samples), values)
    expected = convolved(basis, values, light, points)
    np.testing.assert_allclose(found, expected, atol=ROUNDING * np.abs(expected).max())


def test_head_on_views():
    basis, light = FORMS[0], some_light()
    normals = unit(np.random.default_rng(0).normal(size=(300, 3)))
    rows = np.asarray(basis.rows(light, SurfaceSamples(normals, normals)))
    aside = unit(normals + 1e-7 * np.roll(normals, 1, axis=1))
    near = np.asarray(basis.rows(light, SurfaceSamples(normals, aside)))
    assert np.all(np.isfinite(rows))
    np.testing.assert_allclose(rows, near, atol=1e-5)


@pytest.mark.parametrize("basis", FORMS)
def test_integrals_over_pairs_of_directions(basis):
    """The prior's integrals, by a quadrature over both spheres and over both hemispheres."""
    grid = GaussLegendreGrid(2 * LIMIT + 2, 4 * LIMIT + 3)
    nodes = grid.directions()[:, :1].reshape(-1, 3), grid.directions().reshape(-1, 3)
    around = grid.weights()[:, 0] * grid.shape[1], grid.weights().ravel()
    incoming = np.repeat(nodes[0], len(nodes[1]), axis=0)
    outgoing = np.tile(nodes[1], (len(nodes[0]), 1))
    weights = np.outer(*around).ravel()
    rows = np.asarray(basis.pair_rows(incoming, outgoing))
    rows = rows * outgoing[:, 2:] if basis.reciprocal else rows
    whole = np.einsum("s,su,sv->uv", weights, rows, rows)
    np.testing.assert_allclose(whole, np.diag(basis.norms()), atol=1e-10)
    cosines, gauss = np.polynomial.legendre.leggauss(2 * LIMIT + 2)
    cosines, gauss = (cosines + 1) / 2, gauss / 2
    azimuths = np.arange(4 * LIMIT + 3) * 2 * np.pi / (4 * LIMIT + 3)
    sines = np.sqrt(1 - cosines**2)
    level = np.stack([sines, np.zeros_like(sines), cosines], axis=-1)
    turned = np.stack(
        [
            np.outer(sines, np.cos(azimuths)),
            np.outer(sines, np.sin(azimuths)),
            np.outer(cosines, np.ones_like(azimuths)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    incoming, outgoing = np.repeat(level, len(turned), 0), np.tile(turned, (len(level), 1))
    weights = np.outer(
        2 * np.pi * gauss, np.repeat(gauss, len(azimuths)) * 2 * np.pi / len(azimuths)
    ).ravel()
    rows = np.asarray(basis.pair_rows(incoming, outgoing))
    rows = rows * outgoing[:, 2:] if basis.reciprocal else rows
    halves = np.einsum("s,su,sv->uv", weights, rows, rows)
    np.testing.assert_allclose(basis.visible_overlap(), halves, atol=1e-10)


def test_light_of_fewer_or_more_degrees_is_filled_up_or_cut():
    basis, samples = FORMS[0], some_samples(300)[0]
    light = some_light()
    rows = basis.rows(light, samples)
    more = np.concatenate([light, np.ones((9, CHANNELS))])
    np.testing.assert_array_equal(basis.rows(more, samples), rows)
    cut = light * (degrees(LIMIT) <= 1)[:, None]
    np.testing.assert_array_equal(basis.rows(light[:4], samples), basis.rows(cut, samples))
