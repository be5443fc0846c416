"""A recovered texture as the arrays of ``result.nc``."""

import numpy as np

from jaxrender.inverse.texture import TextureEstimate
from jaxrender.io.netcdf import Group, Variable
from jaxrender.pipelines.arrays import light_group

# What a site has: units, meaning.
_SITE = {
    "kd": ("1/sr", "diffuse BRDF"),
    "kd_error": ("1/sr", "standard error of kd"),
    "ks": ("1", "specular reflectance"),
    "ks_error": ("1", "standard error of ks"),
    "misfit": ("1", "rms of a site's residuals over the noise"),
    "kd_exact_error": ("1/sr", "standard error of kd if the model were exact"),
    "ks_exact_error": ("1", "standard error of ks if the model were exact"),
    "seen": ("1", "observations of a site"),
    "kd_marked": ("1", "whether kd is not to be trusted"),
    "ks_marked": ("1", "whether ks is the prior's more than its own"),
    "ks_colour_marked": ("1", "whether the colour of ks is the prior's more than its own"),
    "region": ("1", "number of the region, -1 for none"),
    "sigma": ("radian", "width of the lobe"),
    "sigma_error": ("radian", "standard error of sigma"),
    "sigma_marked": ("1", "whether sigma is not to be trusted"),
    "normal": ("1", "normal, a unit vector"),
    "normal_offset": ("1", "what to add to the shape's normal before it is made unit"),
    "normal_error": ("radian", "standard error of the normal's tilt along a tangent"),
    "normal_marked": ("1", "whether the normal is not to be trusted"),
}


def texture_groups(estimate: TextureEstimate) -> dict[str, Group]:
    """Lay out every site's values, errors and marks, sigma and mu, and a recovered light."""
    texture, sites = estimate.texture, estimate.sites
    names, size = (("row", "column"), sites.image)
    if size is None:
        names, size = ("vertex",), (sites.count,)
    every = texture._asdict()
    values = {name: every[name] for name in _SITE if every.get(name) is not None}
    values["region"] = sites.regions.of_site
    if estimate.variation is not None:
        values |= zip(("sigma", "sigma_error"), estimate.variation)
    if estimate.normals is not None:
        offset, normal, error = estimate.normals
        values |= {"normal": normal, "normal_offset": offset, "normal_error": error}
    values |= estimate.marked
    variables = {}
    for name, found in values.items():
        inner = (
            (("axis" if name.startswith("normal") else "channel"),) if np.ndim(found) == 2 else ()
        )
        shaped = np.reshape(found, (*size, *np.shape(found)[1:]))
        variables[name] = Variable((*names, *inner), shaped, *_SITE[name])
    groups = {"texture": Group(variables), "lobe": Group(_lobe(estimate))}
    if estimate.light is not None:
        coefficients, errors = estimate.light
        groups["light"] = light_group(coefficients, slow_error=errors)
    return groups


def _lobe(estimate: TextureEstimate) -> dict[str, Variable]:
    variables = {}
    for name in ("sigma", "mu", "sigma_error", "mu_error"):
        given = [getattr(lobe, name) for lobe in estimate.lobes]
        numbers = [np.nan if value is None else value for value in given]
        units = "radian" if name.startswith("sigma") else "1"
        variables[name] = Variable(("region",), numbers, units, f"{name} of each region's lobe")
    return variables
