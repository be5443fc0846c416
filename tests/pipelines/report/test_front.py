"""The first page: five questions in plain words, from what the result says and nothing else.

- What was recovered is said in per cent of the light and degrees, where the light's scale is known.
- The least certain number is named with its range; what is not identifiable is under what could not
  be found, with its reason.
- What would explain a misfit, and pixels that were left out, are under what is wrong; what to do
  comes under what to photograph next. Faults that the fit allowed for are named, too.
- The largest gap among cameras is where no camera is near.
"""

import numpy as np
import pytest
from report_samples import RESULT, Reader, rewritten, sample_frame

from jaxrender.pipelines.report.contents import Pictures, Shown
from jaxrender.pipelines.report.directions import gap_among
from jaxrender.pipelines.report.front import front
from jaxrender.pipelines.report.photographs import Frame, Gallery, gallery

FOUND = Pictures(Shown("data:image/png;base64,AA==", "A ball."))
WORST = Frame("b", "", "", "residual of b", 0.03)
FRAMES = Gallery((Frame("a", "", "", "residual of a", 0.01), WORST), 2, 5, "", WORST)
NO_FACES = np.zeros((0, 3))
QUESTIONS = [
    "What was recovered",
    "How sure that is",
    "What could not be found",
    "What is wrong with the capture",
    "What to photograph next",
]


def cards(contents, pictures=FOUND, **changes):
    changed = contents._replace(result=rewritten(RESULT, **changes))
    found = front(changed, pictures, FRAMES)
    assert [card.question for card in found] == QUESTIONS
    return found


def said(contents, number, **changes):
    return " ".join(cards(contents, **changes)[number].sentences)


def test_the_page_begins_with_the_five_questions(page):
    reader = Reader(page)
    places = [reader.text.index(question) for question in QUESTIONS]
    assert places == sorted(places)
    assert places[-1] < reader.text.index("For experts")


def test_what_was_recovered(contents):
    # pi kd of 0.2, 0.1, 0.05; a lobe is twice as wide as its facets are spread.
    text = said(contents, 0)
    assert "37\u00a0% of the light (red, green, blue: 63\u00a0%, 31\u00a0%, 16\u00a0%)" in text
    assert "satin: the surface blurs what it mirrors by about 34 degrees" in text


def test_no_percentage_where_the_scale_is_open(contents):
    lighting = {"gauge": "mean of kd + ks = 1", "directional": [{}], "sentence": "all degrees"}
    text = said(contents, 0, task="factorize", lighting=lighting)
    assert "%" not in text
    assert "a smooth part, and one lamp" in text
    assert "how bright the light is" in said(contents, 2, lighting=lighting).lower()


@pytest.mark.parametrize(("numbers", "drawn"), [([], False), (["mu"], False), (["mu", "ks"], True)])
def test_pairs_are_drawn_where_there_are_any(contents, numbers, drawn):
    """Of a diffuse ball in unknown light every number of the material is the gauge's."""
    matrix = np.eye(len(numbers)).tolist()
    found = cards(contents, correlations={"numbers": numbers, "matrix": matrix})[2].shown
    assert (found is not None) == drawn


def test_how_sure(contents):
    # mu reaches from 1.2 to 1.9 about 1.5.
    assert "mu (" in said(contents, 1)
    assert "within 23\u00a0%" in said(contents, 1)
    assert "known well" not in said(contents, 1)
    narrow = {"sigma": [0.297, 0.303]}
    assert "All of these numbers are known well." in said(contents, 1, interval90=narrow)
    drawing = cards(contents)[1].shown
    assert drawing.is_drawing
    assert "mu 23" in drawing.picture


def test_what_could_not_be_found(contents):
    assert said(contents, 2) == "Mu is not identifiable: its 90 % interval is 1.2 to 1.9."
    unnamed = said(contents, 2, reasons=[], identifiable={"sigma": False})
    assert unnamed == "Sigma: the photographs do not determine it."
    well = said(contents, 2, reasons=[], identifiable={"sigma": True})
    assert well == "Nothing that was asked for is missing."


def test_what_is_wrong(contents):
    clean = {"relative_rms": 0.01, "misfit": {"rms": 0.0, "share": 0.01}}
    assert "noise of 1.0\u00a0%" in said(contents, 3, residual=clean)
    # A task that does not compare what is left with the noise finds no fault, and says so.
    assert "Nobody looked for faults here. What is left over is 1.5" in said(contents, 3)
    cause = {"sentence": "the sun lies 2 degrees aside", "explains": 0.8, "free": "solve.free_sun"}
    text = said(contents, 3, diagnosis=[cause])
    assert text == "If the sun lies 2 degrees aside, that explains 80\u00a0% of what is left over."
    assert "set solve.free_sun" in said(contents, 4, diagnosis=[cause])
    misfit = {"misfit": {"rms": 0.04, "share": 0.9}}
    assert "4.0\u00a0% more than their noise" in said(contents, 3, residual=misfit)
    pixels = {"usable": 900, "removed": {"saturated": 100, "black": 1}}
    text = said(contents, 3, pixels=pixels)
    assert text == "10.0\u00a0% of the object's pixels are too bright for the camera."
    assert "shorter exposure" in said(contents, 4, pixels=pixels)
    assert "shorter exposure" not in said(contents, 4)
    # The photograph that is explained worst.
    assert cards(contents)[3].shown.picture == "residual of b"


def freed(value, error, unit=("percent",), meaning="gain of each photograph"):
    one = {"meaning": meaning, "value": value, "standard_error": error, "unit": list(unit)}
    return {"nuisances": {"it": one}, "sentences": []}


def test_faults_that_the_fit_allowed_for_are_faults(contents):
    """A gain 5 errors from none is a fault of the capture; one 2 errors from none is noise."""
    clean = {"relative_rms": 0.01, "misfit": {"rms": 0.0, "share": 0.01}}
    text = said(contents, 3, residual=clean, calibration=freed([0.2, -2.5], [0.5, 0.5]))
    assert text == "Found and allowed for: gain of each photograph, up to 2.5 percent."
    noise = said(contents, 3, residual=clean, calibration=freed([0.2, -1.0], [0.5, 0.5]))
    assert noise.startswith("Nothing that the photographs show.")
    source = freed([0.1, 3.0, 0.2, 9.0], [0.1] * 4, ("degrees",) * 3 + ("percent",))
    assert "up to 3.0 degrees and 9.0 percent." in said(contents, 3, calibration=source)
    # What is left over beside it is still said.
    misfit = {"misfit": {"rms": 0.04, "share": 0.9}}
    both = said(contents, 3, residual=misfit, calibration=freed([-2.5], [0.5]))
    assert both.startswith("Found and allowed for")
    assert "4.0\u00a0% more than their noise" in both


def test_the_worst_photograph_is_the_one_whose_residual_is_shown():
    good, bad = sample_frame("good"), sample_frame("bad", (340, 512), seed=1)
    found = gallery((good, bad._replace(predicted=0.7 * bad.predicted), good))
    assert found.worst.name == "bad"
    assert 0 < len(found.worst.residual) < len(found.frames[1].residual) / 2


def test_what_to_photograph_next(contents):
    assert "views that graze the surface" in said(contents, 4)
    circle = [[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0, np.pi, 9)]
    text = said(contents, 4, views=circle)
    assert "elevation" in text
    assert cards(contents, views=circle)[4].shown.is_drawing
    assert cards(contents)[4].shown is None


def test_a_page_may_bring_its_own_pictures(contents):
    own = FOUND._replace(sure=Shown("x", "error"), missing=Shown("y", "marks"))
    found = cards(contents, own)
    assert [card.shown.picture for card in found[:3]] == [FOUND.recovered.picture, "x", "y"]


@pytest.mark.parametrize("azimuth", [0.0, 100.0, 250.0])
def test_the_gap_is_opposite_to_where_the_cameras_stood(azimuth):
    angles = np.radians(azimuth + np.linspace(-90, 90, 13))
    views = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    gap = gap_among(views, NO_FACES)
    turned = (gap.azimuth - azimuth - 180 + 180) % 360 - 180
    assert abs(turned) < 8
    towards = np.radians([gap.azimuth, gap.elevation])
    place = [
        np.cos(towards[1]) * np.cos(towards[0]),
        np.cos(towards[1]) * np.sin(towards[0]),
        np.sin(towards[1]),
    ]
    assert np.isclose(np.degrees(np.arccos(np.max(views @ place))), gap.radius)


def test_a_camera_above_leaves_a_gap_at_the_horizon():
    gap = gap_among(np.array([[0.0, 0.0, 1.0]]), NO_FACES)
    assert gap.elevation < 0
    assert 95 < gap.radius < 101
    assert gap_among(np.zeros((0, 3)), NO_FACES) is None


def test_the_back_of_a_sheet_is_no_gap():
    # The sheet faces azimuth 30; its camera stands before it.
    front = np.array([np.cos(np.radians(30)), np.sin(np.radians(30)), 0.0])
    gap = gap_among(front[None], np.tile(front, (5000, 1)))
    turned = (gap.azimuth - 30 + 180) % 360 - 180
    assert abs(turned) < 79  # where a fifth of it can be seen
    both = gap_among(front[None], np.concatenate([front[None], -front[None]]))
    assert both.radius > 170
