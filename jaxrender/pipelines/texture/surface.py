"""What is known of every site and of the lobe, whatever is known of the light."""

from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfacePlaces, SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import Outcome
from jaxrender.inverse.texture import SigmaMap, Texture
from jaxrender.pipelines.config import BrdfConfig
from jaxrender.pipelines.scene import lobe_of
from jaxrender.reflection import ForwardModel, ShadowedModel, render_samples, render_widths
from jaxrender.shapes import Float, Int

# Half the width of a 90 % interval in standard errors, and how narrow it must be (DESIGN 5).
NORMAL_90, IDENTIFIABLE_WITHIN = 1.6448536269514722, 0.25


class Region(NamedTuple):
    """One material's lobe: sigma and mu with standard errors (None: not stated; mu NaN: none)."""

    name: str
    sites: int
    sigma: float
    mu: float
    sigma_error: float | None
    mu_error: float | None
    outcome: Outcome


class Light(NamedTuple):
    """A light that was recovered with the texture, and how well."""

    coefficients: Float[np.ndarray, "coefficient channel"]
    standard_error: Float[np.ndarray, "coefficient channel"] | None


class Surface(NamedTuple):
    """A recovered texture: every site, the lobe of each region, and what cannot be told.

    ``region`` numbers the region of each site (-1: none).  ``ambiguity`` says in words up to what
    the values are known, and "" where they are absolute; ``gauge`` in what units light is.
    ``variation`` is sigma at every site where it varies; a region's sigma is then a mean.
    """

    texture: Texture
    regions: tuple[Region, ...]
    region: Int[np.ndarray, "site"]
    noise: NoiseModel
    outcome: Outcome
    reasons: tuple[str, ...]
    gauge: str
    ambiguity: str = ""
    light: Light | None = None
    variation: SigmaMap | None = None


class Lobes(NamedTuple):
    """The columns of T 6.13: what K_d = 1 and K_s = 1 would send to the camera."""

    diffuse: Float[np.ndarray, "sample channel"]
    specular: Float[np.ndarray, "sample channel"]

    def radiance(
        self, texture: Texture, site: Int[np.ndarray, "sample"]
    ) -> Float[np.ndarray, "sample channel"]:
        """Evaluate B = K_d(x) D + K_s(x) S; a site that is unknown is black."""
        kd, ks = (np.nan_to_num(values) for values in (texture.kd, texture.ks))
        found = kd[site] * self.diffuse + ks[site][:, None] * self.specular
        return np.where((site >= 0)[:, None], found, 0)


def facets_of(brdf: BrdfConfig) -> Microfacet:
    """Build the lobe that is sought, one of facets (the config allows no other)."""
    variant = lobe_of(brdf)
    assert isinstance(variant, Microfacet)
    return variant


def lobes_of(
    lobe: Microfacet,
    samples: SurfaceSamples,
    model: ForwardModel | ShadowedModel,
    places: SurfacePlaces | None = None,
    widths: Float[np.ndarray, "sample"] | None = None,
) -> Lobes:
    """Evaluate both columns of samples, which may have a sigma each."""
    channels = np.asarray(lobe.kd).shape[0]
    none, full = np.zeros(channels), np.ones(channels)
    matt, gloss = lobe.with_amplitudes(full, none), lobe.with_amplitudes(none, full)
    diffuse = np.asarray(render_samples(matt, samples, model, places))
    if widths is None:
        return Lobes(diffuse, np.asarray(render_samples(gloss, samples, model, places)))
    return Lobes(diffuse, np.asarray(render_widths(gloss, widths, samples, model, places)))


def worst_outcome(outcomes: list[Outcome]) -> Outcome:
    """Pick the outcome that a reader has to know of."""
    order = (
        Outcome.NOT_CONVERGED,
        Outcome.AT_BOUND,
        Outcome.NOT_IDENTIFIABLE,
        Outcome.CONVERGED,
    )
    return next(outcome for outcome in order if outcome in outcomes)
