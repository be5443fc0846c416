"""Every model by the name that it is registered by, for the tests that try them all.

The promises of most are written down.  Any other model of the catalogue has its typical numbers.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import (
    AnisotropicGGX,
    AnisotropicWard,
    BlinnPhong,
    CookTorrance,
    CosineLobe,
    FreeFacets,
    HeTorrance,
    HeTorranceLobe,
    KajiyaKay,
    Lafortune,
    Lambertian,
    MetallicRoughness,
    Microfacet,
    Mixture,
    OpenPBR,
    OrenNayar,
    OrenNayarLobe,
    Phong,
    PoulinFournier,
    Principled,
    TorranceSparrow,
    Ward,
    material_named,
)
from jaxrender.catalogue import MODELS as CATALOGUE
from jaxrender.catalogue import STATED

KD, KS = np.array([0.05, 0.1]), np.array([0.3, 0.2])
COLOR, CLEAR = np.array([0.3, 0.7]), np.ones(2)
GOLD = np.array([0.14, 1.5]), np.array([4.0, 1.9])

# name -> (model, reciprocal, conserves energy, isotropic)
PROMISED = {
    "lambertian": (Lambertian(KD), True, True, True),
    "oren-nayar-full": (OrenNayar(KD, 0.4), True, True, True),
    "oren-nayar qualitative": (OrenNayar(KD, 0.4, qualitative=True), True, True, True),
    "oren-nayar": (OrenNayarLobe(KD, 0.4), True, True, True),
    "phong": (Phong(KD, KS, 20.5), False, False, True),
    "blinn-phong": (BlinnPhong(KD, KS, 33.3), True, True, True),
    "microfacet": (Microfacet(KD, KS, 0.2, 1.5), False, False, True),
    "microfacet half": (Microfacet(KD, KS, 0.2, 1.5, "half"), True, False, True),
    "microfacet smith": (Microfacet(KD, KS, 0.2, None, "half", "smith"), True, True, True),
    "torrance-sparrow": (TorranceSparrow(KD, KS, 0.2, 1.5), True, True, True),
    "torrance-sparrow ggx": (
        TorranceSparrow(KD, KS, 0.2, 1.5, 0.4, "ggx", "smith", "schlick"),
        True,
        True,
        False,
    ),
    "torrance-sparrow gaussian smith": (
        TorranceSparrow(KD, KS, 0.3, None, masking="smith"),
        True,
        True,
        True,
    ),
    "torrance-sparrow unmasked": (
        TorranceSparrow(KD, KS, 0.3, None, masking="none"),
        True,
        False,
        True,
    ),
    "cook-torrance-conductor": (CookTorrance(KD, KS, 0.25, *GOLD), True, True, True),
    "he-torrance-conductor": (
        HeTorrance(KD, KS, 0.15, 1.5, np.array([0.6, 0.5]), *GOLD),
        True,
        False,
        True,
    ),
    "he-torrance": (HeTorranceLobe(KD, KS, 0.2, 1.5), True, False, True),
    "ward": (Ward(KD, KS, 0.2), True, False, True),
    "ward bounded": (Ward(KD, KS, 0.15, 0.4, "bounded"), True, True, False),
    "anisotropic-ward": (AnisotropicWard(KD, KS, 0.15, 0.4), True, False, False),
    "free": (
        FreeFacets(KD, KS, 0.3, 2.6, -0.4, 0.2, 0.1, 0.9, 1.0, 1.05, 1.1),
        True,
        True,
        True,
    ),
    "anisotropic-ggx": (AnisotropicGGX(KD, KS, 0.2, 0.5, None, 0.6), True, True, False),
    "lafortune-lobes": (
        Lafortune(
            KD,
            np.array([[0.4, 0.3], [0.1, 0.2]]),
            np.array([[-1.01, -0.95, 0.95], [0.6, 0.6, 0.7]]),
            np.array([15.5, 4.0]),
        ),
        True,
        True,
        False,
    ),
    "lafortune": (CosineLobe(KD, KS, 15.5, 0.9), True, True, True),
    "kajiya-kay": (KajiyaKay(KD, KS, 20.0), False, False, False),
    "poulin-fournier": (PoulinFournier(KD, KS, 40.0, 2.4, 0.7), True, True, False),
    "metallic-roughness": (MetallicRoughness(COLOR, CLEAR, 0.3, 0.5), True, False, True),
    "metallic-roughness metal": (MetallicRoughness(COLOR, CLEAR, 1.0, 0.5), True, True, True),
    "principled": (
        Principled(COLOR, CLEAR, 0.4 * CLEAR, 0.5 * CLEAR, 0.3, 0.5, 0.7, 0.8),
        True,
        False,
        True,
    ),
    "openpbr": (OpenPBR(COLOR, CLEAR, 0.3, 0.5), True, True, True),
    "openpbr in layers": (
        OpenPBR(
            CLEAR,
            CLEAR,
            base_metalness=0.2,
            specular_roughness=0.7,
            specular_color=0.8,
            specular_roughness_anisotropy=0.6,
            tangent_rotation=0.4,
            coat_weight=0.6,
            coat_color=0.7,
            coat_roughness=0.4,
            fuzz_weight=0.5,
            multiple_scattering="facets",
        ),
        True,
        True,
        False,
    ),
    "mixture": (
        Mixture(
            (BlinnPhong(KD, KS, 5.0), Ward(KD, KS, 0.2, 0.3, "bounded")),
            np.array([[0.3, 0.8], [0.7, 0.2]]),
        ),
        True,
        True,
        False,
    ),
}


def typical(name):
    """A material of a model's typical numbers; its amplitudes are those of the others here."""
    own = {number.name: number.typical for number in CATALOGUE[name].numbers}
    amplitudes = {"kd": KD, "ks": KS}
    return material_named(
        name, {**own, **{key: amplitudes[key] for key in amplitudes if key in own}}
    )


MODELS = {name: model for name, (model, *_) in PROMISED.items()}
MODELS |= {name: typical(name) for name in STATED if name not in MODELS}
NAMES = list(MODELS)


def upper_directions(count, seed, lowest=0.05):
    rng = np.random.default_rng(seed)
    cosine, azimuth = rng.uniform(lowest, 1, count), rng.uniform(0, 2 * np.pi, count)
    return direction(cosine, azimuth)


def direction(cosine, azimuth):
    sine = np.sqrt(1 - np.asarray(cosine) ** 2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine + 0 * azimuth], axis=-1)


def single_precision(leaf):
    return jnp.asarray(leaf, np.float32)
