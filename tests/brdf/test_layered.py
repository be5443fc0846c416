"""The materials of renderers hold what their specifications and physics say.

- A white openpbr surface gives back all the light of a white furnace, of any roughness and index;
  a white metal too, where facets hand light on; coat and fuzz take some, and add none.
- The tabulated albedo of an interface is the integral of its lobe.
- ``metallic-roughness`` is the formula of glTF 2.0, ``principled`` is Mitsuba's and its coat that
  of Disney's own code, which Mitsuba's is without 1 / (4 cos t_i cos t_o).  ``openpbr`` of metal is
  Mitsuba's but for the masking, and with ``specular_color`` it is darker at 82 degrees.
- A turned tangent is a turned surface.  Numbers outside their intervals are refused by name.
"""

import numpy as np
import pytest
from brdf_problems import direction, upper_directions

from jaxrender.brdf import (
    MetallicRoughness,
    Microfacet,
    OpenPBR,
    Principled,
    fresnel,
    head_on_reflectance,
    schlick_fresnel,
)
from jaxrender.brdf.layer_albedo import interface_albedo, mean_interface_albedo, sheen_albedo
from jaxrender.brdf.sheen import sheen
from jaxrender.geometry import Components

WHITE = np.ones(1)
COLOR = np.array([0.2, 0.5, 0.8])
CLEAR = np.ones(3)
OUT = np.array([0.1, 0.4, 0.7, 1.0])


def reflected(brdf, cosine, nodes=(400, 300)):
    """Integrate what leaves for one direction, all light being alike."""
    x, w = np.polynomial.legendre.leggauss(nodes[0])
    azimuth = 2 * np.pi * (np.arange(nodes[1]) + 0.5) / nodes[1]
    incoming = direction(((x + 1) / 2)[:, None], azimuth[None])
    outgoing = np.broadcast_to(direction(cosine, 0.0), incoming.shape)
    values = np.asarray(brdf.evaluate(incoming, outgoing))[..., 0] * incoming[..., 2]
    return float(np.sum(values * (w / 2)[:, None]) * 2 * np.pi / nodes[1])


@pytest.mark.parametrize("multiple_scattering", ["none", "facets"])
@pytest.mark.parametrize(("roughness", "ior"), [(0.5, 1.5), (0.8, 1.3), (1.0, 2.2)])
def test_a_white_surface_keeps_nothing(roughness, ior, multiple_scattering):
    white = OpenPBR(WHITE, WHITE, 0.0, roughness, ior, multiple_scattering=multiple_scattering)
    for cosine in OUT:
        assert reflected(white, cosine) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("roughness", [0.5, 0.8, 1.0])
def test_a_white_metal_keeps_nothing_where_facets_hand_light_on(roughness):
    alone = OpenPBR(WHITE, WHITE, 1.0, roughness)
    together = OpenPBR(WHITE, WHITE, 1.0, roughness, multiple_scattering="facets")
    for cosine in OUT:
        assert reflected(together, cosine) == pytest.approx(1, abs=1e-3)
    assert reflected(alone, 0.7) < 0.995


def test_layers_add_no_light():
    for layers in ({"coat_weight": 1.0}, {"fuzz_weight": 1.0, "fuzz_roughness": 0.25}):
        covered = OpenPBR(WHITE, WHITE, 0.3, 0.6, multiple_scattering="facets", **layers)
        for cosine in (0.02, *OUT):
            assert 0.2 < reflected(covered, cosine) < 1 + 1e-3


@pytest.mark.parametrize("mu", [None, 1.25, 1.5, 2.5])
def test_the_albedo_of_an_interface_is_the_integral_of_its_lobe(mu):
    roughness = 0.65
    lobe = Microfacet(0 * WHITE, WHITE, roughness**2, mu, "half", "smith", "ggx")
    head_on = 1 if mu is None else float(head_on_reflectance(mu))
    exact = [head_on * reflected(lobe, cosine) for cosine in OUT]
    np.testing.assert_allclose(interface_albedo(roughness, mu, OUT), exact, atol=1e-3)
    x, w = np.polynomial.legendre.leggauss(32)
    cosines = (x + 1) / 2
    mean = np.sum(w * cosines * np.asarray(interface_albedo(roughness, mu, cosines)))
    assert float(mean_interface_albedo(roughness, mu, OUT)) == pytest.approx(mean, abs=1e-6)


def test_a_smooth_interface_reflects_as_fresnel_says():
    cosines = np.linspace(0.15, 1, 30)
    found = interface_albedo(0.05, 1.5, cosines)
    np.testing.assert_allclose(found, fresnel(1.5, cosines), atol=2e-3)


def test_sheen_reflects_most_at_grazing_angles_and_never_all():
    found = np.asarray(sheen_albedo(0.25, np.linspace(0.001, 1, 50)))
    assert np.all(np.diff(found) < 0)
    assert 0.9 < found[0] < 1
    incoming, outgoing = upper_directions(200_000, 11, 0), direction(np.full(200_000, 0.3), 0.0)
    lobe = sheen(0.4, Components.of(incoming), Components.of(outgoing))
    # Directions are alike over the hemisphere, of area 2 pi.
    assert 2 * np.pi * np.mean(lobe) == pytest.approx(
        float(sheen_albedo(0.4, OUT[1:2] * 0.75)[0]), abs=2e-3
    )
    covered = OpenPBR(0 * WHITE, 0 * WHITE, 1.0, 0.5, fuzz_weight=0.5, fuzz_roughness=0.4)
    bare = OpenPBR(0 * WHITE, WHITE, 1.0, 0.5, fuzz_weight=0.5, fuzz_roughness=0.4)
    assert reflected(covered, 0.3) == 0 < reflected(bare, 0.3)


def test_metallic_roughness_is_the_formula_of_gltf():
    """Appendix B of the specification, by itself."""
    incoming, outgoing = upper_directions(500, 1), upper_directions(500, 2)
    metallic, roughness = 0.35, 0.6
    brdf = MetallicRoughness(COLOR, CLEAR, metallic, roughness)
    half = incoming + outgoing
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    n_l, n_v, n_h = incoming[:, 2], outgoing[:, 2], half[:, 2]
    v_h = np.sum(outgoing * half, axis=1)
    squared = roughness**4
    density = squared / (np.pi * (n_h**2 * (squared - 1) + 1) ** 2)
    visibility = 1.0
    for cosine in (n_l, n_v):
        visibility = visibility / (cosine + np.sqrt(squared + (1 - squared) * cosine**2))
    specular = (visibility * density)[:, None]
    growth = ((1 - np.abs(v_h)) ** 5)[:, None]
    dielectric = COLOR / np.pi + (specular - COLOR / np.pi) * (0.04 + 0.96 * growth)
    metal = specular * (COLOR + (1 - COLOR) * growth)
    expected = dielectric + metallic * (metal - dielectric)
    np.testing.assert_allclose(brdf.evaluate(incoming, outgoing), expected, rtol=1e-10)


def of_mitsuba(mitsuba, plugin, incoming, outgoing):
    made = mitsuba.load_dict(plugin)
    found = []
    for one, other in zip(incoming, outgoing):
        surface = mitsuba.SurfaceInteraction3f()
        surface.wi = mitsuba.Vector3f(*other)
        value = made.eval(mitsuba.BSDFContext(), surface, mitsuba.Vector3f(*one))
        found.append(np.ravel(np.asarray(value))[:3] / one[2])
    return np.array(found)


@pytest.fixture(scope="module")
def mitsuba():
    found = pytest.importorskip("mitsuba")
    found.set_variant("scalar_rgb")
    return found


def test_principled_is_mitsubas(mitsuba):
    incoming, outgoing = upper_directions(200, 3, 0.15), upper_directions(200, 4, 0.15)
    brdf = Principled(COLOR, CLEAR, 0.3 * CLEAR, 0 * CLEAR, 0.25, 0.6, 0.4)
    plugin = {
        "type": "principled",
        "base_color": {"type": "rgb", "value": COLOR.tolist()},
        "metallic": 0.25,
        "roughness": 0.6,
        "specular": 0.4,
        "sheen": 0.3,
    }
    expected = of_mitsuba(mitsuba, plugin, incoming, outgoing)
    found = np.asarray(brdf.evaluate(incoming, outgoing))
    np.testing.assert_allclose(found, expected, rtol=5e-3)


def test_the_clear_coat_is_disneys():
    """As ``disney.brdf`` of the BRDF explorer has it, by itself."""
    incoming, outgoing = upper_directions(300, 9), upper_directions(300, 10)
    amount, gloss = 0.7, 0.3
    plain, coated = (
        Principled(COLOR, CLEAR, 0 * CLEAR, coat * CLEAR, 0.25, 0.6, 0.4, gloss)
        for coat in (0, amount)
    )
    half = incoming + outgoing
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    squared = (0.1 * (1 - gloss) + 0.001 * gloss) ** 2
    density = (squared - 1) / (np.pi * np.log(squared) * (1 + (squared - 1) * half[:, 2] ** 2))
    reflectance = 0.04 + 0.96 * (1 - np.sum(incoming * half, axis=1)) ** 5
    shading = 1.0
    for cosine in (incoming[:, 2], outgoing[:, 2]):
        shading = shading / (cosine + np.sqrt(0.25**2 + cosine**2 - 0.25**2 * cosine**2))
    expected = 0.25 * amount * density * reflectance * shading
    found = np.asarray(coated.evaluate(incoming, outgoing) - plain.evaluate(incoming, outgoing))
    np.testing.assert_allclose(found, np.repeat(expected[:, None], 3, 1), rtol=1e-8)


def test_openpbr_of_metal_is_mitsubas_but_for_the_masking(mitsuba):
    """Mitsuba's facets mask and shadow apart from each other; the ratio is known."""
    incoming, outgoing = upper_directions(200, 5, 0.15), upper_directions(200, 6, 0.15)
    metal = {"metallic": 1.0, "roughness": 0.4}
    plugin = {
        "type": "principled",
        "base_color": {"type": "rgb", "value": COLOR.tolist()},
        **metal,
    }
    expected = of_mitsuba(mitsuba, plugin, incoming, outgoing)
    apart = np.asarray(MetallicRoughness(COLOR, CLEAR, **metal).evaluate(incoming, outgoing))
    np.testing.assert_allclose(apart, expected, rtol=5e-3)
    found = np.asarray(OpenPBR(COLOR, CLEAR, 1.0, 0.4).evaluate(incoming, outgoing))
    squared = 0.4**4
    one, other = (
        (np.sqrt(1 + squared * (1 / side[:, 2] ** 2 - 1)) - 1) / 2 for side in (incoming, outgoing)
    )
    ratio = (1 + one) * (1 + other) / (1 + one + other)
    np.testing.assert_allclose(found / ratio[:, None], expected, rtol=5e-3)


def test_a_metal_is_darker_at_82_degrees():
    """The reflectance is ``specular_color`` times Schlick's there, and head-on as it was."""
    for cosine, tint in ((1 / 7, 0.6), (1.0, 1.0)):
        out = direction(np.array([cosine]), np.array([0.0]))
        mirror = out * [-1, -1, 1]
        values = [
            np.asarray(OpenPBR(COLOR, CLEAR, 1.0, 0.3, specular_color=c).evaluate(mirror, out))
            for c in (1.0, 0.6)
        ]
        np.testing.assert_allclose(values[1] / values[0], tint, rtol=1e-10)
        lobe = Microfacet(np.zeros(3), CLEAR, 0.09, None, "half", "smith", "ggx")
        schlick = np.array([float(schlick_fresnel(c, np.array(cosine))) for c in COLOR])
        expected = np.asarray(lobe.evaluate(mirror, out)) * schlick
        np.testing.assert_allclose(values[0], expected, rtol=1e-10)


def test_a_turned_tangent_is_a_turned_surface():
    incoming, outgoing = upper_directions(100, 7), upper_directions(100, 8)
    angle = 0.7
    turn = np.array(
        [[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    brushed = {"specular_roughness_anisotropy": 0.7}
    turned = OpenPBR(COLOR, CLEAR, 0.5, 0.5, tangent_rotation=angle, **brushed)
    plain = OpenPBR(COLOR, CLEAR, 0.5, 0.5, **brushed)
    expected = plain.evaluate(incoming @ turn.T, outgoing @ turn.T)
    np.testing.assert_allclose(turned.evaluate(incoming, outgoing), expected, rtol=1e-10)
    # Longest along the tangent: as much light comes from further away there.
    head_on = np.array([0.0, 0.0, 1.0])
    along, across = (np.array([*aside, 0.8]) for aside in ([0.6, 0], [0, 0.6]))
    assert plain.evaluate(along, head_on)[0] > plain.evaluate(across, head_on)[0]


@pytest.mark.parametrize(
    ("kind", "numbers", "message"),
    [
        (OpenPBR, {"base_metalness": 1.2, "specular_roughness": 0.3}, "base_metalness"),
        (OpenPBR, {"base_metalness": 0, "specular_roughness": 0.0}, "specular_roughness"),
        (MetallicRoughness, {"metallic": 0, "roughness": 0.3, "ior": 0.9}, "ior"),
        (
            OpenPBR,
            {"base_metalness": 0, "specular_roughness": 0.3, "multiple_scattering": "all"},
            "choose one of none, facets",
        ),
    ],
)
def test_numbers_outside_their_intervals_are_refused(kind, numbers, message):
    with pytest.raises(ValueError, match=message):
        kind(COLOR, CLEAR, **numbers)
