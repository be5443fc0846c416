"""A BRDF in other channels, and how wide the finest lobe of any BRDF is.

- Weights of one repeat a gray; others add channels up; what makes light is not promised to keep it.
- The width of a narrow lobe is the model's own sigma, of its values alone; paint has none.
"""

import numpy as np
import pytest

from jaxrender.brdf import (
    IsotropicTable,
    Lambertian,
    Microfacet,
    Recoloured,
    lobe_width,
)

PAIR = np.array([[0.3, 0.1, 0.9]]) / np.sqrt(0.91), np.array([[-0.2, 0.4, 0.8]]) / np.sqrt(0.84)


def facets(sigma, kd=0.0):
    return Microfacet(np.full(1, kd), np.ones(1), sigma, None)


def test_channels_are_weighted_sums():
    paint = Lambertian(np.array([0.1, 0.2]))
    other = Recoloured(paint, np.array([[1.0, 0.5, 0.0], [0.0, 0.25, 2.0]]))
    np.testing.assert_allclose(other.evaluate(*PAIR), [[0.1, 0.1, 0.4]], rtol=1e-12)
    assert not other.conserves_energy
    assert Recoloured(paint, np.array([[0.5], [0.5]])).conserves_energy
    gray = Recoloured(Lambertian(np.array([0.1])), np.ones((1, 3)))
    np.testing.assert_allclose(gray.evaluate(*PAIR), [[0.1, 0.1, 0.1]], rtol=1e-12)
    with pytest.raises(ValueError, match="weights of 3 channels for a BRDF of 2"):
        Recoloured(paint, np.ones((3, 3)))


@pytest.mark.parametrize("sigma", [0.03, 0.1])
def test_a_width_is_that_of_the_model(sigma):
    assert lobe_width(facets(sigma)) == pytest.approx(sigma, rel=0.15)
    # A base under the lobe does not widen it.
    assert lobe_width(facets(sigma, kd=0.2)) == pytest.approx(sigma, rel=0.15)
    assert lobe_width(Lambertian(np.array([0.2]))) == np.pi / 2


def test_a_table_is_as_wide_as_what_it_holds():
    table = IsotropicTable.of(facets(0.1), (60, 90, 24))
    assert lobe_width(table) == pytest.approx(lobe_width(facets(0.1)), rel=0.05)
