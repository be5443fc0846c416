"""A recovered texture as files: maps as EXR, marks as PNG, vertices as PLY, all as NetCDF."""

from pathlib import Path

import h5netcdf
import numpy as np

from jaxrender.geometry import Mesh
from jaxrender.harmonics import band_limit_of, degrees, orders
from jaxrender.inverse.texture import Texture, dilated, image_of_sites
from jaxrender.io import write_image, write_mesh
from jaxrender.pipelines.result import write_variable
from jaxrender.pipelines.texture.sites import SurfaceSites
from jaxrender.pipelines.texture.surface import Surface
from jaxrender.shapes import Bool, Float

_MAPS = ("kd", "ks", "kd_error", "ks_error")


def write_maps(folder: Path, surface: Surface, sites: SurfaceSites, reach: int) -> None:
    """Write the maps into ``folder/textures``.

    Maps are continued ``reach`` texels beyond what was seen and are 0 from there on; ``marks.png``
    is red where K_d is not to be trusted, green where K_s is not, blue where nothing was seen.
    """
    (folder / "textures").mkdir()
    if sites.image is None:
        _write_vertices(folder / "textures" / "vertices.ply", surface, sites)
        return
    for name, image in map_images(surface, sites).items():
        filled = dilated(image, reach, sites.wraps)
        write_image(folder / "textures" / f"{name}.exr", np.nan_to_num(filled))
    write_image(folder / "textures" / "marks.png", marks_image(surface.texture, sites))


def map_images(
    surface: Surface, sites: SurfaceSites
) -> dict[str, Float[np.ndarray, "row column channel"]]:
    """Lay values and errors out as images, NaN where unseen or unlit."""
    assert sites.image is not None
    texture, images = surface.texture, {}
    for name in _MAPS:
        # What was seen but never lit has a value that means nothing: its error is infinite.
        error = getattr(texture, f"{name.removesuffix('_error')}_error")
        values = getattr(texture, name)
        known = _finite(values) & _finite(error) & (texture.seen > 0)
        images[name] = image_of_sites(values, sites.image, known)
    if surface.variation is not None:
        sigma, error = surface.variation
        images["sigma"] = image_of_sites(sigma, sites.image, np.isfinite(sigma))
        images["sigma_error"] = image_of_sites(error, sites.image, np.isfinite(sigma))
    return images


def marks_image(texture: Texture, sites: SurfaceSites) -> Float[np.ndarray, "row column channel"]:
    """Lay out what is marked."""
    assert sites.image is not None
    marks = np.stack([texture.kd_marked, texture.ks_marked, texture.seen == 0], axis=-1)
    return image_of_sites(marks.astype(float), sites.image)


def write_texture_arrays(path: Path, surface: Surface, sites: SurfaceSites) -> None:
    """Write every site's values, errors and marks, sigma and mu, and a recovered light."""
    texture = surface.texture
    with h5netcdf.File(path, "w") as file:
        group = file.create_group("texture")
        channels = texture.kd.shape[1]
        if sites.image is None:
            size, names = (sites.count,), ("vertex",)
        else:
            size, names = sites.image, ("row", "column")
        group.dimensions = {**dict(zip(names, size)), "channel": channels}
        for name in ("kd", "kd_error"):
            values = getattr(texture, name).reshape(*size, channels)
            write_variable(group, name, (*names, "channel"), values)
        for name in ("ks", "ks_error", "misfit", "seen", "kd_marked", "ks_marked"):
            values = np.asarray(getattr(texture, name)).reshape(size)
            # NetCDF has no truth values.
            values = values.astype(np.int8) if values.dtype == bool else values
            write_variable(group, name, names, values)
        write_variable(group, "region", names, surface.region.reshape(size))
        if surface.variation is not None:
            for name, values in zip(("sigma", "sigma_error"), surface.variation):
                write_variable(group, name, names, values.reshape(size))
        lobe = file.create_group("lobe")
        lobe.dimensions = {"region": len(surface.regions)}
        for name in ("sigma", "mu", "sigma_error", "mu_error"):
            given = [getattr(region, name) for region in surface.regions]
            numbers = [np.nan if value is None else value for value in given]
            write_variable(lobe, name, ("region",), numbers)
        _write_light(file, surface)


def _write_light(file: h5netcdf.File, surface: Surface) -> None:
    if surface.light is None:
        return
    coefficients, errors = surface.light
    light = file.create_group("light")
    count, channels = coefficients.shape
    light.dimensions = {"coefficient": count, "channel": channels}
    write_variable(light, "degree", ("coefficient",), degrees(band_limit_of(count)))
    write_variable(light, "order", ("coefficient",), orders(band_limit_of(count)))
    write_variable(light, "slow", ("coefficient", "channel"), coefficients)
    if errors is not None:
        write_variable(light, "slow_error", ("coefficient", "channel"), errors)


def _write_vertices(path: Path, surface: Surface, sites: SurfaceSites) -> None:
    """Write the mesh with a number for each vertex and map; unseen vertices have NaN."""
    assert isinstance(sites.shape, Mesh)
    texture = surface.texture
    columns = {"ks": texture.ks, "ks_error": texture.ks_error}
    for channel, letter in enumerate("rgb"):
        columns[f"kd_{letter}"] = texture.kd[:, channel]
        columns[f"kd_error_{letter}"] = texture.kd_error[:, channel]
    columns |= {"kd_marked": texture.kd_marked, "ks_marked": texture.ks_marked}
    if surface.variation is not None:
        columns |= {"sigma": surface.variation.sigma, "sigma_error": surface.variation.error}
    write_mesh(path, sites.shape, columns)


def _finite(values: Float[np.ndarray, "site *channel"]) -> Bool[np.ndarray, "site"]:
    finite: np.ndarray = np.isfinite(np.asarray(values))
    return np.asarray(finite.reshape(len(values), -1).all(axis=1))
