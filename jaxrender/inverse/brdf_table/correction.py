"""A recovered material corrected by a table: what the photographs show beyond any few numbers.

The model that was fitted is multiplied by a positive factor over the half and difference angles
(``CorrectedBRDF``).  The prior is that the factor is smooth and near 1, so that the model stands
where no photograph looked.  How strong this prior is, and how much of the photographs no such
factor explains, is learnt from the photographs themselves: both maximise the evidence, by MacKay's
updates (Bayesian Interpolation, 1992) between Gauss-Newton steps.

The posterior is taken to be Gaussian about its maximum.  So every node has a standard error, nodes
that no photograph saw have that of the prior, and predictions have theirs.
"""

from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, CorrectedBRDF, Parametric
from jaxrender.geometry import Shape
from jaxrender.inverse.brdf import BRDFFit
from jaxrender.inverse.brdf_table.cell_sums import cell_sums
from jaxrender.inverse.brdf_table.smoothness import smooth_functions
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.leverage import draw, leverage
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.material_task import MaterialTask, Stage
from jaxrender.inverse.models import ExactModel
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.passes import DEFAULTS, FitSettings
from jaxrender.inverse.shadowing import concave
from jaxrender.inverse.weights import standard_deviations
from jaxrender.io.merl import MerlTable, write_merl
from jaxrender.shapes import Bool, Float

_MERL, _MERL_CHANNELS = "table.binary", 3
# Nodes of theta_h, theta_d and phi_d.
NODES = (24, 12, 8)
# Samples that the table is fitted to, and the most pairs of one and a direction of light.
_SAMPLES, _MOST_PAIRS = 3_000, 4e7
_FEWEST_SAMPLES = 200
# Radiance below this part of the typical one weighs no more than it.
_DARK = 0.1
# The deviation of the logarithm to begin with; how small it may become; and how large.
_FIRST_STRENGTH, _LEAST_STRENGTH, _MOST_STRENGTH = 0.5, 1e-3, 3.0
_ROUNDS, _SETTLED = 60, 0.02
# No logarithm moves farther than this in one step, and a step is halved so often at most.
_LONGEST_STEP, _HALVINGS = 1.0, 8
# Samples that are predicted at once.
_AT_ONCE = 2_000
# A node is seen where the photographs leave less than this part of the prior's deviation.
_SEEN = 0.5
# A right capture leaves about the noise; so many times the noise is no matter of the material.
_MUCH = 3.0


class Prediction(NamedTuple):
    """Radiance under some light, and the standard deviation that the correction gives it."""

    radiance: Float[np.ndarray, "sample channel"]
    deviation: Float[np.ndarray, "sample channel"]


class Correction(NamedTuple):
    """A material corrected by a table, and how well each part of it is known.

    ``log_error`` is the standard error of the factor's logarithm at each node (about its relative
    error).  ``strength`` is the deviation that the prior gives that logarithm, ``unexplained`` how
    many times the noise the table leaves.  ``before`` and ``after`` are relative rms residuals of
    the ``samples``, of the model and of the corrected material.  ``settled`` says whether the
    rounds came to an end by themselves.
    """

    brdf: CorrectedBRDF
    log_error: Float[np.ndarray, "theta_h theta_d phi_d channel"]
    strength: float
    unexplained: float
    before: float
    after: float
    samples: int
    settled: bool
    covariance: Float[np.ndarray, "channel function function"]

    @property
    def seen(self) -> Bool[np.ndarray, "theta_h theta_d phi_d"]:
        """Where the photographs tell the factor; elsewhere it is filled from the prior."""
        return np.all(self.log_error < _SEEN * self.strength, axis=-1)

    @property
    def sentence(self) -> str:
        """Say what the table has changed."""
        before, after = 100 * self.before, 100 * self.after
        seen = 100 * float(np.mean(self.seen))
        more = "" if self.settled else "; its fit had not come to an end"
        if self.unexplained > _MUCH:
            more += (
                f"; that is {self.unexplained:.2g} times the noise, so more than the material is "
                "wrong: the capture, the light or the shape"
            )
        return (
            f"the table leaves {after:.2g} % of the radiance unexplained where the model leaves "
            f"{before:.2g} %; the photographs tell {seen:.0f} % of its nodes, and the others are "
            f"filled from the model{more}"
        )

    def write_merl(self, folder: Path) -> str | None:
        """Write the corrected material as the MERL database writes one, and name the file.

        Such a file has three channels: of any other number of them nothing is written.
        """
        if self.brdf.amplitudes.shape[1] != _MERL_CHANNELS:
            return None
        write_merl(folder / _MERL, MerlTable.of(self.brdf))
        return _MERL

    def predict(self, exact: ExactModel) -> Prediction:
        """Predict radiance under the light of an exact model, whose material does not matter."""
        return predict_corrected(self.brdf, self.covariance, exact)


def predict_corrected(
    brdf: CorrectedBRDF,
    covariance: Float[np.ndarray, "channel function function"],
    exact: ExactModel,
) -> Prediction:
    """Predict radiance by a corrected material, whose smooth functions have this covariance.

    ``exact`` has the samples and the light; its material does not matter.
    """
    assert isinstance(brdf.model, Parametric)
    of_model = ExactModel(brdf.model, exact.samples, exact.nodes, exact.seen)
    factor = np.asarray(brdf.factor, float).reshape(int(np.prod(brdf.nodes)), -1)
    smooth = smooth_functions(brdf.nodes)
    count = len(np.asarray(exact.samples.normals))
    found = np.zeros((2, count, factor.shape[1]))
    for first in range(0, count, _AT_ONCE):
        rows = slice(first, first + _AT_ONCE)
        sums = cell_sums(of_model.take(rows), brdf.nodes) * factor.T
        moves = smooth.by_place(sums) @ smooth.functions
        variance = np.einsum("scf,cfg,scg->sc", moves, covariance, moves, optimize=True)
        found[0, rows], found[1, rows] = sums.sum(axis=-1), np.sqrt(np.maximum(variance, 0))
    return Prediction(*found)


def correct_by_table(
    fit: BRDFFit,
    light: KnownLight,
    settings: FitSettings = DEFAULTS,
    stage: Stage = lambda name: nullcontext(),
    *,
    shape: Shape | None = None,
    pool: Observations | None = None,
) -> Correction:
    """Correct the material of a fit by a table, from the photographs that it was fitted to.

    ``light`` is the light of the fit, ``pool`` all pixels that may be used; without it the samples
    of the fit.  ``shape`` is asked for shadows where it is concave.

    Raises ``ValueError`` for a material that is anisotropic, for photographs that were mended by
    the fit, for bounced light, for fewer than two photographs, and for too few samples.
    """
    model = fit.brdf
    observations = fit.final.observations if pool is None else pool
    check_correctable(observations, model)
    if fit.calibration is not None:
        raise ValueError("the fit has freed nuisances; write the mended capture, and fit that")
    if fit.bounced is not None:
        raise ValueError("the table knows no bounced light: leave interreflection out")
    task = MaterialTask(
        fit.final.problem, model, observations, light, settings, concave(shape), stage
    )
    with stage("table"):
        nodes = exact_nodes(light, None, float(model.width))
        pairs = sum(part.directions.shape[-2] for part in nodes)
        count = int(np.clip(_MOST_PAIRS / max(pairs, 1), _FEWEST_SAMPLES, _SAMPLES))
        weight = leverage(observations, light, (float(model.width), 1.0))
        some, _ = draw(observations, weight, count, settings.seed)
        exact = task.integral(some, task.nodes(light, some, float(model.width)))
        sums = cell_sums(exact, NODES) * _gains(fit, some)[:, None, None]
        return _fitted(fit, some, sums)


def check_correctable(observations: Observations, model: BRDF | None = None) -> None:
    """Raise ``ValueError`` where no table corrects a material that these photographs show.

    This needs no fit.  ``model`` is the material, or one of its kind, where that is known.
    """
    if model is not None and not model.isotropic:
        raise ValueError(
            "the material is anisotropic, and the table is isotropic: choose another model"
        )
    frames = len(np.unique(np.asarray(observations.frame)))
    if frames < 2:
        raise ValueError(
            "one photograph shows a line of the table and no more: give two photographs or more"
        )
    if observations.count < _FEWEST_SAMPLES:
        raise ValueError(
            f"{observations.count} samples are too few for a table: give {_FEWEST_SAMPLES} or more"
        )


def _gains(fit: BRDFFit, some: Observations) -> Float[np.ndarray, "sample"]:
    """What each photograph's exposure, and the scale of the light, multiply the radiance by."""
    found = fit.parameters.value
    gains = np.asarray(found.gains, float)
    each = gains[np.asarray(some.frame)] if len(gains) > 1 else np.ones(some.count)
    return each * float(found.scale)


class _Channel(NamedTuple):
    """One channel's sums by the places of the smooth functions, and what was measured."""

    sums: Float[np.ndarray, "sample place"]
    functions: Float[np.ndarray, "place function"]
    measured: Float[np.ndarray, "sample"]
    deviation: Float[np.ndarray, "sample"]

    def factor(self, weights: Float[np.ndarray, "function"]) -> Float[np.ndarray, "place"]:
        """Evaluate the factor at the places."""
        return np.exp(self.functions @ weights)

    def cost(self, weights: Float[np.ndarray, "function"], strength: float, noise: float) -> float:
        """Evaluate minus the logarithm of the posterior, but for a constant."""
        off = (self.measured - self.sums @ self.factor(weights)) / (noise * self.deviation)
        return float(off @ off + weights @ weights / strength**2) / 2


class _Posterior(NamedTuple):
    """Where a channel stands: weights, their covariance, and what is left of the photographs."""

    weights: Float[np.ndarray, "function"]
    covariance: Float[np.ndarray, "function function"]
    told: float
    squares: float
    moved: float


def _fitted(
    fit: BRDFFit, some: Observations, sums: Float[np.ndarray, "sample channel cell"]
) -> Correction:
    """Find the factor, the strength of its prior and the noise that it leaves."""
    measured, smooth = np.asarray(some.radiance, float), smooth_functions(NODES)
    channels = measured.shape[1]
    # What no light meets asks for no work.
    own = smooth.by_place(sums)
    met = np.any(own > 0, axis=(0, 1))
    own, places = np.ascontiguousarray(np.moveaxis(own[..., met], 1, 0)), smooth.functions[met]
    strength, noise, settled = _FIRST_STRENGTH, 1.0, False
    found: list[_Posterior] = []
    at = [np.zeros(places.shape[1])] * channels
    predicted = own.sum(axis=-1).T
    for _ in range(_ROUNDS):
        deviation = _deviation(fit, predicted)
        found = [
            _step(_Channel(own[c], places, measured[:, c], deviation[:, c]), at[c], strength, noise)
            for c in range(channels)
        ]
        at = [one.weights for one in found]
        predicted = np.stack([own[c] @ np.exp(places @ at[c]) for c in range(channels)], axis=1)
        told = sum(one.told for one in found)
        before = strength, noise
        size = sum(float(weights @ weights) for weights in at)
        strength = float(np.clip(np.sqrt(size / max(told, 1e-9)), _LEAST_STRENGTH, _MOST_STRENGTH))
        free = max(measured.size - told, 1.0)
        noise = float(np.sqrt(sum(one.squares for one in found) / free))
        changes = np.abs(np.log([strength / before[0], noise / before[1]]))
        settled = bool(max(*changes, *(one.moved for one in found)) < _SETTLED)
        if settled:
            break
    functions = smooth.at_cells
    covariance = np.stack([one.covariance for one in found])
    shape = (*NODES, channels)
    factor = np.stack([np.exp(functions @ weights) for weights in at], axis=-1).reshape(shape)
    variance = np.einsum("kf,cfg,kg->kc", functions, covariance, functions, optimize=True)
    return Correction(
        CorrectedBRDF(fit.brdf, factor),
        np.sqrt(np.maximum(variance, 0)).reshape(shape),
        strength,
        noise,
        _relative(measured - sums.sum(axis=-1), measured),
        _relative(measured - predicted, measured),
        some.count,
        settled,
        covariance,
    )


def _deviation(
    fit: BRDFFit, predicted: Float[np.ndarray, "sample channel"]
) -> Float[np.ndarray, "sample channel"]:
    """Compute the noise of single pixels, which in the dark is that of a typical radiance."""
    typical = float(np.sqrt(np.mean(predicted**2)))
    return standard_deviations(fit.noise, np.maximum(predicted, _DARK * typical))


def _step(
    channel: _Channel, weights: Float[np.ndarray, "function"], strength: float, noise: float
) -> _Posterior:
    """Take one Gauss-Newton step, halved until it gains, and the curvature before it."""
    factor = channel.factor(weights)
    scale = 1 / (noise * channel.deviation)
    slopes = (channel.sums * factor) @ channel.functions * scale[:, None]
    off = (channel.measured - channel.sums @ factor) * scale
    curvature = slopes.T @ slopes
    curvature[np.diag_indices_from(curvature)] += 1 / strength**2
    covariance = np.linalg.inv(curvature)
    step = covariance @ (slopes.T @ off - weights / strength**2)
    farthest = float(np.max(np.abs(channel.functions @ step), initial=0))
    step = step * min(1.0, _LONGEST_STEP / max(farthest, 1e-300))
    before = channel.cost(weights, strength, noise)
    for _ in range(_HALVINGS):
        if channel.cost(weights + step, strength, noise) <= before:
            break
        step = step / 2
    else:
        step = np.zeros_like(step)
    weights = weights + step
    left = (channel.measured - channel.sums @ channel.factor(weights)) / channel.deviation
    told = len(weights) - float(np.trace(covariance)) / strength**2
    moved = float(np.max(np.abs(channel.functions @ step), initial=0))
    return _Posterior(weights, covariance, told, float(left @ left), moved)


def _relative(off: Float[np.ndarray, "..."], measured: Float[np.ndarray, "..."]) -> float:
    return float(np.sqrt(np.sum(off**2) / np.sum(measured**2)))
