"""Every model that a fit knows by name, and what each of its numbers is: plain data.

Configs, recipes, command lines, reports and the classes of ``brdf`` are told the same from here: a
number's name and symbol, where it lies, what is typical, what it means, and its part in a fit.

A new model is a class in ``brdf`` and an entry here.
"""

from collections.abc import Mapping
from types import MappingProxyType

from jaxrender.catalogue.interval import Interval
from jaxrender.catalogue.layers import LAYERED, TANGENT_ROTATION
from jaxrender.catalogue.model import FROM_0, TO_1, Model, Number, amplitude

_ABOVE_0 = Interval("(0, inf)")

_KD = amplitude("kd", "K_d", "diffuse BRDF value [1/sr]; times π it is the albedo", 0.2, "albedo")
_KS = amplitude("ks", "K_s", "specular weight: about the albedo of the lobe", 0.1, "albedo")
_KS_OF_FRESNEL = amplitude(
    "ks", "K_s", "specular weight times the Fresnel reflectance: 1 of a clean surface", 0.1, "F"
)
_KS_OF_COSINE = amplitude(
    "ks", "K_s", "specular weight times the power of a cosine [1/sr]", 0.1, "cosine"
)
_MU = Number(
    "mu",
    "μ",
    "refractive index: how much brighter the lobe gets at grazing angles; none for metals (F = 1)",
    Interval("(1, inf)"),
    1.5,
    may_be_none=True,
)


_FACETS = "microfacet.Microfacet"
# What renderers use, unless said otherwise.
_PHYSICAL = {"fresnel": "half", "masking": "smith"}


def _roughness(meaning: str) -> Number:
    return Number("roughness", "α", meaning, TO_1, 0.1)


def _exponent(of: str, typical: float) -> Number:
    meaning = f"exponent of the cosine to {of}: the larger, the narrower the highlight"
    return Number("exponent", "s", meaning, _ABOVE_0, typical)


_SLOPES = _roughness("roughness: the slopes' deviation times √2; how wide the highlight is")
_WIDTH = "roughness: how wide the highlight is [radians]"
_ALL: tuple[Model, ...] = (
    Model(
        "microfacet",
        "facets of the thesis (T 6.2)",
        _FACETS,
        (_KD, _KS, Number("sigma", "σ", _WIDTH, _ABOVE_0, 0.1), _MU),
        options={"fresnel": "exit", "masking": "none"},
    ),
    *(
        Model(
            name,
            "facets as renderers have them",
            _FACETS,
            (_KD, _KS, Number("sigma", "σ", _WIDTH, TO_1, 0.1), _MU),
            {"distribution": name},
            _PHYSICAL,
        )
        for name in ("ggx", "beckmann")
    ),
    Model(
        "torrance-sparrow",
        "facets in V-grooves",
        "torrance_sparrow.TorranceSparrow",
        (
            _KD,
            _KS_OF_FRESNEL,
            _roughness("roughness: the facets' angle at which they are 1/e as many [radians]"),
            _MU,
        ),
    ),
    Model(
        "cook-torrance",
        "Beckmann's facets in V-grooves",
        "torrance_sparrow.TorranceSparrow",
        (_KD, _KS_OF_FRESNEL, _SLOPES, _MU),
        {"distribution": "beckmann"},
    ),
    Model("ward", "a measured surface", "ward.Ward", (_KD, _KS, _SLOPES)),
    Model(
        "phong",
        "a power of the cosine to the mirror direction",
        "phong.Phong",
        (_KD, _KS, _exponent("the reflected direction", 32.0)),
    ),
    Model(
        "blinn-phong",
        "a power of the cosine to the half vector",
        "blinn_phong.BlinnPhong",
        (_KD, _KS, _exponent("the half vector", 128.0)),
    ),
    Model(
        "lafortune",
        "one lobe, nearer to the horizon than the mirror direction",
        "lafortune.CosineLobe",
        (
            _KD,
            _KS_OF_COSINE,
            _exponent("the reflected direction", 32.0),
            Number(
                "c_z",
                "C_z",
                "how far the lobe (-1, -1, C_z) is off the mirror direction: 1 is not at all, less "
                "is nearer to the horizon",
                _ABOVE_0,
                1.0,
                "stated",
            ),
        ),
    ),
    Model(
        "he-torrance",
        "a rough surface that diffracts light of one wavelength",
        "he_torrance.HeTorranceLobe",
        (
            _KD,
            _KS_OF_FRESNEL,
            _SLOPES,
            _MU,
            Number(
                "deviation",
                "σ₀_λ",
                "deviation of the surface's heights, in wavelengths of the light",
                _ABOVE_0,
                0.5,
                "stated",
            ),
        ),
    ),
    Model(
        "anisotropic-ward",
        "brushed metal",
        "ward.AnisotropicWard",
        (
            _KD,
            _KS,
            _roughness("roughness along the tangent, which is the meridian about +Z"),
            Number(
                "roughness_y",
                "α_y",
                "roughness across the tangent: how long the highlight is that way",
                TO_1,
                0.25,
            ),
        ),
        about_mirror=False,
    ),
    Model(
        "anisotropic-ggx",
        "brushed metal as renderers have it",
        "anisotropic_ggx.AnisotropicGGX",
        (
            _KD,
            _KS,
            _roughness("roughness along the tangent: the width of the GGX lobe"),
            Number("roughness_y", "α_y", "roughness across the tangent", TO_1, 0.3),
            TANGENT_ROTATION,
            _MU,
        ),
        about_mirror=False,
    ),
    Model(
        "kajiya-kay",
        "fibres along the meridians",
        "kajiya_kay.KajiyaKay",
        (
            _KD,
            _KS_OF_COSINE,
            _exponent("the cone into which a fibre along the meridian reflects", 32.0),
        ),
        about_mirror=False,
    ),
    Model(
        "poulin-fournier",
        "cylinders along the meridians",
        "poulin_fournier.PoulinFournier",
        (
            _KD,
            _KS,
            _exponent("the half vector", 128.0),
            Number(
                "spacing",
                "d",
                "distance between the fibres' axes, in their radii",
                Interval("[2, inf)"),
                2.0,
                "stated",
            ),
            Number(
                "height",
                "h",
                "how far the fibres rise, in their radii: 1 is half a cylinder",
                TO_1,
                1.0,
                "stated",
            ),
        ),
        about_mirror=False,
    ),
    Model(
        "oren-nayar",
        "rough diffuse paint",
        "oren_nayar.OrenNayarLobe",
        (
            _KD,
            Number(
                "sigma",
                "σ",
                "roughness: deviation of the grooves' angle [radians]",
                Interval("(0, 1.5708)"),
                0.35,
            ),
        ),
        about_mirror=False,
    ),
    Model("lambertian", "ideal diffuse paint", "lambertian.Lambertian", (_KD,)),
    Model(
        "two-ggx",
        "a sharp highlight in a haze",
        "two_ggx.TwoGGX",
        (
            _KD,
            _KS,
            amplitude(
                "ks_broad",
                "K_b",
                "specular weight of the broad lobe: about its albedo",
                0.05,
                "broad albedo",
            ),
            Number("sigma", "σ", "roughness of the narrow lobe", TO_1, 0.08),
            Number(
                "spread",
                "q",
                "how many times wider the broad lobe is: its roughness is that times σ, at most 1",
                Interval("(1, inf)"),
                4.0,
            ),
            _MU,
        ),
        about_mirror=False,
    ),
    *LAYERED,
    Model(
        "free",
        "any facets: their slopes and their Fresnel curve are found",
        "free_facets.FreeFacets",
        (
            _KD,
            _KS,
            Number("sigma", "σ", "roughness: the width of the facets' distribution", TO_1, 0.15),
            Number(
                "tail",
                "γ",
                "how D falls off, as tan^(-2 γ) of the angle: 2 is GGX, many is Beckmann",
                Interval("(1.5, inf)"),
                2.2,
            ),
            *(
                Number(
                    f"wave_{k}",
                    f"c_{k}",
                    f"wave {k} of log D over the share of the facets that is flatter",
                    Interval("(-inf, inf)"),
                    0.0,
                )
                for k in (2, 3, 4)
            ),
            Number("rise_45", "F_45", "F at 45 degrees over F at 0", Interval("(0, inf)"), 1.26),
            *(
                Number(
                    f"rise_{high}",
                    f"F_{high}",
                    f"F at {high} degrees over F at {low}: beyond 45 it only rises",
                    Interval("[1, inf)"),
                    typical,
                )
                for low, high, typical in ((45, 60, 1.77), (60, 75, 2.84), (75, 90, 3.95))
            ),
        ),
        about_mirror=False,
    ),
    Model(
        "bank",
        "a real surface: as many lobes of set shapes as it needs",
        "bank.Bank",
        (
            _KD,
            Number(
                "ks",
                "K_s",
                "weights of all lobes that are not diffuse, added up: about their albedo",
                FROM_0,
                0.1,
                "sum",
            ),
        ),
        about_mirror=False,
        is_stated=False,
    ),
)

MODELS: Mapping[str, Model] = MappingProxyType({model.name: model for model in _ALL})
# Those whose numbers tell the whole material.
STATED: tuple[str, ...] = tuple(model.name for model in _ALL if model.is_stated)


def numbers_named(name: str) -> dict[str, Number]:
    """Map every model that has a number of this name to what it is there."""
    return {
        model.name: number
        for model in MODELS.values()
        for number in model.numbers
        if number.name == name
    }


# Every name of an amplitude.
AMPLITUDES: tuple[str, ...] = tuple(
    dict.fromkeys(name for model in _ALL for name in model.names("amplitude"))
)
# Every name of a number, each once, in the order in which it first occurs.
NAMES: tuple[str, ...] = tuple(
    dict.fromkeys(number.name for model in MODELS.values() for number in model.numbers)
)


def described(name: str) -> str:
    """Say what a number is: in every model, or in each where it differs."""
    owners: dict[str, list[str]] = {}
    for model, number in numbers_named(name).items():
        owners.setdefault(number.meaning, []).append(model)
    if len(owners) == 1:
        return f"{next(iter(owners))}."
    return "; ".join(f"of {', '.join(models)}: {text}" for text, models in owners.items()) + "."
