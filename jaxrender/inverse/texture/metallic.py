"""glTF's material of every site under known light: base colour, roughness and metalness.

Of each site the base colour is solved for outright, in

    B = b F_b(m, r) + F_c(m, r)

where F_b is what the base colour colours, and F_c what it does not: the clear interface is as
bright as its index says.  The share of metal m and the roughness r are numbers of each site where
they are maps (:mod:`.site_search`), and else of the whole surface.

1. On some sites noise, what all share, and the spread of the sites' numbers are found, with cells
   of the light for rough lobes; then again with those for the sharpest lobes that were found.
2. Kinds of sites are told apart by their shares of metal, and every site is searched as one of each
   kind, a block at a time (:mod:`.metallic_search`).
"""

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import MetallicRoughness
from jaxrender.geometry import Shape
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import concave
from jaxrender.inverse.stated import Unknown
from jaxrender.inverse.texture.clustered import Excess, widening
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.inverse.texture.measurements import SiteObservations, by_site, whole_sites
from jaxrender.inverse.texture.metallic_search import Found, learn_kinds, search_kinds
from jaxrender.inverse.texture.metallic_table import finest_cell, sharpest_told, tabulated
from jaxrender.inverse.texture.rounds import TextureSettings
from jaxrender.inverse.texture.site_numbers import METALLIC_MAPS, NumberMap, SiteNumbers
from jaxrender.inverse.texture.site_search import Shared, SiteFit, numbers_of, search_sites
from jaxrender.inverse.texture.site_solver import Asked
from jaxrender.inverse.texture.site_systems import KnownSpecular
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.shapes import Float, Int

# Cells of the light (radians) by which the roughnesses are looked for first.
_ROUGH_CELL = 0.05
# Observations that all shared numbers and the spreads are found on, and those of a block.
_SOME, _BLOCK = 6000, 2**16
# The table begins so many spreads below the typical roughness, or at this part of that of all.
_SPREADS, _SHARPER = 2.5, 1.5
# The table is no narrower than from here to the roughest.
_MOST_OF_SPAN = 0.9
# The noise before there is a fit; its floor beside the typical radiance.
_FIRST_NOISE, _FIRST_FLOOR = 0.05, 0.01


class MetallicSites(NamedTuple):
    """What was found of every site, NaN and infinite errors where nothing was seen of it.

    ``base_color`` and ``color_error`` are [site, channel].  ``numbers`` are those that each site
    has, in their own units; ``shared`` what all have, with standard errors.  ``misfit`` is the root
    mean square of a site's residuals in units of the noise, and ``left`` what the fit leaves of
    each observation ``index``.  ``sharpest`` is the least roughness that was looked for.
    """

    base_color: Float[np.ndarray, "site channel"]
    color_error: Float[np.ndarray, "site channel"]
    numbers: dict[str, NumberMap]
    shared: dict[str, tuple[float, float]]
    misfit: Float[np.ndarray, "site"]
    seen: Int[np.ndarray, "site"]
    noise: NoiseModel
    left: Float[np.ndarray, "sample channel"]
    index: Int[np.ndarray, "sample"]
    sharpest: float
    relative_rms: float

    def number(self, name: str) -> Float[np.ndarray, "site"]:
        """Pick a number of every site, which all may share."""
        if name in self.numbers:
            return self.numbers[name].value
        return np.full(len(self.seen), self.shared[name][0])


def recover_metallic(
    observations: Observations,
    site: Int[np.ndarray, "sample"],
    count: int,
    light: KnownLight,
    variant: MetallicRoughness,
    unknowns: Unknowns,
    settings: TextureSettings,
    shape: Shape | None = None,
) -> MetallicSites:
    """Recover glTF's material of every site; ``settings.maps`` are ``roughness``, ``metalness``.

    ``site`` numbers the texel or vertex that each observation shows (-1: none).  A concave
    ``shape`` casts shadows.  Raises ``ValueError`` for other maps, for a map of a number that is
    fixed, and where no site is seen often enough.
    """
    _check(unknowns, settings)
    shape = concave(shape)
    measured = by_site(observations, site, count)
    some = whole_sites(measured, min(_SOME, settings.search_samples), settings.seed)
    lit = _Lit(variant, light, observations, shape)
    finest, span = finest_cell(light, observations.count), _span(unknowns)
    level = float(np.sqrt(np.mean(some.radiance**2)))
    noise = settings.noise or NoiseModel(_FIRST_NOISE, _FIRST_FLOOR * level)
    prior, given = KnownSpecular(np.ones(())), settings.noise is not None
    fit = SiteFit.begin(unknowns, unknowns.starts(1)[0], prior, noise)
    rough = lit.model_of(some, span, max(finest, _ROUGH_CELL))
    fit = search_sites(some, rough, settings.maps, fit, given)
    low = max(span[0], _sharpest(fit, settings.maps), sharpest_told(finest))
    span = min(low, _MOST_OF_SPAN * span[1]), span[1]
    unknowns = _within(unknowns, span)
    point = unknowns.pack(_values(fit.shared, span))
    begun = SiteFit.begin(unknowns, point, prior, fit.noise)
    fit = search_sites(some, lit.model_of(some, span, finest), settings.maps, begun, given)
    assert fit.expected is not None
    names = numbers_of(settings.maps)
    asked = Asked(names, unknowns, fit.shared.point, prior, fit.expected, fit.noise)
    kinds = learn_kinds(some, lit.model_of(some, span, finest), asked)
    every = _Sites.begin(measured, names)
    for rows, sites, block in _blocks(measured):
        every.put(rows, sites, search_kinds(block, lit.model_of(block, span, finest), asked, kinds))
    return every.found(measured, asked, fit.shared, span[0])


class _Lit(NamedTuple):
    """A kind of material under a light, as some photographs show it."""

    variant: MetallicRoughness
    light: KnownLight
    observations: Observations
    shape: Shape | None

    def model_of(
        self, measured: SiteObservations, span: tuple[float, float], finest: float
    ) -> ModelOf:
        """Tabulate the observations that are measured over a span of roughness."""
        shown, place = np.unique(measured.index, return_inverse=True)
        own = self.observations.take(shown)
        table = tabulated(self.variant, self.light, own, span, finest, self.shape)
        at = np.full(self.observations.count, -1)
        at[measured.index] = place
        return lambda index: table.take(at[index])


class _Sites(NamedTuple):
    """Room for what is found of every site and observation."""

    color: Float[np.ndarray, "site channel"]
    color_error: Float[np.ndarray, "site channel"]
    value: Float[np.ndarray, "site number"]
    covariance: Float[np.ndarray, "site number number"]
    squares: Float[np.ndarray, "site"]
    excess: Excess
    predicted: Float[np.ndarray, "sample channel"]

    @classmethod
    def begin(cls, measured: SiteObservations, names: tuple[str, ...]) -> "_Sites":
        """Know nothing yet."""
        count, channels, own = measured.count, measured.radiance.shape[1], len(names)
        return cls(
            np.full((count, channels), np.nan),
            np.full((count, channels), np.inf),
            np.full((count, own), np.nan),
            np.tile(np.diag(np.full(own, np.inf)), (count, 1, 1)),
            np.full(count, np.nan),
            Excess(*np.zeros((3, count, 1 + own))),
            np.zeros_like(measured.radiance),
        )

    def put(self, rows: slice, sites: Int[np.ndarray, "found"], found: Found) -> None:
        """Keep what was found of a block."""
        self.color[sites] = np.asarray(found.solved.local.material.kd)
        self.color_error[sites] = found.color_error
        self.value[sites] = found.solved.value
        self.covariance[sites] = found.covariance
        self.squares[sites] = found.squares
        for whole, some in zip(self.excess, found.excess, strict=True):
            whole[sites] = some
        self.predicted[rows] = found.solved.predicted

    def found(
        self, measured: SiteObservations, asked: Asked, shared: Shared, sharpest: float
    ) -> MetallicSites:
        """State values and errors, which are wider where a site is not explained to its noise.

        They are wider, too, by what single photographs leave of the sites together.
        """
        seen, channels = measured.seen, measured.radiance.shape[1]
        freedom = np.maximum(seen * channels - asked.own(measured), 1)
        misfit = np.sqrt(self.squares / freedom)
        wider = np.maximum(np.nan_to_num(misfit, nan=1.0)[:, None], widening(self.excess))
        covariance = self.covariance * wider[:, 1:, None] * wider[:, None, 1:]
        own = SiteNumbers(
            asked.names,
            self.value,
            covariance,
            np.ones((measured.count, channels)),
            np.zeros((measured.count, 2, 3)),
            np.ones((measured.count, 2)),
        )
        maps = {name: own.number(name) for name in asked.names}
        left = measured.radiance - self.predicted
        energy = float(np.sum(measured.share[:, None] * measured.radiance**2))
        unexplained = float(np.sum(measured.share[:, None] * left**2))
        return MetallicSites(
            self.color,
            self.color_error * wider[:, :1],
            {name: one for name, one in maps.items() if one is not None},
            _shared(shared, asked.names),
            misfit,
            seen,
            asked.noise,
            left,
            measured.index,
            sharpest,
            float(np.sqrt(unexplained / energy)) if energy > 0 else 0.0,
        )


def _blocks(
    measured: SiteObservations,
) -> "Iterator[tuple[slice, Int[np.ndarray, 'site'], SiteObservations]]":
    """Cut a surface into blocks of whole sites, numbered anew."""
    seen = measured.seen
    present = np.flatnonzero(seen)
    ends = np.cumsum(seen[present])
    first, start = 0, 0
    while first < len(present):
        last = max(int(np.searchsorted(ends, start + _BLOCK, side="right")), first + 1)
        rows, sites = slice(start, int(ends[last - 1])), present[first:last]
        own = measured.take(np.arange(rows.start, rows.stop))
        number = np.searchsorted(sites, own.site)
        yield rows, sites, own._replace(site=number, count=len(sites))
        first, start = last, rows.stop


def _span(unknowns: Unknowns) -> tuple[float, float]:
    """Between what the roughness lies."""
    known = unknowns["roughness"]
    return (known.fixed[0], 1.01 * known.fixed[0]) if known.fixed else (known.lower, known.upper)


def _within(unknowns: Unknowns, span: tuple[float, float]) -> Unknowns:
    """Bound the roughness to what is tabulated."""
    if unknowns["roughness"].fixed is not None:
        return unknowns
    numbers = tuple(
        Unknown(None, *span) if one.name == "roughness" else known
        for one, known in zip(unknowns.searched, unknowns.numbers)
    )
    return dataclasses.replace(unknowns, numbers=numbers)


def _values(shared: Shared, span: tuple[float, float]) -> dict[str, float]:
    """What all sites share, and what is typical of what they do not; within the span."""
    physical = shared.unknowns.unpack(jnp.asarray(shared.point))
    found = {name: float(value) for name, value in physical.numbers.items()}
    return found | {"roughness": float(np.clip(found["roughness"], *span))}


def _sharpest(fit: SiteFit, maps: tuple[str, ...]) -> float:
    """Tell the roughness below which there are hardly any sites."""
    names = numbers_of(maps)
    if "roughness" not in names:
        return _values(fit.shared, (0.0, 1.0))["roughness"] / _SHARPER
    assert fit.expected is not None
    at = names.index("roughness")
    spread = 1 / np.sqrt(fit.expected.precision[at])
    return float(np.exp(fit.expected.mean[at] - _SPREADS * spread))


def _shared(shared: Shared, own: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    """List what all sites share, with standard errors: 0 of what is fixed."""
    unknowns, point = shared.unknowns, jnp.asarray(shared.point)
    numbers = unknowns.unpack(point).numbers
    slopes = jax.jacfwd(lambda at: unknowns.unpack(at).numbers)(point)
    found = {}
    for name, value in numbers.items():
        by = np.asarray(slopes[name])
        error = float(np.sqrt(max(by @ shared.covariance @ by, 0.0)))
        found[name] = float(value), error
    return {name: one for name, one in found.items() if name not in own}


def _check(unknowns: Unknowns, settings: TextureSettings) -> None:
    for name in settings.maps:
        if name not in METALLIC_MAPS:
            raise ValueError(
                f"maps has {name!r}: of metallic-roughness choose of {', '.join(METALLIC_MAPS)}"
            )
        for number in METALLIC_MAPS[name]:
            if not unknowns[number].free:
                raise ValueError(f"{number} is fixed, but each site is to have its own: free it")
    if settings.free:
        raise ValueError("nothing is freed with metallic-roughness: leave free out")
    if settings.method != "joint":
        raise ValueError(
            f"method={settings.method!r} knows K_d and K_s: of metallic-roughness choose joint"
        )
