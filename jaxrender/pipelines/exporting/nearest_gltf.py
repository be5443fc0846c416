"""The material of glTF, as it is or as another program takes its numbers, nearest to any BRDF.

Compared are square roots of rho cos t_i cos t_o, with weights (cos t_i cos t_o)^2 dw_i dw_o, over
pairs that are dense about the highlight.  Without the root, a model without masking would be
compared at grazing alone.  A dielectric has a base colour, a coloured reflectance head-on and a
roughness; a metal a base colour and a roughness.  The better of the two is taken.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from jaxrender.brdf import BRDF, AnisotropicGGX, MetallicRoughness, Microfacet, OpenPBR
from jaxrender.io.exports import Brushed, GltfMaterial, GltfTextures, MaterialMaps, MetallicMaps
from jaxrender.pipelines.exporting.differences import dense_pairs

_FIRST_ROUGHNESS = 0.4
_LEAST_ROUGHNESS, _LEAST_HEAD_ON, _MOST_HEAD_ON = 0.05, 1e-4, 0.95
_EVALUATIONS, _TINY = 40, 1e-12
# What a program makes of glTF's numbers.
Reading = Callable[[GltfMaterial], BRDF]


def as_gltf(material: GltfMaterial) -> BRDF:
    """Take the numbers as glTF defines them."""
    return material


def own_gltf(brdf: BRDF) -> GltfMaterial | None:
    """Translate a BRDF whose definition is glTF's; None for all others."""
    if not isinstance(brdf, MetallicRoughness):
        return None
    color = np.asarray(brdf.base_color, float)
    # A reflectance that a fit has scaled has no place in glTF.
    if not np.allclose(np.asarray(brdf.interface), 1) or np.any(color > 1) or color.shape != (3,):
        return None
    return GltfMaterial(color, float(brdf.metallic), float(brdf.roughness), float(brdf.ior))


def nearest_gltf(brdf: BRDF, metals: bool = True, reading: Reading = as_gltf) -> GltfMaterial:
    """Fit glTF's material to an isotropic BRDF of three channels; ``metals`` are tried, too.

    ``reading`` is what a program makes of the material.
    """
    pairs = dense_pairs()
    wanted = pairs.roots(brdf)

    def apart(numbers: np.ndarray) -> np.ndarray:
        return np.ravel(pairs.roots(reading(_material(numbers))) - wanted)

    found = [_fitted(apart, metal) for metal in ((False, True) if metals else (False,))]
    return _material(min(found, key=lambda one: float(np.sum(apart(one) ** 2))))


def nearest_brushed(
    brdf: AnisotropicGGX | OpenPBR, brushed: Brushed, reading: Reading = as_gltf
) -> GltfMaterial:
    """Fit the surface with one width, their geometric mean, and give the fit both again."""
    mean = float(np.sqrt(brushed.along * brushed.across))
    if isinstance(brdf, OpenPBR):
        even = dataclasses.replace(
            brdf, specular_roughness=np.sqrt(mean), specular_roughness_anisotropy=0.0
        )
    else:
        even = dataclasses.replace(brdf, roughness=mean, roughness_y=mean)
    near = nearest_gltf(even, reading=reading)
    factor = float(near.roughness) ** 2 / mean
    along, across = (min(factor * one, 1.0) for one in (brushed.along, brushed.across))
    strength = np.sqrt((along - across) / max(1 - across, _TINY))
    return dataclasses.replace(
        near,
        roughness=np.sqrt(across),
        anisotropy_strength=float(strength),
        anisotropy_rotation=brushed.rotation,
    )


class TexturedGltf(NamedTuple):
    """Textures, what they multiply, and the share of texels that are brighter than white.

    ``mean`` is the material nearest to that of the mean texel; None: the texture is glTF's own.
    """

    mean: GltfMaterial | None
    material: GltfMaterial
    textures: GltfTextures
    too_bright: float


def nearest_textured(maps: MaterialMaps | MetallicMaps, reading: Reading = as_gltf) -> TexturedGltf:
    """Find the material nearest to the mean, and scale its numbers for every texel.

    Colours change by kd and ks over the mean's, the roughness by the root of sigma over the mean's.
    """
    if isinstance(maps, MetallicMaps):
        material = GltfMaterial(np.ones(3), 1.0, 1.0, float(maps.mean.ior))
        color = np.minimum(maps.base_color, 1)
        textures = GltfTextures(color, None, maps.roughness, maps.metallic)
        bright = float(np.mean(np.any(maps.base_color > 1, axis=-1)))
        return TexturedGltf(None, material, textures, bright)
    nearest = nearest_gltf(maps.mean, metals=False, reading=reading)
    amplitudes = np.asarray(maps.mean.amplitudes, float)
    kd, ks = amplitudes[0], amplitudes[-1]
    base = np.asarray(nearest.base_color) * maps.kd / np.maximum(kd, _TINY)
    index = float(nearest.ior)
    head_on = ((index - 1) / (index + 1)) ** 2 * np.asarray(nearest.specular_color)
    specular = None
    if np.any(ks > 0):
        of_texel = head_on * (maps.ks.reshape(*maps.ks.shape[:2], -1) / np.maximum(ks, _TINY))
        brightest = min(float(of_texel.max()), _MOST_HEAD_ON)
        specular = np.minimum(of_texel / brightest, 1)
        root = np.sqrt(brightest)
        index = (1 + root) / (1 - root)
    roughness = None
    if maps.sigma is not None:
        assert isinstance(maps.mean, Microfacet)
        ratio = np.sqrt(np.maximum(maps.sigma, 0) / float(maps.mean.sigma))
        roughness = np.clip(float(nearest.roughness) * ratio, 0, 1)
    material = GltfMaterial(np.ones(3), 0.0, float(nearest.roughness), index)
    textures = GltfTextures(np.minimum(base, 1), specular, roughness)
    return TexturedGltf(nearest, material, textures, float(np.mean(np.any(base > 1, axis=-1))))


def described(material: GltfMaterial) -> str:
    """Say what a material's numbers are."""
    color = " ".join(f"{x:.3f}" for x in np.asarray(material.base_color))
    tint = " ".join(f"{x:.3f}" for x in np.asarray(material.specular_color))
    said = f"base colour {color}, roughness {float(material.roughness):.3f}"
    if float(material.anisotropy_strength):
        said += f", anisotropy {float(material.anisotropy_strength):.3f}"
    if float(material.metallic) == 1:
        return f"{said}, metallic 1"
    return f"{said}, metallic 0, index {float(material.ior):.3f}, specular colour {tint}"


def _fitted(residuals: Callable[[np.ndarray], np.ndarray], metal: bool) -> np.ndarray:
    """Find the four numbers of a metal, or the seven of a dielectric."""
    colors = [0.5, 0.5, 0.5] if metal else [0.5, 0.5, 0.5, 0.1, 0.1, 0.1]
    low = [0.0] * 3 + [_LEAST_HEAD_ON] * (len(colors) - 3) + [_LEAST_ROUGHNESS]
    high = [1.0] * 3 + [_MOST_HEAD_ON] * (len(colors) - 3) + [1.0]
    start = [*colors, _FIRST_ROUGHNESS]
    done = least_squares(residuals, start, bounds=(low, high), x_scale="jac", max_nfev=_EVALUATIONS)
    return done.x


def _material(numbers: np.ndarray) -> GltfMaterial:
    """Make a metal of four numbers, a dielectric of seven."""
    color, rough = numbers[:3], numbers[-1]
    if len(numbers) == 4:
        return GltfMaterial(color, 1.0, rough)
    head_on = numbers[3:6]
    # The index that the brightest channel asks for, so that no colour is above one.
    index = np.sqrt(head_on.max())
    ior = (1 + index) / (1 - index)
    return GltfMaterial(color, 0.0, rough, ior, 1.0, head_on / head_on.max())
