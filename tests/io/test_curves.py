"""Response curves from text files.

- Comments, commas, blank lines and a byte order mark are read over; values are those written.
- What is no table is refused with file, line and what is wanted.
"""

import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.imaging import Curve
from jaxrender.io import read_curve, write_curve


def test_a_table_with_comments(tmp_path):
    path = tmp_path / "curve.txt"
    text = "\ufeff# value radiance\n0 0\n\n0.25, 0.1  # measured twice\n\t1\t2e0\n"
    path.write_text(text, encoding="utf-8")
    curve = read_curve(path)
    np.testing.assert_array_equal(curve.values, [0, 0.25, 1])
    np.testing.assert_array_equal(curve.radiance, [0, 0.1, 2])
    # Linear between its entries.
    np.testing.assert_allclose(curve.linearise(np.array([0.125, 0.625])), [0.05, 1.05])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "0 0\n0.5\n1 1\n",
            r"curve\.txt:2: found '0\.5'; each line is two numbers, value radiance, or four",
        ),
        ("0 0\n0.5 1 2\n", r"curve\.txt:2: found '0\.5 1 2'; each line is two numbers"),
        ("0 0\n1 1 1 1\n", r"curve\.txt:2: 4 numbers, after lines of 2: give all lines as many"),
        ("0 0 0 0\n1 1 0 1\n", r"curve\.txt: a curve's radiance of channel 1 must increase"),
        ("# a\n0 zero\n", r"curve\.txt:2: found '0 zero'; each line is two numbers"),
        ("", r"curve\.txt: a curve's values must be at least two finite numbers"),
        ("0 0\n1 nan\n", r"curve\.txt: a curve's radiance must be at least two finite numbers"),
        ("0 0\n1 1\n0.5 2\n", r"curve\.txt: a curve's values must increase strictly, but entry 2"),
        ("0 0\n0.5 1\n1 1\n", r"curve\.txt: a curve's radiance must increase strictly, .* entry 2"),
    ],
)
def test_what_is_no_table(tmp_path, text, message):
    path = tmp_path / "curve.txt"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_curve(path)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_written_curve_is_read(tmp_path, channels):
    rng = np.random.default_rng(0)
    values = np.cumsum(rng.uniform(0.1, 1, 9))
    radiance = np.cumsum(rng.uniform(0.1, 1, (9, channels)), axis=0)
    curve = Curve(values, radiance if channels > 1 else radiance[:, 0])
    write_curve(tmp_path / "curve.txt", curve, "measured\nby day")
    found = read_curve(tmp_path / "curve.txt")
    np.testing.assert_array_equal(found.values, curve.values)
    np.testing.assert_array_equal(found.radiance, curve.radiance)
    assert (tmp_path / "curve.txt").read_text().startswith("# measured\n# by day\n# value r")
    with pytest.raises(ValueError, match="a curve of 2 channels"):
        write_curve(tmp_path / "curve.txt", Curve(values, np.stack([values, values], axis=-1)))


def test_each_channel_has_its_own_curve(tmp_path):
    path = tmp_path / "curve.txt"
    path.write_text("0 0 0 0\n0.5 0.1 0.2 0.3\n1 1 1 1\n")
    curve = read_curve(path)
    grey = np.full((2, 3), 0.25)
    np.testing.assert_allclose(curve.linearise(grey)[0], [0.05, 0.1, 0.15])
    np.testing.assert_allclose(curve.encode(curve.linearise(grey)), grey)
    with pytest.raises(ValueError, match="a response of 3 channels and an image of shape"):
        curve.linearise(np.full((2, 2), 0.5))


def test_what_is_no_text(tmp_path):
    with pytest.raises(InputError, match=r"nope\.txt: no such file; mend the path"):
        read_curve(tmp_path / "nope.txt")
    with pytest.raises(InputError, match=r"a folder; give the path of the file inside it"):
        read_curve(tmp_path)
    (tmp_path / "curve.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"curve\.txt:1: not a text in UTF-8 \(byte 0 is 0xff\)"):
        read_curve(tmp_path / "curve.txt")
