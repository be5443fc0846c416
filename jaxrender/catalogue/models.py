"""Every model that a fit knows by name, and what each of its numbers is: plain data.

Configs, recipes, command lines, reports and the classes of ``brdf`` are told the same from here: a
number's name and symbol, where it lies, what is typical, what it means, and its part in a fit.

``amplitude``
    enters linearly: how much of one of the model's lobes there is, in each channel
``searched``
    shapes a lobe: a fit looks for it unless it is fixed
``stated``
    is stated by whoever names the model, and no fit looks for it
``sum``
    is what a fit says of several lobes together, and nobody states

A new model is a class in ``brdf`` and an entry here.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from jaxrender.catalogue.interval import Interval

Part = Literal["amplitude", "searched", "stated", "sum"]


class Number(NamedTuple):
    """One number of a model.

    ``symbol`` is a letter and, after an underscore, its index.  ``weighs`` says of an amplitude
    what it is times, so that it means the same in two models if that is the same; what is typical
    of one is an albedo (of kd over π).  ``settled`` is what a number is that nobody states or calls
    free; None: it is free then.
    """

    name: str
    symbol: str
    meaning: str
    domain: Interval
    typical: float
    part: Part = "searched"
    may_be_none: bool = False
    weighs: str = ""
    settled: float | None = None

    @property
    def letter(self) -> str:
        """The symbol without its index."""
        return self.symbol.partition("_")[0]

    @property
    def index(self) -> str:
        """The symbol's index, or ''."""
        return self.symbol.partition("_")[2]


class Model(NamedTuple):
    """A model by its name, and the surface that it stands for.

    ``home`` is the module and class below ``jaxrender.brdf`` that holds it for a fit.  ``fixed`` is
    what makes the class this model, ``options`` what may be chosen otherwise.  ``about_mirror``
    says that its lobe is about the reflected direction, so that it has a frequency view.
    ``is_stated`` says that its numbers tell the whole material: a recipe can state it.
    """

    name: str
    surface: str
    home: str
    numbers: tuple[Number, ...]
    fixed: Mapping[str, Any] = MappingProxyType({})
    options: Mapping[str, str] = MappingProxyType({})
    about_mirror: bool = True
    is_stated: bool = True

    def names(self, *parts: Part) -> tuple[str, ...]:
        """Name the numbers that have one of these parts in a fit."""
        return tuple(number.name for number in self.numbers if number.part in parts)

    def number(self, name: str) -> Number:
        """Find a number by its name; ``KeyError`` if the model has none of that name."""
        for number in self.numbers:
            if number.name == name:
                return number
        raise KeyError(name)

    @property
    def settled(self) -> dict[str, float]:
        """What the numbers are that nobody states or calls free."""
        return {one.name: one.settled for one in self.numbers if one.settled is not None}

    @property
    def has_one_lobe(self) -> bool:
        """Whether there is a base and a lobe, or one of the two, and no more."""
        return self.is_stated and {*self.names("amplitude")} <= {"kd", "ks"}

    @property
    def has_specular(self) -> bool:
        """Whether the model has more than a diffuse lobe."""
        return self.names("amplitude", "sum") != ("kd",)


_ABOVE_0, _FROM_0, _TO_1 = Interval("(0, inf)"), Interval("[0, inf)"), Interval("(0, 1]")


def _amplitude(name: str, symbol: str, meaning: str, typical: float, weighs: str) -> Number:
    return Number(name, symbol, meaning, _FROM_0, typical, "amplitude", weighs=weighs)


_KD = _amplitude("kd", "K_d", "diffuse BRDF value [1/sr]; times π it is the albedo", 0.2, "albedo")
_KS = _amplitude("ks", "K_s", "specular weight: about the albedo of the lobe", 0.1, "albedo")
_KS_OF_FRESNEL = _amplitude(
    "ks", "K_s", "specular weight times the Fresnel reflectance: 1 of a clean surface", 0.1, "F"
)
_KS_OF_COSINE = _amplitude(
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


_SHARE = Interval("[0, 1]")
_COLOR = _amplitude(
    "base_color", "c", "albedo of the diffuse base, and a metal's reflectance head-on", 0.3, "color"
)
_INTERFACE = Number(
    "interface",
    "K_i",
    "how bright what the base does not colour is: 1 is what physics says",
    _FROM_0,
    1.0,
    "amplitude",
    weighs="interface",
    settled=1.0,
)


def _layer(
    name: str,
    symbol: str,
    meaning: str,
    settled: float | None,
    typical: float | None = None,
    domain: Interval = _SHARE,
    part: Part = "searched",
) -> Number:
    """Make a number of a renderer's material."""
    typical = settled if typical is None else typical
    assert typical is not None
    return Number(name, symbol, meaning, domain, typical, part, weighs=name, settled=settled)


_METAL = "share of the base that is metal"
_INDEX_OF_REFRACTION = Interval("(1, 6]")


def _interface_roughness(name: str, index: str, of: str, settled: float | None = None) -> Number:
    meaning = f"roughness of the {of}: the root of the width of its GGX lobe"
    return _layer(name, f"r_{index}" if index else "r", meaning, settled, 0.3, _TO_1)


_FACETS = "microfacet.Microfacet"
# What renderers use, unless said otherwise.
_PHYSICAL = {"fresnel": "half", "masking": "smith"}


def _roughness(meaning: str) -> Number:
    return Number("roughness", "α", meaning, _TO_1, 0.1)


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
            (_KD, _KS, Number("sigma", "σ", _WIDTH, _TO_1, 0.1), _MU),
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
                _TO_1,
                0.25,
            ),
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
                _TO_1,
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
            _amplitude(
                "ks_broad",
                "K_b",
                "specular weight of the broad lobe: about its albedo",
                0.05,
                "broad albedo",
            ),
            Number("sigma", "σ", "roughness of the narrow lobe", _TO_1, 0.08),
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
    Model(
        "metallic-roughness",
        "the material of glTF 2.0",
        "metallic_roughness.MetallicRoughness",
        (
            _COLOR,
            _INTERFACE,
            _interface_roughness("roughness", "", "surface"),
            _layer("metallic", "m", _METAL, None, 0.3),
            _layer(
                "ior", "n", "refractive index of the interface", 1.5, domain=_INDEX_OF_REFRACTION
            ),
        ),
        about_mirror=False,
    ),
    Model(
        "principled",
        "Disney's principled material, what reflects of it",
        "principled.Principled",
        (
            _COLOR,
            _INTERFACE,
            _layer("sheen", "K_h", "amount of sheen, as of cloth", 0.0, 0.2, _FROM_0, "amplitude"),
            _layer("clearcoat", "K_c", "amount of clear coat", 0.0, 0.5, _FROM_0, "amplitude"),
            _interface_roughness("roughness", "", "surface"),
            _layer("metallic", "m", _METAL, None, 0.3),
            _layer("specular", "s", "reflectance of the interface head-on, over .08", 0.5),
            _layer("clearcoat_gloss", "g", "how glossy the clear coat is", 1.0),
        ),
        about_mirror=False,
    ),
    Model(
        "openpbr",
        "OpenPBR's opaque surface: a base, a coat and a fuzz",
        "openpbr.OpenPBR",
        (
            _COLOR,
            _INTERFACE,
            _interface_roughness("specular_roughness", "s", "base"),
            _layer("base_metalness", "m", _METAL, None, 0.3),
            _layer(
                "specular_ior",
                "n",
                "refractive index of the base's interface",
                1.5,
                domain=_INDEX_OF_REFRACTION,
            ),
            _layer(
                "specular_color",
                "c_82",
                "how bright a metal is at 82 degrees, over Schlick's reflectance",
                1.0,
            ),
            _layer(
                "specular_roughness_anisotropy",
                "a",
                "how much narrower the highlight is across the tangent: 0 is not at all",
                0.0,
            ),
            _layer(
                "tangent_rotation",
                "φ",
                "angle by which the tangent is turned from the meridian about +Z [radians]",
                0.0,
                domain=Interval("[-1.5708, 1.5708]"),
            ),
            _layer("coat_weight", "w_c", "share of the surface that is coated", 0.0),
            _layer(
                "coat_color",
                "c_c",
                "what is left of light that crosses the coat twice along the normal",
                1.0,
            ),
            _interface_roughness("coat_roughness", "c", "coat", 0.1),
            _layer(
                "coat_ior", "n_c", "refractive index of the coat", 1.6, domain=_INDEX_OF_REFRACTION
            ),
            _layer("fuzz_weight", "w_f", "share of the surface that is covered by fuzz", 0.0),
            _layer(
                "fuzz_roughness",
                "r_f",
                "roughness of the fuzz: how far from grazing it is still bright",
                0.5,
                domain=Interval("[0.25, 1]"),
            ),
        ),
        options={"multiple_scattering": "none"},
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
                _FROM_0,
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
