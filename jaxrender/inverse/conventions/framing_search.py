"""The framing whose silhouettes overlap those of the photographs, from coarse to fine.

Boxes around projected vertices first say which framings are worth it; those are traced.  A framing
is told from another where it overlaps more in every photograph by more than chance: the mean
difference exceeds three of its standard errors, and two per cent.  Of those that cannot be told
apart, the one that changes least of what was told is taken.
"""

import itertools
from typing import NamedTuple

import numpy as np

from jaxrender.geometry import Mesh, Placement, Shape, Sphere, fibonacci_sphere
from jaxrender.inverse.conventions.framings import Framing, framings
from jaxrender.inverse.conventions.silhouettes import Silhouettes
from jaxrender.shapes import Float

# Pixels along the longest side, photographs and framings of each stage; None: all photographs.
_COARSE, _FINE = 40, 96
_FEW, _MANY = 4, 12
_WORTH, _TRACED = 60, 12
_POINTS = 250
# A difference of overlaps counts from here on, and where it exceeds so many standard errors.
LEAST_DIFFERENCE, DEVIATIONS = 0.02, 3.0
# Framings that overlap less than this fit none of the photographs.
POOR = 0.6


class FoundFraming(NamedTuple):
    """The framing that overlaps best, its overlap, that of the told one, and what comes next.

    ``rivals`` has, for each aspect, the best overlap of a framing in which that aspect is another,
    and ``told_apart`` the aspects in which the best is better than these by more than chance.
    ``tied`` are the framings, the best among them, that overlap as well but for chance.
    """

    framing: Framing
    overlap: float
    told: Framing
    told_overlap: float
    rivals: dict[str, float]
    told_apart: tuple[str, ...]
    tied: tuple[Framing, ...] = ()

    @property
    def fits(self) -> bool:
        """Whether the silhouettes are those of the shape at all."""
        return self.overlap >= POOR

    @property
    def changed(self) -> tuple[str, ...]:
        """The aspects in which it is not as told."""
        pairs = zip(Framing._fields, self.framing, self.told, strict=True)
        return tuple(name for name, one, other in pairs if one != other)

    def sentences(self) -> list[str]:
        """Say it in words, aspect by aspect."""
        if not self.fits:
            return [
                f"no axes, turn or unit fit: the silhouettes overlap by {self.overlap:.2f} at best "
                f"(as told {self.told_overlap:.2f})"
            ]
        found = []
        for name, rival in self.rivals.items():
            words = self.framing.aspect(name)
            if name not in self.told_apart:
                found.append(f"{words}: cannot be told from another (next {rival:.2f})")
                continue
            how = "" if name in self.changed else ", as told"
            found.append(f"{words}{how}: overlap {self.overlap:.2f}, next {rival:.2f}")
        return found


def find_framing(
    shape: Shape, silhouettes: Silhouettes, told: Framing, placed: Placement | None = None
) -> FoundFraming:
    """Find how a capture is meant, of a shape that is placed as it is told (``placed``).

    ``ValueError`` without a silhouette.
    """
    if not silhouettes.names:
        raise ValueError("no photograph shows a silhouette: give masks")
    placed = Placement() if placed is None else placed
    every = framings(told, shape)
    few = silhouettes.some(_MANY).shrunk(_COARSE)
    boxes = _boxes(shape, few, every, placed)
    worth = _kept(every, boxes, _WORTH)
    coarse = np.array([_overlaps(shape, few.some(_FEW), one, placed).mean() for one in worth])
    kept = _kept(worth, coarse, _TRACED)
    order = [worth[int(k)] for k in np.argsort(-coarse, kind="stable")]
    order += [every[int(k)] for k in np.argsort(-boxes, kind="stable")]
    rivals = _one_of_each(order, kept)
    fine = silhouettes.some(_MANY).shrunk(_FINE)
    tried = [*kept, *rivals]
    overlaps = np.array([_overlaps(shape, fine, one, placed) for one in tried])
    return _choice(tried, overlaps)


def _kept(every: list[Framing], scores: Float[np.ndarray, "framing"], count: int) -> list[Framing]:
    """Keep the told one, which is the first, and the best of the others."""
    order = [int(k) for k in np.argsort(-scores, kind="stable") if k]
    return [every[0], *(every[k] for k in order[: count - 1])]


def _one_of_each(order: list[Framing], kept: list[Framing]) -> list[Framing]:
    """Find the first framing in which each aspect is other than in the first of all."""
    best, found = order[0], []
    for at in range(len(best)):
        other = next((one for one in order if one[at] != best[at]), None)
        if other is not None and other not in (*kept, *found):
            found.append(other)
    return found


def _choice(
    tried: list[Framing], overlaps: Float[np.ndarray, "framing photograph"]
) -> FoundFraming:
    told, means = tried[0], overlaps.mean(axis=1)
    top = int(np.argmax(means))
    tied = [k for k in range(len(tried)) if not surpasses(overlaps[top], overlaps[k])]
    best = min(tied, key=lambda k: (tried[k].changes(told), -means[k]))
    rivals, told_apart = {}, []
    for at, name in enumerate(Framing._fields):
        others = [k for k, one in enumerate(tried) if one[at] != tried[best][at]]
        if not others:
            continue
        rival = max(others, key=lambda k: means[k])
        rivals[name] = float(means[rival])
        if surpasses(overlaps[best], overlaps[rival]):
            told_apart.append(name)
    return FoundFraming(
        tried[best],
        float(means[best]),
        told,
        float(means[0]),
        rivals,
        tuple(told_apart),
        tuple(tried[k] for k in tied),
    )


def surpasses(one: Float[np.ndarray, "photograph"], other: Float[np.ndarray, "photograph"]) -> bool:
    """Tell whether overlaps are larger than others by more than chance."""
    difference = one - other
    error = float(np.std(difference, ddof=1)) / len(difference) ** 0.5 if len(one) > 1 else 0.0
    return bool(difference.mean() > max(LEAST_DIFFERENCE, DEVIATIONS * error))


def _overlaps(
    shape: Shape, silhouettes: Silhouettes, framing: Framing, placed: Placement
) -> Float[np.ndarray, "photograph"]:
    return silhouettes.meant(framing).overlaps(shape, framing.moved(placed))


def _boxes(
    shape: Shape, silhouettes: Silhouettes, every: list[Framing], placed: Placement
) -> Float[np.ndarray, "framing"]:
    """Score framings by boxes: that of the projected points against that of the silhouette.

    The overlap of the boxes is multiplied by the part of the points that lie in the silhouette.
    """
    points = surface_points(shape, _POINTS)
    moves = list(dict.fromkeys(one[2:] for one in every))
    moved = [Framing(turn=turn, unit=unit).moved(placed).points(points) for turn, unit in moves]
    cloud, scores = np.concatenate(moved), {}
    for axes, mirrored in itertools.product(dict.fromkeys(one.axes for one in every), (0, 1)):
        meant = silhouettes.meant(Framing(axes, bool(mirrored)))
        of_photographs = []
        for camera, mask in zip(meant.cameras, meant.masks):
            places = camera.project(cloud).reshape(len(moves), len(points), 2)
            of_photographs.append(_box_scores(places, mask))
        means = np.mean(of_photographs, axis=0)
        scores |= {Framing(axes, bool(mirrored), *m): s for m, s in zip(moves, means)}
    return np.array([scores[one] for one in every])


def _box_scores(
    places: Float[np.ndarray, "move point 2"], mask: np.ndarray
) -> Float[np.ndarray, "move"]:
    rows, columns = np.nonzero(mask)
    low = np.array([columns.min(), rows.min()], float)
    high = np.array([columns.max(), rows.max()]) + 1.0
    ahead = np.asarray(np.isfinite(places).all(axis=-1))
    whole = np.all(ahead, axis=1)
    seen = np.where(ahead[..., None], places, 0)
    cell = np.clip(np.floor(seen), 0, np.array(mask.shape[::-1]) - 1).astype(int)
    inside = mask[cell[..., 1], cell[..., 0]] & ahead
    inside &= ((seen >= 0) & (seen < np.array(mask.shape[::-1]))).all(axis=-1)
    least, most = seen.min(axis=1), seen.max(axis=1)
    common = np.prod(np.clip(np.minimum(most, high) - np.maximum(least, low), 0, None), axis=1)
    with np.errstate(over="ignore"):
        total = np.prod(most - least, axis=1) + np.prod(high - low) - common
    return np.where(whole, common / np.maximum(total, 1e-12) * inside.mean(axis=1), 0)


def surface_points(shape: Shape, count: int) -> Float[np.ndarray, "point 3"]:
    """Spread points over a shape: vertices of a mesh, those that reach furthest among them."""
    if isinstance(shape, Sphere):
        return shape.center + shape.radius * fibonacci_sphere(count)
    if not isinstance(shape, Mesh):
        raise ValueError(f"a {type(shape).__name__} has no vertices: give a mesh or a sphere")
    used = shape.vertices[np.unique(shape.faces)]
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(used), min(count, len(used)), replace=False)
    furthest = np.argmax(used @ fibonacci_sphere(64).T, axis=0)
    return used[np.unique(np.concatenate([chosen, furthest]))]
