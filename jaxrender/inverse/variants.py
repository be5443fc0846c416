"""How a fit changes under a slightly different model: masking on or off, Fresnel angle.

T 6.2 leaves out masking and takes Fresnel at the exit angle.  Each variant of these choices is
refitted with the exact integral from where the fit ended.  The distribution of facets stays: sigma
of another one is not the same number and could not be compared.  A parameter is *model sensitive*
if it moves by more than 25 % under a variant that the data do not reject.  Its error bar is right
only if the model is.
"""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import FRESNEL_ANGLES, MASKINGS, Microfacet, normalised_fresnel
from jaxrender.geometry import Components, Shape
from jaxrender.inverse.brdf import BRDFFit
from jaxrender.inverse.intervals import IDENTIFIABLE_WITHIN, Uncertain
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.leverage import draw, leverage, width_range
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import ExactModel
from jaxrender.inverse.parameters import Parameters, to_parameters
from jaxrender.inverse.passes import FitSettings, Stop, descend
from jaxrender.inverse.shadowing import concave, nodes_seen
from jaxrender.shapes import AnyArray, Array, Bool, Float

# A variant is rejected when its chi-squared is this much above that of the model that was fitted.
_REJECTED_ABOVE = 10.0
# Few samples and a coarse light are enough for differences, as all variants see the same.
_SAMPLES = 500
_CELL_ANGLE_PER_SIGMA = 0.5
_TOLERANCE = 1e-2


class Variant(NamedTuple):
    """One variant's fit: its choices, its parameters, and its chi-squared less that of the fit."""

    fresnel: str
    masking: str
    parameters: Parameters
    chi_squared: float

    @property
    def rejected(self) -> bool:
        """Whether the data reject it."""
        return self.chi_squared > _REJECTED_ABOVE

    @property
    def preferred(self) -> bool:
        """Whether the data reject the model that was fitted, beside this one."""
        return self.chi_squared < -_REJECTED_ABOVE

    def sentence(self) -> str:
        """Say that it is better, and what to choose."""
        return (
            f"the photographs prefer fresnel: {self.fresnel}, masking: {self.masking}, by a "
            f"chi-squared of {-self.chi_squared:,.0f}: choose these"
        )


def preferred(variants: tuple[Variant, ...]) -> Variant | None:
    """Find the variant that the data prefer to the model that was fitted, the best of them."""
    better = [variant for variant in variants if variant.preferred]
    return min(better, key=lambda one: one.chi_squared, default=None)


class _Switched(Microfacet):
    """A microfacet whose choices are values of switches: one compiled program serves them all."""

    half_angle: Bool[AnyArray, ""] = dataclasses.field(default_factory=lambda: np.array(False))
    smith: Bool[AnyArray, ""] = dataclasses.field(default_factory=lambda: np.array(False))

    @classmethod
    def to(cls, brdf: Microfacet) -> "_Switched":
        """Set the switches to the choices of a model."""
        numbers = (brdf.kd, brdf.ks, brdf.sigma, brdf.mu)
        half_angle, smith = np.array(brdf.fresnel == "half"), np.array(brdf.masking == "smith")
        return cls(*numbers, "half", "smith", brdf.distribution, half_angle, smith)

    def _attenuated(
        self,
        lobe: Float[Array, "*batch"],
        incoming: Components,
        outgoing: Components,
        cos_half: Float[Array, "*batch"],
        cos_o: Float[Array, "*#batch"],
    ) -> Float[Array, "*batch"]:
        """Multiply by those factors that are switched on."""
        lobe = lobe * jnp.where(self.smith, self.masked("smith", incoming, outgoing), 1)
        if self.mu is None:
            return lobe
        return lobe * normalised_fresnel(self.mu, jnp.where(self.half_angle, cos_half, cos_o))


def fit_variants(
    fit: BRDFFit, light: KnownLight, settings: FitSettings, shape: Shape | None = None
) -> tuple[Variant, ...]:
    """Refit every variant of the model but the one that was fitted, on a subset of the samples.

    ``shape`` is that which the fit was given.  Models without such choices have no variants.
    """
    final, fitted = fit.final, fit.brdf
    if not isinstance(fitted, Microfacet):
        return ()
    weight = leverage(final.observations, light, width_range(final.problem.unknowns, fitted))
    some, index = draw(final.observations, weight, _SAMPLES, settings.seed)
    predicted = np.asarray(final.fit.predicted)[index]
    sigma = float(fit.brdf.sigma)
    nodes = exact_nodes(light, some, sigma, _CELL_ANGLE_PER_SIGMA)
    seen = nodes_seen(concave(shape), some, nodes)
    settings = settings._replace(noise=final.noise)
    # Differences of chi-squared on the subset stand for those on all samples of the fit.
    per_sample = final.observations.count / some.count

    def refit(variant: Microfacet) -> Stop:
        model = ExactModel(_Switched.to(variant), some.samples, nodes, seen)
        return descend(final.problem, model, some, final.onward(predicted), settings, _TOLERANCE)

    base = refit(fitted)
    found = []
    for variant in _others(fitted):
        stop = refit(variant)
        worse = 2 * (float(stop.fit.solution.cost) - float(base.fit.solution.cost)) * per_sample
        parameters = to_parameters(
            stop.problem, stop.fit.solution.point, stop.fit.linear.eliminated
        )
        found.append(Variant(variant.fresnel, variant.masking, parameters, worse))
    return tuple(found)


def model_sensitive(fit: BRDFFit, variants: tuple[Variant, ...]) -> dict[str, bool]:
    """Say which free parameters move by more than 25 % under a variant that is not rejected."""
    standing = [variant.parameters for variant in variants if not variant.rejected]
    return {
        name: any(_moved(name, fit.parameters, other) for other in standing)
        for name in fit.identifiable
    }


def _moved(name: str, fitted: Uncertain, other: Parameters) -> bool:
    origin = fitted.origins.get(name, 0.0)
    before, after = (np.asarray(p.of(name)) - origin for p in (fitted.value, other))
    return bool(np.any(np.abs(after - before) > IDENTIFIABLE_WITHIN * np.abs(before)))


def _others(brdf: Microfacet) -> list[Microfacet]:
    """List the other choices of Fresnel angle (dielectrics only) and masking."""
    angles = FRESNEL_ANGLES if brdf.mu is not None else (brdf.fresnel,)
    choices = [(angle, masking) for angle in angles for masking in MASKINGS]
    return [
        brdf.with_variant(angle, masking)
        for angle, masking in choices
        if (angle, masking) != (brdf.fresnel, brdf.masking)
    ]
