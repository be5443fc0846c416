"""Which models a config may name, which parameters each has, and what becomes of them.

- Every glossy model of ``brdf/`` that a fit knows by its name can be named, by the key that is its
  own field; a key that no model asked for has is refused, with the keys that there are.
- torrance-sparrow and cook-torrance have an index as the microfacets do; cook-torrance is
  ``CookTorrance`` with that index in all channels; lafortune is ``Lafortune`` with one lobe, whose
  C_z is stated and not searched for; he-torrance is ``HeTorrance`` of one wavelength and index, the
  deviation of its heights stated.
- Bounds of an exponent become bounds of a width, the other way around; fixed stays fixed.
- A model that is compared with another takes what is said of the parameters that it has; Fresnel
  and masking go along within a kind, ks where it is a weight of the same thing.
- Models whose lobe is not about R are known as such; Oren and Nayar's kd is an amplitude of its
  own, a roughness across the tangent is searched as an index.
- What only known light, or only a lobe about R, can do is refused elsewhere.
"""

import numpy as np
import pytest
from pydantic import ValidationError

from jaxrender.brdf import (
    PARAMETRIC,
    CookTorrance,
    CosineLobe,
    HeTorrance,
    Lafortune,
    Microfacet,
    OrenNayar,
    Phong,
    TorranceSparrow,
    Ward,
    material_named,
)
from jaxrender.catalogue import MODELS
from jaxrender.inverse.own_words import OwnWords
from jaxrender.pipelines.config import BrdfConfig, RunConfig, SolveConfig
from jaxrender.pipelines.config.recipe import RecipeBrdfConfig
from jaxrender.pipelines.scene import lobe_of, true_material, unknowns_of


def run(brdf, **more):
    capture = {"recipe": "r.yaml"}
    return RunConfig.model_validate({"task": "brdf", "capture": capture, "brdf": brdf, **more})


def test_the_models_of_the_config_are_those_of_the_brdfs():
    for name in MODELS:
        kind = PARAMETRIC.get(name, Microfacet)
        assert isinstance(lobe_of(BrdfConfig(model=name)), kind)


@pytest.mark.parametrize(
    ("brdf", "fault"),
    [
        (
            {"model": "ward", "mu": "none"},
            r"brdf.mu: found 'none', but model ward \(kd, ks, roughness\) has no mu; "
            "remove it, or choose another model",
        ),
        (
            {"model": "microfacet", "exponent": 3},
            r"model microfacet \(kd, ks, sigma, mu, fresnel, masking\) has no exponent",
        ),
        (
            {"model": "phong", "compare": ["ward"], "sigma": 0.1},
            "model phong .* and ward .* has no sigma",
        ),
        ({"model": "ward", "roughness": 1.5}, "every value here must be above 0 and at most 1"),
        ({"model": "lambertian", "compare": ["ggx"], "sigma": 2}, "found sigma 2 with model ggx"),
        ({"compare": ["gxx"]}, "Input should be"),
        (
            {"model": "torrance-sparrow", "sigma": 0.1},
            r"model torrance-sparrow \(kd, ks, roughness, mu\) has no sigma",
        ),
        (
            {"model": "cook-torrance", "roughness": 1.5},
            "every value here must be above 0 and at most 1",
        ),
        ({"model": "torrance-sparrow", "masking": "smith"}, "has no masking"),
        ({"model": "torrance-sparrow", "mu": 0.9}, "every value here must be above 1"),
        ({"model": "phong", "c_z": 0.9}, r"model phong \(kd, ks, exponent\) has no c_z"),
        ({"model": "lafortune", "c_z": 0}, "greater than 0"),
        ({"model": "lafortune", "deviation": 1}, "has no deviation"),
        ({"model": "ward", "sigma": "free", "roughness": 0.1}, "brdf.sigma: found 'free', but"),
    ],
)
def test_foreign_keys_are_refused(brdf, fault):
    with pytest.raises(ValidationError, match=fault):
        run(brdf)


def test_an_exponent_is_searched_as_what_it_is():
    config = run({"model": "phong", "exponent": {"bounds": [2, 50], "start": 8}})
    unknowns = unknowns_of(config, 1)
    exponent = unknowns["exponent"]
    assert (exponent.lower, exponent.start, exponent.upper) == (2, 8, 50)
    assert unknowns.free_numbers == ("exponent",)
    fixed = run({"model": "blinn-phong", "exponent": 50})
    assert unknowns_of(fixed, 1)["exponent"].fixed == (50,)


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


def test_a_ladder_chooses_the_models_itself():
    brdf = BrdfConfig.model_validate({"compare": "auto", "kd": 0.1, "masking": "none"})
    assert brdf.models == ("lambertian", "ggx", "two-ggx", "bank")
    ggx = brdf.as_model("ggx")
    assert (ggx.kd.fixed, ggx.fresnel, ggx.masking) == (0.1, "half", "none")


@pytest.mark.parametrize(
    ("sections", "fault"),
    [
        (
            {"task": "texture", "brdf": {"model": "ward"}},
            "brdf.model: found 'ward', but task texture under known light fits facets",
        ),
        (
            {"task": "lighting", "brdf": {"model": "ward", "kd": 0.1, "ks": 0.1}},
            "needs a known material; fix roughness, or choose",
        ),
        (
            {"task": "factorize", "brdf": {"model": "oren-nayar", "kd": 0.2}},
            "a diffuse object shows only the product of light and kd",
        ),
        (
            {"solve": {"interreflection": True}, "brdf": {"compare": ["bank"]}},
            "model bank is fitted once, before there is light that bounces",
        ),
        (
            {"solve": {"model": "azimuthal"}, "brdf": {"model": "anisotropic-ward"}},
            "model anisotropic-ward has no lobe about the reflected direction",
        ),
        (
            {"task": "texture", "texture": {"size": 8}, "brdf": {"compare": ["ggx"]}},
            "known light fits one model; remove it, or choose task: brdf or factorize",
        ),
        (
            {"task": "lighting", "brdf": {"kd": 1, "compare": ["ggx"]}},
            "task lighting knows the material; remove it, or choose task: brdf or factorize",
        ),
        ({"task": "factorize", "solve": {"interreflection": True}}, "or choose task: brdf "),
        (
            {"solve": {"interreflection": True}, "lighting": {"free_scale": True}},
            "lighting.free_scale leaves open the albedo that bounced light needs",
        ),
        ({"task": "factorize", "solve": {"model": "shrm"}}, "found 'shrm', but task factorize"),
    ],
)
def test_what_only_known_light_can_do(sections, fault):
    with pytest.raises(ValidationError, match=fault):
        RunConfig.model_validate({"task": "brdf", "capture": {"recipe": "r.yaml"}, **sections})


def test_bounces_need_the_refinement():
    with pytest.raises(ValidationError, match=r"or choose solve\.refine: exact"):
        run({}, solve={"interreflection": True, "refine": "off"})


def test_the_reflection_maps_model_has_its_own_filter():
    chosen = SolveConfig.model_validate({"model": "shrm", "view_degree": 6})
    azimuthal = SolveConfig.model_validate({"model": "azimuthal"})
    assert azimuthal.transfer_name == "azimuthal-4"
    assert (chosen.transfer_name, SolveConfig().transfer_name) == ("shrm-6", "exit-cosine")
    with pytest.raises(ValidationError, match=r"solve\.model: shrm has a filter of its own"):
        run({}, solve={"model": "shrm", "transfer": "gaussian"})
    with pytest.raises(ValidationError, match=r"solve\.model: dual has no degree of the viewer"):
        run({}, solve={"view_degree": 6})
    with pytest.raises(ValidationError, match="less than or equal to 12"):
        SolveConfig.model_validate({"model": "shrm", "view_degree": 13})


def test_a_result_gives_its_material_back():
    kd = [0.1, 0.2, 0.3]
    ward = material_named("ward", {"kd": kd, "ks": 0.1, "roughness": 0.23})
    assert isinstance(ward, Ward)
    phong = material_named("phong", {"kd": kd, "ks": [0.1, 0.2, 0.1], "exponent": 17.0})
    assert isinstance(phong, Phong)
    assert (float(ward.roughness), float(phong.exponent)) == pytest.approx((0.23, 17.0))
    np.testing.assert_array_equal(ward.ks, np.full(3, 0.1))
    np.testing.assert_array_equal(phong.kd, kd)


def test_facets_with_a_reflectance_have_an_index_or_none():
    config = run({"model": "torrance-sparrow", "mu": {"bounds": [1.2, 2]}, "roughness": 0.2})
    lobe, unknowns = lobe_of(config.brdf), unknowns_of(config, 1)
    assert lobe.mu is not None
    assert (unknowns["mu"].lower, unknowns["mu"].upper) == (1.2, 2)
    assert unknowns["roughness"].fixed == (0.2,)
    metal = run({"model": "cook-torrance", "mu": "none", "compare": ["ggx", "torrance-sparrow"]})
    assert lobe_of(metal.brdf).mu is None
    assert unknowns_of(metal, 1).free_numbers == ("roughness",)
    for model in metal.brdf.models:
        assert lobe_of(metal.brdf.as_model(model)).mu is None


def test_ks_goes_along_where_it_means_the_same():
    brdf = BrdfConfig(model="torrance-sparrow", compare=("cook-torrance", "ggx"), ks=1.0, kd=0.1)
    clean, other = (brdf.as_model(name) for name in brdf.models[1:])
    assert (clean.ks.fixed, clean.kd.fixed) == (1.0, 0.1)
    assert (other.ks.free, other.kd.fixed) == (True, 0.1)


def test_a_stated_number_of_the_lobe_goes_through():
    brdf = BrdfConfig.model_validate({"model": "ward", "compare": ["lafortune"], "c_z": 0.9})
    lobe = lobe_of(brdf.as_model("lafortune"))
    assert isinstance(lobe, CosineLobe)
    assert float(lobe.c_z) == pytest.approx(0.9)


def at_some_directions(brdf):
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(2, 50, 3))
    directions[..., 2] = np.abs(directions[..., 2])
    return brdf.evaluate(*directions / np.linalg.norm(directions, axis=-1, keepdims=True))


@pytest.mark.parametrize(
    ("stated", "twin"),
    [
        ({"model": "torrance-sparrow", "ks": 1.0, "roughness": 0.3, "mu": 1.5}, "torrance-sparrow"),
        ({"model": "cook-torrance", "ks": 0.7, "roughness": 0.3, "mu": 1.5}, "cook-torrance"),
        ({"model": "lafortune", "ks": 0.6, "exponent": 9.5, "c_z": 0.9}, "lafortune"),
        (
            {"model": "he-torrance", "ks": 0.7, "roughness": 0.3, "mu": 1.5, "deviation": 0.3},
            "he-torrance",
        ),
    ],
)
def test_recipe_and_result_make_the_model_of_the_registry(stated, twin):
    kd = np.array([0.1, 0.2, 0.3])
    ks = np.full(3, stated["ks"])
    twins = {
        "torrance-sparrow": TorranceSparrow(kd, ks, 0.3, 1.5),
        "cook-torrance": CookTorrance(kd, ks, 0.3, np.full(3, 1.5), np.zeros(3)),
        "lafortune": Lafortune(kd, ks[None], np.array([[-1, -1, 0.9]]), np.array([9.5])),
        # Any wavelength: lengths count by it.
        "he-torrance": HeTorrance(kd, ks, 0.15, 1.0, np.full(3, 0.5), np.full(3, 1.5), np.zeros(3)),
    }
    expected = at_some_directions(twins[twin])
    recipe = RecipeBrdfConfig.model_validate({**stated, "kd": kd.tolist()})
    for made in (true_material(recipe), material_named(twin, {**stated, "kd": kd.tolist()})):
        np.testing.assert_allclose(at_some_directions(made), expected, rtol=1e-9)
    with pytest.raises(ValidationError, match="missing: ks"):
        RecipeBrdfConfig.model_validate(
            {key: value for key, value in stated.items() if key != "ks"} | {"kd": kd.tolist()}
        )


def test_the_albedo_of_grooves_is_an_amplitude_of_its_own():
    """There is no base under it."""
    config = run({"model": "oren-nayar", "kd": [0.2, 0.1, 0.1]})
    unknowns = unknowns_of(config, 1)
    assert unknowns.amplitude_names == ("kd",)
    assert unknowns["kd"].fixed == (0.2, 0.1, 0.1)
    assert unknowns.coloured == ("kd",)
    assert unknowns.free_numbers == ("sigma",)
    stated = {"model": "oren-nayar", "kd": [0.2, 0.1, 0.1], "sigma": 0.4}
    material = true_material(RecipeBrdfConfig.model_validate(stated))
    twin = OrenNayar(np.array([0.2, 0.1, 0.1]), 0.4, qualitative=True)
    pair = np.array([[0.3, 0.1, 0.7], [-0.5, 0.4, 0.6]])
    pair = pair / np.linalg.norm(pair, axis=1, keepdims=True)
    np.testing.assert_allclose(material.evaluate(*pair), twin.evaluate(*pair), rtol=1e-12)
    words = OwnWords("oren-nayar", material)
    assert words.names == ["kd", "sigma"]


def test_a_second_roughness_is_searched_as_what_it_is():
    free = unknowns_of(run({"model": "anisotropic-ward"}), 1)["roughness_y"]
    assert (free.lower, free.upper) == pytest.approx((0.02, 1.0))
    bounded = {"model": "anisotropic-ward", "roughness_y": {"bounds": [0.1, 0.5], "start": 0.2}}
    searched = unknowns_of(run(bounded), 1)["roughness_y"]
    assert (searched.lower, searched.start, searched.upper) == (0.1, 0.2, 0.5)
    fixed = run({"model": "anisotropic-ward", "roughness_y": 0.3})
    assert unknowns_of(fixed, 1)["roughness_y"].fixed == (0.3,)
    numbers = {"kd": [0.1] * 3, "ks": [0.2] * 3, "roughness": 0.1, "roughness_y": 0.3}
    brdf = {"model": "anisotropic-ward", **numbers}
    material = true_material(RecipeBrdfConfig.model_validate(brdf))
    assert float(material.roughness_y) == pytest.approx(0.3)
    assert float(material.mu) == pytest.approx(1.3)
    again = material_named("anisotropic-ward", brdf)
    assert float(again.roughness_y) == pytest.approx(0.3)
