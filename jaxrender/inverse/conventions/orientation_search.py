"""The orientation of a panorama whose light leaves least of the photographs unexplained.

Layouts, mirror images and yaws are all tried with a quick fit, and the best of them refined.  One
is told from another where it leaves clearly less.  What is wrong with a model is wrong alike at
neighbours, so that pixels say less than there are.  Parts of the photographs are counted instead:
the samples of one photograph whose mirror directions lie in one octant.  The other must leave a
fifth more, and N log(S' / S) must exceed 9, for N parts and sums of squares S and S'.  No part
alone may make the difference.  Of those that cannot be told apart, the one that changes least of
what was told is taken.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.geometry import Shape, SurfaceSamples, fibonacci_sphere
from jaxrender.inverse.conventions.orientations import Orientation, Panoramas
from jaxrender.inverse.conventions.quick_fit import QuickFit, Responses
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.observations import Observations, stratified_subset
from jaxrender.shapes import ImageArray, Int

# Samples, directions and rows of the coarse and the fine stage.
_SAMPLES, _FEW_SAMPLES = 1500, 250
_DIRECTIONS, _FEW_DIRECTIONS = 4000, 1500
_ROWS, _FEW_ROWS = 64, 32
# Degrees between the yaws of each stage; about so many degrees another yaw is another light.
_STEP, _STEPS = 15.0, (5.0, 2.0, 0.7)
_ANOTHER_YAW = 20.0
# Programs differ by quarter turns: one that is so near, and leaves so little more, is meant.
_QUARTER, _NEAR, _ALIKE = 90.0, 3.0, 1.02
# Orientations of each layout that are refined.
_REFINED = 2
# Another is told apart where it leaves more by this factor, and where this much likelier a fit is
# (-2 log), as if each part were one measurement.
LEAST_RATIO, LEAST_GAIN = 1.2, 9.0
# Light whose radiance varies less than this, relative to its mean, is uniform.
_UNIFORM = 0.05
_EVEN = "the light is uniform"
# With fewer samples nothing is told.
_FEWEST = 40
# What leaves more than this of the photographs explains nothing.
POOR = 0.5


class Known(NamedTuple):
    """What else is known: lights besides the panorama, and the model of the material."""

    others: KnownLight | None = None
    lobe: Parametric | None = None


NOTHING = Known()


class FoundOrientation(NamedTuple):
    """The orientation that explains most, what it leaves, and what comes next.

    ``rivals`` has, for each aspect, what is left by the best orientation in which that is another,
    ``told_apart`` the aspects in which the best is better than these by more than chance.  ``why``
    says why nothing can be told; empty where something is.
    """

    orientation: Orientation
    unexplained: float
    told: Orientation
    told_unexplained: float
    rivals: dict[str, float]
    told_apart: tuple[str, ...]
    why: str

    @property
    def is_even(self) -> bool:
        """Whether it cannot be told by any photographs, because the light is uniform."""
        return self.why == _EVEN

    @property
    def fits(self) -> bool:
        """Whether the light explains the photographs at all."""
        return self.unexplained < POOR

    @property
    def changed(self) -> tuple[str, ...]:
        """The aspects in which it is not as told."""
        pairs = zip(Orientation._fields, self.orientation, self.told, strict=True)
        return tuple(name for name, one, other in pairs if one != other)

    def sentences(self) -> list[str]:
        """Say it in words."""
        if self.why:
            return [f"the environment's layout, mirror and yaw cannot be told, because {self.why}"]
        left = f"{100 * self.unexplained:.2g} % unexplained"
        if not self.fits:
            return [f"no orientation of the environment explains the photographs: {left} at best"]
        least = min(self.rivals[name] for name in self.told_apart)
        how = f" (as told {100 * self.told_unexplained:.2g} %)" if self.changed else ", as told"
        found = [f"{self.orientation.words()}: {left}, next {100 * least:.2g} %{how}"]
        unsure = [name for name in self.rivals if name not in self.told_apart]
        if unsure:
            found.append(f"its {' and '.join(unsure)} cannot be told from another")
        return found


class _Tried(NamedTuple):
    orientation: Orientation
    fit: QuickFit

    @property
    def left(self) -> float:
        return self.fit.unexplained


def find_orientation(
    observations: Observations,
    shape: Shape | None,
    picture: ImageArray,
    told: Orientation,
    known: Known = NOTHING,
) -> FoundOrientation:
    """Find how a panorama is meant, as the light of observations of a shape that is known.

    ``ValueError`` for a picture that is no panorama
    of any layout.
    """
    measured = np.asarray(observations.radiance, float)
    some, _ = stratified_subset(observations, measured, _SAMPLES, 0)
    few, _ = stratified_subset(observations, measured, _FEW_SAMPLES, 0)
    rough = _Search.of(few, shape, (_FEW_DIRECTIONS, _FEW_ROWS), picture, known)
    coarse = rough.every(told)
    fine = _Search.of(some, shape, (_DIRECTIONS, _ROWS), picture, known)
    tried = fine.tried([told])
    for layout in rough.panoramas.layouts:
        own = [one for one in coarse if one.orientation._replace(yaw=0.0) == layout]
        for start in _apart(own)[:_REFINED]:
            found = fine.refined(rough.refined(start, _STEPS[:2]), _STEPS[2:])
            tried.append(fine.quarter(found))
    tried += fine.tried([one.orientation for one in _others(coarse, tried)])
    return _choice(tried, told, parts_of(some), _why(fine, some, tried))


class _Search(NamedTuple):
    """Responses to light from even directions, and the panoramas whose light it may be."""

    responses: Responses
    panoramas: Panoramas

    @classmethod
    def of(
        cls,
        observations: Observations,
        shape: Shape | None,
        sizes: tuple[int, int],
        picture: ImageArray,
        known: Known,
    ) -> "_Search":
        directions = fibonacci_sphere(sizes[0])
        responses = Responses.of(observations, shape, directions, *known)
        return cls(responses, Panoramas.of(picture, sizes[1]))

    def tried(self, orientations: list[Orientation]) -> list[_Tried]:
        if not orientations:
            return []
        directions = self.responses.directions
        radiances = [self.panoramas.radiance(one, directions) for one in orientations]
        fits = self.responses.fits(radiances)
        return [_Tried(one, fit) for one, fit in zip(orientations, fits)]

    def every(self, told: Orientation) -> list[_Tried]:
        """Try all layouts at even yaws from the told one."""
        yaws = told.yaw + np.arange(0, 360, _STEP)
        layouts = self.panoramas.layouts
        return self.tried([layout.turned(float(yaw)) for layout in layouts for yaw in yaws])

    def refined(self, start: _Tried, steps: tuple[float, ...]) -> _Tried:
        """Go down in yaw by smaller and smaller steps."""
        best = self.tried([start.orientation])[0]
        for step in steps:
            for _ in range(8):
                around = [best.orientation.yaw + k * step for k in (-1, 1)]
                sides = self.tried([best.orientation.turned(yaw) for yaw in around])
                better = min(sides, key=lambda one: one.left)
                if better.left >= best.left:
                    break
                best = better
        return best

    def quarter(self, found: _Tried) -> _Tried:
        """Take a quarter turn instead of a yaw that is as good."""
        yaw = found.orientation.yaw
        whole = _QUARTER * round(yaw / _QUARTER)
        if abs(yaw - whole) > _NEAR:
            return found
        even = self.tried([found.orientation.turned(whole)])[0]
        return even if even.left <= _ALIKE * found.left else found


def _apart(tried: list[_Tried]) -> list[_Tried]:
    """Sort by what is left, without those whose yaw is near that of a better one."""
    kept: list[_Tried] = []
    for one in sorted(tried, key=lambda one: one.left):
        if all(one.orientation.off(other.orientation) > _ANOTHER_YAW for other in kept):
            kept.append(one)
    return kept


def _others(coarse: list[_Tried], tried: list[_Tried]) -> list[_Tried]:
    """Find the best of the coarse ones whose yaw is another than that of the best."""
    best = min(tried, key=lambda one: one.left).orientation
    far = [one for one in coarse if one.orientation.off(best) > _ANOTHER_YAW]
    same = [one for one in far if one.orientation[:2] == best[:2]]
    return sorted(same, key=lambda one: one.left)[:1]


def parts_of(observations: Observations) -> Int[np.ndarray, "sample"]:
    """Number parts of the photographs: by photograph, and by the octant of the mirror direction."""
    samples = SurfaceSamples(*(np.asarray(part, float) for part in observations.samples))
    bits = (np.asarray(samples.reflected) > 0) @ np.array([1, 2, 4])
    return np.unique(8 * np.asarray(observations.frame) + bits, return_inverse=True)[1]


def surpasses(one: QuickFit, other: QuickFit, parts: Int[np.ndarray, "sample"]) -> bool:
    """Tell whether a fit leaves less than another by more than chance."""
    if other.unexplained < LEAST_RATIO * one.unexplained:
        return False
    difference = np.bincount(parts, other.squares - one.squares)
    gain = 2 * np.log(other.unexplained / max(one.unexplained, 1e-12))
    alone = difference.max() >= difference.sum()
    return bool(len(difference) * gain > LEAST_GAIN and not alone)


def _why(search: _Search, observations: Observations, tried: list[_Tried]) -> str:
    if observations.count < _FEWEST:
        return f"only {observations.count} pixels show the object"
    if not np.any(np.asarray(observations.radiance) > 0):
        return "the object is black in all photographs"
    image = next(iter(search.panoramas.images.values()))
    brightness = image.mean(axis=-1)
    if np.std(brightness) < _UNIFORM * max(float(np.mean(brightness)), 1e-300):
        return _EVEN
    return ""


def _choice(
    tried: list[_Tried], told: Orientation, parts: Int[np.ndarray, "sample"], why: str
) -> FoundOrientation:
    top = min(tried, key=lambda one: one.left)
    tied = [one for one in tried if not surpasses(top.fit, one.fit, parts)]
    best = min(tied, key=lambda one: (one.orientation.changes(told), one.left))
    rivals, told_apart = {}, []
    for name in Orientation._fields:
        others = [one for one in tried if _differs(one.orientation, best.orientation, name)]
        if not others:
            continue
        rival = min(others, key=lambda one: one.left)
        rivals[name] = rival.left
        if surpasses(best.fit, rival.fit, parts):
            told_apart.append(name)
    if not told_apart and not why:
        why = "others explain the photographs as well"
    if why:
        best, told_apart = tried[0], []
    return FoundOrientation(
        best.orientation, best.left, told, tried[0].left, rivals, tuple(told_apart), why
    )


def _differs(one: Orientation, other: Orientation, name: str) -> bool:
    if name == "yaw":
        return one[:2] == other[:2] and one.off(other) > _ANOTHER_YAW
    return getattr(one, name) != getattr(other, name)
