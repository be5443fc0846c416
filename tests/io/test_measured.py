"""Files of measured reflectance: Cornell's text and MERL's tables.

Pinned down: a file written out by hand arrives as the directions and values that it says; MERL
files come back bit for bit; one marked entry, written at the offset that the format states, is seen
from a pair of directions with its angles, in 1/sr; missing entries take their neighbours'; a model
exported and read again is itself; every kind of bad input is an ``InputError`` that names file,
place, value and remedy; and measured paints, where they are at hand.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from jaxrender.brdf import HalfDifference, Lambertian, TorranceSparrow
from jaxrender.brdf.tables.isotropic import pair_at
from jaxrender.errors import InputError
from jaxrender.io import MerlTable, read_cornell, read_merl, write_merl

PAINTS = Path(__file__).parents[3] / "shared" / "data" / "paints"

HEADER = "# a paint\n\n3\n# nm\n400 500\n600\n\n"
ROW = "0.5 0 0.25 3.0 0.1 0.2 0.3\n"
NODES = 90 * 90 * 180
SCALES = np.array([1.0, 1.15, 1.66]) / 1500


def cornell(tmp_path, text):
    path = tmp_path / "paint.brdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_cornell_by_hand(tmp_path):
    text = HEADER + ROW + "# again\n0.1 -1 0.2 1 -0.5 0 7 # aside\n"
    found = read_cornell(cornell(tmp_path, text))
    np.testing.assert_array_equal(found.wavelengths, [400, 500, 600])
    np.testing.assert_array_equal(found.values, [[0.1, 0.2, 0.3], [-0.5, 0, 7]])
    np.testing.assert_allclose(found.incoming[0], [np.sin(0.5), 0, np.cos(0.5)], rtol=1e-15)
    s = np.sin(0.2)
    expected = [s * np.cos(1), s * np.sin(1), np.cos(0.2)]
    np.testing.assert_allclose(found.outgoing[1], expected, rtol=1e-15)


CORNELL = {
    "empty": ("", "paint.brdf: no number in it"),
    "comments alone": ("# nothing\n", "no number in it"),
    "no count": ("x 400\n", r"paint.brdf:1: found 'x'; the first number counts"),
    "an impossible count": (
        "99999999999999999999 400\n",
        r"1 wavelengths where the first number says 9+; the file is cut short",
    ),
    "no row": (HEADER, "no measurement after the wavelengths; the file is cut short"),
    "a short row": (HEADER + ROW + ROW[:-5] + "\n", r"paint.brdf:9: 6 numbers; a row has 7"),
    "a long row": (HEADER + "1 " + ROW, r"paint.brdf:8: 8 numbers; a row has 7"),
    "not a number": (HEADER + ROW.replace("0.3", "nan"), r"paint.brdf:8: found 'nan'; .* negative"),
    "a word": (HEADER + ROW.replace("0.3", "O.3"), r"paint.brdf:8: found 'O.3'; wanted a finite"),
    "degrees": (
        HEADER + ROW.replace("0.5", "50"),
        r"paint.brdf:8: theta_i is 50; it lies in \[0, pi/2\): angles are in radians",
    ),
    "below the surface": (HEADER + ROW.replace("0.25", "1.6"), r"theta_s is 1.6"),
    "an azimuth in degrees": (HEADER + ROW.replace("3.0", "180"), r"phi_s is 180"),
    "descending": ("2 500 400\n" + ROW, r"paint.brdf:1: wavelengths 500 to 400 nm; they must asc"),
    "rows too early": ("2 400 500 0.1\n", r"paint.brdf:1: the wavelengths end within this line"),
    "a MERL file": (
        np.array([90, 90, 180], "<i4").tobytes() + b"\0" * 80,
        "binary file.*read_merl",
    ),
    "other bytes": (b"\xff\xfe", "not a text in UTF-8"),
}


@pytest.mark.parametrize("case", CORNELL)
def test_bad_cornell_files(tmp_path, case):
    text, expected = CORNELL[case]
    with pytest.raises(InputError, match=expected):
        read_cornell(cornell(tmp_path, text))


@pytest.mark.parametrize("read", [read_cornell, read_merl])
def test_missing_files(tmp_path, read):
    with pytest.raises(InputError, match=r"nothing: no such file; mend the path"):
        read(tmp_path / "nothing")


def marked_file(path, entries, background=0.0):
    """Write by the format's own words: header, then [channel][theta_h][theta_d][phi_d]."""
    numbers = np.full(3 * NODES, background)
    for (channel, h, d, p), value in entries.items():
        numbers[p + 180 * (d + 90 * (h + 90 * channel))] = value
    path.write_bytes(np.array([90, 90, 180], "<i4").tobytes() + numbers.astype("<f8").tobytes())


def test_merl_is_written_back_bit_for_bit(tmp_path):
    numbers = np.random.default_rng(0).integers(-1, 2**40, 3 * NODES).astype("<f8") / 7
    path, again = tmp_path / "a.binary", tmp_path / "b.binary"
    path.write_bytes(np.array([90, 90, 180], "<i4").tobytes() + numbers.tobytes())
    write_merl(again, read_merl(path))
    assert path.read_bytes() == again.read_bytes()
    assert sorted(os.listdir(tmp_path)) == ["a.binary", "b.binary"]


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_a_marked_entry_is_where_it_belongs(tmp_path, channel):
    path, node = tmp_path / "one.binary", (30, 20, 50)
    marked_file(path, {(channel, *node): 3000.0})
    # theta_h is 90 degrees (30/90)^2 = 10, theta_d 20 and phi_d 50 degrees.
    seen = {}
    for shift in (0, 1):
        angles = (np.radians([float(v)]) for v in (10.0, 20.0 + shift, 50.0))
        seen[shift] = np.asarray(read_merl(path).brdf().evaluate(*pair_at(HalfDifference(*angles))))
    expected = np.where(np.arange(3) == channel, 3000 * SCALES, 0)
    np.testing.assert_allclose(seen[0][0], expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(seen[1][0], 0, atol=1e-6)


def test_missing_entries_take_their_neighbours(tmp_path):
    path, (h, d, p) = tmp_path / "holes.binary", (30, 20, 50)
    marked_file(path, {(0, h, d, p): -1.0, (1, h, d - 1, p): 600.0}, background=300.0)
    table = read_merl(path)
    assert np.argwhere(table.invalid).tolist() == [[h, d, p]]
    values = np.asarray(table.brdf().values)
    np.testing.assert_allclose(values[h, d, p], np.array([300, 600, 300]) * SCALES)
    assert table.raw[0, h, d, p] == -1


def test_rows_without_any_measurement_are_filled(tmp_path):
    raw = np.full((3, 90, 90, 180), 150.0)
    raw[:, :2] = raw[:, -1] = raw[:, :, :3] = -1.0
    values = MerlTable(raw).brdf().values
    np.testing.assert_allclose(values, np.broadcast_to(150 * SCALES, values.shape))
    assert np.all(np.asarray(MerlTable(-np.ones_like(raw)).brdf().values) == 0)


def test_an_exported_model_comes_back(tmp_path):
    kd = np.array([0.02, 0.05, 0.1])
    model = TorranceSparrow(kd, np.full(3, 0.5), 0.3, 1.5)
    path = tmp_path / "model.binary"
    write_merl(path, MerlTable.of(model))
    table = read_merl(path)
    assert 0.2 < table.invalid.mean() < 0.8
    rng = np.random.default_rng(0)
    cosine, turn = rng.uniform(0.3, 1, (2, 500)), rng.uniform(0, 7, (2, 500))
    sine = np.sqrt(1 - cosine**2)
    a, b = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=-1)
    found, truth = table.brdf().evaluate(a, b), model.evaluate(a, b)
    np.testing.assert_allclose(found, truth, rtol=0.02)


def test_exports_of_other_channels_are_refused(tmp_path):
    with pytest.raises(ValueError, match="has 2 channels; a MERL file has three"):
        MerlTable.of(Lambertian(np.array([0.1, 0.2])))
    table = MerlTable(np.zeros((3, 90, 90, 180)))
    with pytest.raises(InputError, match="no such folder"):
        write_merl(tmp_path / "absent" / "a.binary", table)


DIMENSIONS = np.array([90, 90, 180], "<i4").tobytes()
MERL = {
    "empty": (b"", "0 bytes; the header alone has 12"),
    "cut in the header": (DIMENSIONS[:7], "7 bytes; the header alone has 12: the file is cut"),
    "cut short": (DIMENSIONS + b"\0" * 800, "812 bytes where the header makes 34992012"),
    "enormous": (
        np.array([2**31 - 1] * 3, "<i4").tobytes(),
        r"say \(2147483647, 2147483647, 2147483647\) nodes; a MERL .binary says \(90, 90, 180\)",
    ),
    "text": (b"31\n400 410 420 430", r"bytes 0 to 11 say .*text files .* read_cornell"),
}


@pytest.mark.parametrize("case", MERL)
def test_bad_merl_files(tmp_path, case):
    content, expected = MERL[case]
    path = tmp_path / "bad.binary"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"bad\.binary: .*{expected}"):
        read_merl(path)


def test_numbers_that_are_not(tmp_path):
    path = tmp_path / "nan.binary"
    marked_file(path, {(0, 0, 0, 5): np.nan})
    with pytest.raises(InputError, match=r"nan at byte 52; wanted a finite number: fetch"):
        read_merl(path)
    path.write_bytes(path.read_bytes() + b"\0")
    with pytest.raises(InputError, match="34992013 bytes where the header makes 34992012; fetch"):
        read_merl(path)


@pytest.mark.skipif(not PAINTS.exists(), reason="the measured paints are not on this machine")
@pytest.mark.parametrize("paint", ["krylon_blue", "acryl_blue"])
def test_measured_paints(paint):
    found = read_cornell(PAINTS / f"{paint}.brdf")
    assert found.values.shape == (1439, 31)
    np.testing.assert_array_equal(found.wavelengths, np.arange(400, 701, 10))
    # The source stood at 10 to 80 degrees in steps of 10, at azimuth 0.
    polar = np.degrees(np.arccos(found.incoming[:, 2]))
    np.testing.assert_allclose(polar, 10 * np.round(polar / 10), atol=1e-3)
    assert np.all(np.abs(found.incoming[:, 1]) < 1e-12)
