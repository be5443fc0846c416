"""The report: one file that asks for nothing, says what the result says, and survives absences.

- Self-contained: no script, no event handler, no address but ``data:`` and ``#``; ids are unique;
  every picture has words in its place.
- Every section is there; values, intervals and reasons stand where they belong.
- Strings from outside are text, never markup.
- Whatever is absent (environment, specular lobe, Fresnel, refinement, channels, frames, keys) is
  left out.
- The same contents give the same bytes; six photographs stay below two megabytes.
"""

import numpy as np
import pytest
from report_samples import (
    RESULT,
    SECTIONS,
    Reader,
    lambertian,
    rewritten,
    sample_environment,
    sample_fit,
    sample_frame,
    source,
)

from jaxrender.imaging import NoiseModel
from jaxrender.inverse import KnownLight
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.report import write_report
from jaxrender.pipelines.report.contents import MaterialContents
from jaxrender.pipelines.report.known_light import material_page


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
    # Two frames, four balls, two panoramas; a ball and a residual on the first page.
    assert len(pictures) == 2 * 3 + 4 + 2 + 2
    assert all(a["alt"].strip() for a in pictures)
    drawings = [a for tag, a in reader.elements if tag == "svg"]
    assert len(drawings) == 7 + 2
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
    assert write_report(tmp_path, material_page(contents)) == tmp_path / "report.html"
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == page


def test_six_large_photographs_stay_below_two_megabytes(light, tmp_path):
    frames = tuple(sample_frame(f"view{k}", (340, 512), seed=k) for k in range(8))
    contents = MaterialContents("big", {}, sample_fit(light), light, frames)
    path = write_report(tmp_path, material_page(contents))
    assert path.stat().st_size < 2e6
    text = Reader(path.read_text(encoding="utf-8")).text
    assert "6 of 8 photographs" in text
    # Spread over the capture: the first and the last are among them.
    assert "view0" in text
    assert "view7" in text


def test_it_says_what_the_result_says(page):
    text = Reader(page).text
    for words in (
        "Not identifiable",
        "the photographs do not determine every free parameter".capitalize(),
        "1.5 % rms of 12 000 samples",
        "0.1900 to 0.2100",
        "albedo 0.628",
        "+1.2 %",
        "σ rests on grazing angles.",
        "no information",
        "12 346",
        "0.432",
        "The fit took 2 directional sources out of the environment. They have 60 % of its",
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


def test_what_is_told_only_together_is_named(contents, page, tmp_path):
    text = Reader(page).text
    assert "much better together than each alone: Ks and μ." in text
    # Of three channels the strongest stands in the table, with its sign.
    table = page.split('id="correlations"')[1].split("</details>")[0]
    assert "−0.30" in table
    assert "−0.10</td>" in table
    assert "−0.20" not in table
    alone = {"numbers": ["kd[0]", "kd[1]"], "matrix": [[1, 0.9], [0.9, 1]]}
    other = contents._replace(result=RESULT | {"correlations": alone})
    assert "correlations" not in write_report(tmp_path, material_page(other)).read_text(
        encoding="utf-8"
    )


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
    contents = MaterialContents(HOSTILE, result, sample_fit(light), light, frames)
    source = write_report(tmp_path, material_page(contents)).read_text(encoding="utf-8")
    reader = assert_asks_for_nothing(source)
    assert reader.text.count(HOSTILE) >= 12
    assert f"Photograph {HOSTILE}" in reader.attributes("alt")


def absent_result(light):
    return MaterialContents("bare", {}, sample_fit(light), light, ())


def metal(light):
    brdf = RESULT["brdf"] | {"mu": "none"}
    result = rewritten(RESULT, brdf=brdf, interval90={}, standard_error={}, reasons=[])
    return MaterialContents("metal", result, sample_fit(light, mu=None), light, (sample_frame(),))


def bare_metal(light):
    return MaterialContents("metal", {}, sample_fit(light, mu=None), light, (sample_frame(),))


def moving_sources(light):
    own = KnownLight(
        None, DirectionalSources.none(), (source([0, 0, 1], 3), DirectionalSources.none())
    )
    return MaterialContents("moving", {}, sample_fit(own, refined=False), own, (sample_frame(),))


def one_source(light):
    own = KnownLight(None, source([0, 1, -1], 3))
    return MaterialContents("source", {}, sample_fit(own), own, ())


def one_channel(light):
    own = KnownLight(sample_environment(1), DirectionalSources.none(1))
    frames = (sample_frame(channels=1),)
    return MaterialContents("grey", {}, sample_fit(own, kd=(0.2,)), own, frames)


def two_channels(light):
    own = KnownLight(sample_environment(2), DirectionalSources.none(2))
    frames = (sample_frame(channels=2),)
    return MaterialContents("two", {}, sample_fit(own, kd=(0.2, 0.1)), own, frames)


def no_noise(light):
    fit = sample_fit(light, noise=NoiseModel(0.0, 0.0))
    return MaterialContents("exact", {}, fit, light, (sample_frame(),))


def nothing_covered(light):
    frame = sample_frame()
    nothing = np.zeros_like(frame.usable)
    empty = frame._replace(usable=nothing, covered=nothing)
    broken = frame._replace(photograph=np.full_like(frame.photograph, np.nan))
    return MaterialContents("empty", {}, sample_fit(light), light, (empty, broken))


def nulls(light):
    result = dict.fromkeys(("seconds", "variants", "evidence", "split")) | {
        "brdf": {"model": "microfacet", "kd": [None, 0.1, 0.1], "sigma": None, "mu": None},
        "residual": {"relative_rms": None},
        "noise": {"relative": None, "floor": 0.0},
        "outcome": "unheard_of",
    }
    return MaterialContents("nulls", result, sample_fit(light), light, (sample_frame(),))


PARTIAL = {
    made.__name__: made
    for made in (
        absent_result,
        lambertian,
        metal,
        bare_metal,
        moving_sources,
        one_source,
        one_channel,
        two_channels,
        no_noise,
        nothing_covered,
        nulls,
    )
}


@pytest.mark.parametrize("case", PARTIAL)
def test_what_is_absent_is_left_out(case, light, tmp_path):
    path = write_report(tmp_path, material_page(PARTIAL[case](light)))
    source = path.read_text(encoding="utf-8")
    reader = assert_asks_for_nothing(source)
    assert set(SECTIONS) <= set(reader.attributes("id"))
    words = reader.text.lower().split()
    assert not {"nan", "none,", "inf", "undefined"} & set(words)
    assert "nan" not in "".join(reader.attributes("d", "cx", "cy", "r", "style"))


def test_a_metal_is_called_one(light, tmp_path):
    for case in (metal, bare_metal):
        source = write_report(tmp_path, material_page(case(light))).read_text(encoding="utf-8")
        assert "a metal reflects the same" in Reader(source).text


def test_a_diffuse_material_has_no_specular_lobe_to_show(light, tmp_path):
    text = Reader(
        write_report(tmp_path, material_page(lambertian(light))).read_text(encoding="utf-8")
    ).text
    assert "its specular part" not in text
    assert "Evidence for σ" not in text
    assert "roughness: how wide" not in text
