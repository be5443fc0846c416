"""Rows of ``jaxrender.brdf``."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxrender import brdf
from jaxrender.geometry import Components

from .page import Above, Along, Row, Unit
from .places import normal, repeated

CHANNELS = {"kd": np.array([0.05, 0.1]), "ks": np.array([0.3, 0.2])}
UP = repeated([0.0, 0.0, 1.0])


def directions(cosines: list[float], azimuths: list[float]) -> np.ndarray:
    """Directions of stated cosines to the normal and azimuths."""
    cosine, azimuth = np.array(cosines), np.array(azimuths)
    sine = np.sqrt(1 - cosine**2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)


OUT = directions([0.8, 0.35], [0.4, 2.3])
MIRROR = OUT * [-1, -1, 1]
# About a lobe of width .2 away from the mirror's direction, in the plane and out of it.
NEAR = MIRROR + np.array([[0.1, -0.15, 0.02], [-0.1, 0.12, 0.1]])
NEAR /= np.linalg.norm(NEAR, axis=1, keepdims=True)
# A hundredth of a radian away.
CLOSE = MIRROR + np.array([[0.01, -0.008, 0.002], [-0.006, 0.012, 0.004]])
CLOSE /= np.linalg.norm(CLOSE, axis=1, keepdims=True)
GRAZING = directions([0.03, 0.02], [0.4, 2.3])
OPPOSITE = directions([0.04, 0.03], [0.43 + np.pi, 2.26 + np.pi])
PAIR = {"incoming": Unit(NEAR), "outgoing": Unit(OUT)}
# Where the directions themselves are at an edge.
PLACES = {
    "head-on": {"incoming": Unit(UP), "outgoing": Unit(UP)},
    "at the mirror": {"incoming": Unit(MIRROR)},
    "coincident": {"incoming": Unit(OUT)},
    "grazing": {"incoming": Unit(OPPOSITE), "outgoing": Unit(GRAZING)},
    "below": {"incoming": Unit(NEAR * [1, 1, -1])},
}


def width(name: str, narrow: float = 0.01, wide: float = 1.5) -> dict[str, dict[str, Any]]:
    """A narrow lobe close to its middle, and a wide one."""
    return {
        f"{name} {narrow:g}": {name: Above(np.array(narrow)), "incoming": Unit(CLOSE)},
        f"{name} {wide:g}": {name: Above(np.array(wide))},
    }


INDICES = {
    "mu 1.001": {"mu": Above(np.array(1.001), 1)},
    "mu 100": {"mu": Above(np.array(100.0), 1)},
}


def model(
    at: str,
    kind: type,
    parameters: Mapping[str, Any],
    edges: Mapping[str, Mapping[str, Any]] | None = None,
    kinks: Mapping[str, str] | None = None,
    **static: Any,
) -> Row:
    """A model of its parameters, evaluated for two directions."""

    def evaluate(incoming, outgoing, **own):
        return kind(**own, **static).evaluate(incoming, outgoing)

    everything = {**PLACES, **(edges or {})}
    arguments = {**parameters, **PAIR}
    return Row(kind.__name__, evaluate, arguments, everything, kinks=kinks or {}, at=at)


def scalar(value: float, least: float = 0.0) -> Above:
    """A number above a least one."""
    return Above(np.array(value), least)


EQUAL = dict.fromkeys(
    ("head-on", "coincident", "at the mirror"), "the larger of two equal angles changes over"
)
FACETS = {
    "smooth": ({"roughness": scalar(0.2)}, {"masking": "v-groove"}),
    "smith": ({"roughness": scalar(0.3)}, {"masking": "smith", "distribution": "beckmann"}),
    "anisotropic": (
        {"roughness": scalar(0.2), "roughness_y": scalar(0.4)},
        {"masking": "smith", "distribution": "ggx", "fresnel": "schlick"},
    ),
    "gaussian smith": ({"roughness": scalar(0.3)}, {"masking": "smith"}),
}
COLOR = {"base_color": np.array([0.3, 0.7]), "interface": np.array([1.0, 0.9])}
LAYERS = {
    "base_metalness": 0.3,
    "specular_roughness": 0.6,
    "specular_color": 0.8,
    "specular_roughness_anisotropy": 0.4,
    "tangent_rotation": 0.3,
    "coat_weight": 0.6,
    "coat_color": 0.7,
    "coat_roughness": 0.3,
    "fuzz_weight": 0.4,
    "fuzz_roughness": 0.5,
}
METAL = {"eta": np.array([0.14, 1.5]), "k": np.array([4.0, 1.9])}
MU = {"mu": scalar(1.5, 1)}

MODELS = [
    model("", brdf.Lambertian, {"kd": CHANNELS["kd"]}),
    model(
        "",
        brdf.OrenNayar,
        {"kd": CHANNELS["kd"], "sigma": scalar(0.4)},
        {"sigma 0.01": {"sigma": scalar(0.01)}, "sigma 1.5": {"sigma": scalar(1.5)}},
        EQUAL,
    ),
    model(
        "",
        brdf.OrenNayarLobe,
        {"kd": CHANNELS["kd"], "sigma": scalar(0.4)},
        {"sigma 1.5": {"sigma": scalar(1.5)}},
        EQUAL,
    ),
    model("", brdf.Phong, {**CHANNELS, "exponent": scalar(20.5)}, width("exponent", 5000.0, 0.2)),
    model(
        "", brdf.BlinnPhong, {**CHANNELS, "exponent": scalar(33.3)}, width("exponent", 5000.0, 0.2)
    ),
    model(
        "",
        brdf.CosineLobe,
        {**CHANNELS, "exponent": scalar(15.5), "c_z": scalar(0.9)},
        width("exponent", 5000.0, 0.2),
    ),
    model(
        "",
        brdf.Lafortune,
        {
            "kd": CHANNELS["kd"],
            "ks": np.array([[0.4, 0.3], [0.1, 0.2]]),
            "coefficients": np.array([[-1.01, -0.95, 0.95], [0.6, 0.6, 0.7]]),
            "exponents": Above(np.array([15.5, 4.0])),
        },
    ),
    model("", brdf.Microfacet, {**CHANNELS, "sigma": scalar(0.2), **MU}, width("sigma") | INDICES),
    model(
        "",
        brdf.TwoGGX,
        {
            **CHANNELS,
            "ks_broad": np.array([0.1, 0.05]),
            "sigma": scalar(0.1),
            "spread": scalar(4.0, 1),
            **MU,
        },
        width("sigma", 0.01, 0.2) | INDICES,
    ),
    model(
        "",
        brdf.MetallicRoughness,
        {**COLOR, "metallic": scalar(0.3), "roughness": scalar(0.5), "ior": scalar(1.5, 1)},
        width("roughness", 0.1, 0.99),
    ),
    model(
        "",
        brdf.Principled,
        {
            **COLOR,
            "sheen": np.array([0.2, 0.1]),
            "clearcoat": np.array([0.4, 0.3]),
            "metallic": scalar(0.3),
            "roughness": scalar(0.5),
            "specular": scalar(0.5),
            "clearcoat_gloss": scalar(0.4),
        },
        width("roughness", 0.1, 0.99),
    ),
    model(
        "",
        brdf.OpenPBR,
        {
            **COLOR,
            **{name: scalar(value) for name, value in LAYERS.items()},
            "specular_ior": scalar(1.5, 1),
            "coat_ior": scalar(1.6, 1),
        },
        width("specular_roughness", 0.15, 0.95),
        multiple_scattering="facets",
    ),
    model(
        "no index",
        brdf.Microfacet,
        {**CHANNELS, "sigma": scalar(0.2)},
        width("sigma"),
        mu=None,
        masking="smith",
    ),
    *(
        model(
            distribution,
            brdf.Microfacet,
            {**CHANNELS, "sigma": scalar(0.2), **MU},
            width("sigma", 0.01, 1.0) | INDICES,
            distribution=distribution,
            fresnel="half",
            masking="smith",
        )
        for distribution in ("beckmann", "ggx")
    ),
    *(
        model(
            at,
            brdf.TorranceSparrow,
            {**CHANNELS, **parameters, **MU},
            {**width("roughness", 0.01, 1.0), **INDICES},
            **static,
        )
        for at, (parameters, static) in FACETS.items()
    ),
    model("no index", brdf.TorranceSparrow, {**CHANNELS, "roughness": scalar(0.3)}, masking="none"),
    model("", brdf.CookTorrance, {**CHANNELS, "roughness": scalar(0.25), **METAL}),
    model(
        "",
        brdf.HeTorrance,
        {
            **CHANNELS,
            "roughness": scalar(0.15),
            "correlation_length": scalar(1.5),
            "wavelengths": Above(np.array([0.6, 0.5])),
            **METAL,
        },
    ),
    model(
        "",
        brdf.HeTorranceLobe,
        {**CHANNELS, "roughness": scalar(0.2), **MU, "deviation": scalar(0.5)},
        INDICES,
    ),
    model("", brdf.Ward, {**CHANNELS, "roughness": scalar(0.2)}, width("roughness", 0.01, 1.0)),
    *(
        model(
            normalisation,
            brdf.Ward,
            {**CHANNELS, "roughness": scalar(0.15), "roughness_y": scalar(0.4)},
            normalisation=normalisation,
        )
        for normalisation in ("duer", "bounded")
    ),
    model(
        "",
        brdf.AnisotropicWard,
        {**CHANNELS, "roughness": scalar(0.15), "roughness_y": scalar(0.4)},
        width("roughness", 0.01, 1.0),
    ),
    model("", brdf.KajiyaKay, {**CHANNELS, "exponent": scalar(20.0)}),
    model(
        "",
        brdf.PoulinFournier,
        {**CHANNELS, "exponent": scalar(40.0), "spacing": scalar(2.4), "height": scalar(0.7)},
        kinks={"coincident": "the arc that both directions see ends where either one's does"},
    ),
]

# Cells that the steps from the places above stay in.
TABLE = np.abs(normal(5, 5, 4, 2))
MEANS_NOTHING = "an angle of the table has a cusp there"
TABLES = [
    model(
        "",
        brdf.IsotropicTable,
        {"values": Above(TABLE)},
        kinks=dict.fromkeys(("head-on", "at the mirror", "coincident"), MEANS_NOTHING),
    ),
    *(
        model(
            reconstruction,
            brdf.PolarIsotropicTable,
            {"values": Above(TABLE)},
            kinks=dict.fromkeys(("head-on", "coincident", "at the mirror"), MEANS_NOTHING),
            reconstruction=reconstruction,
        )
        for reconstruction in ("linear", "b-spline")
    ),
    model(
        "",
        brdf.CorrectedBRDF,
        {"factor": Above(TABLE)},
        kinks=dict.fromkeys(("head-on", "at the mirror", "coincident"), MEANS_NOTHING),
        model=brdf.Phong(CHANNELS["kd"], CHANNELS["ks"], 20.0),
    ),
    model(
        "",
        brdf.PolarNodesTable,
        {"values": Above(np.abs(normal(4, 6, 4, 6, 2)))},
        kinks={"head-on": MEANS_NOTHING},
        largest_polar=1.5,
    ),
    *(
        model(
            reconstruction,
            brdf.TabulatedBRDF,
            {"values": Above(np.abs(normal(4, 4, 4, 4, 2)))},
            kinks={"head-on": "the centre of the square is the corner of four cells"},
            reconstruction=reconstruction,
        )
        for reconstruction in ("linear", "cubic")
    ),
    model("", brdf.ZernikeBRDF, {"coefficients": normal(5, 2)}, order=2),
]


def _like(values):
    """The amplitudes in the precision of other numbers."""
    return {name: part.astype(values.dtype) for name, part in CHANNELS.items()}


def _mixture(weights, roughness, exponent, incoming, outgoing):
    parts = (
        brdf.BlinnPhong(**_like(weights), exponent=exponent),
        brdf.Ward(**_like(weights), roughness=roughness),
    )
    return brdf.Mixture(parts, weights).evaluate(incoming, outgoing)


def _mean(roughness, roughness_y, kd, incoming, outgoing):
    ward = brdf.AnisotropicWard(kd, kd, roughness, roughness_y)
    return brdf.IsotropicMean(ward, 4).evaluate(incoming, outgoing)


HALF = directions([0.9, 0.5], [0.3, 4.0])


def _components(vectors):
    return Components(vectors[..., 0], vectors[..., 1], vectors[..., 2])


def distribution(kind: type, method: str, **roughnesses: Above) -> Row:
    """A distribution of facets, for directions above the horizon."""

    def call(of, **own):
        value = getattr(kind(**own), method)(_components(of))
        # As masking it is of order one where it vanishes itself.
        return 1 / (1 + value) if method == "smith_lambda" else value

    narrow = {name: scalar(0.01) for name in roughnesses}
    edges = {
        "normal": {"of": Unit(UP)},
        "roughness 1": {name: scalar(1.0) for name in roughnesses},
        "roughness .01": {**narrow, "of": Unit(directions([0.99995, 0.9999], [0.3, 4.0]))},
        "grazing": {"of": Unit(GRAZING)},
    }
    name = f"{kind.__name__}.{method}"
    return Row(name, call, {"of": Unit(HALF), **roughnesses}, edges)


COSINES = np.array([0.8, 0.3])
ENDS = {
    "head-on": {"cosines": Along(np.ones(2), -1.0)},
    "grazing": {"cosines": Along(np.zeros(2), 1.0)},
}
ONE_SIDED = dict.fromkeys(ENDS, "one-sided: a cosine lies from 0 to 1")

BANK = tuple(
    brdf.BankLobe(*shape)
    for shape in (("ggx", 0.3, 1.5), ("beckmann", 0.2), ("retro", 0.5), ("burley", 1.0))
)
ROWS = [
    *MODELS,
    model(
        "",
        brdf.Bank,
        {
            "kd": CHANNELS["kd"],
            "ks": np.array([[0.4, 0.3], [0.1, 0.2], [0.05, 0.1], [0.02, 0.03]]),
        },
        lobes=BANK,
    ),
    *TABLES,
    Row(
        "Mixture",
        _mixture,
        {
            "weights": np.array([[0.3, 0.8], [0.7, 0.2]]),
            "roughness": scalar(0.2),
            "exponent": scalar(5.0),
            **PAIR,
        },
        PLACES,
    ),
    Row(
        "IsotropicMean",
        _mean,
        {"roughness": scalar(0.2), "roughness_y": scalar(0.5), "kd": CHANNELS["kd"], **PAIR},
        PLACES,
    ),
    Row(
        "HeTorrance.specular_reflectance",
        lambda cosines, ks, **own: brdf.HeTorrance(
            ks, ks, wavelengths=np.array([0.6, 0.5], ks.dtype), **own
        ).specular_reflectance(cosines),
        {
            "cosines": COSINES,
            "ks": CHANNELS["ks"],
            "roughness": scalar(0.05),
            "correlation_length": scalar(1.5),
            **METAL,
        },
    ),
    Row(
        "TabulatedBRDF.at_places",
        lambda values, incoming, outgoing: brdf.TabulatedBRDF(values).at_places(incoming, outgoing),
        {
            "values": Above(np.abs(normal(4, 4, 4, 4, 2))),
            "incoming": np.array([[0.45, 0.52], [0.7, 0.33]]),
            "outgoing": np.array([[0.42, 0.57], [0.3, 0.44]]),
        },
    ),
    *(
        distribution(kind, method, **roughnesses)
        for method in ("density", "smith_lambda")
        for kind, roughnesses in (
            (brdf.Gaussian, {"roughness": scalar(0.3)}),
            (brdf.Beckmann, {"roughness": scalar(0.3), "roughness_y": scalar(0.5)}),
            (brdf.TrowbridgeReitz, {"roughness": scalar(0.3), "roughness_y": scalar(0.5)}),
        )
    ),
    Row(
        "v_groove_masking",
        lambda incoming, outgoing: brdf.v_groove_masking(
            brdf.Beckmann(0.3), _components(incoming), _components(outgoing)
        ),
        PAIR,
        {
            "head-on": PLACES["head-on"],
            "grazing": {"incoming": Unit(GRAZING[::-1]), "outgoing": Unit(GRAZING)},
        },
    ),
    Row(
        "smith_facet_masking",
        lambda roughness, incoming, outgoing: brdf.smith_facet_masking(
            brdf.Beckmann(roughness), _components(incoming), _components(outgoing)
        ),
        {"roughness": scalar(0.3), **PAIR},
        {name: PLACES[name] for name in ("head-on", "grazing")},
    ),
    Row(
        "smith_masking",
        brdf.smith_masking,
        {"sigma": scalar(0.3), "cos_incoming": COSINES, "cos_outgoing": COSINES[::-1]},
        {
            "sigma 1.5": {"sigma": scalar(1.5)},
            "head-on": {name: Along(np.ones(2), -1.0) for name in ("cos_incoming", "cos_outgoing")},
            "grazing": {"cos_incoming": Above(np.full(2, 0.02))},
        },
        {"head-on": ONE_SIDED["head-on"]},
    ),
    Row(
        "half_difference",
        lambda incoming, outgoing: brdf.half_difference(
            _components(incoming), _components(outgoing)
        ),
        PAIR,
        {name: PLACES[name] for name in ("head-on", "at the mirror", "coincident", "grazing")},
        kinks=dict.fromkeys(
            ("head-on", "at the mirror", "coincident"), "an angle that is nowhere negative is 0"
        ),
    ),
    Row(
        "microfacet_distribution",
        brdf.microfacet_distribution,
        {"squared_half_angle": np.array([0.02, 0.1]), "sigma": scalar(0.2)},
        {
            "0": {"squared_half_angle": np.zeros(2)},
            "sigma .01": {"squared_half_angle": np.array([1e-4, 2e-4]), "sigma": scalar(0.01)},
            "sigma 1.5": {"sigma": scalar(1.5)},
        },
    ),
    Row("fresnel", brdf.fresnel, {**MU, "cosines": COSINES}, INDICES | ENDS, ONE_SIDED),
    Row("normalised_fresnel", brdf.normalised_fresnel, {**MU, "cosines": COSINES}, INDICES),
    Row(
        "conductor_fresnel",
        brdf.conductor_fresnel,
        {"eta": scalar(0.14), "k": scalar(4.0), "cosines": COSINES},
        {"no absorption": {"eta": scalar(1.5), "k": np.array(0.0)}, **ENDS},
        ONE_SIDED,
    ),
    Row(
        "schlick_fresnel",
        brdf.schlick_fresnel,
        {"head_on": scalar(0.04), "cosines": COSINES},
        ENDS,
        ONE_SIDED,
    ),
    Row("head_on_reflectance", brdf.head_on_reflectance, MU, INDICES),
]

_FIT = "a fit on the host, of measurements"
_SETS = "numbers that are found on the host, for a whole table"
_NUMBER = "one number of a whole BRDF, found on the host by quadrature or random directions"
_BASE = "what such a BRDF is: its rows are those of the models"
_GIVEN = "what a function gives: numbers, no function"
EXCEPTIONS = {
    "*.transfer": "what evaluate is made of, and differentiated with it",
    "*.specular_transfer": "what evaluate is made of, and differentiated with it",
    "*.attenuated": "what evaluate is made of, and differentiated with it",
    "*.masked": "what evaluate is made of, and differentiated with it",
    "*.evaluate": "the rows named after a model are its evaluate",
    "*.with_amplitudes": "replaces numbers",
    "*.with_roughness": "replaces numbers",
    "*.draw": "random directions on the host, which jump from cell to cell",
    "*.density": "the density of random directions, constant in each cell",
    **dict.fromkeys(("BRDF", "Glossy", "Parametric", "WithoutIndex", "ByOwnNumber"), _BASE),
    "Distribution": "what a distribution is: its rows are those of the three",
    **dict.fromkeys(("fit_isotropic_table", "fit_zernike"), _FIT),
    **dict.fromkeys(("masked", "tabulate"), _SETS),
    **dict.fromkeys(
        (
            "nearest_energy_conserving",
            "nearest_isotropic",
            "nearest_reciprocal",
            "nearest_separable",
        ),
        _SETS,
    ),
    **dict.fromkeys(
        (
            "directional_albedo",
            "isotropy_error",
            "max_albedo",
            "reciprocity_error",
            "separability_error",
        ),
        _NUMBER,
    ),
    **dict.fromkeys(("brdf_named", "lobe_named", "material_named"), "of a name"),
    **dict.fromkeys(("HalfDifference", "Masked", "Nearest", "Samples"), _GIVEN),
    **dict.fromkeys(("ScatteredFit", "Searched", "ZernikeFit"), _GIVEN),
    **dict.fromkeys(("BankLobe", "standard_lobes"), "set shapes"),
    **dict.fromkeys(("ShapeParameter", "IndexParameter"), "a power, and a sum, of one number"),
    **dict.fromkeys(
        ("CosineSampler", "DirectionSampler", "TreeSampler"),
        "random directions, and a density that is constant in each cell",
    ),
    **dict.fromkeys(
        ("WaveletBRDF", "ScatteringTrees"), "of a tree: constant in each cell, or linear"
    ),
    "RglBRDF": "of a measured file: its warps are inverted in the file's cells",
}
