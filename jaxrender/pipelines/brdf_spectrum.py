"""Task ``brdf-spectrum``: the BRDF as coefficients from photographs under known light (T 6.4.2)."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import Shape, SurfaceSamples, fibonacci_sphere
from jaxrender.harmonics import degrees
from jaxrender.inverse import KnownLight, Observations, Outcome
from jaxrender.inverse.brdf_spectrum import BRDFSpectrum, SpectrumBasis, fit_brdf_spectrum
from jaxrender.inverse.photographs import Photograph
from jaxrender.io import write_environment
from jaxrender.io.netcdf import Group, Variable, opened
from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.config import RunConfig, SpectrumConfig
from jaxrender.pipelines.progress import Progress
from jaxrender.pipelines.recovery import Recovery
from jaxrender.pipelines.result import ARRAYS_FORMAT, Result
from jaxrender.pipelines.scene import fault_of, settings_of
from jaxrender.shapes import Float
from jaxrender.spectra import light_coefficients

# Directions of either side in which the lobe's error is judged, and the smallest cosine there.
_DIRECTIONS, _LOWEST_COSINE = 64, 0.15
# Half a 90 % interval in standard errors, and how wide it may be beside the lobe (DESIGN 5).
_NORMAL_90, _IDENTIFIABLE_WITHIN = 1.6448536269514722, 0.25
# More than this left unexplained is worth a word.
_MUCH_LEFT = 0.1
# Light of this amplitude beside degree 0 is next to none of a degree.
_NEXT_TO_NONE = 0.01
_UNKNOWN = ("unknown",)


class SpectrumRecovery(Recovery):
    """Recovered coefficients, of the order asked for and of some below."""

    def __init__(
        self,
        orders: tuple[BRDFSpectrum, ...],
        light: tuple[KnownLight, Float[np.ndarray, "coefficient channel"]],
        observations: Observations,
        photographs: list[Photograph],
    ):
        self.orders, self.observations = orders, observations
        (self.light, self.coefficients), self.photographs = light, photographs

    @property
    def spectrum(self) -> BRDFSpectrum:
        """The coefficients of the order asked for."""
        return self.orders[-1]

    def result(self) -> Result:
        """Sum up how well the lobe is told."""
        spectrum, amplitudes = self.spectrum, self._amplitudes()
        assert spectrum.noise is not None
        outcome, reasons = _judged(spectrum, amplitudes)
        return Result(
            task="brdf-spectrum",
            outcome=outcome,
            reasons=reasons,
            brdf={"model": "spectrum"},
            interval90={},
            standard_error={},
            identifiable={"lobe": outcome is Outcome.CONVERGED},
            relative_rms=spectrum.relative_rms,
            samples=self.observations.count,
            noise=spectrum.noise,
            lighting={
                "gauge": "given",
                "band_limit": spectrum.basis.band_limit,
                "coefficients_total": self.coefficients.tolist(),
            },
            photographs=self.photographs,
            own={"spectrum": _summary(self.orders, amplitudes)},
        )

    def predict(self) -> list[Float[np.ndarray, "row column channel"]]:
        """Render every photograph by the convolution (T 2.55)."""
        images = []
        for photograph in self.photographs:
            view = photograph.view
            samples = SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])
            image = np.zeros((*view.hit.shape, self.spectrum.values.shape[1]))
            # A truncated series may dip below zero.
            image[view.hit] = np.maximum(self.spectrum.radiance(self.coefficients, samples), 0)
            images.append(image)
        return images

    def arrays(self) -> dict[str, Group]:
        """Lay out the coefficients with their covariance, and the light."""
        spectrum = self.spectrum
        names = ("degree", "outgoing_degree", "order")
        variables = {
            name: Variable(_UNKNOWN, index, "1", f"{name.replace('_', ' ')} of a coefficient")
            for name, index in zip(names, spectrum.basis.indices)
        }
        for name, values, units, words in (
            ("value", spectrum.values, "1/sr", "coefficients of the lobe"),
            ("standard_error", spectrum.standard_error, "1/sr", "standard errors of value"),
            ("resolution", spectrum.resolution, "1", "part that the data have in a coefficient"),
        ):
            variables[name] = Variable((*_UNKNOWN, "channel"), values, units, words)
        every = ("channel", *_UNKNOWN, "other_unknown")
        words = "covariance of value"
        variables["covariance"] = Variable(every, spectrum.covariance, "1/sr^2", words)
        total = Variable(
            ("coefficient", "channel"), self.coefficients, "radiance", "coefficients of the light"
        )
        reciprocal = {"reciprocal": int(spectrum.basis.reciprocal)}
        return {"spectrum": Group(variables, reciprocal), "light": Group({"total": total})}

    def write_images(self, folder: Path) -> None:
        """Write the light."""
        if self.light.environment is not None:
            write_environment(folder / "lighting.exr", self.light.environment)

    def contents(self, title: str, result: dict[str, Any], frames: tuple) -> Any:
        """Gather what the report shows."""
        from jaxrender.pipelines.report import SpectrumContents

        energy = np.asarray(self._amplitudes()) ** 2
        return SpectrumContents(title, result, self.orders, energy, frames)

    def _amplitudes(self) -> Float[np.ndarray, "degree"]:
        """Take the root of the light's energy of each degree, beside that of degree 0."""
        energy = np.mean(self.coefficients**2, axis=1)
        by_degree = np.bincount(degrees(self.spectrum.basis.band_limit), energy)
        return np.sqrt(by_degree / by_degree[0])


def recover_spectrum(
    config: RunConfig,
    known: tuple[Observations, KnownLight],
    seen: tuple[list[Photograph], Shape],
    clock: Clock,
    progress: Progress,
) -> SpectrumRecovery:
    """Recover the coefficients; ``InputError`` for concave shapes and for too few samples."""
    (observations, light), (photographs, shape) = known, seen
    asked = config.spectrum or SpectrumConfig()
    place = str(config.capture.transforms)
    if not shape.is_convex():
        raise InputError(
            f"{place}: the shape is concave, and coefficients are recovered without shadows; "
            "choose task: brdf, which has them"
        )
    basis = SpectrumBasis(asked.order, asked.reciprocal)
    if observations.count < basis.count:
        raise InputError(
            f"{place}: {observations.count} samples for {basis.count} coefficients; lower "
            "spectrum.order, or raise samples.count"
        )
    with clock.stage("spectrum"), fault_of(place):
        coefficients = _coefficients(light, asked.order)
        found = []
        for order in _orders(asked.order):
            noise = settings_of(config).noise
            own = SpectrumBasis(order, asked.reciprocal)
            found.append(fit_brdf_spectrum(observations, coefficients, own, noise))
            progress.note(f"order {order}: {100 * found[-1].relative_rms:.2f} % unexplained")
    return SpectrumRecovery(tuple(found), (light, coefficients), observations, photographs)


def read_spectrum(path: Path) -> BRDFSpectrum:
    """Read the coefficients of a result; ``InputError`` where it has none or is damaged."""
    by_channel = (*_UNKNOWN, "channel")
    with opened(path, ARRAYS_FORMAT) as file:
        group = file.group("spectrum")
        limit = int(group.array("degree", _UNKNOWN).max())
        basis = SpectrumBasis(limit, bool(group.one_of("reciprocal", (0, 1))))
        value, told = (group.array(name, by_channel) for name in ("value", "resolution"))
        covariance = group.array("covariance", ("channel", *_UNKNOWN, "other_unknown"))
    return BRDFSpectrum(basis, value, covariance, told)


def _coefficients(light: KnownLight, order: int) -> Float[np.ndarray, "coefficient channel"]:
    total = np.zeros(((order + 1) ** 2, light.directional.irradiance.shape[1]))
    if light.environment is not None:
        if light.environment.grid.band_limit < order:
            raise ValueError(
                f"an environment of {light.environment.grid.shape[0]} rows has degrees to "
                f"{light.environment.grid.band_limit}: lower spectrum.order, or give more rows"
            )
        total = total + np.asarray(light_coefficients(light.environment, order))
    if light.directional.directions.shape[0]:
        total = total + np.asarray(light_coefficients(light.directional, order))
    return total


def _orders(order: int) -> list[int]:
    """A third, two thirds, and all of the order asked for."""
    return sorted({max(1, order // 3), max(1, 2 * order // 3), order} if order > 1 else {order})


def _summary(
    orders: tuple[BRDFSpectrum, ...], amplitudes: Float[np.ndarray, "degree"]
) -> dict[str, Any]:
    spectrum = orders[-1]
    told = _told(spectrum)
    size = np.sqrt(np.mean(spectrum.values**2, axis=1))
    error = np.sqrt(np.mean(spectrum.standard_error**2, axis=1))
    highest = np.max(spectrum.basis.indices[:2], axis=0)
    return {
        "order": spectrum.basis.band_limit,
        "reciprocal": spectrum.basis.reciprocal,
        "unknowns": spectrum.basis.count,
        "determined": float(spectrum.resolution.sum(axis=0).mean()),
        "lobe_relative_error": _lobe_error(spectrum),
        "by_degree": [
            {
                "degree": degree,
                "light": float(amplitudes[degree]),
                "told": float(told[degree]),
                "rms_value": float(np.sqrt(np.mean(size[highest == degree] ** 2))),
                "rms_standard_error": float(np.sqrt(np.mean(error[highest == degree] ** 2))),
            }
            for degree in range(spectrum.basis.band_limit + 1)
        ],
        "orders": [
            {
                "order": one.basis.band_limit,
                "unknowns": one.basis.count,
                "relative_rms": one.relative_rms,
                "lobe_relative_error": _lobe_error(one),
            }
            for one in orders
        ],
    }


def _told(spectrum: BRDFSpectrum) -> Float[np.ndarray, "degree"]:
    """Find the largest part that the data have in a coefficient of each degree of the light."""
    part = spectrum.resolution.mean(axis=1)
    degree = spectrum.basis.indices[0]
    return np.array([part[degree == one].max() for one in range(spectrum.basis.band_limit + 1)])


def _lobe_error(spectrum: BRDFSpectrum) -> float:
    """Compare the standard error of rho cos t_i with itself, rms over visible directions."""
    directions = fibonacci_sphere(_DIRECTIONS)
    above = directions[directions[:, 2] > _LOWEST_COSINE]
    first, second = (part.ravel() for part in np.indices((len(above), len(above))))
    values, errors = spectrum.transfer(above[first], above[second])
    return float(np.sqrt(np.mean(errors**2) / np.mean(values**2)))


def _judged(
    spectrum: BRDFSpectrum, amplitudes: Float[np.ndarray, "degree"]
) -> tuple[Outcome, tuple[str, ...]]:
    """Decide whether the lobe is told, and say what it lacks."""
    error = _lobe_error(spectrum)
    if _NORMAL_90 * error <= _IDENTIFIABLE_WITHIN:
        left = spectrum.relative_rms
        if left < _MUCH_LEFT:
            return Outcome.CONVERGED, ()
        much = (
            f"{100 * left:.0f} % of the photographs is left unexplained: the order is too low for "
            "light this sharp, or the surface is not of one material"
        )
        return Outcome.CONVERGED, (much,)
    reasons = [
        f"the lobe is not told to order {spectrum.basis.band_limit}: its standard error is "
        f"{100 * error:.0f} % of it"
    ]
    dark = np.flatnonzero(amplitudes < _NEXT_TO_NONE)
    if dark.size:
        numbers = ", ".join(map(str, dark))
        reasons.append(
            f"the light has next to nothing of degree {numbers}, so what the lobe does there "
            "shows in no photograph: lower spectrum.order, or give light with more detail"
        )
    else:
        reasons.append("give more views, less noise, or a lower spectrum.order")
    return Outcome.NOT_IDENTIFIABLE, tuple(reasons)
