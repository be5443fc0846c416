"""What would explain what a texture under unknown light leaves.

A cause explains only what neither paint nor lobe nor any light can make.  So each coefficient of
the light but the mean may differ from the one found, as far as its size lets expect.  These
differences are integrated out: they are noise that the pixels share (``diagnosis.derivatives``).
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Shape, SurfaceSamples
from jaxrender.harmonics import band_limit_of
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.diagnosis import Suspect
from jaxrender.inverse.diagnosis.derivatives import Derivatives
from jaxrender.inverse.diagnosis.light_parts import LightParts
from jaxrender.inverse.models import Columns
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.texture.estimate import TextureEstimate
from jaxrender.inverse.texture.harmonic_columns import (
    LobeColumns,
    diffuse_basis,
    diffuse_under,
    harmonic_columns,
)
from jaxrender.inverse.texture.paint_slopes import PaintSlopes
from jaxrender.inverse.texture.reach import Reach
from jaxrender.inverse.texture.region_lobe import ORIGIN
from jaxrender.inverse.texture.sites import middles
from jaxrender.inverse.texture.view_dependent import LightCoefficients
from jaxrender.inverse.texture.view_search import light_precision
from jaxrender.inverse.weights import standard_deviations
from jaxrender.lighting import DirectionalSources
from jaxrender.shapes import Array, Bool, Float, Int

# What the fit finds is taken for granted by none of these; edges of paint look like a blur.
_UNKNOWN = ("sites", "blur", "convention", "gain", "environment", "lamps")
# Programs are made for multiples of so many pixels.
_PIXELS = 256
# A step changes sigma and mu - 1 by no more than this part.
_LARGEST = 0.5


class LitPixels(NamedTuple):
    """Some pixels, and the paint, the lobe and the light that were found with them.

    ``number`` says which of the ``sites`` each pixel shows, whose ``kd`` and ``ks`` these are;
    ``told`` marks those whose K_s the photographs tell.  ``names`` are the numbers of the lobe that
    are free.  ``slopes`` say how paint changes beside the sites, where it is known where they lie.
    """

    observations: Observations
    sites: Int[np.ndarray, "site"]
    number: Int[np.ndarray, "sample"]
    kd: Float[np.ndarray, "site channel"]
    ks: Float[np.ndarray, "site"]
    told: Bool[np.ndarray, "site"]
    lobe: Microfacet
    names: tuple[str, ...]
    light: LightCoefficients
    exact: bool
    slopes: PaintSlopes | None = None

    @classmethod
    def of(
        cls,
        estimate: TextureEstimate,
        observations: Observations,
        index: Int[np.ndarray, "tested"],
        exact: bool,
    ) -> "LitPixels":
        """Take some pixels of those that a texture and a light were found from."""
        assert estimate.light is not None
        texture, site, places = estimate.texture, estimate.sites.of_observation, observations.places
        sites, number = np.unique(site[index], return_inverse=True)
        slopes, unknowns = None, estimate.material.unknowns()
        if places is not None:
            every = middles(np.asarray(places.points), site, estimate.sites.count)
            slopes = PaintSlopes.of(texture, every, sites)
        return cls(
            observations.take(index),
            sites,
            number,
            texture.kd[sites],
            texture.ks[sites],
            ~texture.ks_marked[sites],
            estimate.brdf_of(estimate.lobes[0]),
            tuple(name for name in estimate.lobe_names if unknowns[name].free),
            estimate.light,
            exact,
            slopes,
        )

    def moved(self, by: Float[np.ndarray, "parameter"]) -> "LitPixels":
        """Move paint, lobe and light by a step; numbers of the lobe change by half at most."""
        parts = np.cumsum([self.kd.size, self.ks.size, len(self.names)])
        kd, ks, numbers, of_light = np.split(by, parts)
        lobe = {name: float(getattr(self.lobe, name)) for name in self.names}
        for (name, value), step in zip(tuple(lobe.items()), numbers):
            size = _LARGEST * (value - ORIGIN[name])
            lobe[name] = value + float(np.clip(step, -size, size))
        coefficients = self.light.coefficients
        light = coefficients + of_light.reshape(coefficients.T.shape).T
        return self._replace(
            kd=self.kd + kd.reshape(self.kd.shape),
            ks=self.ks + ks,
            lobe=self.lobe.with_numbers(lobe),
            light=self.light._replace(coefficients=light),
        )

    def reaching(
        self,
        estimate: TextureEstimate,
        shifts: Float[np.ndarray, "number cause"],
        *,
        both: bool = False,
    ) -> TextureEstimate:
        """Widen errors by how far causes move what they are of, a column each.

        ``both`` widens the errors of a model that is exact as well.
        """
        assert estimate.light is not None
        light = estimate.light
        own, of_light = np.split(shifts, [len(shifts) - light.coefficients.size])
        reach = Reach.of(estimate.texture, self.sites, self.names, own)
        (lobe,) = estimate.lobes
        exact, wider = {}, {}
        for name, at in zip(ORIGIN, lobe.if_exact().errors):
            error, moves = getattr(lobe, f"{name}_error"), reach.of_number(name)
            wider[f"{name}_error"] = None if error is None else float(np.hypot(error, moves))
            exact[name] = float(np.hypot(at, moves)) if both else at
        moved = np.sqrt(np.sum(of_light**2, axis=1)).reshape(light.coefficients.T.shape).T
        errors = light.standard_error
        if errors is not None:
            light = light._replace(standard_error=np.hypot(errors, moved))
        return replace(
            estimate,
            texture=reach.texture(estimate.texture, both=both),
            lobes=(lobe._replace(**wider, exact_errors=(exact["sigma"], exact["mu"])),),
            light=light,
        )

    def suspect(
        self,
        shape: Shape | None,
        told: Observations,
        pool: Observations,
        noise: NoiseModel,
        freed: tuple[str, ...] = (),
        weights: Float[np.ndarray, "sample channel"] | None = None,
    ) -> Suspect:
        """Suspect what was found of what it leaves; ``told``, ``pool``, ``freed`` are as there.

        ``weights`` are those of the noise if not given.
        """
        lit, slopes = self._lit()
        columns = Columns(diffuse_under(lit.diffuse, self._light), lit.specular @ self._light)
        diffuse, specular = np.asarray(columns.diffuse), np.asarray(columns.specular)
        kd, ks = self.kd[self.number], self.ks[self.number][:, None]
        predicted = kd * diffuse + ks * specular
        if weights is None:
            weights = 1 / np.maximum(standard_deviations(noise, predicted), 1e-12)
        known = self._derivatives(columns, lit, slopes, weights, predicted)
        by_place = None
        if self.slopes is not None:
            by_place = self.slopes.of_samples(columns, self.number)
        return Suspect(
            self.observations,
            predicted,
            np.ones(len(predicted)),
            self._mean_material(),
            LightParts.found(self.light.coefficients, DirectionalSources.none()),
            shape,
            told,
            pool,
            partial(_of, known),
            freed=freed,
            unknown=_UNKNOWN,
            paint=np.stack([kd, np.broadcast_to(ks, kd.shape)], axis=1),
            by_place=by_place,
        )

    def _derivatives(
        self,
        columns: Columns,
        lit: LobeColumns,
        slopes: dict[str, Float[np.ndarray, "sample channel"]],
        weights: Float[np.ndarray, "sample channel"],
        predicted: Float[np.ndarray, "sample channel"],
    ) -> Derivatives:
        """Differentiate by paint, lobe and the mean of the light, and by the rest under a prior."""
        count, channels = predicted.shape
        of_site, each = np.eye(len(self.ks))[self.number], np.eye(channels)
        diffuse, specular = np.asarray(columns.diffuse), np.asarray(columns.specular)
        kd, ks = self.kd[self.number], self.ks[self.number]
        by_kd = np.einsum("sc,sn,cd->scnd", diffuse, of_site, each).reshape(count, channels, -1)
        by_ks = np.einsum("sc,sn->scn", specular, of_site)
        by_lobe = [(ks[:, None] * slopes[name])[:, :, None] for name in self.names]
        basis, lobes = np.asarray(lit.diffuse), np.asarray(lit.specular) * ks[:, None]
        by_light = kd[:, :, None] * basis[:, None, :] + lobes[:, None, :]
        by_mean = by_light[:, :, 0, None] * each
        by_unknown = np.concatenate([by_kd, by_ks, *by_lobe, by_mean], axis=2)
        deviation = self._deviation()
        prior = np.moveaxis(weights[:, :, None] * by_light[:, :, 1:], 1, 0) * deviation[:, None, :]
        radiance = np.asarray(self.observations.radiance, float)
        return Derivatives(
            weights * (radiance - predicted),
            weights[:, :, None] * by_unknown,
            weights,
            tuple(prior),
            self._parameters(deviation),
        )

    def _parameters(
        self, deviation: Float[np.ndarray, "channel part"]
    ) -> Float[np.ndarray, "parameter number"]:
        """Differentiate what is stated: K_d, K_s, the lobe's free numbers, each channel's light.

        Only products of paint and light show.  So paint keeps its mean, and the light answers.
        """
        channels, parts = deviation.shape
        first = self.kd.size + self.ks.size + len(self.names)
        known = first + channels
        rows = np.zeros((first + channels * (1 + parts), known + channels * parts))
        rows[:first, :first] = np.eye(first)
        for channel in range(channels):
            at = first + channel * (1 + parts)
            rows[at, first + channel] = 1
            own = slice(known + channel * parts, known + (channel + 1) * parts)
            rows[at + 1 : at + 1 + parts, own] = np.diag(deviation[channel])
        still, light = np.zeros(len(self.names)), self.light.coefficients.T.ravel()
        scale = np.concatenate([self.kd.ravel(), self.ks, still, -light])
        mean = np.zeros(len(rows))
        of_kd, of_ks = mean[: self.kd.size].reshape(self.kd.shape), mean[self.kd.size :]
        kept = self.told if self.told.any() else np.ones(len(self.told), bool)
        of_kd[kept], of_ks[: len(kept)][kept] = 1 / channels, 1
        return rows - np.outer(scale, mean @ rows) / (mean @ scale)

    def _deviation(self) -> Float[np.ndarray, "channel part"]:
        """Say how far each coefficient but the mean may be from the one found."""
        errors = self.light.standard_error
        variance = np.zeros_like(self.light.coefficients) if errors is None else errors**2
        return 1 / np.sqrt(light_precision(self.light.coefficients, variance)[1:].T)

    def _lit(self) -> tuple[LobeColumns, dict[str, Float[np.ndarray, "sample channel"]]]:
        """Evaluate both lobes under each harmonic, and the slopes of the second under the light."""
        count = self.observations.count
        rows = np.pad(np.arange(count), (0, -count % _PIXELS), mode="edge")
        samples = SurfaceSamples(*(jnp.asarray(a)[rows] for a in self.observations.samples))
        numbers = {name: jnp.asarray(float(getattr(self.lobe, name))) for name in self.names}
        limit = band_limit_of(len(self.light.coefficients))
        found = _columns_at(samples, self.lobe, numbers, self._light, limit, self.exact)
        lit, slopes = LobeColumns(*(part[:count] for part in found[0])), found[1]
        return lit, {name: np.asarray(slope)[:count] for name, slope in slopes.items()}

    def _mean_material(self) -> Microfacet:
        """Make one material of all: the lobe, and mean amplitudes."""
        kd = np.nanmean(self.kd, axis=0)
        return self.lobe.with_amplitudes(kd, np.full(kd.shape, np.nanmean(self.ks)))

    @property
    def _light(self) -> Float[Array, "coefficient channel"]:
        return jnp.asarray(self.light.coefficients)


@eqx.filter_jit
def _columns_at(
    samples: SurfaceSamples,
    lobe: Microfacet,
    numbers: dict[str, Float[Array, ""]],
    light: Float[Array, "coefficient channel"],
    band_limit: int,
    exact: bool,
) -> tuple[LobeColumns, dict[str, Float[Array, "sample channel"]]]:
    def lit(numbers: dict[str, Float[Array, ""]]) -> tuple[Array, Array]:
        found = harmonic_columns(samples, lobe.with_numbers(numbers), band_limit, exact)
        return jnp.matmul(found, light, precision="highest"), found

    slopes, specular = jax.jacfwd(lit, has_aux=True)(numbers)
    return LobeColumns(diffuse_basis(samples, band_limit), specular), slopes


def _of(known: Derivatives, index: Int[np.ndarray, "sample"]) -> Derivatives:
    """Take the derivatives of some of the pixels."""
    return Derivatives(
        known.residual[index],
        known.by_unknown[index],
        known.weights[index],
        tuple(part[index] for part in known.prior),
        known.parameters,
    )
