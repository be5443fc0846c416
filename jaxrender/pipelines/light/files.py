"""A recovered light as images and as NetCDF, and the samples that it explains."""

import h5netcdf
import numpy as np

from jaxrender.harmonics import LatLongGrid, band_limit_of, degrees, orders
from jaxrender.inverse import Factorization, Observations
from jaxrender.inverse.factorization import RecoveredScene
from jaxrender.lighting import DirectionalSources, positive_environment
from jaxrender.pipelines.result import write_variable
from jaxrender.shapes import Float

# Rows of the recovered light's image: its texels are smaller than any lobe that showed it.
_ROWS = 128


def write_light(file: h5netcdf.File, scene: RecoveredScene) -> None:
    """Write slow coefficients and lamps, with their errors."""
    light = file.create_group("light")
    count, channels = scene.slow.shape
    lamps = scene.sources.directions.shape[0]
    light.dimensions = {
        "coefficient": count,
        "channel": channels,
        "source": max(lamps, 1),
        "component": 3,
    }
    band_limit = band_limit_of(count)
    write_variable(light, "degree", ("coefficient",), degrees(band_limit))
    write_variable(light, "order", ("coefficient",), orders(band_limit))
    for name in ("slow", "slow_error", "total"):
        write_variable(light, name, ("coefficient", "channel"), getattr(scene, name))
    if lamps:
        write_variable(light, "direction", ("source", "component"), scene.sources.directions)
        write_variable(light, "irradiance", ("source", "channel"), scene.sources.irradiance)
        write_variable(light, "irradiance_error", ("source", "channel"), scene.energy_error)
        write_variable(light, "direction_error", ("source",), scene.direction_error)


def write_samples(file: h5netcdf.File, observations: Observations, found: Factorization) -> None:
    """Write the samples, and what the light and the material that were found predict of them."""
    samples, channels = file.create_group("samples"), observations.radiance.shape[1]
    samples.dimensions = {"sample": observations.count, "channel": channels, "component": 3}
    each = ("sample", "component")
    write_variable(samples, "normal", each, observations.samples.normals)
    write_variable(samples, "outgoing", each, observations.samples.outgoing)
    write_variable(samples, "radiance", ("sample", "channel"), observations.radiance)
    write_variable(samples, "predicted", ("sample", "channel"), found.predicted)
    write_variable(samples, "frame", ("sample",), observations.frame)


def light_images(
    scene: RecoveredScene,
) -> tuple[Float[np.ndarray, "row column channel"], Float[np.ndarray, "row column channel"]]:
    """Draw the whole light, each lamp as one texel of its energy, and its slow part alone.

    Where a sum of few degrees falls below zero the light is black; what that adds is taken off
    elsewhere, so that the image has the coefficients that were found.
    """
    grid = LatLongGrid(_ROWS, 2 * _ROWS)
    light = positive_environment(np.asarray(scene.slow), np.asarray(scene.slow_error), _ROWS)
    slow = np.asarray(light.radiance)
    whole = slow.copy()
    rows, columns = texels_of(scene.sources, grid)
    energy = np.maximum(np.asarray(scene.sources.irradiance), 0)
    np.add.at(whole, (rows, columns), energy / grid.weights()[rows, columns, None])
    return whole, slow


def texels_of(sources: DirectionalSources, grid: LatLongGrid) -> tuple[np.ndarray, np.ndarray]:
    """Find the texel that holds each source."""
    x, y, z = np.asarray(sources.directions, float).T
    height, width = grid.shape
    rows = np.clip(np.arccos(np.clip(z, -1, 1)) / np.pi * height, 0, height - 1).astype(int)
    columns = ((np.arctan2(y, x) / (2 * np.pi)) % 1 * width).astype(int) % width
    return rows, columns
