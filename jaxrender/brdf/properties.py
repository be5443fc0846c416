"""What a BRDF does, measured: reciprocity, isotropy, separability, the light that leaves again.

Host side: numbers to look at, in tests and reports.  Directions are local, +Z the normal.
"""

import itertools
from collections.abc import Sequence

import equinox as eqx
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.parameters import refuse_unlisted
from jaxrender.shapes import Float, checked

# Which direction stays put while the other runs over the hemisphere.
FIXED_DIRECTIONS = ("incoming", "outgoing")

# Head-on to grazing, denser where albedos grow; a maximum is looked for here.
DEFAULT_COSINES = (1.0, 0.9, 0.7, 0.5, 0.35, 0.2, 0.1, 0.05, 0.02)

# Where a lobe's width is looked for: tilts of the half vector, slants of the outgoing direction.
_FINEST_TILT, _TILTS, _SLANTS = 1e-3, 240, (0.0, 0.8, 1.2)
# Closer to the horizon than this cosine no incoming direction counts; what rises by less than
# this share is no lobe.
_LOWEST_COSINE, _LEAST_RISE = 0.05, 0.1

_evaluate = eqx.filter_jit(BRDF.evaluate)


def reciprocity_error(
    brdf: BRDF, count: int = 256, seed: int = 0, smallest_cosine: float = 0.05
) -> float:
    """Find the largest |rho(a, b) - rho(b, a)| / max(rho(a, b), rho(b, a)) over random pairs.

    Half of the pairs lie near each other's mirror direction, where narrow lobes have their light.
    """
    rng = np.random.default_rng(seed)
    a, b = (_random_directions(count, smallest_cosine, rng) for _ in range(2))
    near = count // 2
    b[:near] = a[:near] * [-1, -1, 1] + 0.2 * b[:near]
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    there, back = (np.asarray(_evaluate(brdf, *pair), float) for pair in ((a, b), (b, a)))
    larger = np.maximum(np.abs(there), np.abs(back))
    return float(np.max(np.abs(there - back) / np.where(larger > 0, larger, 1)))


@checked
def directional_albedo(
    brdf: BRDF,
    cosines: Sequence[float] | Float[np.ndarray, "cosine"],
    fixed: str = "incoming",
    azimuth: float = 0.0,
    nodes: int = 96,
) -> Float[np.ndarray, "cosine channel"]:
    """Integrate rho cos t over the hemisphere of the direction that is not ``fixed``.

    ``incoming`` fixed is the share of the light from there that leaves again, which energy
    conservation bounds by 1; ``outgoing`` fixed is the radiance seen under uniform light of
    radiance 1.  They agree for reciprocal models.  The fixed direction has the given azimuth.

    Gauss-Legendre nodes in the angle from the normal, on either side of the mirror direction's,
    and in azimuth with a substitution that crowds them about the mirror direction and its opposite:
    good to 1e-4 for lobes as narrow as .05 down to a cosine of .02 with the default ``nodes``
    (3e-4 with V-grooves there, whose minimum has a kink).
    Raises ``ValueError`` for cosines outside (0, 1] and an unlisted ``fixed``.
    """
    refuse_unlisted("fixed", fixed, FIXED_DIRECTIONS)
    albedos = []
    for cosine in np.asarray(cosines, float):
        if not 0 < cosine <= 1:
            raise ValueError(f"cosine={cosine}: must lie in (0, 1], from the normal to grazing")
        albedos.append(evaluated_about_mirror(brdf, cosine, azimuth, fixed, nodes)[1].sum(axis=0))
    return np.stack(albedos)


def evaluated_about_mirror(
    brdf: BRDF, cosine: float, azimuth: float = 0.0, fixed: str = "incoming", nodes: int = 96
) -> tuple[Float[np.ndarray, "node"], Float[np.ndarray, "node channel"]]:
    """Evaluate what ``directional_albedo`` adds up, with the cosine of each direction."""
    directions, weights = _nodes_about_mirror(np.arccos(cosine), azimuth, nodes)
    polar = np.sqrt(1 - cosine**2)
    still = [polar * np.cos(azimuth), polar * np.sin(azimuth), cosine]
    still = np.broadcast_to(still, directions.shape)
    pair = (still, directions) if fixed == "incoming" else (directions, still)
    values = np.asarray(_evaluate(brdf, *pair), float)
    return directions[:, 2], (weights * directions[:, 2])[:, None] * values


def max_albedo(
    brdf: BRDF, cosines: Sequence[float] = DEFAULT_COSINES, azimuths: int = 5, nodes: int = 96
) -> float:
    """Find the largest share of light that leaves again, over angles and channels.

    Anisotropic models are looked at from ``azimuths`` directions in a quarter circle.
    """
    around = np.linspace(0, np.pi / 2, 1 if brdf.isotropic else azimuths)
    albedos = [directional_albedo(brdf, cosines, "incoming", a, nodes) for a in around]
    return float(np.max(albedos))


def isotropy_error(brdf: BRDF, polars: int = 12, azimuths: int = 24) -> float:
    """Find the rms of rho minus its mean over turns about the normal, as a share of rho's rms.

    Over pairs of directions weighted by their projected solid angles, ``polars`` Gauss nodes in
    sin^2 t by ``azimuths``; lobes narrower than the nodes' distances may be missed.
    """
    values = _pairwise(brdf, polars, azimuths)
    turned = [np.roll(values, (turn, turn), axis=(1, 3)) for turn in range(azimuths)]
    weights = _polar_nodes(polars)[1]
    mean = sum(turned[1:], turned[0]) / azimuths
    return float(np.sqrt(_energy(values - mean, weights) / (_energy(values, weights) or 1)))


def separability_error(brdf: BRDF, polars: int = 12, azimuths: int = 24) -> float:
    """Find the share of rho's energy that the best product f(w_i) g(w_r) in each channel misses.

    Energy is int int rho^2 cos t_i cos t_r dw_i dw_r over the nodes of ``isotropy_error``; 0 for a
    product, and near 1 for a mirror.
    """
    values = _pairwise(brdf, polars, azimuths)
    across = np.sqrt(np.repeat(_polar_nodes(polars)[1], azimuths))[:, None]
    matrices = values.reshape(len(across), len(across), -1) * across[:, None] * across
    strengths = np.linalg.svd(np.moveaxis(matrices, -1, 0), compute_uv=False) ** 2
    whole = strengths.sum()
    return float(max(1 - strengths[:, 0].sum() / whole, 0)) if whole > 0 else 0.0


def lobe_width(brdf: BRDF) -> float:
    """Measure how wide (radians) the finest lobe is, as ``sigma`` says it of a model.

    The half vector leaves the normal by t in the plane of incidence and across it, with the
    outgoing direction at the normal and at two slants.  The width is the least t that holds 1 - 1/e
    of int (rho - min rho) t dt, which is sigma of exp(-(t / sigma)^2); pi / 2 where nothing rises
    by a tenth.  Raises ``ValueError`` for values that are not finite.
    """
    tilts = np.geomspace(_FINEST_TILT, np.pi / 3, _TILTS)
    found = np.pi / 2
    for slant, azimuth in itertools.product(_SLANTS, (0.0, np.pi / 2, np.pi)):
        outgoing = np.array([np.sin(slant), 0.0, np.cos(slant)])
        sine, cosine = np.sin(tilts), np.cos(tilts)
        half = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)
        incoming = 2 * (half @ outgoing)[:, None] * half - outgoing
        values = np.asarray(_evaluate(brdf, incoming, np.broadcast_to(outgoing, half.shape)), float)
        if not np.isfinite(values).all():
            raise ValueError(f"{type(brdf).__name__}: values are not finite; mend the BRDF")
        seen = incoming[:, 2] > _LOWEST_COSINE
        rise = values[seen] - values[seen].min(axis=0)
        # Steps of a geometric sequence are as long as t: t dt is t^2.
        held = np.cumsum(rise * tilts[seen, None] ** 2, axis=0)
        for channel in np.flatnonzero(rise[0] > _LEAST_RISE * np.abs(values[0])):
            enough = held[:, channel] >= (1 - 1 / np.e) * held[-1, channel]
            found = min(found, float(tilts[seen][np.argmax(enough)]))
    return found


def _polar_nodes(count: int) -> tuple[Float[np.ndarray, "node"], Float[np.ndarray, "node"]]:
    """Gauss nodes of sin^2 t in [0, 1], over which projected solid angle is even, and weights."""
    x, w = np.polynomial.legendre.leggauss(count)
    return (x + 1) / 2, w / 2


def _pairwise(
    brdf: BRDF, polars: int, azimuths: int
) -> Float[np.ndarray, "polar_i azimuth_i polar_r azimuth_r channel"]:
    squares = _polar_nodes(polars)[0]
    cosine, turn = np.meshgrid(
        np.sqrt(1 - squares), 2 * np.pi * np.arange(azimuths) / azimuths, indexing="ij"
    )
    sine = np.sqrt(1 - cosine**2)
    nodes = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=-1).reshape(-1, 3)
    pairs = np.repeat(nodes, len(nodes), axis=0), np.tile(nodes, (len(nodes), 1))
    found = np.asarray(_evaluate(brdf, *pairs), float)
    return found.reshape(polars, azimuths, polars, azimuths, -1)


def _energy(
    values: Float[np.ndarray, "polar_i azimuth_i polar_r azimuth_r channel"],
    weights: Float[np.ndarray, "polar"],
) -> float:
    return float(np.einsum("iajbc,i,j->", values**2, weights, weights, optimize=True))


def _random_directions(
    count: int, smallest_cosine: float, rng: np.random.Generator
) -> Float[np.ndarray, "direction 3"]:
    cosine, azimuth = rng.uniform(smallest_cosine, 1, count), rng.uniform(0, 2 * np.pi, count)
    sine = np.sqrt(1 - cosine**2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)


def _nodes_about_mirror(
    polar: float, azimuth: float, nodes: int
) -> tuple[Float[np.ndarray, "node 3"], Float[np.ndarray, "node"]]:
    """Directions, and the solid angles they stand for."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    x, w = (x + 1) / 2, w / 2
    ends = [0.0, polar, np.pi / 2] if polar > 0 else [0.0, np.pi / 2]
    pieces = list(itertools.pairwise(ends))
    angles = np.concatenate([start + (end - start) * x for start, end in pieces])
    across = np.concatenate([(end - start) * w for start, end in pieces])
    # The smooth step x^3 (10 - 15 x + 6 x^2) has two derivatives 0 at either end.
    around = np.pi * x**3 * (10 - 15 * x + 6 * x**2)
    density = np.pi * 30 * (x * (1 - x)) ** 2 * w
    turns = azimuth + np.pi + np.concatenate([around, -around])
    densities = np.concatenate([density, density])
    sine = np.sin(angles)[:, None]
    directions = np.stack(
        [
            sine * np.cos(turns),
            sine * np.sin(turns),
            np.broadcast_to(np.cos(angles)[:, None], (len(angles), len(turns))),
        ],
        axis=-1,
    )
    return directions.reshape(-1, 3), np.outer(across * np.sin(angles), densities).ravel()
