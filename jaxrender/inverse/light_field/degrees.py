"""The degrees of a light field as products, and the ties between them (T 2.4.3).

Of degree l the field is Lambda_l L_lm rho~_lpq: of rank one in m against (p, q), so the nearest
such product uses every m.  Its factors are known up to t_l.  Reciprocity says what t_l / t_p is
where rho~_lpq does not vanish; the ties make a forest, grown from degree 0 by the surest tie first.
Host, float64.
"""

import math
from typing import NamedTuple

import numpy as np

from jaxrender.shapes import Float, Int

# A coefficient, or a sum of squares, counts as present when it exceeds its noise this many times.
CLEARLY = 5.0
# The component of a degree that the field does not contain.
UNLIT = -1


class DegreeFactors(NamedTuple):
    """The field of one degree as a product: unit light, and rho~_lpq times the light's size."""

    light: Float[np.ndarray, "order"]
    brdf: Float[np.ndarray, "outgoing_degree order"]
    certainty: Float[np.ndarray, "outgoing_degree"]
    lit: bool


class Ties(NamedTuple):
    """Which degrees are tied to one another, by number of the component, and their factors t_l."""

    component: Int[np.ndarray, "degree"]
    scale: Float[np.ndarray, "degree"]


def split_degree(values: np.ndarray, deviation: np.ndarray, exists: np.ndarray) -> DegreeFactors:
    """Find the product that is nearest to the field of one degree: all m in least squares."""
    there = np.broadcast_to(exists, values.shape)
    squares = np.sum(np.where(there, values / deviation, 0) ** 2)
    size = int(np.count_nonzero(there))
    weight = np.where(exists, np.mean(deviation**-2.0, axis=0) ** 0.5, 0)
    left, singular, right = np.linalg.svd(
        (values * weight[None]).reshape(len(values), -1), full_matrices=False
    )
    white = (singular[0] * right[0]).reshape(weight.shape)
    brdf = np.where(exists, white / np.where(exists, weight, 1), 0)
    return DegreeFactors(
        left[:, 0], brdf, np.sum(white**2, axis=1), _is_clear(float(squares), size)
    )


def tie_degrees(parts: list[DegreeFactors]) -> Ties:
    """Tie degrees to one another by reciprocity, the surest tie first.

    rho~_lpq = x_lpq / (Lambda_l t_l) = x_plq / (Lambda_p t_p), so t_l = t_p (Lambda_p x_lpq) /
    (Lambda_l x_plq).
    """
    count, outgoing_count = len(parts), parts[0].brdf.shape[0]
    component, scale = np.full(count, UNLIT), np.zeros(count)
    waiting = {k for k, part in enumerate(parts) if part.lit}
    largest, own = None, 1
    while waiting:
        root = min(waiting)
        if root == 0:
            which, scale[root] = 0, 1 / (wavelength(0) * parts[0].light[0])
        else:
            which, own = own, own + 1
            scale[root] = _conventional_scale(root, parts[root], largest)
        tree = [root]
        waiting.discard(root)
        while tree:
            component[tree[-1]] = which
            ties = [
                (_certainty(parts, a, b), a, b)
                for a in waiting
                for b in tree
                if max(a, b) < outgoing_count
            ]
            sure, a, b = max(ties, default=(0.0, 0, 0))
            if not sure:
                break
            mine, other = parts[a].brdf[b] / wavelength(a), parts[b].brdf[a] / wavelength(b)
            scale[a] = scale[b] * (mine @ other) / (other @ other)
            waiting.discard(a)
            tree.append(a)
        if which == 0:
            largest = np.abs(parts[0].brdf).max() / abs(wavelength(0) * scale[0])
    return Ties(component, scale)


def _certainty(parts: list[DegreeFactors], a: int, b: int) -> float:
    """Say how clearly two degrees are tied: chi-squared of the weaker side, 0 where unclear."""
    weaker = float(min(parts[a].certainty[b], parts[b].certainty[a]))
    return weaker if _is_clear(weaker, min(a, b) + 1) else 0.0


def _is_clear(squares: float, freedom: int) -> bool:
    return squares > freedom + CLEARLY * math.sqrt(2 * freedom) + CLEARLY**2


def _conventional_scale(degree: int, part: DegreeFactors, largest: float | None) -> float:
    """Choose the member of the family: its largest rho~ is that of degree 0, and positive.

    Of a mirror that is the mirror, f(l) = 1 (T 3.26).
    """
    straight = part.brdf[:, 0]
    sign = np.sign(straight[np.argmax(np.abs(straight))]) or 1.0
    return float(sign * np.abs(part.brdf).max() / (wavelength(degree) * (largest or 1.0)))


def wavelength(degree):
    """Compute Lambda_l = sqrt(4 pi / (2l + 1)) of a degree or of many (T 2.51)."""
    return np.sqrt(4 * np.pi / (2 * np.asarray(degree) + 1))
