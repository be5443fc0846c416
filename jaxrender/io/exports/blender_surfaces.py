"""Materials as Blender's shader nodes: a sum of shaders, each with a weight.

GGX and Beckmann facets with joint masking over a diffuse base are a sum of Blender's own nodes: the
Diffuse BSDF of colour pi kd, and

- of a metal (F = 1) the Glossy BSDF of colour ks;
- with F at the exit angle the same times Fresnel's node, which knows the viewer's direction alone;
- with F at the half angle a Principled BSDF of black base, which is F(mu) S, taken ks / F(mu, 0)
  times: GGX of a grey ks alone.

All else is one Principled BSDF (``blender_material`` says what Blender makes of it).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, AnisotropicGGX, Lambertian, Microfacet, head_on_reflectance
from jaxrender.geometry import Shape
from jaxrender.io.exports.contents import MaterialMaps
from jaxrender.io.exports.gltf import GltfTextures
from jaxrender.io.exports.gltf_material import GltfMaterial
from jaxrender.io.exports.texel_frames import in_frames, texel_frames
from jaxrender.shapes import AnyArray, Float

_DIFFUSE, _GLOSSY = "ShaderNodeBsdfDiffuse", "ShaderNodeBsdfGlossy"
_PRINCIPLED = "ShaderNodeBsdfPrincipled"
# Blender's anisotropy a of a Principled BSDF makes sqrt(1 - .9 a) of the ratio of the widths.
_MOST_ANISOTROPY, _LEAST_RATIO = 0.9, 0.1
# Channels so near to one another are grey.
_GREY = 1e-6
_NO_FACETS = 1e-12


class Shader(NamedTuple):
    """A shader node: values by its sockets' names, and how many times it is taken.

    ``pictures`` take the place of values; that of "Weight" multiplies the weight, that of "Normal"
    has unit normals in the object's axes.  ``fresnel``: the colour is multiplied by the reflectance
    of this index at the exit angle.
    """

    node: str
    inputs: dict[str, Any]
    distribution: str | None = None
    weight: float = 1.0
    fresnel: float | None = None
    pictures: dict[str, Float[np.ndarray, "row column *channel"]] = {}  # noqa: RUF012


class Surface(NamedTuple):
    """A sum of shaders; tangents are the meridians, turned by ``turn`` radians."""

    shaders: tuple[Shader, ...]
    turn: float | None = None

    @property
    def is_textured(self) -> bool:
        """Whether any socket has a picture."""
        return any(one.pictures for one in self.shaders)


class _Facets(NamedTuple):
    """A diffuse base under facets of the larger width ``along`` the tangent."""

    kd: Float[np.ndarray, "3"]
    ks: Float[np.ndarray, "3"]
    along: float
    across: float
    mu: float | None
    at_exit: bool = False
    distribution: str = "GGX"
    turn: float | None = None


def own_surface(brdf: BRDF) -> Surface | None:
    """Make the nodes that are a BRDF of three channels exactly; None where there are none."""
    found = _facets(brdf)
    if found is None or np.any(found.kd < 0) or np.any(found.ks < 0):
        return None
    diffuse = Shader(_DIFFUSE, {"Color": _colour(np.pi * found.kd), "Roughness": 0.0})
    if np.all(found.ks <= _NO_FACETS):
        return Surface((diffuse,))
    mean, ratio = math.sqrt(found.along * found.across), found.across / found.along
    inputs: dict[str, Any] = {"Roughness": math.sqrt(mean)}
    if found.mu is None or found.at_exit:
        # Blender's widths of a Glossy BSDF are the mean over 1 + a and times it.
        inputs["Anisotropy"] = math.sqrt(ratio) - 1
        ks = found.ks
        if found.mu is not None:
            ks = ks / float(head_on_reflectance(found.mu))
        inputs["Color"] = _colour(ks)
        lobe = Shader(_GLOSSY, inputs, found.distribution, fresnel=found.mu)
    else:
        is_grey = np.ptp(found.ks) <= _GREY * np.max(found.ks)
        if not is_grey or found.distribution != "GGX" or ratio < _LEAST_RATIO:
            return None
        inputs |= {"Base Color": _colour(np.zeros(3)), "IOR": found.mu}
        inputs["Anisotropic"] = (1 - ratio) / _MOST_ANISOTROPY
        weight = float(np.mean(found.ks)) / float(head_on_reflectance(found.mu))
        lobe = Shader(_PRINCIPLED, inputs, "GGX", weight)
    return Surface((diffuse, lobe), found.turn)


def own_textured(maps: MaterialMaps) -> Surface | None:
    """Make the nodes that are the material of every texel exactly; None where there are none."""
    found = own_surface(maps.mean)
    if found is None or np.min(maps.kd) < 0 or np.min(maps.ks) < 0:
        return None
    diffuse = found.shaders[0]._replace(pictures={"Color": np.pi * maps.kd})
    if len(found.shaders) == 1:
        return Surface((diffuse,))
    lobe = found.shaders[1]
    ks = np.broadcast_to(maps.coloured_ks, maps.kd.shape)
    pictures: dict[str, Float[np.ndarray, "row column *channel"]] = {}
    if lobe.node == _GLOSSY:
        pictures["Color"] = ks if lobe.fresnel is None else ks / head_on_reflectance(lobe.fresnel)
    elif np.any(np.ptp(ks, axis=-1) > _GREY * np.max(ks)):
        return None
    else:
        brightest = float(np.max(ks))
        pictures["Weight"] = ks[..., 0] / brightest
        weight = brightest / float(head_on_reflectance(lobe.inputs["IOR"]))
        lobe = lobe._replace(weight=weight)
    if maps.sigma is not None:
        pictures["Roughness"] = np.sqrt(np.clip(maps.sigma, 0, 1))
    return Surface((diffuse, lobe._replace(pictures=pictures)))


def with_normals(surface: Surface, maps: MaterialMaps, shape: Shape) -> Surface:
    """Give all shaders the unit normals of texels; without any the surface stays as it is."""
    if maps.offset is None:
        return surface
    frames = texel_frames(shape, maps.kd.shape[:2])
    normals = np.einsum("...a,...ai->...i", in_frames(maps.offset, frames), frames)
    shaders = [one._replace(pictures=one.pictures | {"Normal": normals}) for one in surface.shaders]
    return surface._replace(shaders=tuple(shaders))


def _facets(brdf: BRDF) -> _Facets | None:
    if isinstance(brdf, Lambertian):
        return _Facets(np.asarray(brdf.kd, float), np.zeros(3), 1.0, 1.0, None)
    if isinstance(brdf, AnisotropicGGX):
        along, across = float(brdf.roughness), float(brdf.roughness_y)
        turn = float(brdf.tangent_rotation)
        if along < across:
            along, across, turn = across, along, turn + math.pi / 2
        kd, ks, mu = _amplitudes(brdf)
        return _Facets(kd, ks, along, across, mu, turn=None if along == across else turn)
    if not isinstance(brdf, Microfacet) or brdf.masking != "smith":
        return None
    if brdf.distribution not in ("ggx", "beckmann"):
        return None
    kd, ks, mu = _amplitudes(brdf)
    sigma, name = float(brdf.sigma), brdf.distribution.upper()
    return _Facets(kd, ks, sigma, sigma, mu, brdf.fresnel == "exit", name)


def _amplitudes(
    brdf: AnisotropicGGX | Microfacet,
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], float | None]:
    mu = None if brdf.mu is None else float(brdf.mu)
    return np.asarray(brdf.kd, float), np.asarray(brdf.ks, float), mu


def principled_losses(material: GltfMaterial) -> tuple[str, ...]:
    """Say what a Principled BSDF cannot hold of glTF's material."""
    lost = ()
    if float(material.specular) != 1:
        lost += ("that an interface reflects less than all light at grazing",)
    if not material.isotropic and _widths(material)[1] < _LEAST_RATIO:
        lost += ("widths of a brushed surface that differ more than tenfold: they differ tenfold",)
    return lost


def principled(material: GltfMaterial, textures: GltfTextures | None = None) -> Surface:
    """Give the numbers of glTF's material to a Principled BSDF, with its textures as they are."""
    inputs: dict[str, Any] = {
        "Base Color": _colour(material.base_color),
        "Metallic": float(material.metallic),
        "Roughness": float(material.roughness),
        "IOR": float(material.ior),
        # A half is the index's own reflectance.
        "Specular IOR Level": float(material.specular) / 2,
        "Specular Tint": _colour(material.specular_color),
    }
    if material.clearcoat:
        inputs["Coat Weight"] = float(material.clearcoat)
        inputs["Coat Roughness"] = float(material.clearcoat_roughness)
    turn = None
    if not material.isotropic:
        mean, ratio = _widths(material)
        inputs["Roughness"] = math.sqrt(mean)
        inputs["Anisotropic"] = (1 - max(ratio, _LEAST_RATIO)) / _MOST_ANISOTROPY
        turn = float(material.anisotropy_rotation)
    pictures = {}
    if textures is not None:
        maps = {
            "Base Color": textures.base_color,
            "Specular Tint": textures.specular_color,
            "Roughness": textures.roughness,
            "Metallic": textures.metallic,
        }
        pictures = {name: values for name, values in maps.items() if values is not None}
    return Surface((Shader(_PRINCIPLED, inputs, "GGX", pictures=pictures),), turn)


def _widths(material: GltfMaterial) -> tuple[float, float]:
    """Give the geometric mean of a brushed surface's widths, and the smaller over the larger."""
    across = float(material.roughness) ** 2
    along = across + (1 - across) * float(material.anisotropy_strength) ** 2
    return math.sqrt(along * across), across / along


def _colour(values: Float[AnyArray, "3"]) -> list[float]:
    return [*(float(x) for x in np.asarray(values, float)), 1.0]
