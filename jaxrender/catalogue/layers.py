"""The materials of renderers: a base under an interface, a coat and a fuzz.

Their numbers go by the names that glTF, Disney and OpenPBR gave them.  Most are settled, so that a
fit finds few unless more are called free.
"""

from jaxrender.catalogue.interval import Interval
from jaxrender.catalogue.model import FROM_0, TO_1, Model, Number, Part, amplitude

_SHARE = Interval("[0, 1]")
_COLOR = amplitude(
    "base_color", "c", "albedo of the diffuse base, and a metal's reflectance head-on", 0.3, "color"
)
_INTERFACE = Number(
    "interface",
    "K_i",
    "how bright what the base does not colour is: 1 is what physics says",
    FROM_0,
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


TANGENT_ROTATION = _layer(
    "tangent_rotation",
    "φ",
    "angle by which the tangent is turned from the meridian about +Z [radians]",
    0.0,
    domain=Interval("[-1.5708, 1.5708]"),
)
_METAL = "share of the base that is metal"
_INDEX_OF_REFRACTION = Interval("(1, 6]")


def _interface_roughness(name: str, index: str, of: str, settled: float | None = None) -> Number:
    meaning = f"roughness of the {of}: the root of the width of its GGX lobe"
    return _layer(name, f"r_{index}" if index else "r", meaning, settled, 0.3, TO_1)


_ROUGHNESS = _interface_roughness("roughness", "", "surface")
_METALLIC = _layer("metallic", "m", _METAL, None, 0.3)

LAYERED: tuple[Model, ...] = (
    Model(
        "metallic-roughness",
        "the material of glTF 2.0",
        "metallic_roughness.MetallicRoughness",
        (
            _COLOR,
            _INTERFACE,
            _ROUGHNESS,
            _METALLIC,
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
            _layer("sheen", "K_h", "amount of sheen, as of cloth", 0.0, 0.2, FROM_0, "amplitude"),
            _layer("clearcoat", "K_c", "amount of clear coat", 0.0, 0.5, FROM_0, "amplitude"),
            _ROUGHNESS,
            _METALLIC,
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
            TANGENT_ROTATION,
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
)
