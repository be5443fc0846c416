"""The light in angle and in frequency at once, from a known material (T 6.17 to 6.21).

Without the diffuse light, the photographs are a picture of the light in a blurred mirror:

L_slow(R) = U - sum_lm W_lm L_lm,   U = B / g,   W_lm = K_d Y~_lm / g                (T 6.17, 6.18)

with g = K_s V(R) h_0 the share of the light that the lobe passes on (the thesis: K_s F).  The
diffuse light needs the L_lm of low degree, which are moments of L_slow.  So (T 6.21; T 6.23 takes F
out of a sum in which it varies: ERRATA 46, 47)

sum_l'm' Q_lm,l'm' L_l'm' = P_lm,   P = E'U,   Q = f_l delta + E'W

E holds weight x Y_lm of the bins of R.  L_slow is filtered by the lobe, so its moments are f_l L_lm
with f_l the mean of h_l / h_0 over the samples; the thesis has f_l = 1, as has the operator's
transfer ``none``.

Many samples share a bin; each is split bilinearly between four texels of the grid and weighs as
its confidence, the inverse variance of its L_slow, (g / noise)^2.  Any number of parameters: the
operator's degree is that of the diffuse light, nine for the thesis, more and with transfer vectors
and V(R) for concave objects.

Bins that no sample sees are marked in ``observed`` and follow a rule of ``unseen_directions``.

Host side, NumPy float64.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.harmonics import LatLongGrid
from jaxrender.inverse.descent import descend
from jaxrender.inverse.lighting.operator import LightOperator
from jaxrender.inverse.lighting.positivity import Misfit, hard_positive, soft_positive
from jaxrender.inverse.lighting.reflected_bins import bin_by_reflection
from jaxrender.inverse.lighting.unseen_directions import UNSEEN
from jaxrender.lighting import Environment
from jaxrender.shapes import AnyArray, Bool, Float, checked

# The equations of clamped light are solved to this part of the light.
_BALANCED = 1e-12


class DualSettings(NamedTuple):
    """How the dual light is recovered; ``strength`` is lambda of T 6.24.

    ``positivity`` is ``none``, ``clamp`` (T 6.4.3: negative values of step 1 are set to 0 within
    the consistency equations), ``soft`` or ``hard``; ``unseen`` is ``smooth`` or ``left-out``.
    """

    height: int = 64
    positivity: str = "none"
    unseen: str = "smooth"
    strength: float = 1.0


DEFAULT_DUAL = DualSettings()


class RecoveredDual(NamedTuple):
    """The light by direction, filtered by the lobe, and the coefficients of the diffuse light.

    ``confidence`` is the inverse variance of a bin before the diffuse light is subtracted;
    ``standard_errors`` include that of the latter, and are infinite where nothing was observed.
    ``conditioning`` is the condition number of Q.
    """

    radiance: Float[np.ndarray, "row column channel"]
    standard_errors: Float[np.ndarray, "row column channel"]
    confidence: Float[np.ndarray, "row column channel"]
    observed: Bool[np.ndarray, "row column"]
    coefficients: Float[np.ndarray, "coefficient channel"]
    conditioning: float
    reasons: tuple[str, ...]

    def to_environment(self) -> Environment:
        """Make a light of it; negative radiance, which none may have, becomes 0."""
        return Environment(np.maximum(self.radiance, 0))


@checked
def recover_dual(
    operator: LightOperator,
    radiance: Float[AnyArray, "sample channel"],
    weights: Float[AnyArray, "sample channel"] | None = None,
    settings: DualSettings = DEFAULT_DUAL,
) -> RecoveredDual:
    """Recover L_slow on a grid of reflected directions; ``weights`` are 1 / noise.

    Without weights all samples are equally sure, and standard errors are relative.
    Raises ``ValueError`` for unknown rules, no usable sample, and a material without a specular
    part.
    """
    _check(operator, settings)
    weights = np.ones(radiance.shape) if weights is None else np.asarray(weights)
    bins = bin_by_reflection(operator, np.asarray(radiance), weights, settings.height)
    seen = np.flatnonzero(bins.observed)
    grid = LatLongGrid(settings.height, 2 * settings.height)
    moments, fill = UNSEEN[settings.unseen](grid, bins.observed, operator.band_limit)
    images, errors, lights, conditions, notes = [], [], [], [], []
    for channel in range(radiance.shape[1]):
        known = _Channel(
            bins.direct[channel][seen],
            bins.diffuse[channel][seen],
            bins.variance[channel][seen],
            moments,
            bins.passed,
            grid.weights().ravel()[seen],
            bins.scatter[channel],
        )
        light, condition = _consistent(known)
        image, light, converged = POSITIVE[settings.positivity](known, light, settings.strength)
        images.append(fill(image))
        spread = np.full(bins.observed.shape, np.inf)
        spread[seen] = _standard_errors(known)
        errors.append(spread)
        lights.append(light)
        conditions.append(condition)
        if not converged:
            notes.append(f"the {settings.positivity} positivity of channel {channel} did not end")
    shape = (*grid.shape, radiance.shape[1])
    return RecoveredDual(
        np.stack(images, axis=-1).reshape(shape),
        np.stack(errors, axis=-1).reshape(shape),
        np.where(bins.observed, 1 / bins.variance, 0).T.reshape(shape),
        bins.observed.reshape(grid.shape),
        np.stack(lights, axis=1),
        max(conditions),
        _reasons(grid, bins.observed, settings, max(conditions)) + tuple(notes),
    )


class _Solved(NamedTuple):
    """The image and the coefficients of one channel, and whether the iteration ended."""

    image: Float[np.ndarray, "seen"]
    light: Float[np.ndarray, "coefficient"]
    converged: bool


class _Channel(NamedTuple):
    """The observed bins of one channel: U, W, the variance of U, E, f; solid angle, scatter."""

    direct: Float[np.ndarray, "seen"]
    diffuse: Float[np.ndarray, "seen coefficient"]
    variance: Float[np.ndarray, "seen"]
    moments: Float[np.ndarray, "seen coefficient"]
    passed: Float[np.ndarray, "coefficient"]
    solid_angle: Float[np.ndarray, "seen"]
    scatter: Float[np.ndarray, "2"]

    def mirror(self, light: Float[np.ndarray, "coefficient"]) -> Float[np.ndarray, "seen"]:
        """Subtract the diffuse light: step 1, U - W L."""
        return self.direct - self.diffuse @ light

    def coefficients(self, image: Float[np.ndarray, "seen"]) -> Float[np.ndarray, "coefficient"]:
        """Take the moments and undo the lobe's filter: step 2."""
        return self.moments.T @ image / self.passed


def _consistent(known: _Channel) -> tuple[Float[np.ndarray, "coefficient"], float]:
    """Solve Q L = P (T 6.21)."""
    matrix = np.diag(known.passed) + known.moments.T @ known.diffuse
    right = known.moments.T @ known.direct
    return np.linalg.lstsq(matrix, right)[0], float(np.linalg.cond(matrix))


def _standard_errors(known: _Channel) -> Float[np.ndarray, "seen"]:
    """Carry the variance of U through U - W Q^-1 E'U."""
    matrix = np.diag(known.passed) + known.moments.T @ known.diffuse
    back = known.diffuse @ np.linalg.pinv(matrix)
    weighted = known.moments * known.variance[:, None]
    covariance = weighted.T @ known.moments
    both = np.einsum("bk,bk->b", back, weighted)
    added = np.einsum("bk,kl,bl->b", back, covariance, back)
    return np.sqrt(np.maximum(known.variance - 2 * both + added, 0))


def _as_it_is(known: _Channel, light: np.ndarray, strength: float) -> _Solved:
    return _Solved(known.mirror(light), light, True)


def _clamped(known: _Channel, light: np.ndarray, strength: float) -> _Solved:
    """Solve f L = E' max(U - W L, 0) by Newton's method from the solution of T 6.21."""

    def unbalance(light: np.ndarray) -> np.ndarray:
        return known.passed * light - known.moments.T @ np.maximum(known.mirror(light), 0)

    def cost(light: np.ndarray) -> float:
        return float(np.linalg.norm(unbalance(light)))

    def step_at(light: np.ndarray) -> np.ndarray:
        lit = known.mirror(light) > 0
        slope = np.diag(known.passed) + known.moments[lit].T @ known.diffuse[lit]
        return -np.linalg.lstsq(slope, unbalance(light))[0]

    def balanced(light: np.ndarray) -> bool:
        return cost(light) <= _BALANCED * float(np.linalg.norm(light))

    light = descend(light, cost, step_at, lambda before, after: balanced(after)).point
    return _Solved(np.maximum(known.mirror(light), 0), light, balanced(light))


def _penalised(known: _Channel, light: np.ndarray, strength: float) -> _Solved:
    image, converged = soft_positive(_misfit(known), strength)
    return _Solved(image, known.coefficients(image), converged)


def _bounded(known: _Channel, light: np.ndarray, strength: float) -> _Solved:
    image, converged = hard_positive(_misfit(known))
    return _Solved(image, known.coefficients(image), converged)


class MirrorMisfit(Misfit):
    """The misfit of an image x to U = x + W L(x), L(x) = moments'x: a diagonal and low rank.

    ``rest`` is what the samples of the bins disagree by, which no image can mend.
    """

    direct: Float[np.ndarray, "node"]
    diffuse: Float[np.ndarray, "node coefficient"]
    confidence: Float[np.ndarray, "node"]
    moments: Float[np.ndarray, "node coefficient"]
    weights: Float[np.ndarray, "node"]
    rest: float
    measured: float

    @property
    def own_stiffness(self) -> Float[np.ndarray, "node"]:
        """The confidence of each bin."""
        return self.confidence

    def squares(self, light: Float[np.ndarray, "node"]) -> float:
        """Compute chi^2."""
        left = light + self.diffuse @ (self.moments.T @ light) - self.direct
        return float(self.rest + self.confidence @ left**2)

    def at_nodes(self, light: Float[np.ndarray, "node"]) -> Float[np.ndarray, "node"]:
        """Return the image as it is: its texels are the nodes."""
        return light

    def minimum(
        self, stiffness: Float[np.ndarray, "node"], aim: Float[np.ndarray, "node"]
    ) -> Float[np.ndarray, "node"]:
        """Solve (1 + E W') C (1 + W E') x + stiffness x by Woodbury's identity.

        With D = C + stiffness and P = C W the matrix is D + P E' + E P' + E W'C W E'.
        """
        weighted = self.confidence[:, None] * self.diffuse
        inner = self.diffuse.T @ weighted
        seen = self.confidence * self.direct
        right = seen + self.moments @ (self.diffuse.T @ seen) + stiffness * aim
        diagonal = self.confidence + stiffness
        factors = np.concatenate([weighted, self.moments], axis=1)
        scaled = factors / diagonal[:, None]
        unit, none = np.eye(len(inner)), np.zeros_like(inner)
        core = np.block([[-inner, unit], [unit, none]]) + factors.T @ scaled
        return right / diagonal - scaled @ np.linalg.solve(core, scaled.T @ right)


def _misfit(known: _Channel) -> MirrorMisfit:
    rest, number = known.scatter
    return MirrorMisfit(
        direct=known.direct,
        diffuse=known.diffuse,
        confidence=1 / known.variance,
        moments=known.moments / known.passed[None, :],
        weights=known.solid_angle,
        rest=float(rest),
        measured=float(number),
    )


POSITIVE = {"none": _as_it_is, "clamp": _clamped, "soft": _penalised, "hard": _bounded}


def _check(operator: LightOperator, settings: DualSettings) -> None:
    for name, known in (("positivity", POSITIVE), ("unseen", UNSEEN)):
        if (given := getattr(settings, name)) not in known:
            raise ValueError(f"{name}={given!r}: choose one of {', '.join(known)}")
    if settings.height < 2 * operator.band_limit + 1:
        raise ValueError(
            f"height={settings.height}: moments of degree {operator.band_limit} need "
            f"{2 * operator.band_limit + 1} rows or more"
        )
    if not np.all(np.asarray(operator.ks) > 0):
        raise ValueError(
            f"ks={np.asarray(operator.ks)}: a material without a specular part shows no mirror "
            "image; use recover_coefficients"
        )


def _reasons(
    grid: LatLongGrid, observed: np.ndarray, settings: DualSettings, condition: float
) -> tuple[str, ...]:
    reasons = []
    unseen = float(grid.weights().ravel()[~observed].sum() / (4 * np.pi))
    if unseen > 0:
        rule = "filled smoothly" if settings.unseen == "smooth" else "left out"
        reasons.append(f"{100 * unseen:.2g} % of the directions are reflected nowhere: {rule}")
    if condition > 1e3:
        reasons.append(
            f"the consistency equations have the condition {condition:.2g}: diffuse light and the "
            "mirror image cannot be distinguished"
        )
    return tuple(reasons)
