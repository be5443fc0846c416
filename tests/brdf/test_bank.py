"""A bank of lobes: each is what it is called, and together they are the material.

- A GGX lobe is that of ``Microfacet`` to rounding, a Beckmann one within a hundredth of it, where
  masking is a rational function in place of one with error functions.
- Every lobe is reciprocal to rounding, is isotropic, and is dark below the horizon; a retro lobe is
  brightest towards the light.
- A narrow lobe in single precision is that of double.
- What a bank says that it conserves it does; a mirror of a hundred per cent at each angle does not
  say so.
- It is the same in parts: narrow and broad, those in use, and written down and read again.
- A standard bank begins where it is asked to, and ends at the widest.
- Lobes that there are none of are refused.
"""

import numpy as np
import pytest

from jaxrender.brdf import Bank, BankLobe, Microfacet, max_albedo, standard_lobes
from jaxrender.geometry import Components

SEED, COUNT = 3, 400
# Two values of masking, each off by .4 % at most.
RATIONAL = 0.01


def directions(seed=SEED):
    drawn = np.random.default_rng(seed).normal(size=(2, COUNT, 3))
    drawn[..., 2] = np.abs(drawn[..., 2])
    return drawn / np.linalg.norm(drawn, axis=-1, keepdims=True)


def one(kind, width, mu=None):
    return Bank(np.zeros(1), np.ones((1, 1)), (BankLobe(kind, width, mu),))


def weighted(seed=0, scale=0.02):
    rng = np.random.default_rng(seed)
    bank = Bank.black(2)
    used = rng.uniform(size=len(bank.lobes)) < 0.3
    ks = scale * used[:, None] * rng.uniform(size=(len(bank.lobes), 2))
    return bank.with_amplitudes(np.array([0.1, 0.05]), *ks)


@pytest.mark.parametrize("mu", [None, 1.5])
@pytest.mark.parametrize("width", [0.03, 0.4, 1.0])
@pytest.mark.parametrize(("kind", "tolerance"), [("ggx", 1e-12), ("beckmann", RATIONAL)])
def test_facets_are_those_of_the_microfacet_model(kind, tolerance, width, mu):
    alone = Microfacet(np.zeros(1), np.ones(1), width, mu, "half", "smith", kind)
    expected = np.asarray(alone.evaluate(*directions()))
    found = np.asarray(one(kind, width, mu).evaluate(*directions()))
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=1e-12 * expected.max())


@pytest.mark.parametrize("lobe", Bank.black(1).lobes[::5], ids=lambda lobe: lobe.name)
def test_every_lobe_is_reciprocal_and_isotropic(lobe):
    incoming, outgoing = directions()
    bank = one(*lobe)
    there = np.asarray(bank.evaluate(incoming, outgoing))
    back = np.asarray(bank.evaluate(outgoing, incoming))
    np.testing.assert_allclose(back, there, rtol=1e-12, atol=1e-14 * there.max())
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1.0]])
    turned = np.asarray(bank.evaluate(incoming @ turn, outgoing @ turn))
    np.testing.assert_allclose(turned, there, rtol=1e-9, atol=1e-12 * there.max())
    assert not np.asarray(bank.evaluate(incoming * [1, 1, -1], outgoing)).any()


def test_a_retro_lobe_is_brightest_towards_the_light():
    incoming, outgoing = directions()
    lobe = np.asarray(one("retro", 0.2).evaluate(incoming, incoming))
    elsewhere = np.asarray(one("retro", 0.2).evaluate(incoming, outgoing))
    steep = incoming[:, 2] > 0.5
    assert lobe[steep].min() > np.median(elsewhere)


@pytest.mark.parametrize("kind", ["ggx", "beckmann"])
def test_a_narrow_lobe_in_single_precision_is_that_of_double(kind):
    rng = np.random.default_rng(SEED)
    outgoing = directions()[1]
    mirror = outgoing * [-1, -1, 1]
    incoming = mirror + 0.01 * rng.normal(size=mirror.shape)
    incoming /= np.linalg.norm(incoming, axis=-1, keepdims=True)
    few = [np.asarray(pair, np.float32) for pair in (incoming, outgoing)]
    bank = one(kind, 0.01, 1.5)
    found, exact = (
        np.asarray(bank.transfer(*(Components.of(pair.astype(dtype)) for pair in few))[1])
        for dtype in (np.float32, np.float64)
    )
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, exact, rtol=1e-3, atol=1e-3 * np.max(exact))


def test_what_conserves_energy_does():
    calm = weighted(scale=0.002)
    assert calm.conserves_energy
    assert max_albedo(calm) <= 1
    bright = one("ggx", 0.3, 1.5)
    assert not bright.conserves_energy
    assert weighted().reciprocal
    assert weighted().isotropic


def test_burleys_curve_stays_below_the_overshoot_that_is_stated():
    for roughness in (0.0, 1.0):
        bank = Bank(np.zeros(1), np.full((1, 1), 1 / np.pi), (BankLobe("burley", roughness),))
        assert max_albedo(bank) < 1.6


def test_a_material_is_the_same_in_parts_and_in_writing():
    bank = weighted()
    expected = np.asarray(bank.evaluate(*directions()))
    narrow, broad = bank.by_width
    parts = sum(np.asarray(part.evaluate(*directions())) for part in (narrow, broad))
    np.testing.assert_allclose(parts, expected, rtol=1e-12)
    assert narrow.width < 0.3 <= broad.width
    np.testing.assert_allclose(bank.in_use.evaluate(*directions()), expected, rtol=1e-12)
    assert len(bank.in_use.lobes) < len(bank.lobes)
    written = Bank.of_lobes(bank.in_use.as_lobes())
    np.testing.assert_array_equal(written.amplitudes, bank.in_use.amplitudes)
    assert written.lobes == bank.in_use.lobes


def test_sums_hold_every_amplitude_once():
    bank = weighted()
    assert bank.amplitudes.shape == (1 + len(bank.lobes), 2)
    assert len(bank.transfer(*map(Components.of, directions()))) == len(bank.amplitude_names)
    parts = [name for names in bank.sums.values() for name in names]
    assert sorted(parts) == sorted(bank.amplitude_names)
    assert not Bank.black(1).in_use.ks.any()


def test_a_standard_bank_begins_where_it_is_asked_to():
    for narrowest in (0.01, 0.1, 1.0):
        widths = [lobe.width for lobe in standard_lobes(narrowest) if lobe.about_mirror]
        assert narrowest / 1.47 < min(widths) <= narrowest * (1 + 1e-12)
        assert max(widths) == 1
    with pytest.raises(ValueError, match="narrowest"):
        standard_lobes(0.0)


@pytest.mark.parametrize(
    ("rows", "lobes", "words"),
    [
        (1, (BankLobe("phong", 0.1),), "kind='phong': choose one of ggx"),
        (1, (BankLobe("ggx", 0.0),), "width=0.0: must lie in"),
        (2, (BankLobe("ggx", 0.1),), "1 lobes where ks has 2 rows"),
        (2, (BankLobe("ggx", 0.1),) * 2, "ggx-0.1 is there twice"),
        (0, (), "without a lobe"),
    ],
)
def test_lobes_that_there_are_none_of_are_refused(rows, lobes, words):
    with pytest.raises(ValueError, match=words):
        Bank(np.zeros(1), np.zeros((rows, 1)), lobes)
