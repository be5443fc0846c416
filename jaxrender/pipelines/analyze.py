"""The spectra of a light and of lobes, the well-posed inverse problems, and the degrees needed."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.harmonics import analyse
from jaxrender.inverse.posedness import RECOVERABLE, Posedness, posedness
from jaxrender.io import read_environment
from jaxrender.pipelines.lobe_orders import TOLERANCE, LobeOrders, OrdersGoal, lobe_orders
from jaxrender.pipelines.lobes import Lobe
from jaxrender.pipelines.reflection_maps import LightSpectrum, percent
from jaxrender.pipelines.source_lobes import lobe_named
from jaxrender.shapes import Float

DEFAULT_LOBES = ("lambertian", "microfacet:sigma=0.2", "microfacet:sigma=0.05")
_DEGREES_SHOWN = (*range(9), 10, 12, 16, 20, 24, 32, 48, 64)


class Measurement(NamedTuple):
    """What photographs measure: the relative noise of a sample, and the number of samples."""

    noise: float = 0.01
    samples: int = 12_000


class Analysis(NamedTuple):
    """The table for a terminal, and its contents: verdict and orders for each lobe."""

    title: str
    table: str
    lobes: tuple[Lobe, ...]
    verdicts: tuple[Posedness, ...]
    orders: tuple[LobeOrders | None, ...]
    """None for a mirror, which passes all degrees."""

    def draw(self, path: Path) -> None:
        """Draw the spectra as a picture (PNG, PDF or SVG)."""
        _draw(path, self.title, self.lobes, self.verdicts)


DEFAULT_MEASUREMENT = Measurement()


def analyze(
    light: Path,
    convention: str = "z-up",
    brdfs: Sequence[str] = DEFAULT_LOBES,
    band_limit: int = 32,
    measurement: Measurement = DEFAULT_MEASUREMENT,
    tolerance: float = TOLERANCE,
) -> Analysis:
    """Compare the spectra of a panorama and of lobes, degree by degree (T 2.4.2, 3.2, 5.5).

    ``tolerance`` is the part of the energy that the degrees may miss.  Raises ``InputError`` for an
    unusable panorama, unknown lobes, more degrees than texels, and a tolerance outside (0, 1).
    """
    goal = OrdersGoal(tolerance)
    goal.check()
    lobes = tuple(lobe_named(specification) for specification in dict.fromkeys(brdfs))
    try:
        environment = read_environment(light, convention)
        coefficients = np.asarray(analyse(environment.grid, environment.radiance, band_limit))
        verdicts = tuple(
            posedness(
                coefficients, lobe.transfer(band_limit), measurement.noise, measurement.samples
            )
            for lobe in lobes
        )
        spectrum = LightSpectrum.of(environment)
        orders = tuple(None if lobe.brdf is None else lobe_orders(lobe, goal) for lobe in lobes)
        sentences = [_orders(spectrum, found, goal) for found in orders]
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{light}: {error}") from None
    sections = [
        _section(lobe, verdict, lines) for lobe, verdict, lines in zip(lobes, verdicts, sentences)
    ]
    heading = (
        f"{light.name}, to degree {band_limit}; samples with {100 * measurement.noise:g} % noise: "
        f"{measurement.samples:,}.\n"
        f"Recoverable: a relative standard error below {100 * RECOVERABLE:g} %.\n"
    )
    return Analysis(light.name, "\n".join([heading, *sections]), lobes, verdicts, orders)


def _section(lobe: Lobe, verdict: Posedness, orders: list[str]) -> str:
    band_limit = len(verdict.light) - 1
    lines = [
        f"{lobe.specification}  (about the {lobe.about}{', mean of channels' * lobe.whole})",
        *(f"  {sentence}" for sentence in lobe.said),
        f"{'degree':>6s} {'light':>10s} {'BRDF A_l':>10s} {'product':>10s} "
        f"{'light known to':>15s} {'BRDF known to':>15s}",
    ]
    for degree in (d for d in (*_DEGREES_SHOWN, band_limit) if d <= band_limit):
        lines.append(
            f"{degree:6d} {verdict.light[degree]:10.4g} {verdict.transfer[degree]:10.4g} "
            f"{verdict.reflected[degree]:10.4g} {_percent(verdict.light_error[degree]):>15s} "
            f"{_percent(verdict.brdf_error[degree]):>15s}"
        )
        if degree == band_limit:
            break
    lines += [
        f"  inverse lighting: {_which(verdict.light_recoverable)}",
        f"  inverse BRDF:     {_which(verdict.brdf_recoverable)}",
        *orders,
        "",
    ]
    return "\n".join(lines)


def _orders(light: LightSpectrum, found: LobeOrders | None, goal: OrdersGoal) -> list[str]:
    """Say which degrees of light and viewer miss no more than the tolerance (T 5.16 to 5.19)."""
    heading = f"  orders for {percent(goal.tolerance)} missing energy: "
    missing = light.missing()
    enough = np.flatnonzero(missing < goal.tolerance)
    alone = (
        f"F {enough[0]}"
        if len(enough)
        else f"beyond degree {light.band_limit}, which leaves {percent(missing[-1])}"
    )
    if found is None:
        return [f"{heading}none for a mirror, which passes every degree (of light alone: {alone})"]
    first, second = found.spectrum.band_limits
    if not found.reached:
        left = percent(found.least_missing)
        return [
            f"{heading}above F {first}, P {second}, which leave {left} (of light alone: {alone})"
        ]
    orders, (rows, views) = found.orders, found.orders.resolutions
    explicit = f"{views} x {views} explicit views" if views > 1 else "one explicit view"
    last = min(orders.light, light.band_limit)
    return [
        f"{heading}F {orders.light}, P {orders.viewer} (of light alone: {alone}); maps of {rows} "
        f"rows, {explicit}",
        f"  beyond degree {last} of this light: at most {percent(light.beyond(found))} of the "
        "reflected light's energy",
    ]


def _percent(error: float) -> str:
    if not error < 10:
        return "nothing"
    return f"{100 * error:.0f} %" if error >= 1 else f"{100 * error:.2g} %"


def _which(recoverable: Float[np.ndarray, "degree"] | np.ndarray) -> str:
    """Say in words which degrees can be recovered."""
    lost = np.flatnonzero(~recoverable)
    if not len(lost):
        return f"well posed for all degrees up to {len(recoverable) - 1}"
    first, later = int(lost[0]), np.flatnonzero(recoverable[lost[0] :]) + lost[0]
    if first == 0:
        return "ill posed: not even the mean"
    sentence = f"well posed up to degree {first - 1}"
    if len(later):
        listed = ", ".join(str(d) for d in later[:8]) + (", ..." if len(later) > 8 else "")
        sentence += f", and for {listed}"
    return sentence


def _draw(path: Path, title: str, lobes: tuple[Lobe, ...], verdicts: tuple[Posedness, ...]) -> None:
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(4.2 * len(lobes), 4.0), layout="constrained")
    drawing.suptitle(title)
    for place, (lobe, verdict) in enumerate(zip(lobes, verdicts)):
        axes = drawing.add_subplot(1, len(lobes), place + 1)
        degrees = np.arange(len(verdict.light))
        for name, spectrum, style in (
            ("light", verdict.light / verdict.light[0], "o-"),
            ("BRDF", np.abs(verdict.transfer / verdict.transfer[0]), "s-"),
            ("product", verdict.reflected / verdict.reflected[0], "^-"),
        ):
            # What vanishes has no place on a logarithmic axis.
            shown = np.where(spectrum > 1e-9, spectrum, np.nan)
            axes.semilogy(degrees, shown, style, label=name, markersize=3, linewidth=1)
        # The product at which the relative error of a degree's light is just tolerable.
        bearable = verdict.noise / RECOVERABLE / verdict.reflected[0]
        axes.semilogy(degrees, bearable, "k--", linewidth=0.8, label="needed to know the light")
        axes.set(title=lobe.specification, xlabel="degree", ylim=(1e-6, 3))
        axes.legend(fontsize=7)
    drawing.savefig(path, dpi=120)
