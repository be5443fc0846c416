"""A recovered texture as files: maps as EXR, marks as PNG, vertices as PLY, all as NetCDF."""

from pathlib import Path

import numpy as np

from jaxrender.geometry import Mesh
from jaxrender.inverse.texture import Texture, dilated, image_of_sites
from jaxrender.io import write_image, write_mesh
from jaxrender.io.netcdf import Group, Variable
from jaxrender.pipelines.arrays import light_group
from jaxrender.pipelines.texture.sites import SurfaceSites
from jaxrender.pipelines.texture.surface import Surface
from jaxrender.shapes import Bool, Float

_MAPS = ("kd", "ks", "kd_error", "ks_error")
# What a site has: units, meaning.
_SITE = {
    "kd": ("1/sr", "diffuse BRDF"),
    "kd_error": ("1/sr", "standard error of kd"),
    "ks": ("1", "specular reflectance"),
    "ks_error": ("1", "standard error of ks"),
    "misfit": ("1", "rms of a site's residuals over the noise"),
    "seen": ("1", "observations of a site"),
    "kd_marked": ("1", "whether kd is not to be trusted"),
    "ks_marked": ("1", "whether ks is the prior's more than its own"),
    "region": ("1", "number of the region, -1 for none"),
    "sigma": ("radian", "width of the lobe"),
    "sigma_error": ("radian", "standard error of sigma"),
}


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


def texture_groups(surface: Surface, sites: SurfaceSites) -> dict[str, Group]:
    """Lay out every site's values, errors and marks, sigma and mu, and a recovered light."""
    texture = surface.texture
    names, size = (("row", "column"), sites.image)
    if size is None:
        names, size = ("vertex",), (sites.count,)
    values = {name: getattr(texture, name) for name in _SITE if name in texture._fields}
    values["region"] = surface.region
    if surface.variation is not None:
        values |= zip(("sigma", "sigma_error"), surface.variation)
    variables = {}
    for name, found in values.items():
        inner = ("channel",) if np.ndim(found) == 2 else ()
        shaped = np.reshape(found, (*size, *np.shape(found)[1:]))
        variables[name] = Variable((*names, *inner), shaped, *_SITE[name])
    groups = {"texture": Group(variables), "lobe": Group(_lobe(surface))}
    if surface.light is not None:
        coefficients, errors = surface.light
        groups["light"] = light_group(coefficients, slow_error=errors)
    return groups


def _lobe(surface: Surface) -> dict[str, Variable]:
    variables = {}
    for name in ("sigma", "mu", "sigma_error", "mu_error"):
        given = [getattr(region, name) for region in surface.regions]
        numbers = [np.nan if value is None else value for value in given]
        units = "radian" if name.startswith("sigma") else "1"
        variables[name] = Variable(("region",), numbers, units, f"{name} of each region's lobe")
    return variables


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
