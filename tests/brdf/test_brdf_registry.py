"""Models by name, and the measures of reciprocity and albedo themselves.

Pinned down: each name makes its class from lists; a wrong name or parameter names the nearest one;
a missing one is named; each refusal names value and remedy; traced values are not looked at; the
albedo of a constant is pi times it whichever direction is fixed, that of a narrow lobe is stable in
the number of nodes, and the thesis's excess at grazing is ERRATA 25's.
"""

import jax
import numpy as np
import pytest

from jaxrender.brdf import (
    BRDFS,
    CookTorrance,
    HeTorrance,
    Lambertian,
    Microfacet,
    Mixture,
    OrenNayar,
    Phong,
    TorranceSparrow,
    Ward,
    brdf_named,
    directional_albedo,
    max_albedo,
    reciprocity_error,
)

KD, KS = np.array([0.1, 0.2]), np.array([0.3, 0.4])
ALBEDO = 1e-4  # what directional_albedo promises


def test_a_name_says_what_its_model_fixes_and_chooses():
    ggx = brdf_named("ggx", kd=KD, ks=KS, sigma=0.2, mu=1.5)
    assert (ggx.distribution, ggx.fresnel, ggx.masking) == ("ggx", "half", "smith")
    assert brdf_named("ggx", kd=KD, ks=KS, sigma=0.2, mu=1.5, masking="none").masking == "none"
    with pytest.raises(ValueError, match="ggx has no parameter 'distribution'"):
        brdf_named("ggx", kd=KD, ks=KS, sigma=0.2, mu=1.5, distribution="beckmann")
    cook = brdf_named("cook-torrance", kd=KD, ks=KS, roughness=0.2, mu=1.5)
    assert isinstance(cook, TorranceSparrow)
    assert cook.distribution == "beckmann"
    grooves = brdf_named("oren-nayar", kd=[0.1, 0.2], sigma=0.3)
    np.testing.assert_array_equal(grooves.amplitudes, [KD])


def test_a_name_and_lists_make_a_model():
    brdf = brdf_named("phong", kd=[0.1, 0.2], ks=[0.3, 0.4], exponent=20)
    assert isinstance(brdf, Phong)
    np.testing.assert_array_equal(brdf.amplitudes, [KD, KS])
    lambertian = brdf_named("lambertian", kd=[0.1])
    mixed = brdf_named("mixture", parts=(lambertian,), weights=[[0.5]])
    assert isinstance(mixed, BRDFS["mixture"])


@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("blin-phong", {}, "no BRDF is named 'blin-phong', did you mean 'blinn-phong'"),
        ("xyz", {}, "no BRDF is named 'xyz'; choose one of microfacet, ggx, beckmann"),
        (
            "ward",
            {"kd": [0.1], "ks": [0.1], "roughnes": 0.1},
            "ward has no parameter 'roughnes', did you mean 'roughness'",
        ),
        ("phong", {"kd": [0.1]}, "phong needs a value for ks, exponent"),
        ("phong", {"kd": [0.1], "ks": [0.1], "exponent": -1.0}, r"exponent=-1.0: must lie in \[0"),
        (
            "oren-nayar",
            {"kd": [0.1], "sigma": 30.0},
            "sigma=30.0: must lie in .* it is in radians, 30 degrees are .52",
        ),
        ("poulin-fournier", {"spacing": 1.5}, "spacing=1.5: .* cylinders of radius 1 touch at 2"),
        ("poulin-fournier", {"height": 0.0}, "height=0.0: must lie in"),
        ("torrance-sparrow", {"roughness": 2.0}, "roughness=2.0: must lie in"),
        ("torrance-sparrow", {"roughness": 0.1, "mu": 1.0}, "mu=1.0: .* None sets the Fresnel"),
        (
            "torrance-sparrow",
            {"roughness": 0.1, "masking": "v"},
            "masking='v': choose one of none, smith, smith-separate, v-groove",
        ),
        (
            "torrance-sparrow",
            {"roughness": 0.1, "distribution": "phong"},
            "distribution='phong': choose one of gaussian, beckmann, ggx",
        ),
        (
            "torrance-sparrow",
            {"roughness": 0.1, "roughness_y": 0.2},
            "roughness_y=0.2: the Gaussian distribution is isotropic",
        ),
        ("ward", {"roughness": 0.1, "normalisation": "none"}, "choose one of ward, duer, bounded"),
        ("ward", {"roughness": 0.1, "roughness_y": 0.0}, "roughness_y=0.0"),
        (
            "cook-torrance-conductor",
            {"roughness": 0.1, "eta": [1.0, 1.0], "k": [1.0]},
            "eta has 2 channels where kd has 1",
        ),
        (
            "cook-torrance-conductor",
            {"roughness": 0.1, "eta": [1.0], "k": [-1.0]},
            "k=.*absorption is positive here",
        ),
        (
            "lafortune-lobes",
            {"ks": [[0.1]], "coefficients": [[1.0, 1.0, 1.0]], "exponents": [1.0, 2.0]},
            r"ks, coefficients and exponents have \(1, 1, 2\) lobes",
        ),
        ("mixture", {"parts": (Lambertian(KD),), "weights": [[1.0]]}, "weights has 1 channels"),
        ("mixture", {"parts": (), "weights": [[1.0]]}, "parts=0 and weights=1"),
    ],
)
def test_misuse_is_refused_with_a_remedy(name, parameters, message):
    common = {"kd": [0.1], "ks": [0.1]} if name not in ("oren-nayar", "mixture", "phong") else {}
    if name == "poulin-fournier":
        common["exponent"] = 10.0
    with pytest.raises(ValueError, match=message):
        brdf_named(name, **common | parameters)


def test_he_torrances_lengths_are_positive():
    good = {
        "kd": KD,
        "ks": KS,
        "roughness": 0.1,
        "correlation_length": 1.0,
        "wavelengths": KS,
        "eta": KS,
        "k": KS,
    }
    HeTorrance(**good)
    for name in ("roughness", "correlation_length"):
        with pytest.raises(ValueError, match=f"{name}=0.0: .* unit of the wavelengths"):
            HeTorrance(**good | {name: 0.0})
    with pytest.raises(ValueError, match="wavelengths has 1 channels where kd has 2"):
        HeTorrance(**good | {"wavelengths": np.ones(1)})


def test_traced_values_are_not_looked_at():
    def value(x):
        models = (
            TorranceSparrow(KD, KS, x, 1 + x),
            Ward(KD, KS, x),
            OrenNayar(KD, x),
            Phong(KD, KS, x),
            CookTorrance(KD, KS, x, KD + x, KS + x),
        )
        up = np.array([[0.6, 0, 0.8]])
        return sum(model.evaluate(up, up).sum() for model in models)

    assert np.isfinite(jax.jit(jax.grad(value))(0.3))


@pytest.mark.parametrize("fixed", ["incoming", "outgoing"])
def test_albedo_of_a_constant(fixed):
    found = directional_albedo(Lambertian(KD), [1.0, 0.3, 0.01], fixed)
    np.testing.assert_allclose(found, np.tile(np.pi * KD, (3, 1)), rtol=1e-10)


def test_albedo_of_a_narrow_lobe_is_accurate():
    """ERRATA 25's numbers for sigma = .2, and both directions of a reciprocal model."""
    thesis = Microfacet(np.zeros(1), np.ones(1), 0.2, None)
    cosines = np.cos(np.radians([0, 70, 85]))
    found = [directional_albedo(thesis, cosines, fixed)[:, 0] for fixed in ("incoming", "outgoing")]
    np.testing.assert_allclose(found[0], [0.974, 0.938, 1.207], atol=6e-4)
    np.testing.assert_allclose(*found, rtol=1e-9)
    narrow = Ward(np.zeros(1), np.ones(1), 0.05, 0.3, "bounded")
    coarse, fine = (
        directional_albedo(narrow, [0.7, 0.1, 0.02], azimuth=0.8, nodes=n) for n in (96, 160)
    )
    np.testing.assert_allclose(coarse, fine, atol=ALBEDO)


def test_albedo_tells_the_directions_of_phong_apart():
    """Uniform light seen in Phong's lobe is at most 1; light from grazing leaves manifold."""
    phong = Phong(np.zeros(1), np.ones(1), 30.0)
    assert directional_albedo(phong, [0.02], "outgoing")[0, 0] < 1
    assert directional_albedo(phong, [0.02], "incoming")[0, 0] > 3
    assert max_albedo(phong, [1.0, 0.02]) > 3


def test_reciprocity_error_sees_a_lobe_at_the_exit_angle():
    assert reciprocity_error(Microfacet(KD, KS, 0.1, 1.5)) > 0.1
    assert reciprocity_error(Mixture((Lambertian(KD),), np.ones((1, 2)))) == 0


def test_wrong_arguments_of_the_albedo_are_refused():
    with pytest.raises(ValueError, match="fixed='exit': choose one of incoming, outgoing"):
        directional_albedo(Lambertian(KD), [1.0], "exit")
    with pytest.raises(ValueError, match=r"cosine=0.0: must lie in \(0, 1\]"):
        directional_albedo(Lambertian(KD), [0.0])
