"""Any isotropic BRDF as RGL's table, and the container as it is written.

- Arrays of every type come back from a written container; what has no type there is refused.
- A table comes back as the BRDF, by our reader: in the mean over a cosine within 1.5 %, for matt,
  glossy and narrow lobes.  Mitsuba's plugin reads the same values.
- Of a BRDF that is not reciprocal either direction may come first.
"""

import equinox as eqx
import numpy as np
import pytest

from jaxrender.brdf import (
    BRDF,
    AnisotropicWard,
    Exchanged,
    Lambertian,
    MetallicRoughness,
    Microfacet,
    tabulate_rgl,
)
from jaxrender.brdf.tables.rgl_tabulation import RglSize
from jaxrender.io import read_rgl, read_tensors, write_rgl, write_tensors

TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8")
KD, CLEAR = np.array([0.2, 0.15, 0.1]), np.ones(3)
SMALL = RglSize(samples=64)
evaluate = eqx.filter_jit(BRDF.evaluate)

MATERIALS = {
    "matt": Lambertian(KD),
    "thesis": Microfacet(KD, 0.12 * CLEAR, 0.25, 1.6),
    "narrow": Microfacet(KD, 0.3 * CLEAR, 0.05, 1.5, "half", "smith", "ggx"),
    # Straight back it is even but for rounding.
    "base": MetallicRoughness(0.9 * CLEAR, 0 * CLEAR, 0.0, 0.4),
}


def pairs(count=400, least=0.25):
    """Pairs about the mirror direction, none near grazing."""
    rng = np.random.default_rng(3)
    cosine, turn = rng.uniform(least, 0.98, count), rng.uniform(0, 7, count)
    tilt, around = np.pi / 2 * rng.uniform(0, 0.7, count) ** 2, rng.uniform(0, 7, count)
    incoming, half = (
        np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
        for t, p in ((np.arccos(cosine), turn), (tilt, around))
    )
    outgoing = 2 * np.sum(incoming * half, axis=1, keepdims=True) * half - incoming
    kept = outgoing[:, 2] > least
    return incoming[kept][:150], outgoing[kept][:150]


def test_a_written_container_comes_back(tmp_path):
    fields = {f"array {t}": np.arange(24, dtype=t).reshape(2, 3, 4) for t in TYPES}
    fields |= {"none": np.zeros((0, 3)), "one": np.array(7.0)}
    fields["turned"] = np.asfortranarray(fields["array f4"])
    write_tensors(tmp_path / "all.bsdf", fields)
    found = read_tensors(tmp_path / "all.bsdf")
    assert list(found) == list(fields)
    for name, array in fields.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


def test_what_has_no_type_is_refused(tmp_path):
    with pytest.raises(ValueError, match="'a' holds complex128"):
        write_tensors(tmp_path / "a.bsdf", {"a": np.zeros(2, complex)})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", MATERIALS)
def test_a_table_is_the_material(tmp_path, name):
    brdf = MATERIALS[name]
    write_rgl(tmp_path / "m.bsdf", tabulate_rgl(brdf, size=SMALL), "made up")
    read = read_rgl(tmp_path / "m.bsdf")
    assert (read.description, read.negative, read.wavelengths) == ("made up", 0, None)
    incoming, outgoing = pairs()
    expected = np.asarray(evaluate(brdf, incoming, outgoing))
    found = np.asarray(evaluate(read.brdf, incoming, outgoing))
    assert np.abs(found / expected - 1).mean() < 0.012
    assert np.sum(found) / np.sum(expected) == pytest.approx(1, abs=0.015)


def test_either_direction_may_come_first(tmp_path):
    """The thesis's Fresnel ratio depends on the exit angle alone."""
    brdf, (incoming, outgoing) = MATERIALS["thesis"], pairs()
    write_rgl(tmp_path / "m.bsdf", tabulate_rgl(brdf, "outgoing", SMALL))
    found = np.asarray(evaluate(Exchanged(read_rgl(tmp_path / "m.bsdf").brdf), incoming, outgoing))
    expected = np.asarray(evaluate(brdf, incoming, outgoing))
    assert np.abs(found / expected - 1).mean() < 0.01
    backwards = np.asarray(evaluate(brdf, outgoing, incoming))
    assert np.abs(backwards / expected - 1).mean() > 0.03


def test_mitsuba_reads_the_same(tmp_path):
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    brdf, (incoming, outgoing) = MATERIALS["thesis"], pairs()
    write_rgl(tmp_path / "m.bsdf", tabulate_rgl(brdf, "outgoing", SMALL))
    plugin = mitsuba.load_dict({"type": "measured", "filename": str(tmp_path / "m.bsdf")})
    found = []
    for light, camera in zip(incoming, outgoing):
        surface = mitsuba.SurfaceInteraction3f()
        surface.wi = mitsuba.Vector3f(*camera)
        value = plugin.eval(mitsuba.BSDFContext(), surface, mitsuba.Vector3f(*light))
        found.append(np.ravel(np.asarray(value))[:3] / light[2])
    expected = np.asarray(evaluate(brdf, incoming, outgoing))
    assert np.abs(np.array(found) / expected - 1).mean() < 0.01


def test_misuse_is_named(tmp_path):
    with pytest.raises(ValueError, match="choose one of incoming, outgoing"):
        tabulate_rgl(MATERIALS["matt"], "both")
    with pytest.raises(ValueError, match="anisotropic"):
        tabulate_rgl(AnisotropicWard(KD, 0.1 * CLEAR, 0.2, 0.4))
    grey = tabulate_rgl(Lambertian(np.array([0.2])), size=SMALL)
    with pytest.raises(ValueError, match="1 channels; give three"):
        write_rgl(tmp_path / "m.bsdf", grey)
