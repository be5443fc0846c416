"""The result of a texture's fit: values, errors, outcome and reasons."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration import Calibration
from jaxrender.inverse.clusters import widened
from jaxrender.inverse.diagnosis import Diagnosis
from jaxrender.inverse.intervals import IDENTIFIABLE_WITHIN, NORMAL_90
from jaxrender.inverse.misfit import Misfit
from jaxrender.inverse.models import Model
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.texture.coloured_sites import KsPrior
from jaxrender.inverse.texture.rounds import Searched
from jaxrender.inverse.texture.search import lobe_information
from jaxrender.inverse.texture.texture import Texture
from jaxrender.inverse.texture.varying import SigmaMap, VaryingSigma
from jaxrender.inverse.texture.whole_surface import Lobe, Surface


class TextureFit(NamedTuple):
    """A recovered texture, its lobe, and what is known about both.

    ``sigma_error`` and ``mu_error`` are standard errors that know of misfit, ``if_exact`` what they
    would be if the model were exact; mu is NaN for a metal.  ``surface`` says what is left.
    ``misfit`` is what the photographs hold above their noise, where that is known, and
    ``diagnosis`` what would explain it; ``calibration`` is what was freed.
    """

    sigma: float
    mu: float
    sigma_error: float
    mu_error: float
    outcome: Outcome
    prior: KsPrior
    noise: NoiseModel
    lobe: Lobe
    reasons: tuple[str, ...]
    if_exact: tuple[float, float]
    surface: Surface
    misfit: Misfit | None = None
    diagnosis: tuple[Diagnosis, ...] = ()
    calibration: Calibration | None = None

    @property
    def texture(self) -> Texture:
        """The material of every site."""
        return self.surface.texture

    @property
    def variation(self) -> SigmaMap | None:
        """sigma at every site with its standard error, where it varies; ``sigma`` is its mean."""
        return self.lobe.variation()


def lobe_of(searched: Searched, model: Model, noise_given: bool) -> tuple[Lobe, float]:
    """Put together point and covariance, and by how much the residuals exceed the noise."""
    problem, data, fit = searched.problem, searched.data, searched.fit
    left = np.asarray(data.weights) * (data.radiance - np.asarray(fit.predicted))
    fitted = (data.radiance.shape[1] + 1) * len(np.unique(data.site)) + len(problem.unknowns.names)
    scatter = float(np.sum(left**2)) / max(left.size - fitted, 1)
    widening = max(scatter, 1.0) if noise_given else scatter
    information = lobe_information(problem, model, data, fit.point)
    inverse = np.linalg.pinv(np.asarray(information.matrix), hermitian=True)
    exact = widening * inverse
    influence = np.asarray(information.scores) @ inverse
    covariance = widened(exact, searched.clusters.covariance(influence))
    one = problem.unknowns
    one = one.one if isinstance(one, VaryingSigma) else one
    return Lobe(one, np.asarray(fit.point), covariance, exact), float(np.sqrt(widening))


def account_of(surface: Surface, lobe: Lobe, searched: Searched, noise: NoiseModel) -> TextureFit:
    """Judge what was found: outcome, and its reasons in words."""
    texture = surface.texture
    sigma, mu = lobe.values()
    sigma_error, mu_error = lobe.errors()
    sought = searched.problem.unknowns
    bounded = sought.at_bound(jnp.asarray(lobe.point))
    reasons = [f"{name} ended at its bound" for name, at in zip(sought.names, bounded) if at]
    outcome = Outcome.CONVERGED
    if _kd_is_lost(texture):
        outcome = Outcome.NOT_IDENTIFIABLE
        reasons.append(
            "kd is not identifiable at most sites: each is seen too seldom to tell specular from "
            "diffuse; give more photographs"
        )
    for name, value, error in (("sigma", sigma, sigma_error), ("mu", mu - 1, mu_error)):
        if NORMAL_90 * error > IDENTIFIABLE_WITHIN * value:
            outcome = Outcome.NOT_IDENTIFIABLE
            reasons.append(f"{name} is not identifiable: its standard error is {error:.2g}")
    if bounded.any():
        outcome = Outcome.AT_BOUND
    if not bool(searched.fit.converged):
        outcome = Outcome.NOT_CONVERGED
        reasons.append("the search for sigma and mu did not converge")
    return TextureFit(
        sigma,
        mu,
        sigma_error,
        mu_error,
        outcome,
        searched.problem.prior,
        noise,
        lobe,
        tuple(reasons),
        lobe.if_exact().errors(),
        surface,
    )


def _kd_is_lost(texture: Texture) -> bool:
    """Tell whether at most of the sites seen the error of K_d is too large to speak of a value."""
    error, kd = (
        np.asarray(part)[np.asarray(texture.seen) > 0] for part in (texture.kd_error, texture.kd)
    )
    lost = NORMAL_90 * error > IDENTIFIABLE_WITHIN * np.maximum(kd.mean(axis=0), kd)
    return bool(lost.any(axis=1).mean() > 0.5)
