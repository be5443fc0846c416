"""The report: one file that asks for nothing, says what the result says, and survives absences.

- Self-contained: no script, no event handler, no address but ``data:`` and ``#``; ids are unique;
  every picture has words in its place.
- Every section is there; values, intervals and reasons stand where they belong.
- Strings from outside are text, never markup.
- Whatever is absent (environment, gloss, Fresnel, refinement, channels, frames, keys) is left out.
- The same contents give the same bytes; six photographs stay below two megabytes.
- Pictures are right: sign and scale of the residual, one exposure for all, Lambert's cosine on the
  sphere; circles lie where their sources are, with areas in proportion to energy.
- Curves are right: percentiles by exit angle; a source's energy by degree is E^2 (2l + 1) / 4 pi.
"""

import base64
import io
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import SRGB, NoiseModel
from jaxrender.inverse import BRDFFit, KnownLight, Observations, Outcome
from jaxrender.inverse.conditioning import SigmaEvidence
from jaxrender.inverse.elimination import Data, Fit
from jaxrender.inverse.known_light import PreparedLight
from jaxrender.inverse.passes import Stop
from jaxrender.inverse.uncertainty import Parameters, Uncertain
from jaxrender.lighting import DirectionalSources, Environment, candidates, take
from jaxrender.pipelines.report import FramePictures, ReportContents, write_report
from jaxrender.pipelines.report.light import direction_discs, environment_map
from jaxrender.pipelines.report.material import spheres
from jaxrender.pipelines.report.photographs import gallery
from jaxrender.pipelines.report.residuals import binned
from jaxrender.pipelines.report.spectra import energy_by_degree
from jaxrender.pipelines.report.wording import numbers, percent, seconds, shown
from jaxrender.reflection import SourcesNeeded, dual_light
from jaxrender.spectra import light_coefficients

SECTIONS = (
    "outcome",
    "material",
    "photographs",
    "look",
    "light",
    "residuals",
    "spectra",
    "account",
)
SIGMA, BAND_LIMIT = 0.3, 7
KD = (0.2, 0.1, 0.05)
# One 8-bit code around the middle of the sRGB curve, in linear light.
ONE_CODE = 0.006


# ---------------------------------------------------------------- a fit that nobody had to compute


def sample_stop(channels=3, noise=None):
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    outgoing = np.tile([1.0, 0.0, 0.0], (400, 1))
    normals[:, 0] = np.abs(normals[:, 0])
    predicted = rng.uniform(0.5, 1.5, (400, channels))
    radiance = predicted + 0.01 * rng.normal(size=predicted.shape)
    observations = Observations(SurfaceSamples(normals, outgoing), radiance, np.zeros(400, int))
    data = Data(radiance, np.ones_like(radiance), observations.frame)
    noise = noise or NoiseModel(0.01, 0.001)
    return Stop(Fit(None, None, predicted), None, None, data, observations, noise)


def sample_environment(channels=3):
    rng = np.random.default_rng(1)
    radiance = 0.1 + 0.02 * rng.uniform(size=(16, 32, channels))
    radiance[4, 5] = 20
    radiance[6, 20] = 5
    return Environment(radiance)


def prepared(light):
    if light.environment is None:
        return PreparedLight(dual_light(None, light.directional, 0), None, None)
    split = take(light.environment, candidates(light.environment, SIGMA), 2, SIGMA)
    return PreparedLight(
        dual_light(split, light.directional, BAND_LIMIT), split, SourcesNeeded(2, 0.01, 0.25)
    )


def sample_fit(light, mu=1.5, kd=KD, ks=0.2, refined=True, noise=None):
    channels = len(kd)
    value = Parameters(
        np.array(kd),
        np.full(channels, ks),
        np.array(SIGMA),
        np.array(np.nan if mu is None else mu),
        np.ones(1),
        np.array(1.0),
    )
    scaled = [Parameters(*(factor * np.asarray(x) for x in value)) for factor in (0.9, 1.1, 0.05)]
    stop = sample_stop(channels, noise)
    return BRDFFit(
        Microfacet(np.array(kd), np.full(channels, ks), SIGMA, mu),
        Outcome.CONVERGED,
        Uncertain(value, *scaled),
        {"kd": True, "ks": True, "sigma": True, "mu": True},
        SigmaEvidence(0.01, 0.02, float("inf")),
        stop,
        stop if refined else None,
        prepared(light),
        (),
    )


def sample_frame(name="view00", size=(20, 30), channels=3, seed=0):
    rng = np.random.default_rng(seed)
    rows, columns = size
    covered = np.zeros(size, bool)
    covered[2 : rows - 2, 3 : columns - 3] = True
    photograph = rng.uniform(0.2, 1, (*size, channels))
    predicted = np.where(covered[..., None], photograph * 1.02, 0)
    usable = covered.copy()
    usable[: rows // 2] = False
    return FramePictures(name, photograph, predicted, usable, covered)


RESULT = {
    "task": "brdf",
    "outcome": "not_identifiable",
    "reasons": ["mu is not identifiable: its 90 % interval is 1.2 to 1.9"],
    "brdf": {"model": "microfacet", "kd": list(KD), "ks": 0.2, "sigma": 0.3, "mu": 1.5},
    "interval90": {
        "kd": [[0.19, 0.21], [0.09, 0.11], [0.04, 0.06]],
        "ks": [0.18, 0.22],
        "sigma": [0.28, 0.32],
        "mu": [1.2, 1.9],
    },
    "standard_error": {"kd": [0.006, 0.006, 0.006], "ks": 0.012, "sigma": 0.012, "mu": 0.21},
    "identifiable": {"kd": True, "ks": True, "sigma": True, "mu": False},
    "model_sensitive": {"kd": False, "ks": False, "sigma": True, "mu": False},
    "variants": [
        {
            "fresnel": "half",
            "masking": "smith",
            "chi_squared": 12345.6,
            "kd": list(KD),
            "ks": 0.21,
            "sigma": 0.4321,
            "mu": None,
            "rejected": True,
        }
    ],
    "frequency": {
        "brdf": {"kd": list(KD), "ks": 0.2, "sigma": 0.303, "mu": 1.5},
        "bias": {"kd": [0.01, 0.0, -0.01], "ks": 0.0, "sigma": 0.0123, "mu": 0.0},
        "residual": {"relative_rms": 0.023},
    },
    "noise": {"relative": 0.01, "floor": 0.001},
    "residual": {"relative_rms": 0.0153, "samples": 12000},
    "evidence": {
        "sentence": "sigma rests on grazing angles",
        "all": 0.01,
        "without_grazing": 0.08,
        "spectrum": None,
    },
    "split": {
        "sources": 2,
        "slow_energy": 0.4,
        "error": 0.011,
        "error_without": 0.31,
        "sigma": 0.3,
    },
    "seconds": {"load": 0.12, "solve": 0.0004, "refine": 1.25},
    "provenance": {"jaxrender": "0.1.0", "inputs": {"a.exr": "abc123"}},
}


@pytest.fixture(scope="module")
def light():
    return KnownLight(sample_environment(), DirectionalSources.none())


@pytest.fixture(scope="module")
def contents(light):
    frames = (sample_frame(), sample_frame("view01", seed=1))
    return ReportContents("teflon", RESULT, sample_fit(light), light, frames)


@pytest.fixture(scope="module")
def page(contents, tmp_path_factory):
    return write_report(tmp_path_factory.mktemp("report"), contents).read_text(encoding="utf-8")


class Reader(HTMLParser):
    """All elements with their attributes, and all text."""

    def __init__(self, source):
        super().__init__()
        self.elements, self.words, self.open = [], [], []
        self.feed(source)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        self.open.append(tag)

    def handle_endtag(self, tag):
        while self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self):
        # Narrow and fixed spaces count as spaces.
        return " ".join(" ".join(self.words).split())

    def attributes(self, *names):
        return [a[name] for _, a in self.elements for name in names if name in a]


# ---------------------------------------------------------------- the page as a whole


def assert_asks_for_nothing(source):
    reader = Reader(source)
    assert not {"script", "link", "iframe", "object", "embed", "base", "form"} & {
        tag for tag, _ in reader.elements
    }
    for address in reader.attributes("src", "href", "xlink:href", "data", "srcset"):
        assert address.startswith(("data:image/png;base64,", "#"))
    assert not [name for _, a in reader.elements for name in a if name.startswith("on")]
    styles = source.replace("url(#", "")
    assert "url(" not in styles
    assert "@import" not in styles
    return reader


def test_the_page_is_self_contained(page):
    reader = assert_asks_for_nothing(page)
    assert "http://" not in page
    assert "https://" not in page
    policies = [a["content"] for tag, a in reader.elements if "http-equiv" in a]
    assert policies == ["default-src 'none'; img-src data:; style-src 'unsafe-inline'"]


def test_ids_are_unique_and_links_lead_somewhere(page):
    reader = Reader(page)
    ids = reader.attributes("id")
    assert len(ids) == len(set(ids))
    targets = [address[1:] for address in reader.attributes("href") if address.startswith("#")]
    assert targets
    assert set(targets) <= set(ids)


def test_every_picture_has_words_in_its_place(page):
    reader = Reader(page)
    pictures = [a for tag, a in reader.elements if tag == "img"]
    assert len(pictures) == 2 * 3 + 4 + 2
    assert all(a["alt"].strip() for a in pictures)
    drawings = [a for tag, a in reader.elements if tag == "svg"]
    assert len(drawings) == 5
    assert all(a["role"] == "img" and a["aria-label"].strip() for a in drawings)


def test_every_section_is_there(page):
    assert set(SECTIONS) <= set(Reader(page).attributes("id"))


def test_plots_take_their_colours_from_the_page(page):
    body = page[page.index("<body>") :]
    for variable in ("--ink", "--muted", "--grid", "--series-1", "--series-2", "--series-3"):
        assert f"var({variable})" in body
    for stand_in in ("#010203", "#020304", "#030405", "#040506", "#050607", "#060708"):
        assert stand_in not in body


def test_the_same_contents_give_the_same_bytes(page, contents, tmp_path):
    assert write_report(tmp_path, contents) == tmp_path / "report.html"
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == page


def test_six_large_photographs_stay_below_two_megabytes(light, tmp_path):
    frames = tuple(sample_frame(f"view{k}", (340, 512), seed=k) for k in range(8))
    path = write_report(tmp_path, ReportContents("big", {}, sample_fit(light), light, frames))
    assert path.stat().st_size < 2e6
    text = Reader(path.read_text(encoding="utf-8")).text
    assert "6 of 8 photographs" in text
    # Spread over the capture: the first and the last are among them.
    assert "view0" in text
    assert "view7" in text


# ---------------------------------------------------------------- what it says


def test_it_says_what_the_result_says(page):
    text = Reader(page).text
    for words in (
        "Not identifiable",
        "the photographs do not determine every free parameter".capitalize(),
        "1.5 % rms, of 12 000 samples",
        "0.1900 to 0.2100",
        "albedo 0.628",
        "+1.2 %",
        "σ rests on grazing angles.",
        "no information",
        "12 346",
        "0.432",
        "2 point sources were taken out of the environment, with 60 % of its energy",
        "from 31 % to 1.1 %",
        "under 1 ms",
        "inputs · a.exr abc123",
    ):
        assert words in text, words


def test_a_reason_stands_beside_its_parameter(page):
    groups = [part.split("</tbody>")[0] for part in page.split("<tbody>")[1:5]]
    has_reason = ["mu is not identifiable" in group for group in groups]
    assert has_reason == [False, False, False, True]
    verdicts = [
        "no" if 'class="verdict no"' in group else "yes" if 'class="verdict yes"' in group else ""
        for group in groups
    ]
    assert verdicts == ["yes", "yes", "yes", "no"]


HOSTILE = "</script></style><img src=x onerror=alert(1)>\"'&{{ 7 * 7 }}<script>"


def test_strings_from_outside_are_text(light, tmp_path):
    result = RESULT | {
        "outcome": HOSTILE,
        "reasons": [HOSTILE, "sigma " + HOSTILE],
        "variants": [{"fresnel": HOSTILE, "masking": HOSTILE}],
        "evidence": {"sentence": HOSTILE, "all": 0.1},
        "lighting": {"gauge": HOSTILE},
        "pixels": {"removed": {HOSTILE: 3}},
        "seconds": {HOSTILE: 1.0},
        "provenance": {HOSTILE: {HOSTILE: [HOSTILE]}},
    }
    frames = (sample_frame(HOSTILE),)
    contents = ReportContents(HOSTILE, result, sample_fit(light), light, frames)
    source = write_report(tmp_path, contents).read_text(encoding="utf-8")
    reader = assert_asks_for_nothing(source)
    assert reader.text.count(HOSTILE) >= 12
    assert f"Photograph {HOSTILE}" in reader.attributes("alt")


def rewritten(result, **changes):
    return {key: value for key, value in (result | changes).items() if value is not None}


def lamp(direction, energy, channels=3):
    return DirectionalSources(np.array([direction], float), np.full((1, channels), float(energy)))


def absent_result(light):
    return ReportContents("bare", {}, sample_fit(light), light, ())


def lambertian(light):
    result = rewritten(
        RESULT, brdf={"model": "lambertian", "kd": list(KD)}, evidence=None, variants=None
    )
    return ReportContents("matt", result, sample_fit(light, ks=0.0), light, (sample_frame(),))


def metal(light):
    brdf = RESULT["brdf"] | {"mu": "none"}
    result = rewritten(RESULT, brdf=brdf, interval90={}, standard_error={}, reasons=[])
    return ReportContents("metal", result, sample_fit(light, mu=None), light, (sample_frame(),))


def bare_metal(light):
    return ReportContents("metal", {}, sample_fit(light, mu=None), light, (sample_frame(),))


def moving_lamps(light):
    own = KnownLight(
        None, DirectionalSources.none(), (lamp([0, 0, 1], 3), DirectionalSources.none())
    )
    return ReportContents("moving", {}, sample_fit(own, refined=False), own, (sample_frame(),))


def one_lamp(light):
    own = KnownLight(None, lamp([0, 1, -1], 3))
    return ReportContents("lamp", {}, sample_fit(own), own, ())


def one_channel(light):
    own = KnownLight(sample_environment(1), DirectionalSources.none(1))
    frames = (sample_frame(channels=1),)
    return ReportContents("grey", {}, sample_fit(own, kd=(0.2,)), own, frames)


def two_channels(light):
    own = KnownLight(sample_environment(2), DirectionalSources.none(2))
    frames = (sample_frame(channels=2),)
    return ReportContents("two", {}, sample_fit(own, kd=(0.2, 0.1)), own, frames)


def no_noise(light):
    fit = sample_fit(light, noise=NoiseModel(0.0, 0.0))
    return ReportContents("exact", {}, fit, light, (sample_frame(),))


def nothing_covered(light):
    frame = sample_frame()
    nothing = np.zeros_like(frame.usable)
    empty = frame._replace(usable=nothing, covered=nothing)
    broken = frame._replace(photograph=np.full_like(frame.photograph, np.nan))
    return ReportContents("empty", {}, sample_fit(light), light, (empty, broken))


def nulls(light):
    result = dict.fromkeys(("seconds", "variants", "evidence", "split")) | {
        "brdf": {"model": "microfacet", "kd": [None, 0.1, 0.1], "sigma": None, "mu": None},
        "residual": {"relative_rms": None},
        "noise": {"relative": None, "floor": 0.0},
        "outcome": "unheard_of",
    }
    return ReportContents("nulls", result, sample_fit(light), light, (sample_frame(),))


PARTIAL = {
    made.__name__: made
    for made in (
        absent_result,
        lambertian,
        metal,
        bare_metal,
        moving_lamps,
        one_lamp,
        one_channel,
        two_channels,
        no_noise,
        nothing_covered,
        nulls,
    )
}


@pytest.mark.parametrize("case", PARTIAL)
def test_what_is_absent_is_left_out(case, light, tmp_path):
    path = write_report(tmp_path, PARTIAL[case](light))
    source = path.read_text(encoding="utf-8")
    reader = assert_asks_for_nothing(source)
    assert set(SECTIONS) <= set(reader.attributes("id"))
    words = reader.text.lower().split()
    assert not {"nan", "none,", "inf", "undefined"} & set(words)
    assert "nan" not in "".join(reader.attributes("d", "cx", "cy", "r", "style"))


def test_a_metal_is_called_one(light, tmp_path):
    for case in (metal, bare_metal):
        source = write_report(tmp_path, case(light)).read_text(encoding="utf-8")
        assert "the gloss of a metal" in Reader(source).text


def test_a_matt_material_has_no_gloss_to_show(light, tmp_path):
    text = Reader(write_report(tmp_path, lambertian(light)).read_text(encoding="utf-8")).text
    assert "its glossy part" not in text
    assert "What σ rests on" not in text
    assert "roughness: how wide" not in text


# ---------------------------------------------------------------- pictures


def pixels(uri):
    data = base64.b64decode(uri.removeprefix("data:image/png;base64,"))
    return np.asarray(Image.open(io.BytesIO(data))).astype(float)


def flat_frame(photograph, predicted):
    covered = np.ones((10, 12), bool)
    covered[:, :6] = False
    usable = covered.copy()
    usable[5:] = False
    fill = np.ones((10, 12, 3))
    return FramePictures("flat", photograph * fill, predicted * fill, usable, covered)


def test_the_residual_has_the_sign_of_photograph_less_prediction():
    # 4 % and -4 % of a mean radiance of 1; the scale ends at the next 1, 2 or 5 times 10^k.
    shown_ = gallery((flat_frame(1.04, 1.0), flat_frame(0.96, 1.0)))
    assert shown_.limit == 5
    brighter, darker = (pixels(frame.residual) for frame in shown_.frames)
    assert brighter[2, 6, 0] > brighter[2, 6, 2] + 50
    assert darker[2, 6, 2] > darker[2, 6, 0] + 50
    assert shown_.frames[0].rms == pytest.approx(0.04 / 1.04)


def test_the_residual_is_faint_where_unused_and_absent_where_uncovered():
    residual = pixels(gallery((flat_frame(1.04, 1.0),)).frames[0].residual)
    used, unused = residual[2, -1, 3], residual[8, -1, 3]
    assert used == 255
    assert 0 < unused < 128
    assert residual[2, 0, 3] == 0


def test_all_photographs_share_one_exposure():
    bright, dark = gallery((flat_frame(1.0, 1.0), flat_frame(0.25, 0.25))).frames
    linear = [
        SRGB().linearise(pixels(uri)[2, -1] / 255)
        for uri in (bright.photograph, dark.photograph, dark.predicted)
    ]
    np.testing.assert_allclose(linear[1] / linear[0], 0.25, atol=2 * ONE_CODE)
    np.testing.assert_array_equal(linear[1], linear[2])


def test_a_matt_sphere_follows_lamberts_cosine(light):
    contents = lambertian(light)
    picture = pixels(spheres(contents).lamp)
    linear = SRGB().linearise(picture[..., 0] / 255)
    size = len(linear)
    rows, columns = np.mgrid[:size, :size]
    x, y = (columns + 0.5) * 2 / size - 1, 1 - (rows + 0.5) * 2 / size
    inside = np.hypot(x, y) < 0.95
    z = np.sqrt(1 - np.where(inside, x**2 + y**2, 0))
    toward = np.array([-0.45, 0.55, 0.70])
    toward /= np.linalg.norm(toward)
    cosine = np.maximum(x * toward[0] + y * toward[1] + z * toward[2], 0)[inside]
    scale = linear[inside] @ cosine / (cosine @ cosine)
    np.testing.assert_allclose(linear[inside], scale * cosine, atol=2 * ONE_CODE)


# ---------------------------------------------------------------- light


def test_circles_lie_where_their_sources_are(light):
    given = DirectionalSources(
        np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 1.0]]), np.array([[4.0] * 3, [1.0] * 3])
    )
    own = KnownLight(Environment(np.ones((8, 16, 3))), given)
    first, second = environment_map(own, PreparedLight(None, None, None)).given
    # Azimuth and polar angle in degrees; area in proportion to energy.
    assert first[:2] == (90, 90)
    assert second[:2] == (180, 45)
    assert first.radius == pytest.approx(2 * second.radius)


def test_discs_are_equal_area_projections():
    own = KnownLight(
        None,
        DirectionalSources.none(),
        (lamp([0, 0, 1], 1), lamp([1, 0, 1], 4), lamp([0, 1, -1], 1)),
    )
    upper, lower = direction_discs(own)
    # The cap down to polar angle t has the share (1 - cos t) of the half sphere.
    ring = np.sqrt(1 - np.cos(np.pi / 4))
    np.testing.assert_allclose([c[:2] for c in upper.circles], [[0, 0], [ring, 0]], atol=1e-4)
    np.testing.assert_allclose(lower.circles[0][:2], [0, -ring], atol=1e-4)
    assert [c.label for c in upper.circles] == ["1", "2"]
    assert upper.circles[1].radius == pytest.approx(2 * upper.circles[0].radius, rel=1e-3)


def test_a_source_has_the_energy_of_the_addition_theorem():
    found = energy_by_degree(light_coefficients(lamp([1, 2, 3], 3), 6))
    np.testing.assert_allclose(found, 9 * (2 * np.arange(7) + 1) / (4 * np.pi), rtol=1e-12)


# ---------------------------------------------------------------- residuals and words


def test_percentiles_by_exit_angle():
    # One angle in each of the fourteen bins.
    angles = np.repeat(np.linspace(0, 65, 14), 101)
    values = np.tile(np.linspace(-1, 1, 101), 14) + angles
    bins = binned(angles, values[:, None])
    np.testing.assert_allclose(bins.angles, np.arange(0, 70, 5), atol=1e-9)
    np.testing.assert_allclose(bins.middle, bins.angles, atol=1e-9)
    np.testing.assert_allclose(bins.high - bins.low, 1.8, atol=1e-9)


def test_bins_with_few_samples_are_left_out():
    angles = np.concatenate([np.zeros(100), [80.0]])
    assert len(binned(angles, np.zeros((101, 1))).angles) == 1


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        (percent(0.1234), "12\u00a0%"),
        (percent(-0.00123, sign=True), "−0.12\u00a0%"),
        (percent(1e-7), "under 0.001\u00a0%"),
        (percent(0.0), "0.0\u00a0%"),
        (percent(None), "–"),
        (percent(float("inf")), "–"),
        (shown(0.19), "0.1900"),
        (shown(-1.23456e-5, 2), "−1.2\u202f×\u202f10⁻⁵"),
        (shown(0.0), "0"),
        (shown(True), "–"),
        (seconds(1e-5), "under 1 ms"),
        (seconds(250.4), "250 s"),
    ],
)
def test_numbers_as_words(written, expected):
    assert written == expected


def test_numbers_of_anything():
    assert numbers([[0.1, 2], None, "none", 3]) == [0.1, 2.0, 3.0]
    assert numbers(None) == []


def test_the_template_travels_with_the_package():
    folder = Path(__import__("jaxrender.pipelines.report", fromlist=["x"]).__file__).parent
    assert (folder / "report.html.j2").is_file()
    assert (folder / "report.css").is_file()
