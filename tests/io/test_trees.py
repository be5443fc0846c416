"""Coefficient trees in files.

- What is read is what was written, bit for bit: every wavelet, 1 to 4 axes, either precision, trees
  without coefficients, moved samples, and all that a tree was made from.
- Others open the file, and find the function's values with what stands in it alone (levels and
  places are not in it).
- 32^4 samples in RGB at 1 % of the coefficients are less than 400 kB.
- What no tree is made of is refused by name, place and remedy, before memory is taken.
"""

import dataclasses
import sys
from pathlib import Path

import h5netcdf
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.io.tree_layout import TreeAbout
from jaxrender.io.trees import read_tree, write_tree
from jaxrender.wavelets import (
    WAVELETS,
    CoefficientTree,
    analyse_nonstandard,
    daubechies,
    haar,
    keep_fraction,
)

AXES = ("u", "v", "s", "t")


HAAR = haar()


def a_tree(wavelet=HAAR, size=8, axes=4, channels=3, fraction=0.2) -> CoefficientTree:
    samples = np.random.default_rng(axes).normal(size=(*(size,) * axes, channels))
    kept = keep_fraction(analyse_nonstandard(wavelet, jnp.asarray(samples)), fraction, joint=True)
    return CoefficientTree.of_coefficients(wavelet, kept.coefficients)


def about(tree: CoefficientTree, **changes) -> TreeAbout:
    plain = TreeAbout("test", "none", AXES[: tree.axes], "1", "plain")
    return plain._replace(**changes)


BRDF = TreeAbout(
    "paint.brdf",
    channels="rgb",
    relative_rms=0.25,
    relative_rms_between=0.3,
    non_zero=812,
    comment="1 %",
)


@pytest.fixture
def path(tmp_path):
    write_tree(tmp_path / "tree.nc", a_tree(), BRDF)
    return tmp_path / "tree.nc"


def same(found: CoefficientTree, written: CoefficientTree) -> bool:
    return found.structure == written.structure and all(
        np.asarray(getattr(found, p)).tobytes() == np.asarray(getattr(written, p)).tobytes()
        for p in ("root", "values")
    )


@pytest.mark.parametrize("axes", [1, 2, 3, 4])
@pytest.mark.parametrize("wavelet", [*WAVELETS.values(), daubechies(3)], ids=lambda w: w.name)
def test_round_trip(tmp_path, wavelet, axes):
    tree = dataclasses.replace(a_tree(wavelet, 4, axes), offset=0.3)
    write_tree(tmp_path / "tree.nc", tree, about(tree), np.float64)
    found, described = read_tree(tmp_path / "tree.nc")
    assert same(found, tree)
    assert (found.wavelet, found.size, found.offset) == (wavelet, 4, 0.3)
    assert np.isnan([described.relative_rms, described.relative_rms_between]).all()
    known = {"relative_rms": 0.0, "relative_rms_between": 0.0}
    assert described._replace(**known) == about(tree, **known)
    assert [p.name for p in tmp_path.iterdir()] == ["tree.nc"]


def test_precision_and_description(path):
    found, described = read_tree(path)
    assert found.values.dtype == found.root.dtype == np.float32
    np.testing.assert_array_equal(found.values, np.asarray(a_tree().values).astype(np.float32))
    assert described == BRDF


def test_wavelengths_and_nothing_but_a_mean(tmp_path):
    bare = CoefficientTree.of_coefficients(haar(), jnp.zeros((4, 4, 2)).at[0, 0].set(3.0))
    spectral = about(bare, channels="wavelengths", wavelengths=(450.0, 600.5))
    write_tree(tmp_path / "tree.nc", bare, spectral)
    found, described = read_tree(tmp_path / "tree.nc")
    assert described.wavelengths == (450.0, 600.5)
    assert found.count == 1
    np.testing.assert_allclose(found.samples(), np.full((4, 4, 2), 0.75), rtol=1e-6)


def test_the_file_explains_itself(tmp_path):
    """A Haar tree evaluated from the file's own words: masks, products, normalisation."""
    tree = a_tree(axes=2, fraction=0.5)
    write_tree(tmp_path / "tree.nc", tree, about(tree), np.float64)
    with h5netcdf.File(tmp_path / "tree.nc", "r") as file:
        assert "2^(l/2) gamma(2^l q_a - m_a)" in file.attrs["formula_meaning"]
        assert set(file.variables) == {"child_mask", "value_mask", "root", "values"}
        children, held = file["child_mask"][...], file["value_mask"][...]
        root, values = file["root"][...], file["values"][...]
        assert children.dtype == held.dtype == np.uint16
    point = np.array([0.3, 0.8])
    total, rank, nodes = root.copy(), 0, [(0, (0, 0))]
    for number, (level, place) in enumerate(nodes):
        inner = 2**level * point - place
        inside = bool(np.all((inner >= 0) & (inner < 1)))
        for nu in np.flatnonzero([held[number] >> bit & 1 for bit in range(16)]):
            wave = [1 if not (nu >> a & 1) or inner[a] < 0.5 else -1 for a in range(2)]
            total += inside * 2.0**level * np.prod(wave) * values[rank]
            rank += 1
        for b in np.flatnonzero([children[number] >> bit & 1 for bit in range(16)]):
            nodes.append((level + 1, tuple(2 * m + (int(b) >> a & 1) for a, m in enumerate(place))))
    assert rank == len(values)
    np.testing.assert_allclose(total, tree.samples()[2, 6], rtol=1e-12)


def test_a_percent_of_a_large_table_is_small(tmp_path):
    """As many random places and numbers as 1 % of all 32^4: nothing to be compressed."""
    rng = np.random.default_rng(0)
    coefficients = np.zeros((32**4, 3), np.float32)
    kept = np.append(0, rng.choice(32**4, 32**4 // 100, replace=False))
    coefficients[kept] = rng.normal(size=(len(kept), 3))
    tree = CoefficientTree.of_coefficients(haar(), coefficients.reshape(*(32,) * 4, 3))
    write_tree(tmp_path / "tree.nc", tree, BRDF)
    assert (tmp_path / "tree.nc").stat().st_size < 400_000


def odd_wavelet():
    return dataclasses.replace(a_tree(), wavelet=haar()._replace(name="mine"))


@pytest.mark.parametrize(
    ("tree", "described", "precision", "message"),
    [
        (a_tree(), BRDF, np.float16, "choose numpy.float32 or numpy.float64"),
        (odd_wavelet(), BRDF, np.float32, "has no name in files"),
        (a_tree(), BRDF._replace(embedding="disc"), np.float32, "wanted one of none, nusselt"),
        (a_tree(channels=2), BRDF, np.float32, "2 channels called rgb"),
        (a_tree(), BRDF._replace(wavelengths=(400.0,)), np.float32, "1 wavelengths; wanted 0"),
        (a_tree(), BRDF._replace(axis_names=("x",)), np.float32, "1 names of axes and 4 axes"),
        (
            dataclasses.replace(a_tree(), root=np.array([1.0, 1e300, 1.0])),
            BRDF,
            np.float32,
            "not finite as float32",
        ),
    ],
)
def test_misuse_writes_nothing(tmp_path, tree, described, precision, message):
    with pytest.raises(ValueError, match=message):
        write_tree(tmp_path / "tree.nc", tree, described, precision)
    assert not list(tmp_path.iterdir())


# h5netcdf's own destructor stumbles over a file that it could not open.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_no_damaged_byte_ends_in_anything_but_an_input_error(path):
    whole = bytearray(path.read_bytes())
    refused = 0
    for place in np.random.default_rng(1).choice(len(whole), 150, replace=False):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        try:
            read_tree(path)
        except InputError:
            refused += 1
    assert refused > 20


def changed(path: Path, name: str, change):
    """Write an array of a file anew."""
    with h5netcdf.File(path, "a") as file:
        array = np.array(file[name][...])
        file[name][...] = change(array)


def put(place, value):
    def change(array):
        array[place] = value
        return array

    return change


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("values", put((5, 1), np.nan), "`values` at value 5, channel 1 is nan"),
        ("root", put(2, np.inf), "`root` at channel 2 is inf"),
        ("value_mask", put(3, 0), "values, and masks that name"),
        ("value_mask", lambda a: a | 1, "bit 0, the scaling function's"),
        ("child_mask", put(0, 0xFFF), "`child_mask` of node .* is at level 3"),
        ("child_mask", lambda a: np.full_like(a, 0), "the child masks name 0 children"),
        ("child_mask", lambda a: np.full_like(a, 1), "is at level 3, and the size has 3"),
    ],
)
def test_damaged_arrays(path, name, change, message):
    changed(path, name, change)
    with pytest.raises(InputError, match=message) as caught:
        read_tree(path)
    assert str(path) in str(caught.value)
    assert "write it again" in str(caught.value)


def test_stray_bits(tmp_path):
    tree = a_tree(axes=2)
    write_tree(tmp_path / "tree.nc", tree, about(tree))
    changed(tmp_path / "tree.nc", "value_mask", put(1, 0x12))
    with pytest.raises(InputError, match="value mask 0x12 of node 1 has stray bits"):
        read_tree(tmp_path / "tree.nc")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("size", 12, "`size` is 12, no power of two"),
        ("size", 0, "`size` is 0, no power of two"),
        ("size", "8", "`size` is '8'; wanted a whole number"),
        ("size", 2**40, "62 bits tell a place"),
        ("size", 2, "the size has 1"),
        ("axes", 9, "`axes` is 9; wanted 1 to 4"),
        ("wavelet", "morlet", "no wavelet is named 'morlet'"),
        ("offset", 7.0, "`offset` is 7.0; wanted 0 to 1"),
        ("embedding", "disc", "`embedding` is 'disc'"),
    ],
)
def test_wrong_attributes(path, name, value, message):
    with h5netcdf.File(path, "a") as file:
        file.attrs[name] = value
    with pytest.raises(InputError, match=message):
        read_tree(path)


def test_missing_parts(path):
    with h5netcdf.File(path, "a") as file:
        del file.attrs["units"]
    with pytest.raises(InputError, match="no attribute `units`"):
        read_tree(path)


@pytest.mark.skipif(sys.platform == "win32", reason="asks for peak memory by resource")
def test_absurd_sizes_take_no_memory(tmp_path, path):
    """Arrays of terabytes that a file of a few kB declares."""
    with h5netcdf.File(path, "r") as file:
        described = dict(file.attrs)
    for name, dimensions in (("child_mask", ("node",)), ("values", ("value", "channel"))):
        huge = tmp_path / "huge.nc"
        with h5netcdf.File(huge, "w") as file:
            file.attrs.update(described)
            sizes = {"node": 3, "value": 2, "channel": 3, dimensions[0]: 2**42}
            file.dimensions = sizes
            kinds = {"child_mask": "u2", "value_mask": "u2", "root": "f4", "values": "f4"}
            places = {"root": ("channel",), "values": ("value", "channel")}
            for part, kind in kinds.items():
                where = places.get(part, ("node",))
                chunks = tuple(min(sizes[d], 3) for d in where)
                file.create_variable(part, where, dtype=kind, chunks=chunks)
        with pytest.raises(InputError, match=f"`{name}` has .* numbers; wanted 1 to"):
            read_tree(huge)
