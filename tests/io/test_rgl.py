"""RGL's measured materials, and the container that they come in.

Pinned down: a container written by the format's own words comes back array by array, in every type;
materials, isotropic and with either symmetry, in RGB and in spectra, have the values of Mitsuba's
own plugin; a material made of nothing but ones is known in closed form; float32 and derivatives;
and every kind of bad file.
"""

import struct

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import BRDF
from jaxrender.errors import InputError
from jaxrender.io.rgl import read_rgl, read_tensors

TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8")

evaluate = eqx.filter_jit(BRDF.evaluate)
# As many in all tests, so that the programs are the same.
PAIRS = 60


def tensor_bytes(fields, version=(1, 0)):
    """Write header, fields, then the numbers, each at a multiple of 8."""
    sizes = [2 + len(name) + 2 + 1 + 8 + 8 * a.ndim for name, a in fields.items()]
    start, header, body = 18 + sum(sizes), b"", b""
    for name, array in fields.items():
        body += b"\0" * (-(start + len(body)) % 8)
        kind = TYPES.index(array.dtype.str[1:]) + 1
        header += struct.pack("<H", len(name)) + name.encode()
        header += struct.pack(
            f"<HBQ{array.ndim}Q", array.ndim, kind, start + len(body), *array.shape
        )
        body += array.tobytes()
    return b"tensor_file\0" + struct.pack("<BBI", *version, len(fields)) + header + body


def material(phi_i, channels=None, seed=0, scaled=True):
    """Draw a small material at random; two azimuths at most are an isotropic one."""
    rng = np.random.default_rng(seed)
    phi_i, theta_i = np.array(phi_i, np.float32), np.array([0, 0.4, 0.9, 1.5], np.float32)
    many = (len(phi_i), 4)

    def table(*shape):
        return rng.uniform(0.2, 2, shape).astype(np.float32)

    fields = {
        "theta_i": theta_i, "phi_i": phi_i, "ndf": table(6, 5), "sigma": table(4, 7),
        "vndf": table(*many, 8, 6), "luminance": table(*many, 5, 5),
        "description": np.frombuffer(b"made up", np.uint8),
        "jacobian": np.array([scaled], np.uint8),
    }  # fmt: skip
    if len(phi_i) < 3:
        fields["sigma"][:] = fields["sigma"][0]
        fields["vndf"][:] = fields["vndf"][0]
    if channels is None:
        fields["rgb"] = table(*many, 3, 5, 5)
    else:
        fields["spectra"] = table(*many, channels, 5, 5)
        fields["wavelengths"] = np.linspace(400, 700, channels).astype(np.float32)
    if len(phi_i) < 3:
        samples = fields["rgb" if channels is None else "spectra"]
        samples[:] = samples[0]
        # Mirrored about the plane of incidence, as isotropic materials are: with tables that are
        # not, Mitsuba's plugin has agreed with us in some runs and not in others.
        for table in (fields["ndf"], fields["vndf"], samples):
            table[:] = (table + table[..., ::-1, :]) / 2
    return fields


def written(tmp_path, fields):
    path = tmp_path / "m.bsdf"
    path.write_bytes(tensor_bytes(fields))
    return path


def random_pairs(count, seed=0):
    rng = np.random.default_rng(seed)
    cosine, turn = rng.uniform(0.1, 0.98, (2, count)), rng.uniform(0, 7, (2, count))
    sine = np.sqrt(1 - cosine**2)
    return tuple(np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=-1))


def test_a_container_comes_back(tmp_path):
    fields = {f"array {t}": np.arange(24, dtype=t).reshape(2, 3, 4) for t in TYPES}
    fields["none"] = np.zeros((0, 3))
    fields["one"] = np.array(7.0)
    found = read_tensors(written(tmp_path, fields))
    assert list(found) == list(fields)
    for name, array in fields.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


AZIMUTHS = {
    "isotropic": [0.0],
    "isotropic, two": [-np.pi, np.pi],
    "half a turn": np.linspace(-np.pi, 0, 4),
    "a quarter": np.linspace(-np.pi, -np.pi / 2, 3),
    "all around": np.linspace(-np.pi, np.pi, 5),
}


@pytest.mark.parametrize(
    ("name", "scaled"), [*((name, True) for name in AZIMUTHS), ("a quarter", False)]
)
def test_materials_are_mitsubas(tmp_path, name, scaled):
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    path = written(tmp_path, material(AZIMUTHS[name], scaled=scaled))
    brdf = read_rgl(path).brdf
    incoming, outgoing = random_pairs(PAIRS)
    plugin = mitsuba.load_dict({"type": "measured", "filename": str(path)})
    expected = [mitsuba_value(mitsuba, plugin, *pair) for pair in zip(incoming, outgoing)]
    found = np.asarray(evaluate(brdf, incoming, outgoing)) * outgoing[:, 2:]
    np.testing.assert_allclose(found, expected, rtol=2e-4)
    assert brdf.isotropic == name.startswith("isotropic")


def mitsuba_value(mitsuba, plugin, incoming, outgoing, wavelengths=None):
    place = mitsuba.SurfaceInteraction3f()
    place.wi = list(map(float, incoming))
    if wavelengths is not None:
        place.wavelengths = wavelengths
    return np.array(plugin.eval(mitsuba.BSDFContext(), place, list(map(float, outgoing))))


def test_spectra_are_mitsubas(tmp_path):
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_spectral")
    try:
        path = written(tmp_path, material([0.0], channels=7))
        found = read_rgl(path)
        assert found.wavelengths is not None
        np.testing.assert_allclose(found.wavelengths, np.linspace(400, 700, 7))
        plugin = mitsuba.load_dict({"type": "measured", "filename": str(path)})
        chosen = [400.0, 500.0, 650.0, 700.0]
        incoming, outgoing = random_pairs(20)
        expected = [
            mitsuba_value(mitsuba, plugin, *pair, chosen) for pair in zip(incoming, outgoing)
        ]
        values = np.asarray(evaluate(found.brdf, incoming, outgoing)) * outgoing[:, 2:]
        np.testing.assert_allclose(values[:, [0, 2, 5, 6]], expected, rtol=2e-4)
    finally:
        mitsuba.set_variant("scalar_rgb")


def test_ones(tmp_path):
    """f cos t_o = 1 * 1 / (4 * 1)."""
    ones = {name: np.ones_like(a) if a.ndim > 1 else a for name, a in material([0.0]).items()}
    incoming, outgoing = random_pairs(10)
    found = evaluate(read_rgl(written(tmp_path, ones)).brdf, incoming, outgoing)
    expected = np.broadcast_to(0.25 / outgoing[:, 2:], (10, 3))
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    brdf = read_rgl(written(tmp_path, ones)).brdf
    assert np.all(np.asarray(evaluate(brdf, -incoming, outgoing)) == 0)


def test_isotropic_whatever_the_tables_say(tmp_path):
    """Areas that depend on the azimuth, which Mitsuba would show."""
    fields = material([0.0])
    fields["sigma"] = np.random.default_rng(3).uniform(0.5, 2, (4, 7)).astype(np.float32)
    brdf = read_rgl(written(tmp_path, fields)).brdf
    incoming, outgoing = random_pairs(PAIRS)
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    found = evaluate(brdf, incoming @ turn, outgoing @ turn)
    np.testing.assert_allclose(found, evaluate(brdf, incoming, outgoing), rtol=1e-9)


def test_words_and_negative_samples(tmp_path):
    fields = material([0.0])
    fields["rgb"][0, 0, 0, :2] = -1
    found = read_rgl(written(tmp_path, fields))
    assert (found.description, found.wavelengths, found.negative) == ("made up", None, 10)
    assert float(np.min(found.brdf.samples)) == 0


def test_float32_and_derivatives(tmp_path):
    brdf = read_rgl(written(tmp_path, material([0.0]))).brdf
    pairs = random_pairs(PAIRS)
    single = evaluate(brdf, *(jnp.asarray(d, jnp.float32) for d in pairs))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, evaluate(brdf, *pairs), rtol=2e-4)
    # The normal, against itself, something above the horizon, and something below it.
    incoming = jnp.array([[0, 0, 1.0]] * 3)
    outgoing = jnp.array([[0, 0, 1.0], [0.6, 0, 0.8], [0.6, 0, -0.8]])
    found = jax.jit(jax.grad(lambda d: brdf.evaluate(d, outgoing).sum()))(incoming)
    assert np.isfinite(found).all()


def overlapping():
    """Three fields that are the same 800 bytes."""
    entries = b"".join(
        struct.pack("<H", 1) + name + struct.pack("<HBQQ", 1, 11, 90, 100)
        for name in (b"a", b"b", b"c")
    )
    return b"tensor_file\0" + struct.pack("<BBI", 1, 0, 3) + entries + b"\0" * 810


def test_bad_containers(tmp_path):
    good = tensor_bytes({"a": np.arange(6.0), "b": np.arange(4.0)})
    path = tmp_path / "m.bsdf"
    field = good.index(b"a", 12)
    enormous = struct.pack("<Q", 2**62)
    cases = {
        "opens with b''": b"",
        "opens with b'PK.*this is no tensor file": b"PK" * 40,
        "version 2.0; only 1.0": tensor_bytes({}, (2, 0)),
        "ends within its header": good[:30],
        "m.bsdf: ends within": good[:15],
        "'b' of shape .* ends at .*cut short": good[:-1],
        "'a' has type 77; known are 1 to 11": good[: field + 3] + b"\x4d" + good[field + 4 :],
        "shape .46116.* ends at": good[: field + 12] + enormous + good[field + 20 :],
        "bytes for fields of .*they overlap": overlapping(),
        "'a' occurs twice": good.replace(b"\x01\x00b", b"\x01\x00a"),
    }
    for expected, content in cases.items():
        path.write_bytes(content)
        with pytest.raises(InputError, match=rf"m\.bsdf: .*{expected}|{expected}"):
            read_tensors(path)
    with pytest.raises(InputError, match="no such file"):
        read_tensors(tmp_path / "nothing")


def changed(name, change):
    fields = material([0.0])
    fields[name] = change(fields[name])
    return fields


MATERIALS = {
    "no sigma": ({k: v for k, v in material([0.0]).items() if k != "sigma"}, "no field 'sigma'"),
    "no samples": ({k: v for k, v in material([0.0]).items() if k != "rgb"}, "no field 'spectra'"),
    "rank": (changed("vndf", lambda a: a[0]), r"'vndf' has shape \(4, 8, 6\); wanted 4 axes"),
    "empty": (changed("theta_i", lambda a: a[:0]), r"'theta_i' has shape \(0,\)"),
    "angles": (changed("theta_i", lambda a: a[:2]), r"'vndf' is for \(1, 4\) where .* \(1, 2\)"),
    "channels": (changed("rgb", lambda a: a[:, :, :2]), r"'rgb' is for \(1, 4, 2\) where"),
    "integers": (changed("ndf", lambda a: a.astype(np.int32)), "'ndf' holds int32; wanted float"),
    "descending": (changed("theta_i", lambda a: a[::-1].copy()), "theta_i=.* must ascend"),
    "nan": (changed("rgb", lambda a: a * np.nan), r"samples \(1, 4, 3, 5, 5\): give 2 x 2 finite"),
    "dark": (changed("vndf", lambda a: a * 0), "table 0 is zero everywhere; fetch"),
    "negative": (changed("vndf", lambda a: -a), "a density is negative"),
    "no area": (changed("sigma", lambda a: a * 0), "sigma is 0 somewhere: areas are positive"),
}


@pytest.mark.parametrize("case", MATERIALS)
def test_bad_materials(tmp_path, case):
    fields, expected = MATERIALS[case]
    with pytest.raises(InputError, match=rf"m\.bsdf: .*{expected}"):
        read_rgl(written(tmp_path, fields))
