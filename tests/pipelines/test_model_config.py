"""Which models a config may name, which parameters each has, and what becomes of them.

- Every glossy model of ``brdf/`` that a fit knows by its name can be named, by the key that is its
  own field; a key that no model asked for has is refused, with the keys that there are.
- Bounds of an exponent become bounds of a width, the other way around; fixed stays fixed.
- A model that is compared with another takes what is said of the parameters that it has; Fresnel
  and masking go along within a kind.
- What only known light can do is refused elsewhere.
"""

import numpy as np
import pytest
from pydantic import ValidationError

from jaxrender.brdf import SIMPLE_GLOSSY, Microfacet, Phong, Ward
from jaxrender.pipelines.config import BrdfConfig, RunConfig, SolveConfig
from jaxrender.pipelines.config.brdf import _KEYS, FACET_MODELS
from jaxrender.pipelines.render import material_of
from jaxrender.pipelines.scene import lobe_of, unknowns_of


def run(brdf, **more):
    capture = {"recipe": "r.yaml"}
    return RunConfig.model_validate({"task": "brdf", "capture": capture, "brdf": brdf, **more})


def test_the_models_of_the_config_are_those_of_the_brdfs():
    assert set(_KEYS) == {*FACET_MODELS, "lambertian", *SIMPLE_GLOSSY}
    for name, model in SIMPLE_GLOSSY.items():
        assert model.shape.name in _KEYS[name]
        assert isinstance(lobe_of(BrdfConfig(model=name)), model)
    assert isinstance(lobe_of(BrdfConfig(model="ggx")), Microfacet)


@pytest.mark.parametrize(
    ("brdf", "fault"),
    [
        (
            {"model": "ward", "mu": "none"},
            "found mu with model ward, which has kd, ks, roughness; "
            "remove the key, or choose another model",
        ),
        (
            {"model": "microfacet", "exponent": 3},
            "found exponent with model microfacet, which has kd, ks, sigma, mu, fresnel, masking",
        ),
        ({"model": "phong", "compare": ["ward"], "sigma": 0.1}, "with model phong and ward"),
        ({"model": "ward", "roughness": 1.5}, "every value here must be at most 1"),
        ({"model": "lambertian", "compare": ["ggx"], "sigma": 2}, "found sigma 2.0 with model ggx"),
        ({"compare": ["gxx"]}, "Input should be"),
    ],
)
def test_foreign_keys_are_refused(brdf, fault):
    with pytest.raises(ValidationError, match=fault):
        BrdfConfig.model_validate(brdf)


def test_an_exponent_is_searched_as_a_width():
    config = run({"model": "phong", "exponent": {"bounds": [2, 50], "start": 8}})
    sigma = unknowns_of(config, 1).sigma
    assert (sigma.lower, sigma.start, sigma.upper) == pytest.approx((0.1, 0.25, 0.5))
    assert unknowns_of(config, 1).mu is None
    fixed = run({"model": "blinn-phong", "exponent": 50})
    assert unknowns_of(fixed, 1).sigma.fixed == pytest.approx((0.2,))


def test_a_comparison_takes_what_each_model_has():
    brdf = BrdfConfig.model_validate(
        {
            "model": "ggx",
            "masking": "none",
            "compare": ["ward", "beckmann", "microfacet", "ward"],
            "kd": 0.1,
            "sigma": {"bounds": [0.1, 0.4]},
            "roughness": 0.3,
        }
    )
    assert brdf.models == ("ggx", "ward", "beckmann", "microfacet")
    ward, beckmann, thesis = (brdf.as_model(name) for name in brdf.models[1:])
    assert (ward.kd.fixed, ward.roughness.fixed, ward.sigma.free) == (0.1, 0.3, True)
    assert (beckmann.fresnel, beckmann.masking) == ("half", "none")
    assert (thesis.fresnel, thesis.masking, thesis.sigma.bounds) == ("exit", "none", (0.1, 0.4))
    assert thesis.compare == ()


@pytest.mark.parametrize(
    ("sections", "fault"),
    [
        ({"task": "factorize", "brdf": {"model": "ward"}}, "fitted under known light only"),
        ({"task": "factorize", "brdf": {"compare": ["ggx"]}}, "brdf.compare is for task: brdf"),
        ({"task": "factorize", "solve": {"interreflection": True}}, "is for task: brdf"),
        (
            {"solve": {"interreflection": True}, "lighting": {"free_scale": True}},
            "bounced light tells by the albedo",
        ),
        ({"task": "factorize", "solve": {"model": "shrm"}}, "shrm is for a material under known"),
    ],
)
def test_what_only_known_light_can_do(sections, fault):
    with pytest.raises(ValidationError, match=fault):
        RunConfig.model_validate({"task": "brdf", "capture": {"recipe": "r.yaml"}, **sections})


def test_bounces_need_the_refinement():
    with pytest.raises(ValidationError, match="remove refine: off"):
        SolveConfig.model_validate({"interreflection": True, "refine": "off"})


def test_the_reflection_maps_model_has_its_own_filter():
    chosen = SolveConfig.model_validate({"model": "shrm", "view_degree": 6})
    azimuthal = SolveConfig.model_validate({"model": "azimuthal"})
    assert azimuthal.transfer_name == "azimuthal-4"
    assert (chosen.transfer_name, SolveConfig().transfer_name) == ("shrm-6", "exit-cosine")
    with pytest.raises(ValidationError, match="has its own filter; remove transfer"):
        SolveConfig.model_validate({"model": "shrm", "transfer": "gaussian"})
    with pytest.raises(ValidationError, match="view_degree belongs to models"):
        SolveConfig.model_validate({"view_degree": 6})
    with pytest.raises(ValidationError, match="less than or equal to 12"):
        SolveConfig.model_validate({"model": "shrm", "view_degree": 13})


def test_a_result_gives_its_material_back():
    kd = [0.1, 0.2, 0.3]
    ward = material_of({"model": "ward", "kd": kd, "ks": 0.1, "roughness": 0.23})
    assert isinstance(ward, Ward)
    phong = material_of({"model": "phong", "kd": kd, "ks": [0.1, 0.2, 0.1], "exponent": 17.0})
    assert isinstance(phong, Phong)
    assert (float(ward.roughness), float(phong.exponent)) == pytest.approx((0.23, 17.0))
    np.testing.assert_array_equal(ward.ks, np.full(3, 0.1))
    np.testing.assert_array_equal(phong.kd, kd)
