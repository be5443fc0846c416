"""IES files of luminaires.

Pinned down: files of all standards written out by hand arrive with their numbers, keywords and
factors (the thirteenth number is one until 1991 only); each symmetry fills the directions that the
standard says, seen along single directions; feet become metres; tilts are read from within and from
beside the file, never from outside its folder; the flux of a lamp with known light is that; and
every kind of bad input is an ``InputError`` with file, place, value and remedy.
"""

import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.io.photometric import read_ies

HEAD = {
    "LM-63-1986": "A lamp\n[TEST] 12\n",
    "LM-63-1991": "IESNA91\n[TEST] 12\nloose words\n",
    "LM-63-1995": "IESNA:LM-63-1995\n[TEST] 12\n[MORE] and 13\n[LAMP] HME\n",
    "LM-63-2002": "IESNA:LM-63-2002\n[TEST] 12\n",
}


def body(horizontal, rows, vertical="0 45 90", units=2, kind=1, lumens="1000", factors="1 1"):
    counts = f"{len(vertical.split())} {len(horizontal.split())}"
    return (
        f"2 {lumens} 3 {counts} {kind} {units} .2 .5 0\n{factors} 60\n{vertical}\n{horizontal}\n"
        + "\n".join(rows)
    )


def ies(tmp_path, text, name="lamp.ies"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.replace("\n", "\r\n").encode())
    return path


def towards(vertical, horizontal):
    v, h = np.radians(vertical), np.radians(horizontal)
    return np.array([np.sin(v) * np.cos(h), np.sin(v) * np.sin(h), -np.cos(v)])


@pytest.mark.parametrize("standard", HEAD)
def test_by_hand(tmp_path, standard):
    text = HEAD[standard] + "TILT=NONE\n" + body("0", ["10 20,", "30"], factors=".5 .25")
    found = read_ies(ies(tmp_path, text))
    assert found.standard == standard
    assert found.keywords[0] == ("TEST", "12" if "1995" not in standard else "12\nand 13")
    assert found.tilt is None
    assert (found.stated_lumens, found.watts) == (2000, 60)
    np.testing.assert_array_equal(found.vertical, [0, 45, 90])
    # Width is along Y, length along X.
    np.testing.assert_array_equal(found.dimensions, [0.5, 0.2, 0])
    factor = 3 * 0.5 * (0.25 if standard in ("LM-63-1986", "LM-63-1991") else 1)
    np.testing.assert_allclose(found.candela, factor * np.array([[10, 20, 30]]))
    expected = factor * np.array([10, 25, 0])
    seen = found.intensity(np.stack([towards(0, 0), towards(67.5, 123), towards(91, 0)]))
    np.testing.assert_allclose(seen, expected, rtol=1e-12)
    labels = {"LM-63-1986": ("A lamp",), "LM-63-1991": ("loose words",)}
    assert found.labels == labels.get(standard, ())


SYMMETRIES = {
    # Horizontal angles in the file, and at which of them each of 30, 150, 210 and 330 is found.
    "axis": ("0", (0, 0, 0, 0)),
    "quadrants": ("0 30 90", (30, 30, 30, 30)),
    "about X": ("0 30 150 180", (30, 150, 150, 30)),
    "about Y": ("90 150 210 270", (150, 150, 210, 210)),
    "none": ("0 30 150 210 330 360", (30, 150, 210, 330)),
    "none, open": ("0 30 150 210 330", (30, 150, 210, 330)),
}


@pytest.mark.parametrize("name", SYMMETRIES)
def test_symmetries(tmp_path, name):
    horizontal, expected = SYMMETRIES[name]
    # At the vertical angle 90 each row has the square of its own horizontal angle as candela.
    rows = [f"0 0 {(float(h) % 360) ** 2}" for h in horizontal.split()]
    found = read_ies(ies(tmp_path, HEAD["LM-63-2002"] + "TILT=NONE\n" + body(horizontal, rows)))
    seen = found.intensity(np.stack([towards(90, h) for h in (30, 150, 210, 330)]))
    np.testing.assert_allclose(seen, 3.0 * np.array(expected) ** 2, rtol=1e-9)


def test_between_the_last_angle_and_the_first(tmp_path):
    rows = ["0 0 10", "0 0 20", "0 0 30", "0 0 10"]
    text = HEAD["LM-63-2002"] + "TILT=NONE\n" + body("0 120 240 360", rows)
    seen = read_ies(ies(tmp_path, text)).intensity(towards(90, 300))
    np.testing.assert_allclose(seen, 3 * 20, rtol=1e-9)


def test_the_flux_of_a_cosine_lamp(tmp_path):
    """I = I0 cos v has the flux pi I0."""
    angles = np.arange(0, 181, 2.5)
    values = 100 * np.maximum(np.cos(np.radians(angles)), 0)
    text = body("0", [" ".join(map(str, values))], " ".join(map(str, angles)), lumens="-1")
    found = read_ies(ies(tmp_path, HEAD["LM-63-2002"] + "TILT=NONE\n" + text))
    assert found.stated_lumens is None
    assert found.flux() == pytest.approx(300 * np.pi, rel=1e-3)


def test_feet(tmp_path):
    text = HEAD["LM-63-2002"] + "TILT=NONE\n" + body("0", ["1 2 3"], units=1)
    found = read_ies(ies(tmp_path, text + "\r\n\x1a"))
    np.testing.assert_allclose(found.dimensions, [0.1524, 0.06096, 0])


TILT = "1\n3\n0 45 90\n1 .95 .9\n"


def test_tilts_within_and_beside(tmp_path):
    head, rest = HEAD["LM-63-1995"], body("0", ["1 2 3"])
    within = read_ies(ies(tmp_path, f"{head}TILT=INCLUDE\n{TILT}{rest}"))
    (tmp_path / "mh.tlt").write_text(TILT)
    beside = read_ies(ies(tmp_path, f"{head}TILT=mh.tlt\n{rest}"))
    for found in (within, beside):
        assert found.tilt is not None
        assert found.tilt.geometry == 1
        np.testing.assert_array_equal(found.tilt.angles, [0, 45, 90])
        np.testing.assert_array_equal(found.tilt.factors, [1, 0.95, 0.9])
        np.testing.assert_array_equal(found.candela, [[3, 6, 9]])


def test_tilts_from_outside_are_refused(tmp_path):
    (tmp_path / "outside.tlt").write_text(TILT)
    folder = tmp_path / "lamps"
    folder.mkdir()
    (folder / "link.tlt").symlink_to(tmp_path / "outside.tlt")
    for name in ("../outside.tlt", str(tmp_path / "outside.tlt"), "link.tlt"):
        path = ies(folder, HEAD["LM-63-1995"] + f"TILT={name}\n" + body("0", ["1 2 3"]))
        with pytest.raises(InputError, match=r"lamp.ies:5: TILT=.* leads outside .*lamps; put"):
            read_ies(path)


def test_letters_of_makers(tmp_path):
    text = "IESNA:LM-63-1995\n[MANUFAC] Gebr\xfcder\nTILT=NONE\n" + body("0", ["1 2 3"])
    found = read_ies(ies(tmp_path, text.encode("latin-1")))
    assert found.keywords == (("MANUFAC", "Gebr\xfcder"),)


GOOD = HEAD["LM-63-2002"] + "TILT=NONE\n"
ROWS = ["1 2 3"]
BAD = {
    "empty": ("", "no line TILT=...; this is no IES file"),
    "no tilt": (HEAD["LM-63-2002"], "no line TILT="),
    "binary": (b"IESNA:LM-63-2002\0", r"a binary file \(byte 16 is 0\)"),
    "nothing after it": (GOOD, r"0 numbers left where 3 are wanted for lamps, lumens"),
    "no tilt file": (
        GOOD.replace("NONE", "absent.tlt") + body("0", ROWS),
        "absent.tlt: no such file",
    ),
    "cut short": (GOOD + body("0", ["1 2"]), r"2 numbers left where 3 are wanted for candela; the"),
    "too long": (GOOD + body("0", ["1 2 3", "4"]), r":9: 1 numbers too many; a count is wrong"),
    "enormous": (
        GOOD + "1 1 1 2000000000 2000000000 1 2 0 0 0\n1 1 1\n0 1\n",
        r"2 numbers left where 2000000000 are wanted for vertical angles",
    ),
    "no count": (GOOD + "1 1 1 2.5 1 1 2\n", r":4: 2.5 for the number of vertical angles; wanted"),
    "a word": (GOOD + body("0", ["1 x 3"]), r":8: found 'x' for candela; wanted a number"),
    "nan": (GOOD + body("0", ["1 nan 3"]), r":8: found 'nan' for candela"),
    "negative": (GOOD + body("0", ["1 -2 3"]), r"-2 cd at vertical angle 45, horizontal 0"),
    "type A": (GOOD + body("0", ROWS, kind=3), r":4: photometry of type A; only type C is read"),
    "type B": (GOOD + body("0", ROWS, kind=2), r":4: photometry of type B; only type C is read"),
    "no type": (GOOD + body("0", ROWS, kind=7), r":4: photometric type 7; wanted 1"),
    "yards": (GOOD + body("0", ROWS, units=3), r":4: units 3; wanted 1 \(feet\) or 2"),
    "no light": (GOOD + body("0", ROWS, factors="0 1"), r"ballast factor 0; both are positive"),
    "down and up": (GOOD + body("0", ROWS, "0 90 45"), r"vertical angles .* ascending from the"),
    "beyond": (GOOD + body("0", ROWS, "0 90 190"), r"vertical angles .* to at most 180"),
    "one angle": (GOOD + body("0", ["1"], "0"), r"vertical angles .* has at least two"),
    "a third": (GOOD + body("0 120", ROWS * 2), r"horizontal angles .*; type C has 0 alone"),
    "a turn twice": (GOOD + body("0 361", ROWS * 2), r"horizontal angles .*; type C has 0 alone"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files(tmp_path, case):
    text, expected = BAD[case]
    with pytest.raises(InputError, match=expected) as caught:
        read_ies(ies(tmp_path, text))
    assert str(tmp_path) in str(caught.value)


def test_files_that_are_missing_or_too_large(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_ies(tmp_path / "nothing.ies")
    path = tmp_path / "large.ies"
    with path.open("wb") as file:
        file.truncate(2**26 + 1)
    with pytest.raises(InputError, match=r"67,108,865 bytes, .* give a file of one lumi"):
        read_ies(path)
