"""Plots of lights, BRDFs and estimates, and notebooks that show them unasked.

- Each gives matplotlib axes: a new figure's, or those that are given.
- What is drawn is right: radiance where the light is, sources as circles, the BRDF's own values.
- Anything else is refused with what can be plotted.
- ``%load_ext jaxrender`` registers PNG pictures of lights and BRDFs, and ``%unload_ext`` takes them
  back.
"""

import types

import matplotlib.image as mpimg
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import jaxrender as jr
from jaxrender.brdf import Lambertian, brdf_named
from jaxrender.inverse import Estimate
from jaxrender.lighting import (
    ClearSky,
    DirectionalSources,
    Environment,
    HarmonicLight,
    Light,
    LightNodes,
    OvercastSky,
)

SOURCES = DirectionalSources(np.array([[0.0, 1, 0], [0, 0, 1]]), np.array([[1.0] * 3, [4.0] * 3]))
GGX = brdf_named("ggx", kd=np.full(3, 0.1), ks=np.full(3, 0.2), sigma=0.2, mu=1.5)


class Masses(Light):
    """A light of many point masses that is neither an image nor a function."""

    def nodes(self):
        return LightNodes(np.tile([0.0, 0.0, 1.0], (300, 1)), np.full((300, 3), 0.01))


def image_of(axes):
    return np.asarray(axes.images[0].get_array(), float)


def test_an_environment_is_bright_where_it_is():
    radiance = np.full((8, 16, 3), 0.01)
    # Just below the zenith, half way around.
    radiance[1, 8] = [2.0, 0, 0]
    axes = jr.plot(Environment(radiance))
    image = image_of(axes)
    assert axes.images[0].get_extent() == [0, 360, -90, 90]
    row, column = np.unravel_index(np.argmax(image[..., 0]), image.shape[:2])
    assert (row // 16, column // 16) == (1, 8)
    assert image[20, 140, 0] > 2 * image[20, 140, 1]


def test_sources_are_circles_where_they_are():
    axes = jr.plot(SOURCES + OvercastSky(np.full(3, 0.2)))
    assert np.allclose(axes.collections[0].get_offsets(), [[90, 0], [0, 90]])
    small, large = axes.collections[0].get_sizes()
    assert large > 2 * small
    # The sky is above, and nothing below.
    assert image_of(axes)[10].min() > 50
    assert image_of(axes)[-10].max() == 0


@pytest.mark.parametrize(
    "light",
    [
        ClearSky(np.array([0.0, 0.6, 0.8]), np.full(3, 0.3)),
        HarmonicLight(np.array([[1.0], [0.0], [0.5], [0.0]])),
        Masses(),
    ],
    ids=lambda light: type(light).__name__,
)
def test_every_light_has_a_picture(light):
    assert image_of(jr.plot(light)).max() > 0


def test_masses_are_drawn_as_radiance():
    image = image_of(jr.plot(Masses()))
    assert image[0].max() > 0
    assert image[1:].max() == 0


def test_a_lobe_shows_the_brdfs_own_values():
    axes = jr.plot(Lambertian(np.array([0.1, 0.2, 0.3])))
    for line in axes.lines:
        assert np.allclose(line.get_ydata(), 0.2)
    assert len(axes.figure.axes) == 2


def test_a_lobe_peaks_about_the_mirror_direction():
    axes = jr.plot(GGX)
    for line, incident in zip(axes.lines[:2], (10, 45)):
        peak = line.get_xdata()[np.nanargmax(line.get_ydata())]
        assert incident <= peak < incident + 5


def test_the_slice_is_bright_at_half_angle_zero():
    axes = jr.plot(GGX).figure.axes[1]
    image = image_of(axes)
    assert image[45, 0, 0] > 2 * image[45, 30, 0]
    # Fresnel: grazing light is reflected more strongly, at the top.
    assert image[5, 0, 0] > image[85, 0, 0]


def test_given_axes_are_used():
    figure = Figure()
    one, other = figure.subplots(1, 2)
    assert jr.plot(SOURCES, one) is one
    assert jr.plot(GGX, other) is other
    assert figure.axes == [one, other]


def test_an_estimate_shows_its_intervals():
    values = {"kd": np.array([0.2, 0.4]), "sigma": np.array(0.1), "mu": np.array(np.nan)}
    interval = {
        "kd": np.array([[0.19, 0.22], [0.4, 0.5]]),
        "sigma": np.array([0.08, 0.11]),
        "mu": np.array([np.nan, np.nan]),
    }
    fields = dict.fromkeys(Estimate._fields)
    estimate = tuple.__new__(
        Estimate, (fields | {"model": "ggx", "values": values, "interval90": interval}).values()
    )
    axes = jr.plot(estimate)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["kd[0]", "kd[1]", "sigma"]
    segments = axes.collections[0].get_segments()
    reach = [sorted(np.asarray(segment)[:, 0]) for segment in segments]
    assert np.allclose(reach, [[-5, 10], [0, 25], [-20, 10]])


def test_what_has_a_picture_of_its_own_is_shown():
    axes = jr.plot(types.SimpleNamespace(_repr_png_=lambda: jr.pipelines.plots.png_of_plot(GGX)))
    assert axes.images


def test_anything_else_is_refused():
    with pytest.raises(TypeError, match="a dict has no plot; give a light, a BRDF"):
        jr.plot({})


def test_notebooks_show_lights_and_brdfs(tmp_path):
    class Formatter(dict):
        def for_type(self, kind, function):
            self[kind] = function

    pictures = Formatter()
    ipython = types.SimpleNamespace(
        display_formatter=types.SimpleNamespace(formatters={"image/png": pictures})
    )
    jr.load_ipython_extension(ipython)
    for thing in (SOURCES, GGX):
        draw = next(function for kind, function in pictures.items() if isinstance(thing, kind))
        (tmp_path / "a.png").write_bytes(draw(thing))
        assert mpimg.imread(tmp_path / "a.png").std() > 0
    jr.unload_ipython_extension(ipython)
    assert not pictures


def test_plot_returns_axes():
    assert isinstance(jr.plot(SOURCES), Axes)
