"""A texture of one material under a known light, which is split at the roughness found.

The dual model needs to know which parts of the light are narrow beside the lobe.  The lobe is
unknown at first.  So the light is split at a small roughness and a search follows.  Then the light
is split at the roughness found, and the search goes on.

Where sites have a sigma of their own the light is split for the finest of most of them.

The sites of a convex shape are then solved on the integral itself, unless the lobe is so narrow
that the light has too many cells; those of a concave one on the dual model.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Shape, SurfaceSamples
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import DualModel, ExactModel, Model
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.prepared_light import prepare_light
from jaxrender.inverse.shadowing import concave, nodes_seen, shadows_of
from jaxrender.inverse.texture.account import TextureFit
from jaxrender.inverse.texture.calibrate import End, recovered
from jaxrender.inverse.texture.examination import Painted
from jaxrender.inverse.texture.fit import check_variation, find_lobe, fit_maps, fit_texture
from jaxrender.inverse.texture.forward import Forward, ModelOf, dual_forward, exact_forward
from jaxrender.inverse.texture.measurements import by_site, whole_sites
from jaxrender.inverse.texture.rounds import TextureSettings
from jaxrender.inverse.texture.site_numbers import with_normals
from jaxrender.inverse.texture.sites import SurfaceSites
from jaxrender.inverse.texture.varying import SigmaField
from jaxrender.inverse.transfer_field import with_field
from jaxrender.inverse.unknowns import Unknowns, unknowns_of
from jaxrender.lighting import LightNodes
from jaxrender.reflection import FACETS, FrameNodes
from jaxrender.shapes import Float, Int

# The roughness that the light is split at in the first pass, and the table's reach in the second.
_ROUGH_SIGMA, _TABLE_REACH = 0.06, 1.8
# The light is split anew when the search ends this far (in log sigma) from where it was split.
_SPLIT_AGAIN, _SPLITS = 0.25, 3
# Observations that the rough pass looks at; fewer will do for a start of maps.
_ROUGH_SAMPLES, _ROUGHEST_SAMPLES = 4000, 1000
# Sites are solved on a sum over cells of the light, so narrow in widths of the lobe; where there
# are more cells than this, which takes minutes for all pixels, on the dual model.
_CELL_PER_SIGMA, _MOST_CELLS = 1 / 2, 2**15
# Where each site has numbers of its own the model is evaluated again and again: so many
# observations times cells take seconds.
_MAP_WORK = 2**22
# Most sites are at least as rough as this part of the typical one; the finest of most of them.
_FINER, _FINEST_PART = 1.8, 0.05
# Under shadows the environment is condensed to cells this narrow: each is a ray for every sample.
_SHADOWED_ANGLE_PER_SIGMA = 1 / 4


def recover_texture(
    observations: Observations,
    site: Int[np.ndarray, "sample"],
    count: int,
    light: KnownLight,
    variant: Microfacet,
    *,
    unknowns: Unknowns | None = None,
    settings: TextureSettings | None = None,
    shape: Shape | None = None,
    field: SigmaField | None = None,
    sites: SurfaceSites | None = None,
) -> TextureFit:
    """Recover K_d and K_s of every site of an object of one material.

    ``site`` numbers the texel or vertex that each observation shows (-1: none), ``variant`` tells
    the Fresnel angle, the masking and, by ``mu=None``, a metal.  Where ``settings`` have
    ``exact_samples``, sigma and mu are refined on the integral, and the sites solved on it.  A
    concave ``shape`` casts shadows, and the observations must then have places.  With ``field``
    sigma varies over the surface, which takes ``exact_samples`` too.  What the fit leaves is
    examined (:mod:`.examination`), and nuisances are freed as the settings say.  ``sites`` are
    needed where that moves what pixels show.
    """
    settings = settings or TextureSettings()
    unknowns = unknowns or unknowns_of(variant)
    _check_own(unknowns, settings, field, shape)

    def refit(
        observations: Observations, site: Int[np.ndarray, "sample"], light: KnownLight
    ) -> End:
        return _fitted(observations, site, count, light, variant, unknowns, settings, shape, field)

    return recovered(observations, site, light, refit, settings, sites)


def _fitted(
    observations: Observations,
    site: Int[np.ndarray, "sample"],
    count: int,
    light: KnownLight,
    variant: Microfacet,
    unknowns: Unknowns,
    settings: TextureSettings,
    shape: Shape | None,
    field: SigmaField | None,
) -> End:
    """Fit a texture, and examine nothing."""
    exact = settings.exact_samples > 0
    measured = by_site(observations, site, count)
    few = _ROUGHEST_SAMPLES if settings.maps else _ROUGH_SAMPLES
    some = whole_sites(measured, few, settings.seed)
    low, high = _sigma_range(unknowns)
    found = float(np.clip(_ROUGH_SIGMA, low, high))
    most = most_cells(observations.count, settings.maps)
    whole, shape = shape, concave(shape)
    if shape is not None:
        observations = with_field(observations, shape, light.diffuse_degrees)
    rough = forward_under(
        light, observations, variant, found, (low, high), "rough", exact=False, shape=shape
    )
    begun = find_lobe(some, rough, unknowns, settings._replace(search_samples=few))
    numbers = unknowns.unpack(begun.fit.point).numbers
    lobe = {name: float(value) for name, value in numbers.items()}
    finest = lobe["sigma"]
    if "sigma" in settings.maps:
        finest = max(low, finest / _FINER)
    for _ in range(_SPLITS):
        before, found = found, finest
        reach = (max(low, lobe["sigma"] / _TABLE_REACH), min(high, lobe["sigma"] * _TABLE_REACH))
        forward = forward_under(
            light, observations, variant, found, reach, exact=exact, shape=shape, most=most
        )
        start = unknowns.pack(lobe)
        if settings.maps:
            # One lobe for all is but a start.
            begun = begun._replace(fit=begun.fit._replace(point=jnp.asarray(start)))
            fit = fit_maps(measured, forward, begun, settings, _points(observations))
        else:
            fit = fit_texture(measured, forward, unknowns, settings, start, field=field)
        lobe = {"sigma": fit.sigma, "mu": fit.mu}
        varying = fit.variation
        finest = fit.sigma if varying is None else finest_of(varying.sigma, settings.maps)
        off = np.log(finest / found)
        # For a map, light that is split finer than need be will do.
        if (-off if settings.maps else abs(off)) < _SPLIT_AGAIN or before == found:
            break
    final, normals, detail = forward.final, fit.lobe.normals, fit.lobe.detail
    if detail is not None:
        final = detail.applied(final)
        observations = detail.tilted(observations)
    if normals is not None:
        final = with_normals(final, normals, site)
        tilted = normals.tilted(observations.samples.normals, site)
        samples = SurfaceSamples(tilted, np.asarray(observations.samples.outgoing))
        observations = observations._replace(samples=samples)
    painted = Painted(observations, site, light, variant, whole, final, settings.seed)
    return End(painted, fit)


def _points(observations: Observations) -> Float[np.ndarray, "sample 3"] | None:
    places = observations.places
    return None if places is None else np.asarray(places.points, float)


def finest_of(sigma: Float[np.ndarray, "site"], maps: tuple[str, ...]) -> float:
    """Return the least of a sigma that varies: what the light must be split for.

    Of a map, whose single sites may be far off, it is the least of most sites.
    """
    return float(np.nanquantile(sigma, _FINEST_PART if "sigma" in maps else 0.0))


def most_cells(observations: int, maps: tuple[str, ...]) -> int:
    """Say how many cells of the light sites may be solved by."""
    return min(_MOST_CELLS, _MAP_WORK // observations) if maps else _MOST_CELLS


def _check_own(
    unknowns: Unknowns, settings: TextureSettings, field: SigmaField | None, shape: Shape | None
) -> None:
    """Raise ``ValueError`` where sites cannot have what they are to have for themselves."""
    if field is None and not settings.maps:
        return
    if field is not None and settings.maps:
        raise ValueError("a sigma that varies slowly goes with no maps: leave maps out, or field")
    if settings.free:
        raise ValueError(
            "nothing is freed where sigma varies, or where there are maps: leave free out, or these"
        )
    check_variation(unknowns, settings, field is not None or "sigma" in settings.maps)
    if not settings.exact_samples:
        raise ValueError(
            "a sigma that varies, and maps, are found on the integral alone: give exact_samples "
            "above 0"
        )
    if "normal" in settings.maps and concave(shape) is not None:
        raise ValueError(
            "normals of a concave shape would change its shadows: leave normal out of maps"
        )


def forward_under(
    light: KnownLight,
    observations: Observations,
    variant: Microfacet,
    sigma: float,
    sigma_range: tuple[float, float],
    split: str | float = "auto",
    exact: bool = True,
    shape: Shape | None = None,
    most: int = _MOST_CELLS,
) -> Forward:
    """Model observations under a known light, split at ``sigma``; ``shape`` if it is concave.

    Sites are solved on the integral where the light has ``most`` cells or fewer.

    A concave shape's observations have their transfer vectors (T 6.10).
    """
    brdf = variant.with_roughness(sigma, None).as_metal()
    prepared = prepare_light(light, observations, brdf, split, None)
    shadows = shadows_of(shape, observations, prepared.dual)
    dual = dual_forward(variant, observations, prepared.dual, sigma_range, shadows)
    if not exact:
        return dual
    if shape is not None:
        final = _by_facets(light, observations, variant, sigma, shape)
        integral = _shadowed_exact(light, observations, variant, sigma, shape)
        return Forward(dual.search, final, integral)
    integral = exact_forward(variant, observations, exact_nodes(light, observations, sigma))
    cells = site_cells(light, observations, sigma, most)
    if cells is None:
        final = _by_facets(light, observations, variant, sigma, None)
    else:
        final = exact_forward(variant, observations, cells)
    return Forward(dual.search, final, integral)


def site_cells(
    light: KnownLight, observations: Observations | None, sigma: float, most: int = _MOST_CELLS
) -> tuple[LightNodes | FrameNodes, ...] | None:
    """List the cells of a light by which the sites of a convex shape are solved.

    None where there are more than ``most``: the dual model is then quicker, and 1 to 2 % off.
    Without observations they are those that the object's centre sees.
    """
    cells = exact_nodes(light, observations, sigma, _CELL_PER_SIGMA)
    count = sum(part.directions.shape[-2] for part in cells)
    return cells if count <= most else None


def _by_facets(
    light: KnownLight,
    observations: Observations,
    variant: Microfacet,
    sigma: float,
    shape: Shape | None,
) -> ModelOf:
    """Model observations by the dual model with its slow part integrated over the lobe.

    Its azimuthal mean alone would be 1 to 3 % off, which shows in K_d beside the noise of a site
    that is seen a few times.
    """
    brdf = variant.with_roughness(sigma, None).as_metal()
    dual = prepare_light(light, observations, brdf, "auto", None, transfer=FACETS).dual
    shadows = shadows_of(shape, observations, dual)
    return DualModel(variant, observations.samples, dual, shadows, FACETS).take


def _shadowed_exact(
    light: KnownLight, observations: Observations, variant: Microfacet, sigma: float, shape: Shape
) -> ModelOf:
    """Model observations by the integral over the nodes that each of them sees."""

    def model_of(index: Int[np.ndarray, "kept"]) -> Model:
        own = observations.take(index)
        nodes = exact_nodes(light, own, sigma, _SHADOWED_ANGLE_PER_SIGMA)
        return ExactModel(variant, own.samples, nodes, nodes_seen(shape, own, nodes))

    return model_of


def _sigma_range(unknowns: Unknowns) -> tuple[float, float]:
    unknown = unknowns["sigma"]
    if unknown.fixed is not None:
        return unknown.fixed[0], 1.01 * unknown.fixed[0]
    return unknown.lower, unknown.upper
