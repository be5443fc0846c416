"""A BRDF's coefficients from photographs of a convex shape under any known light (T 6.4.2).

estimate = estimate_spectrum(load_capture("photos/transforms.json"), Sphere(), light)
print(estimate)
estimate.save("lobe")
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrender.geometry import Shape, fibonacci_sphere
from jaxrender.harmonics import degrees
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.any_estimate import AnyEstimate
from jaxrender.inverse.brdf_spectrum.basis import SpectrumBasis
from jaxrender.inverse.brdf_spectrum.examination import (
    MORE,
    SpectrumSettings,
    misfit_of,
    order_too_low,
)
from jaxrender.inverse.brdf_spectrum.harmonic_brdf import HarmonicBRDF
from jaxrender.inverse.brdf_spectrum.recovery import BRDFSpectrum, fit_brdf_spectrum
from jaxrender.inverse.diagnosis import Diagnosis
from jaxrender.inverse.intervals import IDENTIFIABLE_WITHIN, NORMAL_90
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.misfit import Misfit
from jaxrender.inverse.observations import Observations, random_subset
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.own_words import plain
from jaxrender.inverse.photographs import LoadedCapture
from jaxrender.lighting import Light
from jaxrender.shapes import Float
from jaxrender.spectra import light_coefficients

# Directions of either side in which the lobe's error is judged, and the smallest cosine there.
_DIRECTIONS, _LOWEST_COSINE = 64, 0.15
# More than this left unexplained is worth a word.
_MUCH_LEFT = 0.1
# Light of this amplitude beside degree 0 is next to none of a degree.
_NEXT_TO_NONE = 0.01


@dataclass(frozen=True, eq=False)
class SpectrumEstimate(AnyEstimate):
    """Recovered coefficients of the order that was asked for, and of some lower ones.

    ``values["rho"]`` are the coefficients of each channel, rho_lpq of T 2.53; the degrees and the
    order of each are ``spectrum.basis.indices``.  ``light`` are the coefficients of the light.
    ``identifiable`` has the one key ``lobe``.  ``misfit`` is what the photographs hold above their
    noise, where that is known, and ``diagnosis`` what would explain it.
    """

    orders: tuple[BRDFSpectrum, ...]
    light: Float[np.ndarray, "coefficient channel"]
    noise: NoiseModel
    outcome: Outcome
    reasons: tuple[str, ...]
    misfit: Misfit | None = None
    diagnosis: tuple[Diagnosis, ...] = ()

    @property
    def title(self) -> str:
        """Say what was found."""
        return f"BRDF to order {self.spectrum.basis.band_limit}"

    @property
    def spectrum(self) -> BRDFSpectrum:
        """The coefficients of the order that was asked for, with their covariance."""
        return self.orders[-1]

    @property
    def material(self) -> HarmonicBRDF:
        """The coefficients as a BRDF to render with."""
        return HarmonicBRDF.of(self.spectrum)

    @property
    def values(self) -> dict[str, Float[np.ndarray, "unknown channel"]]:
        """The coefficients."""
        return {"rho": self.spectrum.values}

    @property
    def standard_error(self) -> dict[str, Float[np.ndarray, "unknown channel"]]:
        """Their standard errors."""
        return {"rho": self.spectrum.standard_error}

    @property
    def interval90(self) -> dict[str, Float[np.ndarray, "unknown channel 2"]]:
        """Their 90 % intervals."""
        value, half = self.spectrum.values, NORMAL_90 * self.spectrum.standard_error
        return {"rho": np.stack([value - half, value + half], axis=-1)}

    @property
    def identifiable(self) -> dict[str, bool]:
        """Whether the lobe as a whole is identifiable."""
        return {"lobe": self.outcome in (Outcome.CONVERGED, Outcome.MISFIT)}

    @property
    def relative_rms(self) -> float:
        """What is left unexplained, beside the radiance."""
        return self.spectrum.relative_rms

    @property
    def light_amplitudes(self) -> Float[np.ndarray, "degree"]:
        """The root of the light's energy of each degree, beside that of degree 0."""
        return _amplitudes(self.light, self.spectrum.basis.band_limit)

    def by_degree(self) -> list["DegreeOfLobe"]:
        """Sum up the coefficients of each degree."""
        spectrum = self.spectrum
        part = spectrum.resolution.mean(axis=1)
        size = np.sqrt(np.mean(spectrum.values**2, axis=1))
        error = np.sqrt(np.mean(spectrum.standard_error**2, axis=1))
        of_light, highest = spectrum.basis.indices[0], np.max(spectrum.basis.indices[:2], axis=0)
        return [
            DegreeOfLobe(
                degree,
                float(amplitude),
                float(part[of_light == degree].max()),
                float(np.sqrt(np.mean(size[highest == degree] ** 2))),
                float(np.sqrt(np.mean(error[highest == degree] ** 2))),
            )
            for degree, amplitude in enumerate(self.light_amplitudes)
        ]

    def _rows(self) -> list[str]:
        error = 100 * lobe_error(self.spectrum)
        note = "" if self.identifiable["lobe"] else "  not identifiable"
        return [
            f"  standard error of the lobe {error:.3g} %{note}",
            "  degree      light determined  rms of rho  its standard error",
            *(
                f"  {one.degree:<6} {one.light:>10.3g} {100 * one.determined:>6.0f} % "
                f"{one.rms_value:>13.4g} {one.rms_standard_error:>19.3g}"
                for one in self.by_degree()
            ),
        ]

    def _write(self, folder: Path) -> dict[str, Any]:
        """Lay out which coefficient is which, and the light."""
        names = ("degree", "outgoing_degree", "order")
        indices = {name: index.tolist() for name, index in zip(names, self.spectrum.basis.indices)}
        return {
            "reciprocal": self.spectrum.basis.reciprocal,
            "indices": indices,
            "light": [{"coefficients": plain(self.light)}],
        }


class DegreeOfLobe(NamedTuple):
    """What the light has of a degree, how far the data tell it, and the size of coefficients.

    ``light`` is an amplitude beside degree 0.  ``determined`` is the largest part that the data
    have in a coefficient of this degree of the light.  The sizes are of those whose higher degree
    it is.
    """

    degree: int
    light: float
    determined: float
    rms_value: float
    rms_standard_error: float


def estimate_spectrum(
    photographs: LoadedCapture | Observations,
    shape: Shape,
    light: Light | KnownLight,
    settings: SpectrumSettings | None = None,
    watch: Callable[[BRDFSpectrum], None] = lambda spectrum: None,
) -> SpectrumEstimate:
    """Recover a BRDF's coefficients of the order asked for, and of a third and two thirds of it.

    ``watch`` is called with the result of each order.  Raises ``ValueError`` for concave shapes,
    and for a light of its own in each photograph.  Raises it, too, for an environment of too few
    rows, for too few samples, and as ``fit_brdf_spectrum`` does.  Raises ``InputError`` for
    photographs that no fit can use.
    """
    settings = settings or SpectrumSettings()
    known = light if isinstance(light, KnownLight) else KnownLight.of(light, shape=shape)
    if known.varies:
        raise ValueError(
            "each photograph has a light of its own; coefficients need one that all share"
        )
    if known.near is not None:
        raise ValueError(
            "sources that have a place look different from every point; coefficients need a light "
            "that is far away"
        )
    if not shape.is_convex():
        raise ValueError(
            "the shape is concave, and coefficients are recovered without shadows; fit a model "
            "(task: brdf), which has them"
        )
    pool = photographs
    if isinstance(pool, LoadedCapture):
        pool = pool.observations(shape)
    drawn = random_subset(pool, settings.count, settings.seed)
    basis = SpectrumBasis(settings.order, settings.reciprocal)
    if drawn.count < basis.count:
        raise ValueError(
            f"{drawn.count} samples for {basis.count} coefficients; lower the order, or give more "
            "samples"
        )
    coefficients = _coefficients(known, settings.order)
    found = []
    for order in _orders(settings.order):
        own = SpectrumBasis(order, settings.reciprocal)
        found.append(fit_brdf_spectrum(drawn, coefficients, own, settings.noise))
        watch(found[-1])
    noise = found[-1].noise
    assert noise is not None
    outcome, reasons = _judged(found[-1], _amplitudes(coefficients, settings.order))
    misfit = misfit_of(drawn, pool, coefficients, found[-1], settings)
    diagnosis: tuple[Diagnosis, ...] = ()
    if misfit is not None and misfit.found:
        finer = _finer(known, settings)
        if finer is not None:
            diagnosis = order_too_low(drawn, finer, found[-1], misfit)
        reasons = (misfit.sentence(), *(one.reason for one in diagnosis), *reasons)
        outcome = Outcome.MISFIT if outcome is Outcome.CONVERGED else outcome
    return SpectrumEstimate(tuple(found), coefficients, noise, outcome, reasons, misfit, diagnosis)


def _finer(
    light: KnownLight, settings: SpectrumSettings
) -> Float[np.ndarray, "coefficient channel"] | None:
    """Analyse the light to two degrees more; None where it has none."""
    try:
        return _coefficients(light, settings.order + MORE)
    except ValueError:
        return None


def lobe_error(spectrum: BRDFSpectrum) -> float:
    """Compare the standard error of rho cos t_i with itself, rms over visible directions."""
    directions = fibonacci_sphere(_DIRECTIONS)
    above = directions[directions[:, 2] > _LOWEST_COSINE]
    first, second = (part.ravel() for part in np.indices((len(above), len(above))))
    values, errors = spectrum.transfer(above[first], above[second])
    return float(np.sqrt(np.mean(errors**2) / np.mean(values**2)))


def _coefficients(light: KnownLight, order: int) -> Float[np.ndarray, "coefficient channel"]:
    total = np.zeros(((order + 1) ** 2, light.directional.irradiance.shape[1]))
    if light.environment is not None:
        if light.environment.grid.band_limit < order:
            raise ValueError(
                f"an environment of {light.environment.grid.shape[0]} rows has degrees to "
                f"{light.environment.grid.band_limit}: lower the order, or give more rows"
            )
        total = total + np.asarray(light_coefficients(light.environment, order))
    if light.directional.directions.shape[0]:
        total = total + np.asarray(light_coefficients(light.directional, order))
    return total


def _orders(order: int) -> list[int]:
    """A third, two thirds, and all of the order asked for."""
    return sorted({max(1, order // 3), max(1, 2 * order // 3), order} if order > 1 else {order})


def _amplitudes(
    light: Float[np.ndarray, "coefficient channel"], order: int
) -> Float[np.ndarray, "degree"]:
    energy = np.mean(light**2, axis=1)
    by_degree = np.bincount(degrees(order), energy)
    return np.sqrt(by_degree / by_degree[0])


def _judged(
    spectrum: BRDFSpectrum, amplitudes: Float[np.ndarray, "degree"]
) -> tuple[Outcome, tuple[str, ...]]:
    """Decide whether the lobe is identifiable, and say what it lacks."""
    error = lobe_error(spectrum)
    if NORMAL_90 * error <= IDENTIFIABLE_WITHIN:
        left = spectrum.relative_rms
        if left < _MUCH_LEFT:
            return Outcome.CONVERGED, ()
        much = (
            f"{100 * left:.0f} % of the photographs is left unexplained: the order is too low for "
            "light this sharp, or the surface is not of one material"
        )
        return Outcome.CONVERGED, (much,)
    reasons = [
        f"the lobe is not identifiable to order {spectrum.basis.band_limit}: its standard error is "
        f"{100 * error:.0f} % of it"
    ]
    dark = np.flatnonzero(amplitudes < _NEXT_TO_NONE)
    if dark.size:
        numbers = ", ".join(map(str, dark))
        reasons.append(
            f"the light has next to nothing of degree {numbers}, so what the lobe does there "
            "shows in no photograph: lower the order, or give light with more detail"
        )
    else:
        reasons.append("give more views, less noise, or a lower order")
    return Outcome.NOT_IDENTIFIABLE, tuple(reasons)
