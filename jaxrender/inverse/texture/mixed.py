"""Sites that hold more than one paint: what is left of them goes by place, in every photograph.

A site is cut into four by two tangents through its middle.  Within each photograph what is left is
compared between the four, so that what a photograph as a whole leaves does not count.  Noise makes
chi-squared of these means as large as their number less one.
"""

import numpy as np

from jaxrender.geometry import world_from_local
from jaxrender.inverse.diagnosis import Diagnosis
from jaxrender.inverse.observations import Observations
from jaxrender.shapes import Float, Int

# Parts of a site differ where chi-squared is this many times what noise makes it: that is as large
# as the number of parts less one.  Paints are said to be mixed where they are in many sites.
_MIXED, _FREE, _MANY = 9.0, 3, 0.25
# A cause is named where the criterion prefers it by so much: odds of e^5 to one.
_NAMED = 10.0
# Fewer pixels of a site say nothing of its parts.
_FEWEST = 24


def mixed(
    pool: Observations,
    site: Int[np.ndarray, "sample"],
    left: Float[np.ndarray, "sample channel"],
    deviation: Float[np.ndarray, "sample channel"],
    tested: int,
) -> tuple[Diagnosis, ...]:
    """Name paints that are mixed in many sites as the cause of what is left, or nothing.

    ``left`` is NaN where nothing is predicted.  ``deviation`` is that of the pixels' noise.  The
    criterion is stated for as many values as other causes are ``tested`` on.
    """
    own = (site >= 0) & np.isfinite(left).all(axis=1)
    if pool.places is None or not own.any():
        return ()
    site, count = site[own], int(site.max()) + 1
    scaled = np.mean(left[own] / deviation[own], axis=1) * np.sqrt(left.shape[1])
    points = np.asarray(pool.places.points, float)[own]
    normals = np.asarray(pool.samples.normals, float)[own]
    quarter = _quarters(points, normals, site, count)
    # A photograph's own mean is taken out of what it leaves of a site.
    _, group = np.unique(
        np.stack([site, np.asarray(pool.frame)[own]], axis=1), axis=0, return_inverse=True
    )
    seen = np.bincount(group)
    within = scaled - (np.bincount(group, scaled) / seen)[group]
    place = 4 * site + quarter
    pixels = np.bincount(place, minlength=4 * count)
    sums = np.bincount(place, within, 4 * count)
    # A mean taken out of m pixels leaves each of them 1 - 1 / m of its variance.
    variance = np.bincount(place, 1 - 1 / seen[group], 4 * count)
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.where(variance > 0, sums**2 / variance, 0).reshape(-1, 4).sum(axis=1)
    parts = (pixels.reshape(-1, 4) > 0).sum(axis=1)
    told = (np.bincount(site, minlength=count) >= _FEWEST) & (parts == 4)
    if not told.any() or np.mean(squares[told] > _MIXED * _FREE) < _MANY:
        return ()
    values = left[own][told[site]] / deviation[own][told[site]]
    before, more = float(np.sum(values**2)), _FREE * int(told.sum())
    explained = min(float(np.sum(squares[told])), 0.999 * before)
    gain = values.size * -np.log1p(-explained / before) - more * np.log(values.size)
    explains = float(np.clip((explained - more) / max(before - values.size, 1e-300), 0, 1))
    if gain <= _NAMED:
        return ()
    share = 100 * float(np.mean(squares[told] > _MIXED * _FREE))
    sentence = f"{share:.0f} % of the sites hold more than one paint, so they are too large"
    return (
        Diagnosis("sites", sentence, explains, float(gain) * tested / values.size, np.zeros(0)),
    )


def _quarters(
    points: Float[np.ndarray, "sample 3"],
    normals: Float[np.ndarray, "sample 3"],
    site: Int[np.ndarray, "sample"],
    count: int,
) -> Int[np.ndarray, "sample"]:
    """Tell in which quarter of its site each point lies."""
    pixels = np.maximum(np.bincount(site, minlength=count), 1)[:, None]

    def middle(vectors: Float[np.ndarray, "sample 3"]) -> Float[np.ndarray, "site 3"]:
        return np.stack([np.bincount(site, axis, count) for axis in vectors.T], axis=1) / pixels

    facing = middle(normals)
    size = np.linalg.norm(facing, axis=1, keepdims=True)
    facing = np.where(size > 0, facing / np.where(size > 0, size, 1), [0.0, 0.0, 1.0])
    frames = np.asarray(world_from_local(facing))[site]
    along = np.einsum("sij,si->sj", frames[:, :, :2], points - middle(points)[site])
    return (along[:, 0] > 0) * 2 + (along[:, 1] > 0)
