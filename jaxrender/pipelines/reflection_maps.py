"""A light and a lobe as a spherical harmonic reflection map, ready to be written (T 5.4 to 5.6).

Maps are global: the harmonics of a distant viewer are evaluated once a picture, the sum over them
is a plain reflection map (T 5.35), nothing is singular at the poles, and a renderer may move them
to a cube.  A local map, which is cheaper to evaluate at one point, is ``local_from_global`` of it.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.errors import InputError
from jaxrender.harmonics import LatLongGrid, analyse
from jaxrender.lighting import Environment
from jaxrender.pipelines.lobe_orders import LobeOrders, OrdersGoal, lobe_orders
from jaxrender.pipelines.lobes import Lobe
from jaxrender.pipelines.shrm_layout import ReflectionMap, ShrmAbout
from jaxrender.reflection.shrm import GlobalShrm, global_shrm, least_rows, local_shrm
from jaxrender.shapes import Float
from jaxrender.spectra import (
    CentralSpectrum,
    lobe_ringing,
    missing_light,
    residual_bound,
    windowed_spectrum,
)

# The fewest rows of a map, as of the maps of one direction.
_LEAST_ROWS = 32
# Numbers that ten rows a degree may come to (64 MiB in float32), and that a map may come to at all.
_MANY_NUMBERS, _MOST_NUMBERS = 1 << 24, 1 << 26


class LightSpectrum(NamedTuple):
    """L_lm of an image to the degree that it carries, and the integral of L^2."""

    coefficients: Float[np.ndarray, "coefficient channel"]
    energy: float

    @classmethod
    def of(cls, light: Environment) -> "LightSpectrum":
        """Analyse the light by the quadrature of its own texels."""
        radiance = np.asarray(light.radiance, float)
        energy = float(np.sum(light.grid.weights()[..., None] * radiance**2))
        return cls(np.asarray(analyse(light.grid, radiance, light.grid.band_limit)), energy)

    @property
    def band_limit(self) -> int:
        """The highest degree."""
        return int(np.sqrt(len(self.coefficients))) - 1

    def to(self, band_limit: int) -> Float[np.ndarray, "coefficient channel"]:
        """Cut at a degree."""
        return self.coefficients[: (band_limit + 1) ** 2]

    def missing(self) -> Float[np.ndarray, "degree"]:
        """Compute what part of the energy lies beyond each degree (T 5.16)."""
        return np.maximum(missing_light(self.coefficients, self.energy), 0)

    def beyond(self, chosen: LobeOrders) -> float:
        """Bound the part of the reflected light's energy beyond a choice's degree F (T 5.19)."""
        first = min(chosen.spectrum.band_limits[0], self.band_limit)
        bounds = residual_bound(self.to(first), self.energy, chosen.spectrum)
        return float(bounds[min(chosen.orders.light, first)])


def check_lobes(lobes: tuple[Lobe, ...] | list[Lobe]) -> None:
    """Raise ``InputError`` for a lobe that has no map."""
    for lobe in lobes:
        if lobe.brdf is None:
            raise InputError(
                f"--brdf {lobe.specification}: a mirror has no spherical harmonic reflection map, "
                "since no number of degrees holds it; leave it out, or leave out --shrm"
            )


def reflection_map(
    light: LightSpectrum,
    lobe: Lobe,
    goal: OrdersGoal,
    made_from: ShrmAbout,
    window: str | None = None,
) -> ReflectionMap:
    """Prefilter a light for a lobe, to the degrees that the goal asks for.

    ``made_from`` brings source, convention and axes; a window weighs the degrees that are kept.
    Raises ``InputError`` for degrees of which the map would not fit, ``ValueError`` for a window
    that nobody knows.
    """
    chosen = lobe_orders(lobe, goal, light.band_limit)
    limits = chosen.orders.light, chosen.orders.viewer
    grid = _grid(limits, light.coefficients.shape[1], lobe)
    kept = chosen.kept if window is None else windowed_spectrum(chosen.kept, window)
    maps = global_shrm(local_shrm(jnp.asarray(light.to(limits[0])), kept, grid))
    # A renderer's own precision, and half the file.
    single = jnp.asarray(maps.maps, jnp.float32)
    about = made_from._replace(
        brdf=lobe.specification,
        central_direction="normal" if lobe.model == "lambertian" else "reflected",
        units=_units(lobe),
        light_missing=float(light.missing()[limits[0]]),
        brdf_missing=max(chosen.orders.missing, 0.0),
        comment="; ".join([_comment(light, chosen, goal, grid), *_ringing(chosen, kept, window)]),
    )
    return ReflectionMap(GlobalShrm(single, grid, maps.band_limit, maps.weighted), about)


def _grid(limits: tuple[int, int], channels: int, lobe: Lobe) -> LatLongGrid:
    """Ten rows a degree, fewer where that were too many numbers, never so few that they alias."""
    orders = limits[0] * 10, (limits[1] + 1) ** 2 * channels
    least = least_rows(*limits)
    if 2 * least**2 * orders[1] > _MOST_NUMBERS:
        raise InputError(
            f"--brdf {lobe.specification}: degrees F {limits[0]} and P {limits[1]} need a map of "
            f"{least} rows of {(limits[1] + 1) ** 2} functions, {8 * least**2 * orders[1] >> 20} "
            "MiB; lower --degree or --view-degree"
        )
    affordable = int(np.sqrt(_MANY_NUMBERS / (2 * orders[1])))
    rows = max(least, _LEAST_ROWS, min(orders[0], affordable))
    return LatLongGrid(rows, 2 * rows)


def _units(lobe: Lobe) -> str:
    if lobe.model == "lambertian":
        return "radiance reflected by K_d = 1 / sr, which is the irradiance; times albedo / pi"
    if lobe.whole:
        return "radiance reflected by the material"
    return "radiance reflected by the lobe at amplitude one"


def _comment(light: LightSpectrum, chosen: LobeOrders, goal: OrdersGoal, grid: LatLongGrid) -> str:
    """Say in words what was kept and what was lost."""
    orders = chosen.orders
    lost = float(light.missing()[orders.light])
    count = (orders.viewer + 1) ** 2
    parts = [
        f"F {orders.light}, P {orders.viewer}: {count} map{'s' * (count > 1)} of {grid.height} x "
        f"{grid.width} texels",
        f"{percent(orders.missing)} of the BRDF's energy left out",
        f"light cut at degree {orders.light}, beyond which lie {percent(lost)} of its energy and "
        f"at most {percent(light.beyond(chosen))} of the reflected light's",
    ]
    if not chosen.reached:
        first, second = chosen.spectrum.band_limits
        why = "all that the probe carries" if first == light.band_limit else "the most tried"
        asked = goal.light is not None or goal.viewer is not None
        tried = "as asked for" if asked else f"F {first}, {why}, and P {second} do not suffice"
        parts.append(f"above the tolerance of {percent(goal.tolerance)}: {tried}")
    if grid.height < 10 * orders.light:
        parts.append(
            f"{grid.height / orders.light:.1f} rows a degree, fewer than 10: details are softened "
            "between texels"
        )
    return "; ".join(parts)


def _ringing(chosen: LobeOrders, kept: CentralSpectrum, window: str | None) -> list[str]:
    if window is None:
        return []
    before, after = (100 * lobe_ringing(spectrum) for spectrum in (chosen.kept, kept))
    return [
        f"lowest value of the lobe {after:.2g} % of its peak through the window {window}, "
        f"{before:.2g} % without"
    ]


def percent(part: float) -> str:
    """Write a part of an energy as a percentage of two digits."""
    return f"{100 * max(part, 0.0):.2g} %" if part < 0.995 else f"{100 * part:.0f} %"
