"""Rows of the factors that models of facets share: distributions, masking, Fresnel reflection."""

import numpy as np

from jaxrender import brdf
from jaxrender.geometry import Components

from ..page import Above, Along, Row, Unit
from .pairs import COSINES, GRAZING, INDICES, MU, PAIR, PLACES, UP, directions, scalar

HALF = directions([0.9, 0.5], [0.3, 4.0])
ENDS = {
    "head-on": {"cosines": Along(np.ones(2), -1.0)},
    "grazing": {"cosines": Along(np.zeros(2), 1.0)},
}
ONE_SIDED = dict.fromkeys(ENDS, "one-sided: a cosine lies from 0 to 1")


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


ROWS = [
    *(
        distribution(kind, method, **roughnesses)
        for method in ("density", "smith_lambda")
        for kind, roughnesses in (
            (brdf.Gaussian, {"roughness": scalar(0.3)}),
            (brdf.Beckmann, {"roughness": scalar(0.3), "roughness_y": scalar(0.5)}),
            (brdf.TrowbridgeReitz, {"roughness": scalar(0.3), "roughness_y": scalar(0.5)}),
            (brdf.FreeDistribution, {"sigma": scalar(0.3)}),
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
