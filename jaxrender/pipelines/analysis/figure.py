"""Forecasts as a picture: the light's spectrum against its errors, and the predicted errors."""

from pathlib import Path

import numpy as np

from jaxrender.inverse.intervals import IDENTIFIABLE_WITHIN, NORMAL_90, relative_error
from jaxrender.inverse.posedness import RECOVERABLE
from jaxrender.pipelines.analysis.forecast import ConfigAnalysis

# A relative standard error at which a 90 % interval reaches as far as it may.
_TELLABLE = IDENTIFIABLE_WITHIN / NORMAL_90
_TITLES = {"kd": "$k_d$", "ks": "$k_s$", "sigma": "$\\sigma$", "mu": "$\\mu - 1$"}


def draw(path: Path, found: ConfigAnalysis) -> None:
    """Write the picture in the format of its suffix."""
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(9.5, 3.8), layout="constrained")
    spectrum, bars = drawing.subplots(1, 2)
    _draw_spectrum(spectrum, found)
    _draw_errors(bars, found)
    drawing.savefig(path, dpi=130)


def _draw_spectrum(axes, found: ConfigAnalysis) -> None:
    axes.set(title="light, material known", xlabel="degree", ylabel="rms coefficient")
    if found.light is None:
        axes.text(0.5, 0.5, "cannot be recovered", ha="center", transform=axes.transAxes)
        return
    size, noise = found.light.size, found.light.report.noise
    degrees = np.arange(len(size))
    shown = np.where(size > 1e-9 * size.max(), size, np.nan)
    axes.semilogy(degrees, shown, "o-", markersize=4, label="light supposed")
    axes.semilogy(degrees, noise, "s-", markersize=3, label="its predicted error")
    axes.semilogy(degrees, noise / RECOVERABLE, "k--", linewidth=0.8, label="identifiable above")
    axes.xaxis.get_major_locator().set_params(integer=True)
    # Degrees that nothing is known of would leave no room for the others.
    axes.set_ylim(0.3 * np.min(noise), 30 * np.max(size))
    axes.legend(fontsize=8)


def _draw_errors(axes, found: ConfigAnalysis) -> None:
    sets = [
        (title, forecast.parameters, forecast.identifiable)
        for title, forecast in (("light known", found.material), ("light unknown", found.joint))
        if forecast is not None
    ]
    axes.set(title="material: predicted relative standard error", yscale="log")
    width = 0.8 / max(1, len(sets))
    brdf = found.supposition.supposed.brdf
    every = [*brdf.amplitude_names, *brdf.numbers]
    for number, (title, parameters, identifiable) in enumerate(sets):
        names = [name for name in every if name in identifiable]
        heights = [max(np.nan_to_num(relative_error(parameters, name)), 1e-6) for name in names]
        places = np.array([every.index(name) for name in names]) + (number - 0.4) * width
        axes.bar(places, heights, width, label=title)
    axes.axhline(_TELLABLE, color="k", linestyle="--", linewidth=0.8, label="just identifiable")
    titles = [_TITLES.get(name, name) for name in every]
    axes.set_xticks(range(len(every)), titles)
    axes.legend(fontsize=8)
