"""A known light by degree: its coefficients, how much it sends, which degrees of it show."""

import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.harmonics import analyse, band_limit_of, real_basis
from jaxrender.inverse.forecast.situation import Foreseen
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.lighting.operator import sizes_by_degree
from jaxrender.inverse.posedness import posedness
from jaxrender.shapes import Float
from jaxrender.spectra import head_on_transfer, transfer_of_samples

_HIGHEST_DEGREE = 64
# Degrees below this part of the strongest are the image's texels and rounding.
_ROUNDING = 1e-4


def highest_identifiable_degree(foreseen: Foreseen) -> int:
    """The highest degree at which the light shows through the lobe above the noise (T 2.4.2)."""
    _, frame, light = foreseen.situation
    brdf, noise = foreseen.supposed.brdf, foreseen.supposed.noise
    coefficients = light_coefficients(light.of_frame(0), _HIGHEST_DEGREE)
    band_limit = band_limit_of(len(coefficients))
    # Of an energy of one, whatever a model's ks means.
    if isinstance(brdf, Glossy):
        lobe = brdf.with_roughness(float(brdf.sigma), None).as_metal()
        transfer = transfer_of_samples(lobe, np.ones(1), band_limit)
        transfer = np.asarray(transfer)[0] / float(lobe.energy)
    else:
        transfer = head_on_transfer(brdf, band_limit) / float(brdf.energy)
    transfer = np.asarray(transfer)
    radiance = np.asarray(foreseen.data.radiance)
    level = np.sqrt(np.mean(radiance**2, keepdims=True))
    deviation = np.asarray(noise.standard_deviation(level))
    relative = deviation.item() / max(level.item(), 1e-300)
    shown = posedness(coefficients, transfer, max(relative, 1e-9), len(frame)).brdf_recoverable
    # Rounding and the image's texels make a little of every degree.
    sizes = sizes_by_degree(coefficients)
    degrees = np.flatnonzero(shown & (sizes > _ROUNDING * sizes.max()))
    return int(degrees[-1]) if degrees.size else 0


def light_coefficients(
    light: KnownLight, band_limit: int
) -> Float[np.ndarray, "coefficient channel"]:
    """Analyse a whole light, sources included, as far as its image's grid allows."""
    environment, sources = light.environment, light.directional
    if environment is not None:
        band_limit = min(band_limit, environment.grid.band_limit)
    directions = np.asarray(sources.directions, float)
    found = np.asarray(real_basis(directions, band_limit)).T @ np.asarray(sources.irradiance)
    if environment is not None:
        radiance = np.asarray(environment.radiance, float)
        found = found + np.asarray(analyse(environment.grid, radiance, band_limit))
    return found


def mean_irradiance(light: KnownLight) -> Float[np.ndarray, "channel"]:
    """The irradiance of a plane, averaged over all ways it may face."""
    parts = [light.directional.nodes()]
    if light.environment is not None:
        parts.append(light.environment.nodes())
    return np.sum([np.sum(np.asarray(part.irradiance), axis=0) for part in parts], axis=0) / 4
