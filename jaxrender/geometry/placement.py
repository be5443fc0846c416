"""Where an object lies: world = scale R p + t for points p of its file.  Host side, NumPy."""

import itertools

import equinox as eqx
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxrender.geometry.mesh import Mesh
from jaxrender.shapes import AnyArray, checked


class Placement(eqx.Module):
    """A similarity: ``rotation`` is world_from_mesh, ``translation`` in world units."""

    scale: float
    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]

    def __init__(
        self,
        scale: float = 1.0,
        rotation: Float[AnyArray, "3 3"] | None = None,
        translation: Float[AnyArray, "3"] | None = None,
    ):
        """Raises ``ValueError`` for a scale that is not positive, and for what is no rotation."""
        self.scale = float(scale)
        self.rotation = np.eye(3) if rotation is None else np.array(rotation, float)
        self.translation = np.zeros(3) if translation is None else np.array(translation, float)
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise ValueError(f"the scale is {scale}: it must be positive and finite")
        off = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
        if not off < 1e-6 or np.linalg.det(self.rotation) < 0:
            raise ValueError(f"world_from_mesh is {self.rotation.tolist()}: give a rotation")

    @classmethod
    @checked
    def of_degrees(
        cls,
        scale: float = 1.0,
        rotation: Float[AnyArray, "3"] | None = None,
        translation: Float[AnyArray, "3"] | None = None,
    ) -> "Placement":
        """Take a rotation vector: its direction is the axis, its length the angle in degrees."""
        vector = np.zeros(3) if rotation is None else np.asarray(rotation, float)
        return cls(scale, Rotation.from_rotvec(vector, degrees=True).as_matrix(), translation)

    @property
    def degrees(self) -> Float[np.ndarray, "3"]:
        """The rotation vector, in degrees."""
        return Rotation.from_matrix(self.rotation).as_rotvec(degrees=True)

    @checked
    def points(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 3"]:
        """Place points of the file in the world."""
        return self.scale * points @ self.rotation.T + self.translation

    def after(self, first: "Placement") -> "Placement":
        """Compose: place what ``first`` has placed."""
        return Placement(
            self.scale * first.scale,
            self.rotation @ first.rotation,
            self.points(first.translation[None])[0],
        )

    @property
    def inverse(self) -> "Placement":
        """Undo it."""
        turn = self.rotation.T
        return Placement(1 / self.scale, turn, -turn @ self.translation / self.scale)

    def mesh(self, mesh: Mesh) -> Mesh:
        """Place a mesh, with its normals and texture coordinates."""
        return Mesh(
            self.points(mesh.vertices),
            mesh.faces,
            mesh.normals @ self.rotation.T,
            mesh.texture_coordinates,
        )


def axis_turns() -> list[Float[np.ndarray, "3 3"]]:
    """List the 24 rotations that take axes to axes, the one that changes nothing first."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.eye(3)[:, order] * np.array(signs)
            if np.linalg.det(turn) > 0:
                found.append(turn)
    return found
