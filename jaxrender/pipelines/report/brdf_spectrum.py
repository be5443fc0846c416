"""The page of a BRDF's coefficients: the lobe against order, and its uncertainty."""

from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from jaxrender.imaging.display import exposed, exposure_for
from jaxrender.inverse.brdf_spectrum import BRDFSpectrum
from jaxrender.inverse.intervals import NORMAL_90
from jaxrender.pipelines.report.contents import FramePictures, Page, Pictures, Shown
from jaxrender.pipelines.report.display import data_uri
from jaxrender.pipelines.report.plots import INK, MUTED, SERIES, plot
from jaxrender.pipelines.report.wording import counted, percent
from jaxrender.shapes import Float

# The slices' exit angle is that of T figure 6.2; the plots stop short of the horizon.
_EXIT_DEGREES, _STEEPEST = 63.0, 85.0
# A slice as a picture: incident angles down, azimuth differences across.
_ROWS, _COLUMNS = 45, 180


class Slice(NamedTuple):
    """The lobe of one order as a picture."""

    order: int
    picture: str


class SpectrumContents(NamedTuple):
    """All that the report of a BRDF's coefficients shows: fits of several orders, the last asked.

    ``light_energy`` is that of each degree of the light.
    """

    title: str
    result: dict[str, Any]
    orders: tuple[BRDFSpectrum, ...]
    light_energy: Float[np.ndarray, "degree"]
    frames: tuple[FramePictures, ...]

    @property
    def fit(self) -> None:
        """None: the result has all there is."""


def spectrum_page(contents: SpectrumContents) -> Page:
    """Lay out the page."""
    spectrum = contents.result["spectrum"]
    sections = {
        "spectrum": spectrum,
        "orders": [
            {
                "order": one["order"],
                "unknowns": counted(one["unknowns"]),
                "residual": percent(one["relative_rms"]),
                "error": percent(one["lobe_relative_error"]),
            }
            for one in spectrum["orders"]
        ],
        "lobe": _lobe_plot(contents.orders),
        "degrees": _degree_plot(contents),
        "slices": _slices(contents.orders),
        "exit_degrees": _EXIT_DEGREES,
    }
    caption = "How strongly light from each direction is reflected, for one direction of view."
    first = Pictures(Shown(sections["slices"][-1].picture, caption))
    return Page("brdf_spectrum.html.j2", contents, sections, first)


def _outgoing(count: int) -> Float[np.ndarray, "pair 3"]:
    angle = np.radians(_EXIT_DEGREES)
    return np.tile([np.sin(angle), 0.0, np.cos(angle)], (count, 1))


def _lobe_plot(orders: tuple[BRDFSpectrum, ...]) -> Markup:
    """Plot rho cos t_i in the plane of incidence, the mean of the channels."""
    degrees = np.linspace(-_STEEPEST, _STEEPEST, 171)
    angles = np.radians(degrees)
    # Positive on the far side of the normal, where the highlight is.
    incoming = np.stack([-np.sin(angles), 0 * angles, np.cos(angles)], axis=-1)
    outgoing = _outgoing(len(angles))
    found = [spectrum.transfer(incoming, outgoing) for spectrum in orders]

    def paint(axes: Axes) -> None:
        styles = [(MUTED, (0, (1.5, 2))), (SERIES[1], (0, (4, 3))), (SERIES[0], "solid")]
        for spectrum, (values, _), style in zip(orders, found, styles[-len(orders) :]):
            label = f"order {spectrum.basis.band_limit}"
            axes.plot(degrees, values.mean(axis=1), color=style[0], linestyle=style[1], label=label)
        values, errors = (part.mean(axis=1) for part in found[-1])
        low, high = values - NORMAL_90 * errors, values + NORMAL_90 * errors
        axes.fill_between(degrees, low, high, color=SERIES[0], alpha=0.22, linewidth=0)
        axes.axhline(0, color=INK, linewidth=0.8)
        axes.axvline(_EXIT_DEGREES, color=MUTED, linewidth=0.9, linestyle=(0, (1.5, 2)))
        axes.set_xlabel("incident angle [degrees], positive across the normal from the view")
        axes.set_ylabel("ρ cos θ [1/sr]")
        axes.legend(loc="upper left")

    last = orders[-1].basis.band_limit
    return plot("lobe", f"The lobe in the plane of incidence, recovered to order {last}", paint)


def _degree_plot(contents: SpectrumContents) -> Markup:
    """Plot the light by degree, and the part of the answer that the data determine."""
    spectrum = contents.orders[-1]
    steps = np.arange(spectrum.basis.band_limit + 1)
    amplitude = np.sqrt(contents.light_energy / max(contents.light_energy[0], 1e-300))
    determined = [one["told"] for one in contents.result["spectrum"]["by_degree"]]

    def paint(axes: Axes) -> None:
        axes.plot(steps, amplitude, color=INK, marker="o", ms=3, label="light / degree 0")
        axes.plot(
            steps, determined, color=SERIES[0], marker="o", ms=3, label="determined by the data"
        )
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        axes.set_xlabel("degree")
        axes.set_ylim(bottom=0)
        axes.legend()

    return plot("by-degree", "Light and information by degree", paint)


def _slices(orders: tuple[BRDFSpectrum, ...]) -> tuple[Slice, ...]:
    polar = np.radians((np.arange(_ROWS) + 0.5) * 90 / _ROWS)[:, None]
    azimuth = np.radians((np.arange(_COLUMNS) + 0.5) * 360 / _COLUMNS)[None, :]
    incoming = np.stack(
        np.broadcast_arrays(
            np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)
        ),
        axis=-1,
    ).reshape(-1, 3)
    images = [
        spectrum.transfer(incoming, _outgoing(len(incoming)))[0].reshape(_ROWS, _COLUMNS, -1)
        for spectrum in orders
    ]
    exposure = exposure_for(images[-1])
    return tuple(
        Slice(spectrum.basis.band_limit, data_uri(_enlarged(exposed(image, exposure))))
        for spectrum, image in zip(orders, images)
    )


def _enlarged(codes: np.ndarray) -> np.ndarray:
    return np.repeat(np.repeat(codes, 2, axis=0), 2, axis=1)
