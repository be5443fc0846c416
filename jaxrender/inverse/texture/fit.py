"""A texture under known light (T 6.13, 6.14): sigma and mu of all, K_d and K_s of every site.

1. Some whole sites are drawn.  With one K_s for all of them, sigma and mu are searched from many
   starts; then each site's own K_s tells how they are spread (:mod:`.specular_prior`), and the
   search goes on with a K_s a site.  Noise is estimated from what is left, and all of it repeated.
2. Where sigma varies slowly over the surface, it is searched for once more at control points
   (:mod:`.varying`), from one sigma for all.
3. Where each site has a sigma, a normal or a coloured K_s of its own, these are searched for at
   every site (:mod:`.site_search`), beginning with one lobe for all.
4. Every site is solved exactly, a chunk at a time, with standard errors that include those of sigma
   and mu; what cannot be trusted is marked.

``method="thesis"`` does it as T 6.4.2 does: phase 1 by simplex, then the alternation.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.models import Model
from jaxrender.inverse.texture.account import TextureFit, account_of, lobe_of
from jaxrender.inverse.texture.forward import Forward
from jaxrender.inverse.texture.measurements import SiteObservations, whole_sites
from jaxrender.inverse.texture.rounds import (
    Searched,
    TextureSettings,
    let_vary,
    prediction_for,
    search_in_rounds,
    weighted,
)
from jaxrender.inverse.texture.search import refine
from jaxrender.inverse.texture.site_equations import Expected
from jaxrender.inverse.texture.site_numbers import COLOR, MAPS, with_normals
from jaxrender.inverse.texture.site_search import SiteFit, search_again, search_sites
from jaxrender.inverse.texture.site_surface import better_detail, nearby_of, solve_numbers
from jaxrender.inverse.texture.texture import Texture
from jaxrender.inverse.texture.varying import SigmaField
from jaxrender.inverse.texture.whole_surface import Lobe, solve_surface
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.shapes import Float, Int

METHODS = ("joint", "thesis")
# What all sites share is found on so many observations, where each has numbers of its own.
_MAP_SAMPLES = 6000
# Rounds in which every site learns from its neighbours.
_NEARBY = 2


def fit_texture(
    measured: SiteObservations,
    forward: Forward,
    unknowns: Unknowns,
    settings: TextureSettings | None = None,
    start: Float[np.ndarray, "unknown"] | None = None,
    *,
    field: SigmaField | None = None,
) -> TextureFit:
    """Recover sigma, mu, and K_d and K_s of every site.

    ``start`` replaces the several starting points.  With ``field`` sigma varies over the surface.
    Raises ``ValueError`` for an unknown method, a fixed kd or ks, and a sigma that is both fixed
    and varying.  Raises it, too, where no site is seen often enough.
    """
    settings = settings or TextureSettings()
    if field is not None:
        check_variation(unknowns, settings)
    some, model, searched = _search_lobe(measured, forward, unknowns, settings, start)
    if settings.maps:
        return fit_maps(measured, forward, searched, settings)
    if field is not None:
        model = forward.final(some.index)
        searched = let_vary(searched, measured, some, model, field, settings)
    elif (
        forward.exact is not None
        and settings.exact_samples
        and settings.method == "joint"
        and unknowns.names
    ):
        few = whole_sites(some, settings.exact_samples, settings.seed)
        data = weighted(few, searched.noise, prediction_for(few, some, searched))
        model = forward.exact(few.index)
        searched = searched._replace(
            fit=refine(searched.problem, model, data, searched.fit),
            data=data,
            clusters=few.clusters,
        )
    lobe, scatter = lobe_of(searched, model, settings.noise is not None)
    lobe = lobe._replace(field=field)
    noise = NoiseModel(searched.noise.relative * scatter, searched.noise.floor * scatter)
    surface = solve_surface(
        measured, forward.final, lobe, searched.problem.prior, noise, settings.method
    )
    return account_of(surface, lobe, searched, noise)


def find_lobe(
    measured: SiteObservations, forward: Forward, unknowns: Unknowns, settings: TextureSettings
) -> Searched:
    """Find sigma and mu alone, as step 1 does: a start for a fit under a model that knows more.

    Raises ``ValueError`` as ``fit_texture`` does.
    """
    *_, searched = _search_lobe(measured, forward, unknowns, settings, None)
    return searched


def _search_lobe(
    measured: SiteObservations,
    forward: Forward,
    unknowns: Unknowns,
    settings: TextureSettings,
    start: Float[np.ndarray, "unknown"] | None,
) -> tuple[SiteObservations, Model, Searched]:
    """Draw whole sites, model them, and search for the lobe on them (step 1)."""
    _check(measured, unknowns, settings)
    some = whole_sites(measured, settings.search_samples, settings.seed)
    model = forward.search(some.index)
    starts = unknowns.starts(settings.starts) if start is None else start[None]
    return some, model, search_in_rounds(some, model, unknowns, starts, settings)


def fit_maps(
    measured: SiteObservations,
    forward: Forward,
    searched: Searched,
    settings: TextureSettings,
    points: Float[np.ndarray, "observation 3"] | None = None,
) -> TextureFit:
    """Go on from one lobe for all sites to numbers that each of them has for itself.

    ``points`` are the places of all observations; without them no site learns from its neighbours.
    """
    one, fit, maps = searched.problem.unknowns, searched.fit, settings.maps
    assert isinstance(one, Unknowns)
    given, model_of = settings.noise is not None, forward.final
    some = whole_sites(measured, min(settings.search_samples, _MAP_SAMPLES), settings.seed)
    begin = SiteFit.begin(one, fit.point, searched.problem.prior, searched.noise, COLOR in maps)
    begun = search_sites(some, model_of, maps, begin, given)
    asked, shared = begun.asked(maps), begun.shared
    # Where neighbours will tell where to search from, a first guess will do.
    own = solve_numbers(measured, model_of, asked, again=points is None)
    detail, nearby = None, None
    if points is not None:
        at, drawn = points[measured.index], _drawn(measured, some)
        nearby = nearby_of(at, measured, asked, own, settings.seed)
        if nearby is None:
            own = solve_numbers(measured, model_of, asked, own.solved.value)
        for _ in range(_NEARBY):
            if nearby is None:
                break
            expected = nearby.expected(asked, own.solved.axes)
            detail, unsure = nearby.detail(at, measured, asked, len(points))
            detail = better_detail(measured, forward.final, asked, own.solved, detail)
            model_of = detail.applied(forward.final)
            few = asked._replace(nearby=Expected(*(part[drawn] for part in expected)))
            few, shared = search_again(some, model_of, few, own.solved.value[drawn], given)
            asked = few._replace(nearby=expected)
            own = solve_numbers(measured, model_of, asked, own.solved.value, unsure=unsure)
            nearby = nearby_of(at, measured, asked, own, settings.seed)
    numbers = own.numbers if nearby is None else nearby.widened(own.numbers)
    lobe = Lobe(one, *shared[1:], own=numbers, detail=detail)
    final = model_of
    if numbers.normals is not None:
        site = np.full(int(measured.index.max()) + 1, -1)
        site[measured.index] = measured.site
        final = with_normals(final, numbers.normals, site)
    surface = solve_surface(measured, final, lobe, asked.prior, asked.noise, settings.method)
    searched = searched._replace(
        fit=fit._replace(point=jnp.asarray(lobe.point)),
        noise=asked.noise,
    )
    return account_of(surface, lobe, searched, asked.noise)._replace(prior=asked.prior)


def _drawn(measured: SiteObservations, some: SiteObservations) -> Int[np.ndarray, "some"]:
    """List the sites that were drawn, by their numbers among all."""
    of_index = np.zeros(int(measured.index.max()) + 1, int)
    of_index[measured.index] = measured.site
    return np.unique(of_index[some.index])


def fit_texture_by_region(
    measured: SiteObservations,
    region: Int[np.ndarray, "site"],
    forward: Forward,
    unknowns: Unknowns,
    settings: TextureSettings | None = None,
) -> tuple[Texture, dict[int, TextureFit]]:
    """Recover a texture with a sigma and a mu (and a spread of K_s) for each region of a mask.

    ``region`` numbers the material of every site; negative ones are left out.  Sites of different
    regions share nothing, so each region is a fit of its own; the textures are put together.
    """
    fits = {
        int(name): fit_texture(measured.of_sites(region == name), forward, unknowns, settings)
        for name in np.unique(region[(region >= 0) & (measured.seen > 0)])
    }
    if not fits:
        raise ValueError("no region has observations: number the material of each site from 0 up")
    joined = None
    for name, fit in fits.items():
        joined = fit.texture if joined is None else joined.with_sites(region == name, fit.texture)
    assert joined is not None
    return joined, fits


def check_variation(unknowns: Unknowns, settings: TextureSettings, sigma: bool = True) -> None:
    """Raise ``ValueError`` where sigma, or what else each site is to have, cannot vary."""
    if sigma and not unknowns["sigma"].free:
        raise ValueError("sigma is fixed, but it is to vary over the surface: leave it free")
    if settings.method != "joint":
        raise ValueError(f"method={settings.method!r} knows one lobe for all sites: choose joint")


def _check(measured: SiteObservations, unknowns: Unknowns, settings: TextureSettings) -> None:
    for name in settings.maps:
        if name not in (*MAPS, COLOR):
            raise ValueError(f"maps has {name!r}: choose of {', '.join((*MAPS, COLOR))}")
    if COLOR in settings.maps and measured.radiance.shape[1] == 1:
        raise ValueError("the photographs have one channel, so K_s has no colour: leave it out")
    if settings.method not in METHODS:
        raise ValueError(f"method={settings.method!r}: choose one of {', '.join(METHODS)}")
    if unknowns.free_amplitudes != unknowns.amplitude_names:
        raise ValueError("kd and ks are fixed, but the texture consists of them: leave both free")
    if "ks" in unknowns.coloured or unknowns.free_gains or unknowns.free_scale:
        raise ValueError(
            "a texture has known exposures, and one K_s for all channels or, with 'color' in maps, "
            "one for each: turn ks_per_channel, free gains and free scale off"
        )
    for name in unknowns.with_prior:
        raise ValueError(f"{name} has a prior; a texture knows bounds alone: give it these")
    most = int(measured.seen.max())
    if unknowns.names and most < 2:
        raise ValueError(
            "no site is seen more than once, so sigma and mu cannot be told from the texture: "
            "give more photographs, larger texels, or fix sigma and mu"
        )
