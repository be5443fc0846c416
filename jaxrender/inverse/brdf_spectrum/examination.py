"""What coefficients of a BRDF leave above the noise, and whether a higher order explains it."""

from typing import NamedTuple

import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.brdf_spectrum.basis import SpectrumBasis
from jaxrender.inverse.brdf_spectrum.recovery import BRDFSpectrum, fit_brdf_spectrum
from jaxrender.inverse.diagnosis import Diagnosis
from jaxrender.inverse.misfit import Left, Misfit, measure_misfit, rows_of_three
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.weights import standard_deviations
from jaxrender.shapes import Float

# Pixels that tell the noise, and how much higher an order is tried.
_NEIGHBOURS, MORE = 6000, 2
# A cause is named where the criterion prefers it by so much: odds of e^5 to one.
_NAMED = 10.0


class SpectrumSettings(NamedTuple):
    """How coefficients are recovered.

    ``order`` is the highest degree of either direction; ``reciprocal`` imposes reciprocity.
    ``noise`` is estimated where it is None.  Of all usable pixels ``count`` are drawn at random.
    """

    order: int = 6
    reciprocal: bool = True
    noise: NoiseModel | None = None
    count: int = 12_000
    seed: int = 0


def misfit_of(
    drawn: Observations,
    pool: Observations,
    light: Float[np.ndarray, "coefficient channel"],
    found: BRDFSpectrum,
    settings: SpectrumSettings,
) -> Misfit | None:
    """Measure noise between neighbours among all pixels, and what the samples hold above it."""
    rows = rows_of_three(pool, _NEIGHBOURS // 3, settings.seed).ravel()
    beside = pool.take(rows) if len(rows) else None
    fitted, neighbours = (
        None if part is None else Left(part, found.radiance(light, part.samples))
        for part in (drawn, beside)
    )
    assert fitted is not None
    return measure_misfit(fitted, neighbours, settings.noise)


def order_too_low(
    drawn: Observations,
    light: Float[np.ndarray, "coefficient channel"],
    found: BRDFSpectrum,
    misfit: Misfit,
) -> tuple[Diagnosis, ...]:
    """Name the order where two degrees more, which the light has, explain what is left."""
    basis = SpectrumBasis(found.basis.band_limit + MORE, found.basis.reciprocal)
    if drawn.count < basis.count:
        return ()
    finer = fit_brdf_spectrum(drawn, light, basis, found.noise, know_misfit=False)
    before, after = (_squares(drawn, light, one, misfit) for one in (found, finer))
    count, channels = drawn.radiance.shape
    more = channels * (basis.count - found.basis.count)
    gain = count * channels * np.log(before / max(after, 1e-300)) - more * np.log(count * channels)
    excess = max(before - count * channels, 1e-300)
    explains = float(np.clip((before - after - more) / excess, 0, 1))
    if gain <= _NAMED or explains <= 0:
        return ()
    sentence = f"the order {found.basis.band_limit} is too low"
    none = np.zeros(found.basis.count * channels)
    return (Diagnosis("order", sentence, explains, float(gain), none),)


def _squares(
    drawn: Observations,
    light: Float[np.ndarray, "coefficient channel"],
    found: BRDFSpectrum,
    misfit: Misfit,
) -> float:
    """Sum up the squares of what is left, over the variance of the pixels' noise."""
    enough = light[: (found.basis.band_limit + 1) ** 2]
    predicted = found.radiance(enough, drawn.samples)
    deviation = standard_deviations(misfit.noise, predicted)
    return float(np.sum(((np.asarray(drawn.radiance) - predicted) / deviation) ** 2))
