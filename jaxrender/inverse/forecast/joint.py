"""Which of material and light photographs will identify, both unknown (T 2.4.3, 6.4.4).

This is the joint system of ``inverse.factorization`` at the supposed answer.  Its curvature, with
the light eliminated, is the Fisher information about ks / kd, sigma, mu and the directions of the
sources.  In each channel only the product of light and reflectance shows; kd + ks = 1 is the gauge.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import expit, logit

from jaxrender.brdf import Parametric
from jaxrender.harmonics import degrees
from jaxrender.inverse.factorization.blocks import Measured, in_blocks
from jaxrender.inverse.factorization.gauges import amplitudes_of, own_numbers
from jaxrender.inverse.factorization.integral_response import response_of_convex
from jaxrender.inverse.factorization.projection import mixed, reduced_system
from jaxrender.inverse.factorization.response import Guess, Response, specular_share
from jaxrender.inverse.forecast.situation import Situation, Supposed, kind_of, thinned, weights_of
from jaxrender.inverse.forecast.spectrum import light_coefficients
from jaxrender.inverse.intervals import Uncertain, intervals, relative_error, within_reach
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.parameters import Parameters
from jaxrender.inverse.reasons import missing_under_unknown_light
from jaxrender.lighting import DirectionalSources, candidates, take
from jaxrender.shapes import AnyArray, Array, Float

# The prior variance of an unknown's logarithm and the light's expected size, as in a factorization.
_PRIOR_VARIANCE = 4.0
_BAND_LIMIT, _MOST_SOURCES, _SAMPLES = 10, 16, 2000
GAUGES = ("red", "green", "blue")


class JointForecast(NamedTuple):
    """The forecast of a factorization's material, in the gauge kd + ks = 1 in each channel.

    The operator takes changes of log(ks / kd), log sigma and log(mu - 1) to the photographs in
    units of their noise, the light being fitted too.  ``singular_values`` are its own.  ``gauge``
    names the directions that no photograph determines.
    """

    parameters: Uncertain
    identifiable: dict[str, bool]
    singular_values: Float[np.ndarray, "unknown"]
    sources: int
    gauge: tuple[str, ...]
    sentences: tuple[str, ...]

    @property
    def is_identifiable(self) -> bool:
        """Whether all of the material is identifiable, up to the gauge."""
        return all(self.identifiable.values())


class SupposedAnswer(NamedTuple):
    """What a factorization is supposed to find; ``light`` is in the gauge kd + ks = 1."""

    response: Response
    guess: Guess
    light: Float[np.ndarray, "part channel"]

    def measured(self, supposed: Supposed, each: float) -> Measured:
        """Predict what would be measured, with the penalty of a factorization.

        Each sample stands for ``each`` samples, with the noise of ``supposed``.
        """
        radiance = np.asarray(_radiance(self.response, self.guess, jnp.asarray(self.light)))
        degree = degrees(int(np.sqrt(self.response.slow_count)) - 1)
        mean = np.abs(self.light[0]) / np.sqrt(4 * np.pi)
        level = np.maximum(mean, 0.2 * radiance.mean(axis=0))
        slow = (degree * (degree + 1))[:, None] / (4 * np.pi * level**2)[None]
        penalty = np.concatenate([slow, np.zeros((len(self.light) - len(slow), slow.shape[1]))])
        return Measured(radiance, np.sqrt(each) * weights_of(supposed.noise, radiance), penalty)


def forecast_joint(
    situation: Situation, supposed: Supposed, band_limit: int = _BAND_LIMIT
) -> JointForecast:
    """Predict the error bars of a factorization; ks / kd, sigma and mu are all unknown.

    All samples of the situation count, as in a factorization; a part stands for the others.  Of a
    purely specular material only the shape of the lobe is unknown.

    Raises ``ValueError`` where ks is supposed to be zero, or kd in some channels only (log(ks / kd)
    is infinite there).  The same holds for a material of several lobes, for light that differs from
    photograph to photograph, and for too few samples.
    """
    brdf = supposed.brdf
    known = {"kd", "ks", brdf.shape.name, brdf.index.name}
    others = [name for name in (*brdf.amplitude_names, *brdf.numbers) if name not in known]
    if others:
        raise ValueError(
            f"{', '.join(others[:3])}: what is not one lobe over a base is found under known light "
            "alone"
        )
    kd, ks = (np.asarray(a, float) for a in (brdf.base_amplitude, brdf.lobe_amplitude))
    if not np.any(ks):
        raise ValueError(
            "of a Lambertian body the product of light and kd shows: in the gauge kd = 1 the light "
            "is known as well as above"
        )
    mixed_lobes = bool(np.any(kd))
    if not np.all(ks > 0) or (mixed_lobes and not np.all(kd > 0)):
        raise ValueError("kd and ks must be above 0 in every channel: suppose a little of both")
    if situation.light.varies:
        raise ValueError("the light differs from photograph to photograph: factorize one light")
    unknown = (band_limit + 1) ** 2
    if len(situation.frame) < 2 * unknown:
        raise ValueError(
            f"{len(situation.frame)} samples for light of {unknown} coefficients: use more samples "
            "or a lower band limit"
        )
    few, each = thinned(situation, _SAMPLES)
    answer = supposed_answer(few, brdf, band_limit)
    guess = answer.guess
    system = reduced_system(in_blocks(answer.response, answer.measured(supposed, each)), guess)
    channels, metal = len(kd), brdf.mu is None
    sources = len(guess.directions)
    free = np.ones(channels + 2 + 2 * sources, bool)
    free[:channels], free[channels + 1] = mixed_lobes, not metal
    curvature = np.asarray(system.curvature)[np.ix_(free, free)]
    covariance = np.linalg.inv(curvature + np.eye(len(curvature)) / _PRIOR_VARIANCE)
    sought = np.flatnonzero(free[: channels + 2])
    few = covariance[: len(sought), : len(sought)]
    errors = np.zeros(channels + 2)
    errors[sought] = np.sqrt(np.diag(few))
    parameters = _parameters(guess, errors, brdf)
    names = [*(brdf.amplitude_names if mixed_lobes else ()), *brdf.numbers]
    identifiable = {name: within_reach(parameters, name) for name in names}
    # The material's curvature when the sources' directions are fitted, too.
    own = np.linalg.inv(few) - np.eye(len(few)) / _PRIOR_VARIANCE
    singular = np.sqrt(np.maximum(np.linalg.eigvalsh(own)[::-1], 0))
    gauge = tuple(
        f"{name}: light times s, kd and ks divided by s, for any s" for name in GAUGES[:channels]
    )
    sentences = _sentences(parameters, identifiable, brdf)
    return JointForecast(parameters, identifiable, singular, sources, gauge, sentences)


def supposed_answer(situation: Situation, brdf: Parametric, band_limit: int) -> SupposedAnswer:
    """Set up the joint model at the supposed material and the situation's light."""
    kd, ks = (np.asarray(a, float) for a in (brdf.base_amplitude, brdf.lobe_amplitude))
    slow, sources = _divided(situation.light, float(brdf.sigma), band_limit)
    response = response_of_convex(
        kind_of(brdf), situation.samples, band_limit, len(sources.directions)
    )
    mu = 1.5 if brdf.mu is None else float(brdf.mu)
    guess = Guess(
        jnp.asarray(logit(ks / (kd + ks))),
        jnp.asarray(np.log(float(brdf.sigma))),
        jnp.asarray(np.log(mu - 1)),
        jnp.asarray(np.asarray(sources.directions, float)),
    )
    light = np.concatenate([slow, np.asarray(sources.irradiance, float)])
    return SupposedAnswer(response, guess, light * (kd + ks)[None])


def _divided(
    light: KnownLight, sigma: float, band_limit: int
) -> tuple[Float[np.ndarray, "coefficient channel"], DirectionalSources]:
    """Split a light as a factorization finds it: slow coefficients, and its strongest sources."""
    directions = np.asarray(light.directional.directions, float)
    irradiance = np.asarray(light.directional.irradiance, float)
    none = DirectionalSources.none(irradiance.shape[1])
    if light.environment is None:
        slow = np.zeros(((band_limit + 1) ** 2, irradiance.shape[1]))
        return slow, light.directional
    parts = take(light.environment, candidates(light.environment, sigma), _MOST_SOURCES, sigma)
    strong = np.asarray(parts.sources.irradiance).sum(axis=1)
    total = np.asarray(parts.environment.nodes().irradiance).sum()
    # Below a thousandth of the light no photograph would show that it is a source.
    kept = strong > 1e-3 * total
    slow = light_coefficients(KnownLight(parts.environment, none), band_limit)
    found = np.asarray(parts.sources.directions)[kept]
    energies = np.asarray(parts.sources.irradiance)[kept]
    lit = DirectionalSources(found, energies)
    if kept.any():
        slow = slow - light_coefficients(KnownLight(None, lit), band_limit)[: len(slow)]
    padded = np.zeros(((band_limit + 1) ** 2, irradiance.shape[1]))
    padded[: len(slow)] = slow
    return padded, DirectionalSources(
        np.concatenate([directions, found]), np.concatenate([irradiance, energies])
    )


@jax.jit
def _radiance(
    response: Response, guess: Guess, light: Float[Array, "part channel"]
) -> Float[Array, "sample channel"]:
    with jax.default_matmul_precision("highest"):
        return jnp.einsum(
            "csp,pc->sc", mixed(response.columns(guess), specular_share(guess)), light
        )


def _parameters(guess: Guess, errors: Float[np.ndarray, "unknown"], brdf: Parametric) -> Uncertain:
    share = expit(np.asarray(guess.specular_logit))
    channels = len(share)
    of_share = share * (1 - share) * errors[:channels]
    one, zero = np.ones(()), np.zeros(())

    def numbers(lobe: Float[Array, "2"]) -> dict[str, Float[AnyArray, ""]]:
        return own_numbers(brdf, jnp.exp(lobe[0]), 1 + jnp.exp(lobe[1]))

    lobe = jnp.stack([jnp.asarray(guess.sigma), jnp.asarray(guess.mu)])
    slopes, own = jax.jacfwd(numbers)(lobe), numbers(lobe)
    spread = errors[channels : channels + 2]
    values = {name: np.asarray(own[name], float) for name in brdf.numbers}
    known = {n: np.asarray(np.linalg.norm(np.asarray(slopes[n]) * spread)) for n in values}
    value = Parameters(amplitudes_of(brdf, 1 - share, share), values, one[None], one)
    error = Parameters(amplitudes_of(brdf, of_share, of_share), known, zero[None], zero)
    return intervals(value, error, {one.name: one.origin for one in brdf.searched})


def _sentences(
    parameters: Uncertain, identifiable: dict[str, bool], brdf: Parametric
) -> tuple[str, ...]:
    found = ["gauge: in each channel only light times reflectance shows; kd + ks = 1 fixes it"]
    for name, known in identifiable.items():
        if not known:
            worst = relative_error(parameters, name)
            found.append(
                f"{name} is not identifiable with the light unknown: standard error "
                f"{100 * worst:.0f} % of its value; {missing_under_unknown_light(brdf, name)}"
            )
    if all(identifiable.values()):
        found.append("light and material are both identifiable, up to the gauge")
    return tuple(found)
