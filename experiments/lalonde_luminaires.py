"""The three luminaires of L fig. 5.1, rebuilt: a shade of spheres, a fluorescent lamp, a room.

L gives no dimensions.  They are traced with direct light only, from point samples of the emitters,
and measured through a window (the lamp below its shade and the fluorescent one below its baffles
shine downwards; the room is seen through its open side).
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.geometry import Mesh, Pinhole, Shape, Sphere, look_at
from jaxrender.lighting.luminaires.luminaire import Luminaire
from jaxrender.lighting.luminaires.measured import compressed, measure_light_field
from jaxrender.lighting.luminaires.surfaces import EmittingSurface, Rectangle, box_faces
from jaxrender.wavelets import Wavelet

OUT = Path(__file__).parent / "out"
# Rays traced at once.
CHUNK = 1 << 16

Factor = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class Thing(NamedTuple):
    """A shape, its albedo, what it emits, and a factor on its BRDF."""

    shape: Shape
    albedo: np.ndarray
    emitted: np.ndarray
    factor: Factor | None = None


class Model(NamedTuple):
    """Things, the point samples of their emitters, and the boundary to measure on."""

    things: list[Thing]
    lights: np.ndarray
    """[light, 6]: position, and the normal of the emitting element (zero: all around)."""
    intensity: np.ndarray
    ambient: float
    patches: tuple[EmittingSurface, ...]
    eye: tuple[np.ndarray, np.ndarray, float]
    """Where the picture is taken from, at what, and the field of view in degrees."""

    def radiance(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """What is seen along rays: emitted, or reflected once."""
        parts = [slice(i, i + CHUNK) for i in range(0, len(origins), CHUNK)]
        return np.concatenate([self._radiance(origins[p], directions[p]) for p in parts])

    def _radiance(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        nearest = np.full(len(origins), np.inf)
        total = np.zeros((len(origins), 3))
        which = np.full(len(origins), -1)
        points, normals = np.zeros((2, len(origins), 3))
        for index, thing in enumerate(self.things):
            hits = thing.shape.first_hits(origins, directions)
            row = np.flatnonzero(hits.distance < nearest)
            nearest[row], which[row] = hits.distance[row], index
            points[row], normals[row] = hits.points[row], hits.geometric_normals[row]
        back = np.einsum("ri,ri->r", normals, directions) > 0
        normals[back] *= -1
        for index, thing in enumerate(self.things):
            row = np.flatnonzero(which == index)
            if thing.emitted.any():
                total[row] = thing.emitted
            elif len(row):
                total[row] = self._reflected(thing, points[row], normals[row], directions[row])
        return total

    def _reflected(
        self, thing: Thing, points: np.ndarray, normals: np.ndarray, directions: np.ndarray
    ) -> np.ndarray:
        total = np.full(len(points), self.ambient)
        origins = points + 1e-4 * normals
        blockers = [t.shape for t in self.things if not t.emitted.any()]
        for position, facing, strength in zip(
            self.lights[:, :3], self.lights[:, 3:], self.intensity
        ):
            towards = position - origins
            distance = np.linalg.norm(towards, axis=1)
            towards /= distance[:, None]
            cosine = np.maximum(np.einsum("pi,pi->p", normals, towards), 0)
            sent = np.maximum(-towards @ facing, 0) if facing.any() else 1.0
            value = strength * sent * cosine / np.maximum(distance, 0.05) ** 2
            if thing.factor is not None:
                value = value * thing.factor(normals, towards, -directions)
            row = np.flatnonzero(value > 0)
            for blocker in blockers:
                met = blocker.first_hits(origins[row], towards[row]).distance
                row = row[met > distance[row] - 1e-3]
                if not len(row):
                    break
            total[row] += value[row] / np.pi
        return total[:, None] * thing.albedo


def fluorescent() -> Model:
    """Two tubes above a grid of baffles in a housing; light leaves through a window below."""
    white, dark = np.full(3, 0.8), np.zeros(3)
    tubes = [box_mesh([-0.9, y - 0.04, 0.26], [0.9, y + 0.04, 0.34]) for y in (-0.25, 0.25)]
    sheets = [quad([x, -0.5, 0], [0, 1, 0], [0, 0, 0.15]) for x in np.linspace(-1, 1, 9)]
    sheets += [quad([-1, y, 0], [2, 0, 0], [0, 0, 0.15]) for y in (-0.5, 0.0, 0.5)]
    housing = [quad([-1, -0.5, 0.4], [2, 0, 0], [0, 1, 0])]
    housing += [quad([x, -0.5, 0.15], [0, 1, 0], [0, 0, 0.25]) for x in (-1.0, 1.0)]
    housing += [quad([-1, y, 0.15], [2, 0, 0], [0, 0, 0.25]) for y in (-0.5, 0.5)]
    things = [Thing(joined(tubes), white, np.full(3, 4.0))]
    things += [Thing(joined(sheets), np.full(3, 0.6), dark), Thing(joined(housing), white, dark)]
    along = np.linspace(-0.85, 0.85, 7)
    lights = np.array([[x, y, 0.3, 0, 0, 0] for y in (-0.25, 0.25) for x in along])
    # Their intensity is that of a face of .08 x 1.8 and radiance 4, shared by seven.
    window = Rectangle(np.array([-1, -0.5, -1e-3]), np.array([0, 1.0, 0]), np.array([2.0, 0, 0]))
    eye = np.array([0.8, -1.0, -1.9]), np.array([0.0, 0, 0.0]), 58.0
    return Model(things, lights, np.full(len(lights), 4 * 0.08 * 1.8 / 7), 0.02, (window,), eye)


def sphere_lamp() -> Model:
    """A bright ball inside a dome of small ones, in a bounding box."""
    count = 60
    height = 1 - 1.5 * (np.arange(count) + 0.5) / count
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    sine = np.sqrt(1 - height**2)
    centers = 0.42 * np.stack([sine * np.cos(turn), sine * np.sin(turn), height], axis=-1)
    shade = joined([Mesh.icosphere(3, 0.072, c) for c in centers])
    bulb = Thing(Sphere(np.zeros(3), 0.12), np.ones(3), np.array([12.0, 11.0, 9.0]))
    things = [bulb, Thing(shade, np.array([0.75, 0.7, 0.55]), np.zeros(3))]
    lights = np.array([[0.0, 0, 0, 0, 0, 0]])
    patches = box_faces(np.full(3, -0.5), np.full(3, 0.5))
    eye = np.array([0.5, -0.9, -1.7]), np.zeros(3), 38.0
    return Model(things, lights, np.array([11 * np.pi * 0.12**2]), 0.02, patches, eye)


def sawtooth(normals: np.ndarray, towards: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
    """A BRDF of rings about the mirror direction, rising and falling sharply."""
    mirrored = 2 * np.einsum("pi,pi->p", normals, outgoing)[:, None] * normals - outgoing
    angle = np.arccos(np.clip(np.einsum("pi,pi->p", mirrored, towards), -1, 1))
    return 0.3 + 2.5 * (1 - (angle / 0.5) % 1) * (angle < 1.5)


def room() -> Model:
    """A red and a blue wall, a green floor, and a ball of sawtooth BRDF, seen from the front."""

    def wall(corner, u, v, albedo):
        return Thing(quad(corner, u, v), np.array(albedo), np.zeros(3))

    things = [
        wall([-1, -1, -1], [0, 2, 0], [0, 0, 2], [0.7, 0.1, 0.1]),
        wall([1, -1, -1], [0, 2, 0], [0, 0, 2], [0.1, 0.1, 0.7]),
        wall([-1, -1, -1], [2, 0, 0], [0, 2, 0], [0.1, 0.6, 0.1]),
        wall([-1, 1, -1], [2, 0, 0], [0, 0, 2], [0.6, 0.6, 0.6]),
        wall([-1, -1, 1], [2, 0, 0], [0, 2, 0], [0.6, 0.6, 0.6]),
        Thing(Sphere(np.array([0.1, 0.1, -0.5]), 0.5), np.full(3, 0.6), np.zeros(3), sawtooth),
    ]
    lights = np.array([[x, -0.3, 0.95, 0, 0, -1.0] for x in (-0.4, 0.4)])
    window = Rectangle(np.array([-1, -1.0, -1]), np.array([2.0, 0, 0]), np.array([0, 0, 2.0]))
    eye = np.array([0.6, -3.6, 0.4]), np.array([0.0, 0, 0]), 46.0
    return Model(things, lights, np.full(2, 6.0), 0.05, (window,), eye)


MODELS = {"sphere lamp": sphere_lamp, "fluorescent": fluorescent, "room": room}


def measured(name: str, size: int) -> list[np.ndarray]:
    """Samples of each patch, kept in the folder of results."""
    path = OUT / f"lalonde_{name.replace(' ', '_')}_{size}.npz"
    if path.exists():
        with np.load(path) as held:
            return [held[key] for key in held]
    model = MODELS[name]()
    samples = [measure_light_field(model.radiance, patch, size) for patch in model.patches]
    OUT.mkdir(exist_ok=True)
    np.savez(path, *samples)
    return samples


def luminaire(
    name: str, samples: list[np.ndarray], keep: float = 1.0, wavelet: Wavelet | None = None
) -> Luminaire:
    """Put the trees of its samples on the boundary of a model; Haar's by default."""
    patches = MODELS[name]().patches
    return Luminaire(patches, [compressed(s, keep, wavelet) for s in samples], convex=True)


def view(model: Model, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions of the rays of a square picture."""
    eye, target, angle = model.eye
    focal = width / 2 / np.tan(np.radians(angle / 2))
    rays = Pinhole(width, width, look_at(eye, target, np.array([0, 0, 1.0])), fl_x=focal).rays()
    return rays.origins.reshape(-1, 3).copy(), rays.directions.reshape(-1, 3).copy()


def shown(radiance: np.ndarray, width: int) -> np.ndarray:
    return np.clip(np.asarray(radiance).reshape(width, -1, 3), 0, 1) ** (1 / 2.2)


def quad(corner, along_u, along_v) -> Mesh:
    corner, u, v = (np.array(a, float) for a in (corner, along_u, along_v))
    return Mesh(
        np.stack([corner, corner + u, corner + u + v, corner + v]), np.array([[0, 1, 2], [0, 2, 3]])
    )


def box_mesh(lower, upper) -> Mesh:
    faces = box_faces(np.array(lower, float), np.array(upper, float))
    return joined([quad(f.corner, f.along_u, f.along_v) for f in faces])


def joined(meshes: list[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + start for m, start in zip(meshes, starts)]),
    )
