"""NetCDF files of any arrays.

- What is read is what was written: numbers of any type, truth values, texts, groups, attributes.
- Every file says what wrote it, in xarray too; many numbers are packed, few are not.
- A file appears whole or not at all.
- A file that is missing, damaged, cut short or foreign is refused by name, with a remedy.
- What a file lacks, or has otherwise than it is asked for, is named with its group.
"""

from typing import NamedTuple

import h5netcdf
import numpy as np
import pytest
import scipy.io
import xarray

from jaxrender import __version__
from jaxrender.errors import InputError
from jaxrender.io.netcdf import Format, Group, Variable, opened, write

POEM = Format("a poem", 2, "poet --rhyme")
OTHER = Format("a song", 1, "singer")
VALUES = {
    "numbers": np.arange(12.0).reshape(3, 4),
    "few": np.float32([0.5, np.nan, np.inf]),
    "whole": np.array([1, 2, 3], np.uint16),
    "truths": np.array([True, False, True]),
    "texts": np.array(["a", "", "é"], object),
    "many": np.arange(3000.0).reshape(3, 1000),
}
DIMENSIONS = {"numbers": ("row", "column"), "many": ("row", "place")}


class About(NamedTuple):
    author: str
    lines: int = 0
    metre: float = 0.0


ABOUT = About("anon", 14, 1.5)


def variables():
    return {
        name: Variable(DIMENSIONS.get(name, ("row",)), values, "1", f"the {name}", ("texts",))
        for name, values in VALUES.items()
    }


@pytest.fixture
def path(tmp_path):
    inner = Group({"numbers": Variable(("row",), [1.0, 2.0], "m", "")}, {"key": 3})
    write(tmp_path / "a.nc", POEM, Group(variables(), ABOUT._asdict(), {"inner": inner}))
    return tmp_path / "a.nc"


def test_round_trip(path):
    with opened(path, OTHER, POEM) as file:
        assert file.format == POEM
        assert file.attributes == ABOUT._asdict()
        assert file.record(About) == ABOUT
        assert file.record(About, lines=3) == ABOUT._replace(lines=3)
        for name, values in VALUES.items():
            found = file.array(name)
            assert found.dtype == values.dtype
            np.testing.assert_array_equal(found, values)
        inner = file.group("inner")
        np.testing.assert_array_equal(inner.array("numbers", ("row",)), [1, 2])
        assert inner.attribute("key", int) == inner.one_of("key", (2, 3)) == 3
        assert "inner" in file
        assert "few" in file
        assert "few" not in inner
    assert [p.name for p in path.parent.iterdir()] == ["a.nc"]


def test_others_read_what_wrote_it_and_what_it_holds(path):
    with xarray.open_dataset(path, engine="h5netcdf") as found:
        assert found.attrs["format"] == "a poem"
        assert found.attrs["format_version"] == 2
        assert found.attrs["program"] == f"jaxrender {__version__}"
        assert found["numbers"].dims == ("row", "column")
        assert found["numbers"].attrs == {"units": "1", "long_name": "the numbers"}
        assert "texts" in found["numbers"].coords
        assert found["truths"].dtype == bool


def test_many_numbers_are_packed(path):
    with h5netcdf.File(path) as file:
        assert (file["many"].compression, file["many"].shuffle) == ("gzip", True)
        assert file["numbers"].compression is None


def test_either_byte_order(tmp_path):
    write(
        tmp_path / "a.nc", POEM, Group({"a": Variable(("row",), np.array([1.5], ">f8"), "1", "")})
    )
    with opened(tmp_path / "a.nc", POEM) as file:
        assert file.array("a", types=(np.float64,)).dtype.isnative


def test_an_attribute_cannot_hide_the_format(tmp_path):
    write(tmp_path / "a.nc", POEM, Group(attributes={"format": "prose"}))
    with opened(tmp_path / "a.nc", POEM) as file:
        assert file.attributes == {}


def test_nothing_is_half_written(path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    before = path.read_bytes()
    monkeypatch.setattr(h5netcdf.File, "create_variable", full)
    with pytest.raises(OSError, match="No space"):
        write(path, POEM, Group(variables()))
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == ["a.nc"]
    with pytest.raises(InputError, match=r"no such folder .*none; make it first"):
        write(path.parent / "none" / "a.nc", POEM, Group())


@pytest.mark.parametrize(
    ("shape", "dimensions", "message"),
    [
        ((0,), ("row",), r"b: shape \(0,\) for \(row\); give a size from 1"),
        ((3,), ("row", "column"), r"b: shape \(3,\) for \(row, column\)"),
        ((4,), ("row",), "b: row is 4, and 3 elsewhere"),
    ],
)
def test_impossible_arrays_are_not_written(tmp_path, shape, dimensions, message):
    first = Variable(("row",), np.zeros(3), "1", "")
    arrays = {"a": first, "b": Variable(dimensions, np.zeros(shape), "1", "")}
    with pytest.raises(ValueError, match=message):
        write(tmp_path / "a.nc", POEM, Group(arrays))
    assert not list(tmp_path.iterdir())


def test_other_files(tmp_path, path):
    text, classic, other = (tmp_path / name for name in ("text.nc", "classic.nc", "other.nc"))
    text.write_text("P 2\n")
    with scipy.io.netcdf_file(classic, "w") as file:
        file.createDimension("row", 3)
    with h5netcdf.File(other, "w") as file:
        file.dimensions = {"row": 3}
    later = tmp_path / "later.nc"
    write(later, POEM._replace(version=3), Group())
    for wrong, message in (
        (
            tmp_path / "none.nc",
            "none.nc: no such file; mend the path, or write it again with `poet",
        ),
        (tmp_path, "a folder; give the path of the file inside it"),
        (text, "text.nc: not a NetCDF-4 file; give one that `poet --rhyme` wrote"),
        (classic, "classic.nc: a NetCDF file of the classic format; convert it to NetCDF-4"),
        (
            other,
            "other.nc: `format` is None; wanted 'a poem': give a file that `poet --rhyme` wrote",
        ),
        (later, "`format_version` is 3; this program reads version 2: take the program that wrote"),
    ):
        with pytest.raises(InputError, match=message), opened(wrong, POEM):
            pass
    words = "`format` is 'a poem'; wanted 'a song'"
    with pytest.raises(InputError, match=words), opened(path, OTHER):
        pass


def read_all(path):
    with opened(path, POEM) as file:
        file.record(About)
        for name in VALUES:
            file.array(name)
        file.group("inner").array("numbers")


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.99])
def test_truncated_files(path, share):
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    words = r"a\.nc: damaged or cut short .*; fetch the file again, or write it again with `poet"
    with pytest.raises(InputError, match=words):
        read_all(path)


# h5netcdf's own destructor stumbles over a file that it could not open.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_no_damaged_byte_ends_in_anything_but_an_input_error(path):
    whole = bytearray(path.read_bytes())
    refused = 0
    for place in np.random.default_rng(1).choice(len(whole), 200, replace=False):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        try:
            read_all(path)
        except InputError:
            refused += 1
    assert refused > 20


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda f: f.array("none"), "no array `none`"),
        (lambda f: f.array("inner"), "no array `inner`"),
        (lambda f: f.group("none"), "no group `none`"),
        (lambda f: f.attribute("none"), "no attribute `none`"),
        (lambda f: f.group("inner").array("few"), "no array `inner/few`"),
        (lambda f: f.group("inner").attribute("key"), "`inner/key` is 3; wanted a text"),
        (lambda f: f.attribute("author", int), "`author` is 'anon'; wanted a whole number"),
        (lambda f: f.attribute("lines", float), "`lines` is 14; wanted a number"),
        (lambda f: f.one_of("author", ("a", "b")), "`author` is 'anon'; wanted one of a, b"),
        (
            lambda f: f.array("numbers", ("column", "row")),
            r"`numbers` has the dimensions \(row, column\); wanted \(column, row\)",
        ),
        (lambda f: f.array("numbers", most=11), "`numbers` has 12 numbers; wanted 1 to 11"),
        (
            lambda f: f.array("whole", types=(np.float32, np.float64)),
            "`whole` is uint16; wanted float32 or float64",
        ),
        (lambda f: f.array("few", finite=True), "`few` at row 1 is nan; wanted finite numbers"),
    ],
)
def test_what_is_otherwise_is_named(path, ask, message):
    words = rf"a\.nc: {message}; write it again with `poet --rhyme`"
    with pytest.raises(InputError, match=words), opened(path, POEM) as file:
        ask(file)
