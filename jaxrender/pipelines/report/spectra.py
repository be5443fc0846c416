"""Light and material by degree: the energy of the light, and the part that the material passes."""

import math
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullLocator

from jaxrender.brdf import Glossy
from jaxrender.harmonics import degrees
from jaxrender.pipelines.report.contents import MaterialContents, is_lambertian
from jaxrender.pipelines.report.material import with_arrays
from jaxrender.pipelines.report.plots import INK, MUTED, SERIES, plot
from jaxrender.pipelines.report.wording import power_of_ten
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Float
from jaxrender.spectra import (
    exit_cosine_transfer,
    gaussian_transfer,
    head_on_transfer,
    lambertian_transfer,
    light_coefficients,
)

_EXIT_COSINES = (1.0, 0.5, 0.2)
# Energies this far below the first are rounding.
_DECADES = 7
# Light without an environment has every degree: plot as far as the lobe lets through, or so far.
_BAND_LIMIT_TIMES_SIGMA = 3.2
_HIGHEST_DEGREE = 64
_LAMBERTIAN_DEGREE = 16


class SpectrumPlots(NamedTuple):
    """The light's energy by degree with and after the blur, and the transfer itself."""

    light: Markup
    transfer: Markup


class _Energies(NamedTuple):
    """sum over m of L_lm^2, the mean of the channels: of all light, and of its slow part."""

    total: Float[np.ndarray, "degree"]
    slow: Float[np.ndarray, "degree"] | None


class _Transfer(NamedTuple):
    """h_l at some exit cosines, and its Gaussian twin (none for a Lambertian material)."""

    curves: dict[str, Float[np.ndarray, "degree"]]
    gaussian: Float[np.ndarray, "degree"] | None


def spectrum_plots(contents: MaterialContents) -> SpectrumPlots:
    """Plot light, transfer and their product by degree: B_lm = Lambda_l rho_l L_lm (T 3.10)."""
    band_limit = _band_limit(contents)
    energies = _energies(contents, band_limit)
    transfer = _transfer(contents, band_limit)
    head_on = next(iter(transfer.curves.values()))
    passed = energies.total * head_on**2

    def paint_light(axes: Axes) -> None:
        _paint_energy(axes, energies, passed)

    def paint_transfer(axes: Axes) -> None:
        _paint_transfer(axes, transfer)

    kept = passed[1:].sum() / max(energies.total[1:].sum(), 1e-300)
    return SpectrumPlots(
        plot(
            "spectrum-light",
            f"Energy of the light by degree up to {band_limit}; the material passes "
            f"{100 * kept:.2g} per cent of what is above degree 0.",
            paint_light,
        ),
        plot(
            "spectrum-transfer",
            f"Transfer of the material by degree: from {head_on[0]:.2g} at degree 0 "
            f"to {head_on[-1]:.2g} at degree {band_limit}.",
            paint_transfer,
        ),
    )


def _band_limit(contents: MaterialContents) -> int:
    if contents.light.has_environment:
        return contents.fit.light.dual.band_limit
    if is_lambertian(contents):
        return _LAMBERTIAN_DEGREE
    return min(_HIGHEST_DEGREE, math.ceil(_BAND_LIMIT_TIMES_SIGMA / float(contents.fit.brdf.width)))


def _energies(contents: MaterialContents, band_limit: int) -> _Energies:
    """Sum the squares of the coefficients; of moving light, those of the first photograph."""
    light = contents.light.of_frame(0)
    total = np.zeros(((band_limit + 1) ** 2, light.directional.irradiance.shape[1]))
    if light.environment is not None:
        total = total + np.asarray(light_coefficients(light.environment, band_limit))
    if light.directional.directions.shape[0]:
        total = total + np.asarray(light_coefficients(light.directional, band_limit))
    slow = None
    if light.environment is not None and contents.fit.light.split is not None:
        slow = energy_by_degree(contents.fit.light.dual.slow)
    return _Energies(energy_by_degree(total), slow)


def energy_by_degree(
    coefficients: Float[AnyArray, "coefficient channel"],
) -> Float[np.ndarray, "degree"]:
    """Sum the squares of a light's coefficients over the orders, the mean of the channels."""
    values = np.asarray(coefficients, float)
    band_limit = math.isqrt(values.shape[0]) - 1
    return np.bincount(degrees(band_limit), np.mean(values**2, axis=1))


def _transfer(contents: MaterialContents, band_limit: int) -> _Transfer:
    if is_lambertian(contents):
        curve = np.asarray(lambertian_transfer(band_limit)) / np.pi
        return _Transfer({"clamped cosine / π": curve}, None)
    brdf = with_arrays(contents.fit.brdf)
    if not isinstance(brdf, Glossy):
        curve = np.asarray(head_on_transfer(brdf, band_limit), float)
        return _Transfer({"exit angle 0°": curve}, None)
    brdf = brdf.as_metal()
    cosines = np.asarray(_EXIT_COSINES, np.float32)
    curves, twin = _both_transfers(brdf, cosines, band_limit)
    names = [f"exit angle {math.degrees(math.acos(c)):.0f}°" for c in _EXIT_COSINES]
    return _Transfer(dict(zip(names, np.asarray(curves, float))), np.asarray(twin, float)[0])


@stored(effort="least")
def _both_transfers(brdf: Glossy, cosines: Float[AnyArray, "bin"], band_limit: int):
    return tuple(
        transfer(brdf, cosines, band_limit)
        for transfer in (exit_cosine_transfer, gaussian_transfer)
    )


def _paint_energy(axes: Axes, energies: _Energies, passed: Float[np.ndarray, "degree"]) -> None:
    top = max(float(energies.total.max()), 1e-300)
    floor = top * 10.0**-_DECADES
    degree = np.arange(len(energies.total))
    style = {"marker": "o", "markersize": 2.5}
    axes.plot(degree, _above(energies.total, floor), color=INK, label="all light", **style)
    if energies.slow is not None:
        slow = _above(energies.slow, floor)
        axes.plot(np.arange(len(slow)), slow, color=SERIES[1], label="slow part", **style)
    label = "all light after the blur, head-on"
    axes.plot(degree, _above(passed, floor), color=SERIES[0], label=label, **style)
    axes.set_yscale("log")
    axes.set_ylim(floor, 4 * top)
    highest = math.floor(math.log10(top))
    axes.set_yticks([10.0**power for power in range(highest, highest - _DECADES, -2)])
    axes.yaxis.set_major_formatter(FuncFormatter(_power))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylabel("energy, Σ L² over a degree")
    _finish(axes)


def _paint_transfer(axes: Axes, transfer: _Transfer) -> None:
    for colour, (name, curve) in zip(SERIES, transfer.curves.items()):
        axes.plot(np.arange(len(curve)), curve, color=colour, label=name)
    if transfer.gaussian is not None:
        twin = transfer.gaussian
        label = "Gaussian exp(−(σl)²)"
        axes.plot(np.arange(len(twin)), twin, color=MUTED, label=label, linestyle=(0, (4, 3)))
    axes.set_ylim(bottom=min(0.0, *(1.05 * curve.min() for curve in transfer.curves.values())))
    axes.set_ylabel("transfer h")
    _finish(axes)


def _finish(axes: Axes) -> None:
    axes.set_xlabel("degree l: coarse detail left, fine detail right")
    axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    axes.set_xlim(left=0)
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)


def _above(energy: Float[np.ndarray, "degree"], floor: float) -> Float[np.ndarray, "degree"]:
    """Leave out of a curve what is no more than rounding."""
    return np.where(energy >= floor, energy, np.nan)


def _power(value: float, _position: int) -> str:
    """Write a power of ten in plain characters."""
    return power_of_ten(round(math.log10(value)))
