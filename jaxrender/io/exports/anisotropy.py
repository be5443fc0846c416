"""Brushed surfaces for other programs: widths along and across a tangent, and where that runs.

Our tangents follow the meridian about +Z, turned about the normal.  Other programs have theirs
from texture coordinates, or at every vertex: here both are made of ours.

Mitsuba's ``roughconductor`` masks each direction apart, where ``AnisotropicGGX`` masks both
together: ``SeparatelyMasked`` is what Mitsuba makes of that model.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF, AnisotropicGGX, OpenPBR, TrowbridgeReitz, normalised_fresnel
from jaxrender.brdf.facets import facet_transfer
from jaxrender.brdf.half_vector import are_visible, lifted
from jaxrender.brdf.parameters import matching
from jaxrender.brdf.tangents import in_tangent_frame
from jaxrender.geometry import Components, Mesh, meridian_frames
from jaxrender.shapes import AnyArray, Array, Float


class Brushed(NamedTuple):
    """GGX widths: the larger ``along`` a tangent turned by ``rotation`` radians, ``across`` it."""

    along: float
    across: float
    rotation: float

    @classmethod
    def of(cls, brdf: BRDF) -> "Brushed | None":
        """Read the widths of a BRDF; None where it is isotropic, or of another kind."""
        if isinstance(brdf, AnisotropicGGX):
            along, across = brdf.roughness, brdf.roughness_y
        elif isinstance(brdf, OpenPBR) and not brdf.isotropic:
            along, across = brdf.widths
        else:
            return None
        along, across, turn = (float(one) for one in (along, across, brdf.tangent_rotation))
        if along >= across:
            return cls(along, across, turn)
        return cls(across, along, turn + np.pi / 2)


class SeparatelyMasked(BRDF):
    """``AnisotropicGGX`` with Smith's masking of each direction apart."""

    brdf: AnisotropicGGX

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """The BRDF's own."""
        return self.brdf.amplitudes

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """When the BRDF does, which masks less."""
        return self.brdf.conserves_energy

    @property
    def isotropic(self) -> bool:
        """When the BRDF is."""
        return self.brdf.isotropic

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate the clamped cosine, and the lobe times the clamped cosine."""
        visible, own = are_visible(incoming, outgoing), self.brdf
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        facets = TrowbridgeReitz(
            *(matching(one, incoming.z) for one in (own.roughness, own.roughness_y))
        )
        sides = (in_tangent_frame(side, own.tangent_rotation) for side in (incoming, outgoing))
        lobe, cosine = facet_transfer(facets, "smith-separate", *sides)
        mu = None if own.mu is None else matching(own.mu, cosine)
        lobe = lobe * normalised_fresnel(mu, cosine)
        return jnp.where(visible, incoming.z, 0), jnp.where(visible, lobe, 0)


def tangents(
    normals: Float[np.ndarray, "place 3"], rotation: float
) -> Float[np.ndarray, "place 3"]:
    """Find the unit tangents at unit normals: the meridian southwards, turned by ``rotation``."""
    frames = np.asarray(meridian_frames(np.asarray(normals, float)))
    return np.cos(rotation) * frames[..., 0] + np.sin(rotation) * frames[..., 1]


class BrushedMesh(NamedTuple):
    """A mesh of loose faces, and texture coordinates at its vertices: u runs along tangents."""

    mesh: Mesh
    coordinates: Float[np.ndarray, "vertex 2"]


def brushed_mesh(mesh: Mesh, rotation: float) -> BrushedMesh:
    """Give every face coordinates in the mesh's own units, u along the tangent at its middle."""
    corners = mesh.vertices[mesh.faces]
    normals = mesh.normals[mesh.faces]
    middle = normals.sum(axis=1)
    middle /= np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-20)
    along = tangents(middle, rotation)
    axes = np.stack([along, np.cross(middle, along)], axis=1)
    offset = corners - corners[:, :1]
    coordinates = np.einsum("fki,fai->fka", offset, axes).reshape(-1, 2)
    faces = np.arange(3 * len(mesh.faces)).reshape(-1, 3)
    return BrushedMesh(Mesh(corners.reshape(-1, 3), faces, normals.reshape(-1, 3)), coordinates)


def brushed_plugin(brdf: AnisotropicGGX) -> dict[str, Any]:
    """Describe the model by Mitsuba's plugins: half is diffuse of twice K_d, half is the lobe.

    Mitsuba's Fresnel reflectance is not over that head-on, so K_s is.  Colours are arrays, which
    may be above one.
    """
    ks = np.asarray(brdf.ks, float)
    lobe: dict[str, Any] = {
        "type": "roughconductor",
        "distribution": "ggx",
        "alpha_u": float(brdf.roughness),
        "alpha_v": float(brdf.roughness_y),
    }
    if brdf.mu is None:
        lobe["material"] = "none"
    else:
        mu = float(brdf.mu)
        ks = ks * ((mu + 1) / (mu - 1)) ** 2
        lobe |= {"eta": mu, "k": 0.0}
    lobe["specular_reflectance"] = 2 * ks
    diffuse = {"type": "diffuse", "reflectance": 2 * np.pi * np.asarray(brdf.kd, float)}
    return {"type": "blendbsdf", "weight": 0.5, "bsdf_0": diffuse, "bsdf_1": lobe}
