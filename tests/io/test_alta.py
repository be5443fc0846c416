"""ALTA's text files.

Pinned down: a file written out by hand in each parametrisation arrives as the directions that the
format's words say, found independently of the reader; what is written comes back to its 17 digits;
a BRDF that is exported, read and tabulated is itself; rows below the horizon are left out and
counted; cosine factors are taken out; errors in ``#VS`` columns are read past; and every kind of
bad input is an ``InputError`` that names file, place, value and remedy.
"""

import os

import numpy as np
import pytest

from jaxrender.brdf import Lambertian, TorranceSparrow, half_difference
from jaxrender.errors import InputError
from jaxrender.geometry import Components
from jaxrender.io.alta import AltaMeasurements, read_alta, write_alta
from jaxrender.io.alta_parametrisations import COORDINATES, PARAMETRISATIONS


def alta(tmp_path, text):
    path = tmp_path / "paint.alta"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def header(name, coordinates, values=1, quantity="INV_STERADIAN", more=""):
    return f"#DIM {coordinates} {values}\n#PARAM_IN {name}\n#PARAM_OUT {quantity}\n{more}"


def direction(polar, azimuth):
    sine = np.sin(polar)
    return np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)])


def random_pairs(count, seed=0):
    rng = np.random.default_rng(seed)
    cosine, turn = rng.uniform(0.1, 1, (2, count)), rng.uniform(-3, 3, (2, count))
    sine = np.sqrt(1 - cosine**2)
    return tuple(np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=-1))


def test_spherical_says_light_first(tmp_path):
    text = header("SPHERICAL_TL_PL_TV_PV", 4) + "0.5 0.1 0.25 3.0 0.7\n# aside\n\n0 0 1.0 -1 -2\n"
    found = read_alta(alta(tmp_path, text))
    np.testing.assert_allclose(found.incoming[0], direction(0.5, 0.1), rtol=1e-15)
    np.testing.assert_allclose(found.outgoing[0], direction(0.25, 3.0), rtol=1e-15)
    np.testing.assert_allclose(found.outgoing[1], direction(1.0, -1.0), rtol=1e-15)
    np.testing.assert_array_equal(found.values, [[0.7], [-2.0]])


def test_cartesian_says_view_first(tmp_path):
    text = header("CARTESIAN", 6, 3, "RGB_COLOR") + "0 0.6 0.8  0.6 0 0.8  1 2 3\n"
    found = read_alta(alta(tmp_path, text))
    np.testing.assert_array_equal(found.outgoing, [[0, 0.6, 0.8]])
    np.testing.assert_array_equal(found.incoming, [[0.6, 0, 0.8]])
    np.testing.assert_array_equal(found.values, [[1, 2, 3]])


def test_isotropic_says_view_first_and_turns_the_light(tmp_path):
    text = header("ISOTROPIC_TV_TL_DPHI", 3) + "0.3 0.9 0.4 1\n"
    found = read_alta(alta(tmp_path, text))
    np.testing.assert_allclose(found.outgoing[0], direction(0.3, 0), rtol=1e-15)
    np.testing.assert_allclose(found.incoming[0], direction(0.9, 0.4), rtol=1e-15)


HALF = {
    "RUSIN_TH_TD_PD": ("0.4 0.3 2.0", (0.4, 0.3, 2.0)),
    "RUSIN_TH_TD": ("0.4 0.3", (0.4, 0.3, np.pi / 2)),
    "COS_TH_TD": (f"{np.cos(0.4)} {np.cos(0.3)}", (0.4, 0.3, np.pi / 2)),
    "STARK_2D": (
        # |H| = cos t_d with its shadow sin t_h of that; |B| = sin t_d.
        f"{np.cos(0.3) * np.sin(0.4)} {np.sin(0.3)}",
        (0.4, 0.3, np.pi / 2),
    ),
}


@pytest.mark.parametrize("name", HALF)
def test_half_angles(tmp_path, name):
    coordinates, expected = HALF[name]
    text = header(name, len(coordinates.split())) + coordinates + " 1\n"
    found = read_alta(alta(tmp_path, text))
    # p_d is that of V: it stands first.
    angles = half_difference(Components.of(found.outgoing), Components.of(found.incoming))
    np.testing.assert_allclose(np.ravel(angles), expected, rtol=1e-12)
    assert abs(np.linalg.norm(found.incoming) - 1) < 1e-12


@pytest.mark.parametrize("name", PARAMETRISATIONS)
def test_every_parametrisation_gives_unit_directions(tmp_path, name):
    count, _ = PARAMETRISATIONS[name]
    rows = np.random.default_rng(0).uniform(0.3, 0.5, (20, count))
    if name == "CARTESIAN":
        rows = np.concatenate(random_pairs(20), axis=1)
    path = tmp_path / "paint.alta"
    path.write_text(header(name, count))
    with path.open("a") as file:
        np.savetxt(file, np.insert(rows, count, 1.0, axis=1), "%.17g")
    found = read_alta(path)
    assert len(found.values) + found.below_horizon == 20
    for directions in (found.incoming, found.outgoing):
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-12)
        assert (directions[:, 2] > 0).all()


def test_p_d_turns_the_view_towards_the_horizon(tmp_path):
    """At p_d = 0 the view lies beyond the half vector: it is t_h + t_d from the normal."""
    found = read_alta(alta(tmp_path, header("RUSIN_TH_TD_PD", 3) + "0.4 0.3 0 1\n"))
    np.testing.assert_allclose(found.outgoing[0], direction(0.7, 0), atol=1e-15)
    np.testing.assert_allclose(found.incoming[0], direction(0.1, 0), atol=1e-15)


def test_rows_below_the_horizon_are_left_out_and_counted(tmp_path):
    text = header("RUSIN_TH_TD_PD", 3) + "0.4 0.3 0 1\n1.5 1.0 0 2\n1.5 1.5 3.1 3\n"
    found = read_alta(alta(tmp_path, text))
    assert found.below_horizon == 2
    np.testing.assert_array_equal(found.values, [[1]])


def test_a_cosine_factor_is_taken_out(tmp_path):
    text = header("SPHERICAL_TL_PL_TV_PV", 4, 1, "INV_STERADIAN_COSINE_FACTOR")
    found = read_alta(alta(tmp_path, text + "0.2 0 1.1 0 0.5\n"))
    np.testing.assert_allclose(found.values, [[0.5 / np.cos(1.1)]], rtol=1e-14)


@pytest.mark.parametrize(
    ("said", "columns"),
    [("0", ""), ("1", "8 9"), ("2", "8 8 9 9"), ("0 2", "8 9"), ("2 1", "8 8 9")],
)
def test_numbers_on_errors_are_read_past(tmp_path, said, columns):
    text = "#ALTA HEADER BEGIN\n" + header("STARK_2D", 2, 2, more=f"#VS {said}\n#ALTA HEADER END\n")
    found = read_alta(alta(tmp_path, f"{text}0.1 0.2 5 6 {columns}\n"))
    np.testing.assert_array_equal(found.values, [[5, 6]])


@pytest.mark.parametrize("name", COORDINATES)
@pytest.mark.parametrize("channels", [1, 3, 5])
def test_what_is_written_comes_back(tmp_path, name, channels):
    values = np.random.default_rng(1).lognormal(0, 8, (50, channels))
    written = AltaMeasurements(*random_pairs(50), values)
    path = tmp_path / "a.alta"
    write_alta(path, written, name)
    found = read_alta(path)
    np.testing.assert_array_equal(found.values, values)
    np.testing.assert_allclose(found.incoming, written.incoming, rtol=0, atol=4e-16)
    np.testing.assert_allclose(found.outgoing, written.outgoing, rtol=0, atol=4e-16)
    assert os.listdir(tmp_path) == ["a.alta"]
    assert ("RGB_COLOR" in path.read_text()) == (channels == 3)


def test_a_brdf_leaves_and_is_itself(tmp_path):
    model = TorranceSparrow(np.array([0.02, 0.05, 0.1]), np.full(3, 0.5), 0.3, 1.5)
    incoming, outgoing = random_pairs(40)
    path = tmp_path / "model.alta"
    write_alta(path, AltaMeasurements.of(model, incoming, outgoing))
    found = read_alta(path)
    again = model.evaluate(found.incoming, found.outgoing)
    np.testing.assert_allclose(found.values, again, rtol=1e-11)


def test_misuse(tmp_path):
    grey = Lambertian(np.array([0.1]))
    incoming, outgoing = random_pairs(3)
    with pytest.raises(ValueError, match=r"outgoing\[0\] is .*: give directions with z > 0"):
        AltaMeasurements.of(grey, incoming, -outgoing)
    found = AltaMeasurements.of(grey, incoming, outgoing)
    with pytest.raises(ValueError, match="'COS_TH_TD': choose of SPHERICAL_TL_PL_TV_PV, CARTESIAN"):
        write_alta(tmp_path / "a", found, "COS_TH_TD")
    with pytest.raises(ValueError, match=r"measurement 0 is .*nan.*: only finite"):
        write_alta(tmp_path / "a", found._replace(values=np.full((3, 1), np.nan)))
    with pytest.raises(InputError, match="no such folder"):
        write_alta(tmp_path / "absent" / "a", found)
    assert os.listdir(tmp_path) == []


GOOD = header("SPHERICAL_TL_PL_TV_PV", 4)
ROW = "0.5 0.1 0.25 3.0 0.7\n"
BAD = {
    "empty": ("", "no header; an ALTA file opens with"),
    "no header": (ROW, "no header"),
    "no row": (GOOD, "no row after the header; the file is cut short"),
    "binary": (GOOD + "#FORMAT binary\n", "a binary file; save it as text"),
    "bytes": (b"#DIM\0\0", "a binary file"),
    "no dimensions": ("#PARAM_IN CARTESIAN\n#PARAM_OUT INV_STERADIAN\n1\n", "#DIM says nothing"),
    "a bad count": (GOOD.replace("4 1", "4 x") + ROW, "#DIM says 4 x; wanted two counts"),
    "another count": (GOOD.replace("4 1", "3 1") + ROW, "says 3 coordinates; SPHERICAL.* has 4"),
    "an enormous count": (GOOD.replace("4 1", "4 99999999999") + ROW, "5 numbers; a row has 1000"),
    "not listed": (
        GOOD.replace("SPHERICAL_TL_PL_TV_PV", "SCHLICK_VK") + ROW,
        r"#PARAM_IN says SCHLICK_VK; known are CARTESIAN, SPHERICAL",
    ),
    "no quantity": ("#DIM 2 1\n#PARAM_IN STARK_2D\n0 0 1\n", "#PARAM_OUT says nothing; known are"),
    "XYZ": (GOOD.replace("INV_STERADIAN", "XYZ_COLOR") + ROW, "says XYZ_COLOR; known are INV_STER"),
    "one colour": (GOOD.replace("INV_STERADIAN", "RGB_COLOR") + ROW, "1 values; RGB_COLOR has 3"),
    "bad VS": (GOOD + "#VS 3\n" + ROW, "#VS says 3; wanted 0, 1 or 2"),
    "a short row": (GOOD + ROW + ROW[4:], r":5: 4 numbers; a row has 5 by #DIM"),
    "a row without errors": (GOOD + "#VS 1\n" + ROW, r":5: 5 numbers; a row has 6"),
    "not finite": (GOOD + ROW.replace("0.7", "nan"), r":4: .*nan'; wanted finite"),
    "a word": (GOOD + ROW.replace("0.7", "O.7"), r":4: .*O.7'; wanted finite"),
    "degrees": (GOOD + ROW.replace("0.5", "50"), r":4: .* wants angles in radians"),
    "not unit": (header("CARTESIAN", 6) + "0 0 2 0 0 1 1\n", r":4: .* wants two unit vectors"),
    "no cosine": (header("COS_TH_TD", 2) + "1.5 0.1 1\n", r":4: .* wants cosines from 0 to 1"),
    "too long": (header("STARK_2D", 2) + "0.9 0.9 1\n", r":4: .* squares add up to at most 1"),
    "all below": (GOOD + "2 0 2 0 1\n", "no row has both directions above the surface; check"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files(tmp_path, case):
    text, expected = BAD[case]
    with pytest.raises(InputError, match=rf"paint\.alta.*{expected}"):
        read_alta(alta(tmp_path, text))


def test_a_missing_file(tmp_path):
    with pytest.raises(InputError, match="no such file; mend the path"):
        read_alta(tmp_path / "nothing")


def test_every_parametrisation_is_tried():
    above = {"CARTESIAN", "SPHERICAL_TL_PL_TV_PV", "ISOTROPIC_TV_TL_DPHI"}
    assert set(PARAMETRISATIONS) == above | set(HALF)
