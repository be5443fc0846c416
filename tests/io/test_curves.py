"""Response curves from text files.

- Comments, commas, blank lines and a byte order mark are read over; values are those written.
- What is no table is refused with file, line and what is wanted.
"""

import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.io import read_curve


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
            r"curve\.txt:2: found '0\.5'; each line is two numbers, value radiance",
        ),
        ("0 0\n0.5 1 2\n", r"curve\.txt:2: found '0\.5 1 2'; each line is two numbers"),
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


def test_what_is_no_text(tmp_path):
    with pytest.raises(InputError, match=r"nope\.txt: no such file; mend the path"):
        read_curve(tmp_path / "nope.txt")
    with pytest.raises(InputError, match=r"a folder; give the path of the file inside it"):
        read_curve(tmp_path)
    (tmp_path / "curve.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"curve\.txt:1: not a text in UTF-8 \(byte 0 is 0xff\)"):
        read_curve(tmp_path / "curve.txt")
