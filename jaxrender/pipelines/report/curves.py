"""Plots of the curves that several numbers of a material describe together."""

from collections.abc import Callable

from markupsafe import Markup
from matplotlib.axes import Axes

from jaxrender.inverse.curves import DEGREES, Curve, curves_of
from jaxrender.pipelines.report.contents import MaterialContents
from jaxrender.pipelines.report.plots import MUTED, SERIES, plot

_AXES = {
    "distribution": ("tilt of a facet [degrees]", "D [1/sr]"),
    "fresnel": ("angle of incidence on a facet [degrees]", "F / F(0)"),
}
_DESCRIPTIONS = {
    "distribution": "The density of facets over their tilt, with its 90 % band",
    "fresnel": "The Fresnel reflectance over the angle of incidence, with its 90 % band",
}
# What is fainter than this part of the peak is not drawn.
_FAINTEST = 1e-5


def curves(contents: MaterialContents) -> list[Markup]:
    """Draw each curve with its band beside the nearest one of a named model; none of most."""
    found = curves_of(contents.fit.brdf, contents.fit.parameters)
    return [plot(curve.name, _DESCRIPTIONS[curve.name], _painter(curve)) for curve in found]


def _painter(curve: Curve) -> Callable[[Axes], None]:
    across, up = _AXES[curve.name]

    def paint(axes: Axes) -> None:
        axes.fill_between(DEGREES, curve.lower, curve.upper, color=SERIES[0], alpha=0.25, lw=0)
        axes.plot(DEGREES, curve.values, color=SERIES[0], label="found, with its 90 % band")
        axes.plot(
            DEGREES, curve.nearest_values, "--", color=MUTED, label=f"nearest: {curve.nearest}"
        )
        axes.set_yscale("log")
        low = max(float(curve.values.min()) / 2, _FAINTEST * float(curve.values.max()))
        axes.set_ylim(low, 2 * float(curve.upper[curve.values > low].max()))
        axes.set_xlabel(across)
        axes.set_ylabel(up)
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)

    return paint
