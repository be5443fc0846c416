"""Light that bounces between parts of a diffuse concave object, as often as it likes.

Of what a place does not see of the light it sees the object, whose radiance there is kd E:

    E(x) = E_0(x) + albedo / pi int (1 - V(x, w)) E(y(x, w)) max(n.w, 0) dw

with y the first point that the ray meets.  E is kept at a mesh's vertices and interpolated over its
faces, so the integral is one sparse matrix G, a mean over cosine-distributed rays, and

    E = E_0 + albedo G E

is solved by following the bounces, each of which is weaker by albedo times what is hidden.  In the
inside of a sphere, of which a part f of the whole sphere is there, G is f times the mean, so that
mean E = mean E_0 / (1 - albedo f).  Host side; ``indirect`` has the gloss.
"""

from typing import NamedTuple

import numpy as np
from scipy import sparse

from jaxrender.geometry import Mesh, SurfacePlaces, world_from_local
from jaxrender.shapes import AnyArray, Float, Int

# Rays start this far above the surface, as part of the diagonal.
_ABOVE = 1e-4
# Places whose rays are traced at once.
_RAYS_AT_ONCE = 2**20
# Bounces are followed until they add less than this part; a white sphere closed all around has
# no end, and stops here.
_SETTLED, _MOST_BOUNCES = 1e-6, 500
_GOLDEN = np.pi * (3 - np.sqrt(5))


class Met(NamedTuple):
    """Rays of places that meet the front of the object: whose, which of its rays, and where."""

    place: Int[np.ndarray, "met"]
    ray: Int[np.ndarray, "met"]
    face: Int[np.ndarray, "met"]
    barycentric: Float[np.ndarray, "met 3"]

    def mean(self, places: int, rays: int, mesh: Mesh) -> sparse.csr_matrix:
        """Make the matrix from a field at the vertices to its mean over each place's rays."""
        rows = np.repeat(self.place, 3)
        columns, values = mesh.faces[self.face].ravel(), self.barycentric.ravel() / rays
        return sparse.csr_matrix((values, (rows, columns)), (places, len(mesh.vertices)))


class Interreflection(NamedTuple):
    """What the vertices of a mesh see of each other."""

    mesh: Mesh
    among_vertices: sparse.csr_matrix
    rays: int
    seed: int

    @classmethod
    def of(cls, mesh: Mesh, rays: int = 256, seed: int = 0) -> "Interreflection":
        """Trace from every vertex.  Raises ``ValueError`` for less than one ray."""
        if rays < 1:
            raise ValueError(f"rays is {rays}: give at least one, 256 for a per cent of the bounce")
        places = SurfacePlaces.of_vertices(mesh)
        return cls(mesh, gathering(mesh, places, mesh.normals, rays, seed), rays, seed)

    def gathering(
        self, places: SurfacePlaces, normals: Float[AnyArray, "place 3"]
    ) -> sparse.csr_matrix:
        """Trace what other places see of the vertices."""
        return gathering(self.mesh, places, np.asarray(normals, float), self.rays, self.seed)

    def total(
        self,
        direct: Float[np.ndarray, "vertex channel"],
        albedo: Float[np.ndarray, "channel"],
    ) -> Float[np.ndarray, "vertex channel"]:
        """Add all bounces to the direct irradiance at the vertices.

        Raises ``ValueError`` for an albedo outside [0, 1].
        """
        albedo = np.asarray(albedo, float)
        if not np.all((albedo >= 0) & (albedo <= 1)):
            raise ValueError(f"albedo is {albedo}: light grows with every bounce; give 0 to 1")
        total = bounce = np.asarray(direct, float)
        for _ in range(_MOST_BOUNCES):
            bounce = albedo * (self.among_vertices @ bounce)
            total = total + bounce
            if np.max(bounce) <= _SETTLED * max(float(np.max(total)), 1e-300):
                break
        return total


def gathering(
    mesh: Mesh,
    places: SurfacePlaces,
    normals: Float[np.ndarray, "place 3"],
    rays: int,
    seed: int,
) -> sparse.csr_matrix:
    """Trace G: the mean of a field over what cosine-distributed rays of each place meet.

    Rays that miss, or meet the surface from behind, bring nothing.  Every place has the same
    rays, turned about its normal by an angle of its own.
    """
    turns = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(normals))
    step = max(1, _RAYS_AT_ONCE // rays)
    parts = []
    for first in range(0, len(normals), step):
        part = slice(first, first + step)
        some = SurfacePlaces(*(np.asarray(field, float)[part] for field in places))
        towards = cosine_rays(np.asarray(normals, float)[part], turns[part], rays)
        parts.append(met_along(mesh, some, towards).mean(len(towards), rays, mesh))
    return sparse.csr_matrix(sparse.vstack(parts))


def met_along(
    mesh: Mesh, places: SurfacePlaces, directions: Float[np.ndarray, "place ray 3"]
) -> Met:
    """Trace the rays of some places; they come place by place."""
    geometric = places.geometric_normals
    origins = places.points + _ABOVE * mesh.diagonal() * geometric
    above = np.einsum("pri,pi->pr", directions, geometric) > 0
    place, ray = np.nonzero(above)
    hits = mesh.first_hits(origins[place], directions[place, ray])
    facing = np.einsum("ri,ri->r", hits.geometric_normals, directions[place, ray]) < 0
    met = hits.hit & facing
    return Met(place[met], ray[met], hits.face[met], hits.barycentric[met])


def cosine_rays(
    normals: Float[np.ndarray, "place 3"], turns: Float[np.ndarray, "place"], rays: int
) -> Float[np.ndarray, "place ray 3"]:
    """Spread directions evenly over the unit disc and lift them to the hemisphere."""
    index = np.arange(rays)
    radius = np.sqrt((index + 0.5) / rays)
    azimuth = index * _GOLDEN + turns[:, None]
    height = np.broadcast_to(np.sqrt(1 - radius**2), azimuth.shape)
    local = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=-1)
    frames = np.asarray(world_from_local(normals))
    return np.einsum("pij,prj->pri", frames, local)
