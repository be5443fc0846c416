"""Rows of models: of their parameters, and of those that are mixtures of others."""

import numpy as np

from jaxrender import brdf

from ..page import Above, Row
from .pairs import CHANNELS, COSINES, INDICES, MU, PAIR, PLACES, model, scalar, width

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
BANK = tuple(
    brdf.BankLobe(*shape)
    for shape in (("ggx", 0.3, 1.5), ("beckmann", 0.2), ("retro", 0.5), ("burley", 1.0))
)


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


ROWS = [
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
    model(
        "",
        brdf.AnisotropicGGX,
        {
            **CHANNELS,
            "roughness": scalar(0.2),
            "roughness_y": scalar(0.4, 1),
            **MU,
            "tangent_rotation": scalar(0.3, 2),
        },
        width("roughness", 0.01, 1.0) | INDICES,
    ),
    model(
        "",
        brdf.FreeFacets,
        {
            **CHANNELS,
            "sigma": scalar(0.2),
            "tail": scalar(2.3, 1.5),
            "wave_2": scalar(-0.2, -6.0),
            "wave_3": scalar(0.1, -6.0),
            "wave_4": scalar(0.05, -6.0),
            "rise_45": scalar(1.2),
            "rise_60": scalar(1.7, 1.0),
            "rise_75": scalar(2.8, 1.0),
            "rise_90": scalar(3.9, 1.0),
        },
        width("sigma", 0.01, 1.0),
    ),
    model("", brdf.KajiyaKay, {**CHANNELS, "exponent": scalar(20.0)}),
    model(
        "",
        brdf.PoulinFournier,
        {**CHANNELS, "exponent": scalar(40.0), "spacing": scalar(2.4), "height": scalar(0.7)},
        kinks={"coincident": "the arc that both directions see ends where either one's does"},
    ),
    model(
        "",
        brdf.Bank,
        {
            "kd": CHANNELS["kd"],
            "ks": np.array([[0.4, 0.3], [0.1, 0.2], [0.05, 0.1], [0.02, 0.03]]),
        },
        lobes=BANK,
    ),
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
]
