"""Scale, turn and shift of a mesh, by the silhouettes of its photographs.

Of each turn the boxes around the silhouettes give scale and shift; those that overlap best are
refined by least squares of the distances between the mesh's rim and the masks' outlines.  Nothing
is found where the best overlaps little, or where two turns overlap alike: such a mesh is symmetric,
or its silhouettes are.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from jaxrender.geometry import Camera, Mesh, Placement, axis_turns, random_rotations
from jaxrender.inverse.alignment.rims import Edges, Rim, looked_up, signed_distance, traced_outline
from jaxrender.inverse.conventions.framing_search import surface_points, surpasses
from jaxrender.inverse.conventions.silhouettes import Silhouettes
from jaxrender.shapes import Float

# Pixels along the longest side while turns are tried, and while the best are refined.
_COARSE, _MIDDLE, _FINE = 40, 80, 192
_PHOTOGRAPHS = 16
_POINTS = 200
# Turns that are tried where none of the 24 along the axes will do, and how many are refined.
_TURNS, _REFINED = 300, 4
# A turn along the axes that overlaps so much after a refinement needs no others.
_GOOD, POOR = 0.9, 0.8
_ROUNDS, _LAST_ROUNDS, _SETTLED, _TRIALS = 3, 4, 3e-5, 6
# A mask may be wider all around than the object by so many pixels.
_SYSTEMATIC, _FEWEST = 0.05, 20
# Poses whose turns differ by less than this many degrees are one.
_SAME = 3.0
# A turn that is known no better than this, in degrees, is not known.
_UNKNOWN = 5.0


class Alignment(NamedTuple):
    """Where a mesh lies, with standard errors: of the turn in degrees, of the scale relative to
    it, of the shift in world units.

    ``why`` says why nothing was found; it is empty where something was.
    """

    placement: Placement
    overlap: float
    turn_error: float
    scale_error: float
    shift_error: float
    why: str = ""

    @property
    def found(self) -> bool:
        """Whether one pose, and no other, fits."""
        return not self.why

    def sentence(self) -> str:
        """Say it in words."""
        if self.why:
            return f"the mesh's place was not found: {self.why}"
        scale, shift = self.placement.scale, self.placement.translation
        return (
            f"the mesh lies at scale {scale:.4g} (+- {100 * self.scale_error:.1g} %), turned by "
            f"{_listed(self.placement.degrees)} degrees (+- {self.turn_error:.1g}), shifted by "
            f"{_listed(shift)} (+- {self.shift_error:.1g}): overlap {self.overlap:.2f}"
        )


class _Pose(NamedTuple):
    placement: Placement
    overlaps: Float[np.ndarray, "photograph"]
    covariance: Float[np.ndarray, "7 7"]


def align(mesh: Mesh, silhouettes: Silhouettes) -> Alignment:
    """Find where a mesh lies, whose cameras are known.  ``ValueError`` without silhouettes."""
    if not silhouettes.names:
        raise ValueError("no photograph shows a silhouette: give masks")
    seen = silhouettes.some(_PHOTOGRAPHS)
    search = _Search(mesh, Edges.of(mesh), *(seen.shrunk(n) for n in (_COARSE, _MIDDLE, _FINE)))
    poses = search.refined(axis_turns())
    if poses[0].overlaps.mean() < _GOOD:
        poses = sorted(poses + search.refined(list(random_rotations(_TURNS, 0))), key=_worse)
    best, middle = search.last(poses[0]), poses[0].overlaps
    poses = [best, *poses[1:]]
    turn, scale, shift = np.split(np.sqrt(np.maximum(np.diag(best.covariance), 0)), [3, 4])
    overlap = float(best.overlaps.mean())
    blur = _SYSTEMATIC / search.pixels
    errors = (
        float(np.degrees(np.hypot(np.linalg.norm(turn), blur))),
        float(np.hypot(scale[0], blur)),
        float(np.hypot(np.linalg.norm(shift), blur * best.placement.scale * mesh.diagonal())),
    )
    return Alignment(best.placement, overlap, *errors, _why(poses, middle, errors[0]))


def _why(poses: list[_Pose], overlaps: Float[np.ndarray, "photograph"], turn_error: float) -> str:
    best = poses[0]
    if best.overlaps.mean() < POOR:
        return f"the silhouettes overlap by {best.overlaps.mean():.2f} at best"
    if turn_error > _UNKNOWN:
        values, vectors = np.linalg.eigh(best.covariance[:3, :3])
        axis = _listed(vectors[:, int(np.argmax(values))])
        return f"its silhouettes stay the same as it turns about {axis}"
    for other in poses[1:]:
        between = Rotation.from_matrix(other.placement.rotation @ best.placement.rotation.T)
        angle = np.degrees(between.magnitude())
        if angle > _SAME and not surpasses(overlaps, other.overlaps):
            axis = _listed(between.as_rotvec() / between.magnitude())
            return f"it fits as well when it is turned by {angle:.0f} degrees about {axis}"
    return ""


def _worse(pose: _Pose) -> float:
    return -float(pose.overlaps.mean())


def _listed(vector: Float[np.ndarray, "3"]) -> str:
    return f"[{', '.join(f'{x:.4g}' for x in np.round(vector, 6) + 0.0)}]"


class _Search(NamedTuple):
    mesh: Mesh
    edges: Edges
    coarse: Silhouettes
    middle: Silhouettes
    fine: Silhouettes

    @property
    def pixels(self) -> float:
        """The mean radius of the silhouettes, in pixels."""
        return float(np.mean([np.sqrt(np.count_nonzero(mask) / np.pi) for mask in self.fine.masks]))

    def refined(self, turns: list[Float[np.ndarray, "3 3"]]) -> list[_Pose]:
        """Refine the best of some turns; the best first, each pose once."""
        points = surface_points(self.mesh, _POINTS)
        starts = [_by_boxes(points, self.coarse, turn) for turn in turns]
        overlaps = [self.coarse.overlaps(self.mesh, start).mean() for start in starts]
        order = np.argsort(-np.array(overlaps), kind="stable")[:_REFINED]
        poses = [self._settled(starts[int(k)], self.middle, _ROUNDS) for k in order]
        return sorted(poses, key=_worse)

    def last(self, pose: _Pose) -> _Pose:
        """Refine a pose by all pixels."""
        return self._settled(pose.placement, self.fine, _LAST_ROUNDS)

    def _settled(self, placement: Placement, seen: Silhouettes, rounds: int) -> _Pose:
        """Find rims and move the mesh in turn, until it moves no more."""
        distances = [signed_distance(mask) for mask in seen.masks]
        middle = np.asarray(self.mesh.bounds()).mean(axis=0)
        covariance = np.full((7, 7), np.inf)
        for _ in range(rounds):
            cameras = seen.cameras
            rims = [
                self.edges.rim(c, placement, traced_outline(c, self.mesh, placement))
                for c in cameras
            ]
            if sum(len(rim.points) for rim in rims) < _FEWEST:
                break
            step = _Step(placement, middle, cameras, distances, rims)
            start = np.zeros(7)
            solved = least_squares(step.residuals, start, loss="soft_l1", max_nfev=_TRIALS)
            placement, covariance = step.moved(solved.x), step.covariance(solved)
            if np.abs(solved.x).max() < _SETTLED:
                break
        return _Pose(placement, seen.overlaps(self.mesh, placement), covariance)


class _Step(NamedTuple):
    """How far the rim of a mesh is from the masks' outlines as the mesh moves about its middle.

    Seven numbers: a rotation vector, the logarithm of the scale, and a shift in sizes of the mesh.
    """

    start: Placement
    middle: Float[np.ndarray, "3"]
    cameras: tuple[Camera, ...]
    distances: list[np.ndarray]
    rims: list[Rim]

    @property
    def size(self) -> float:
        """A length of the object in the world."""
        every = np.concatenate([rim.points for rim in self.rims])
        return self.start.scale * float(np.linalg.norm(np.ptp(every, axis=0)))

    def moved(self, by: Float[np.ndarray, "7"]) -> Placement:
        """Where the mesh is after a movement."""
        turn = Rotation.from_rotvec(by[:3]).as_matrix() @ self.start.rotation
        u, _, v = np.linalg.svd(turn)
        scale = self.start.scale * float(np.exp(np.clip(by[3], -3, 3)))
        here = self.start.points(self.middle[None])[0] + self.size * by[4:]
        return Placement(scale, u @ v, here - scale * (u @ v) @ self.middle)

    def residuals(self, by: Float[np.ndarray, "7"]) -> Float[np.ndarray, "point"]:
        """How far the mesh's outline is from the masks', in pixels, of all photographs.

        Both are outlines of pixels, so that what pixels do to an outline cancels.
        """
        placement = self.moved(by)
        parts = zip(self.cameras, self.distances, self.rims)
        return np.concatenate(
            [
                looked_up(image, c.project(placement.points(rim.points))) - rim.inside
                for c, image, rim in parts
            ]
        )

    def covariance(self, solved) -> Float[np.ndarray, "7 7"]:
        """Of the seven numbers, the shift in world units: neighbours within a pixel err alike."""
        count = len(solved.fun)
        outline = sum(float(np.count_nonzero(np.abs(d) < 0.75)) / 1.5 for d in self.distances)
        variance = float(np.sum(solved.fun**2)) / max(count - 7, 1) * max(1.0, count / outline)
        # What the photographs say nothing of is infinitely uncertain, not singular.
        normal = solved.jac.T @ solved.jac + 1e-9 * np.eye(7)
        scale = np.array([1, 1, 1, 1, *[self.size] * 3])
        return variance * np.linalg.inv(normal) * scale[:, None] * scale


def _by_boxes(
    points: Float[np.ndarray, "point 3"], seen: Silhouettes, turn: Float[np.ndarray, "3 3"]
) -> Placement:
    """Find scale and shift of a turned mesh whose boxes are those of the silhouettes."""
    boxes = [_box(mask) for mask in seen.masks]
    centre = _meeting_point(seen, [box.mean(axis=0) for box in boxes])
    middle = turn @ points.mean(axis=0)
    radius = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
    # Small enough to be in front of every camera.
    nearest = min(float(np.linalg.norm(c.position - centre)) for c in seen.cameras)
    scale = 0.2 * nearest / radius
    shift = centre - scale * middle
    for _ in range(6):
        placed = Placement(scale, turn, shift)
        ratios, rays = [], []
        for camera, box in zip(seen.cameras, boxes):
            places = camera.project(placed.points(points))
            own = np.stack([np.nanmin(places, axis=0), np.nanmax(places, axis=0)])
            ratios.append(np.prod(np.ptp(box, axis=0) / np.maximum(np.ptp(own, axis=0), 1e-9)))
            rays.append(box.mean(axis=0) - own.mean(axis=0))
        here = placed.points(points.mean(axis=0)[None])[0]
        wanted = [c.project(here[None])[0] + off for c, off in zip(seen.cameras, rays)]
        if not (np.isfinite(ratios).all() and np.isfinite(wanted).all()):
            break
        scale *= float(np.clip(np.sqrt(np.median(ratios)), 0.3, 3))
        shift = _meeting_point(seen, wanted) - scale * middle
    return Placement(scale, turn, shift)


def _box(mask: np.ndarray) -> Float[np.ndarray, "2 2"]:
    """The lower and the upper corner (x, y) of a silhouette."""
    rows, columns = np.nonzero(mask)
    low, high = [columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]
    return np.array([low, high], float)


def _meeting_point(
    seen: Silhouettes, places: list[Float[np.ndarray, "2"]]
) -> Float[np.ndarray, "3"]:
    """Find the point nearest to the rays through a place (x, y) of each photograph."""
    matrix, right = np.zeros((3, 3)), np.zeros(3)
    for camera, place in zip(seen.cameras, places):
        rays = camera.rays()
        row, column = (
            int(np.clip(place[k] - 0.5, 0, n - 1).round())
            for k, n in ((1, camera.height), (0, camera.width))
        )
        origin, direction = rays.origins[row, column], rays.directions[row, column]
        across = np.eye(3) - np.outer(direction, direction)
        matrix, right = matrix + across, right + across @ origin
    # Of one photograph the depth is not known: take the point nearest to the origin.
    return np.linalg.lstsq(matrix + 1e-9 * np.eye(3), right, rcond=None)[0]
