"""Fits whose light is unknown, from config to result folder.

- ``task: factorize`` finds two sources and the material of a ball in plain NumPy's photographs, in
  the gauge it states, and predicts the photographs.
- ``task: lighting`` finds the sources' own irradiance, given the material.
- Any glossy model can be fitted, and is reported in its own words.
- A diffuse ball's sources are found, too, and which degrees of the light it cannot tell is said.
- ``result.json`` has the keys of the contract; the light is written as an image of that energy, the
  slow part with the coefficients that were found.
- Exposures that differ are found with light and material, if they are freed: stated, written with
  the cameras, and in the predicted photographs.
- A source is rendered as it stands beside the picture.
- A source with a width is rendered with it.
- The result renders again, and under another environment.
- Too few pixels for the light's coefficients are refused in words.
"""

import json
import shutil
from unittest import mock

import h5netcdf
import numpy as np
import pytest
import small_captures
from small_captures import KD, KS, MU, SIGMA, Ball, write_ball

from jaxrender.brdf import BlinnPhong, material_named
from jaxrender.errors import InputError
from jaxrender.io import read_capture, read_environment, read_image, write_environment
from jaxrender.lighting import Environment
from jaxrender.pipelines import fit, load_run_config
from jaxrender.pipelines.render import Scene, light_of_run, render_config
from jaxrender.pipelines.result import read_run
from jaxrender.pipelines.summary import summary_of

SOURCES = (((0.5, 0.6, 0.62), (2.0, 1.8, 1.5)), ((0.3, -0.7, 0.2), (0.6, 0.7, 0.9)))
BALL = Ball(views=6, size=40, lights=(SOURCES,) * 6, gains=(1.0,) * 6)
CONFIG = """\
task: {task}
capture: {{transforms: transforms.json, geometry: {{sphere: {{radius: 1}}}}}}
brdf: {{{brdf}}}
samples: {{count: {count}}}
solve: {{band_limit: 3, most_sources: 4}}
"""
GIVEN = f"kd: [{KD[0]}, {KD[1]}, {KD[2]}], ks: {KS}, sigma: {SIGMA}, mu: {MU}"


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sources") / "capture"
    write_ball(folder, BALL)
    return folder


@pytest.fixture(scope="module")
def factorized(capture):
    return _run(capture, "factorize", "")


@pytest.fixture(scope="module")
def relit(capture):
    return _run(capture, "lighting", GIVEN)


def _run(capture, task, brdf, count=1200, name=None):
    path = capture / f"{name or task}.yaml"
    path.write_text(CONFIG.format(task=task, brdf=brdf, count=count))
    output = capture.parent / (name or task)
    config = load_run_config(path).model_copy(update={"output": output})
    fit(config, force=True)
    return output, json.loads((output / "result.json").read_text())


def _angles(result):
    """Between each true source and the nearest found one, degrees, and which that is."""
    found = np.array([source["direction"] for source in result["lighting"]["directional"]])
    truth = np.array([direction for direction, _ in SOURCES])
    cosines = truth / np.linalg.norm(truth, axis=1, keepdims=True) @ found.T
    return np.degrees(np.arccos(np.clip(cosines.max(axis=1), -1, 1))), cosines.argmax(axis=1)


def test_factorize_finds_material_and_sources(factorized):
    _, result = factorized
    assert (result["task"], result["outcome"]) == ("factorize", "converged")
    kd = np.array(KD)
    np.testing.assert_allclose(result["brdf"]["ks"], KS / (kd + KS), rtol=0.02)
    np.testing.assert_allclose(np.add(result["brdf"]["kd"], result["brdf"]["ks"]), 1)
    assert result["brdf"]["sigma"] == pytest.approx(SIGMA, rel=0.01)
    assert result["brdf"]["mu"] == pytest.approx(MU, rel=0.03)
    assert result["residual"]["relative_rms"] == pytest.approx(BALL.noise, rel=0.2)
    angles, which = _angles(result)
    assert np.all(angles < 0.2)
    energies = [result["lighting"]["directional"][k]["irradiance"] for k in which]
    truth = np.array([energy for _, energy in SOURCES]) * (kd + KS)
    np.testing.assert_allclose(energies, truth, rtol=0.03)


@pytest.mark.slow
def test_exposures_are_freed_with_light_and_material(tmp_path):
    gains = 1 + 0.04 * np.array([1.0, -0.6, 0.3, -1.1, 0.8, -0.4])
    write_ball(tmp_path / "capture", BALL._replace(gains=tuple(gains.tolist())))
    path = tmp_path / "capture/freed.yaml"
    text = CONFIG.format(task="factorize", brdf="", count=1200)
    path.write_text(text.replace("solve: {", "solve: {free: [exposure], "))
    folder = tmp_path / "freed"
    fit(load_run_config(path).model_copy(update={"output": folder}))
    result = json.loads((folder / "result.json").read_text())
    assert result["outcome"] == "converged"
    assert result["brdf"]["sigma"] == pytest.approx(SIGMA, rel=0.01)
    exposure = result["calibration"]["nuisances"]["exposure"]
    logarithms = 100 * np.log(gains)
    np.testing.assert_allclose(exposure["value"], logarithms - logarithms.mean(), atol=0.3)
    found = [row["gain"] for row in result["photographs"]]
    np.testing.assert_allclose(found, np.exp(np.array(exposure["value"]) / 100))
    frames = read_capture(folder / "capture.json", images=tmp_path / "capture").frames
    np.testing.assert_allclose([frame.exposure for frame in frames], found)
    # Predicted are the photographs as they were taken.
    for number in (0, 3):
        predicted = read_image(folder / "images" / f"{number}_predicted.exr").pixels
        photograph = read_image(frames[number].image_path).pixels[..., :3]
        inside = predicted.sum(axis=-1) > 0.05
        ratio = predicted[inside].sum() / photograph[inside].sum()
        assert ratio == pytest.approx(1, abs=0.003)
    assert "What was freed" in (folder / "report.html").read_text()


@pytest.mark.slow
def test_another_model_speaks_its_own_words(capture):
    """Facets of few degrees look much alike: an exponent of the half vector is 2 / sigma^2.

    All pixels together say 27.2.
    """
    _, result = _run(capture, "factorize", "model: blinn-phong", 800, "blinn")
    own = {"kd", "ks", "exponent"}
    assert set(result["brdf"]) == {"model", *own}
    for key in ("interval90", "standard_error", "identifiable"):
        assert set(result[key]) == own
    low, high = result["interval90"]["exponent"]
    assert low < result["brdf"]["exponent"] < high
    assert result["brdf"]["exponent"] == pytest.approx(2 / SIGMA**2, rel=0.2)
    assert isinstance(material_named("blinn-phong", result["brdf"]), BlinnPhong)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "brdf", "scale"),
    [
        ("lighting", f", kd: [{KD[0]}, {KD[1]}, {KD[2]}]", np.ones(3)),
        ("factorize", "", KD),
    ],
    ids=["lighting", "factorize"],
)
def test_a_diffuse_ball_tells_its_sources(tmp_path, task, brdf, scale):
    with mock.patch.object(small_captures, "KS", 0.0):
        write_ball(tmp_path / "capture", BALL)
    output, result = _run(tmp_path / "capture", task, "model: lambertian" + brdf)
    assert result["brdf"] == {"model": "lambertian", "kd": list(KD if brdf else np.ones(3))}
    angles, which = _angles(result)
    assert np.all(angles < 0.5)
    energies = [result["lighting"]["directional"][k]["irradiance"] for k in which]
    np.testing.assert_allclose(
        energies, [energy * np.array(scale) for _, energy in SOURCES], rtol=0.03
    )
    sentence = "of the slow light degrees 0 to 2 are identifiable; smoothness fills in the rest"
    assert result["lighting"]["sentence"] == sentence
    assert result["lighting"]["told"][3] < 0.05
    assert sentence in summary_of(result)
    page = (output / "report.html").read_text()
    assert "The material is diffuse: it reflects light in all directions" in page
    assert "the material compensates for" not in page


def test_lighting_finds_irradiance_in_its_own_units(relit):
    _, result = relit
    assert result["task"] == "lighting"
    assert result["lighting"]["gauge"] == "given by the material"
    angles, which = _angles(result)
    assert np.all(angles < 0.2)
    energies = [result["lighting"]["directional"][k]["irradiance"] for k in which]
    np.testing.assert_allclose(energies, [energy for _, energy in SOURCES], rtol=0.02)
    assert result["brdf"]["kd"] == list(KD)
    assert result["identifiable"] == {}


def test_results_have_the_keys_of_the_contract(factorized):
    folder, result = factorized
    for key in ("interval90", "standard_error", "identifiable", "noise", "seconds", "provenance"):
        assert result[key], key
    lighting = result["lighting"]
    assert len(lighting["coefficients"]) == len(lighting["coefficients_total"]) == 16
    assert lighting["band_limit"] == 3
    assert lighting["clusters"] == []
    assert {one["cluster"] for one in lighting["directional"]} == {None}
    deviation = np.asarray(read_environment(folder / lighting["deviation"]).radiance)
    # The mean square over the sphere is that of the coefficients, before channels are tied.
    stated = np.sqrt(np.sum(np.square(lighting["coefficients_error"])) / (12 * np.pi))
    assert 0.3 * stated < np.sqrt(np.mean(deviation**2)) < 1.1 * stated
    assert result["path"][0]["sources"] == 0
    assert result["path"][-1]["sources"] == len(lighting["directional"])
    with h5netcdf.File(folder / "result.nc") as file:
        assert file["light"]["slow"].shape == (16, 3)
        assert file["samples"]["predicted"].shape == (1200, 3)
    page = (folder / "report.html").read_text()
    assert "Material and light recovered from photographs" in page
    # A gauge's reflectances are no albedo.
    assert ">albedo " not in page


def test_the_summary_says_where_a_cluster_is(factorized):
    _, result = factorized
    assert "cluster" not in summary_of(result)
    one = {
        "members": [0, 2, 3],
        "direction": [0, 0.6, 0.8],
        "width_degrees": 2.81,
        "irradiance": [1, 0.9, 0.8],
    }
    lighting = result["lighting"] | {"clusters": [one]}
    said = "3 of them are a cluster, 2.8 degrees wide: from 0 0.6 0.8, irradiance 1 0.9 0.8 in all"
    assert said in summary_of(result | {"lighting": lighting})


def test_the_light_is_written_with_its_energy(factorized):
    folder, result = factorized
    nodes = read_environment(folder / "lighting.exr").nodes()
    slow = read_environment(folder / "lighting_slow.exr").nodes()
    sources = np.sum([source["irradiance"] for source in result["lighting"]["directional"]], axis=0)
    energy = np.asarray(nodes.irradiance).sum(0) - np.asarray(slow.irradiance).sum(0)
    np.testing.assert_allclose(energy, sources, rtol=1e-4)
    brightest = np.asarray(nodes.directions)[np.asarray(nodes.irradiance).sum(1).argmax()]
    truth = np.array(SOURCES[0][0]) / np.linalg.norm(SOURCES[0][0])
    assert brightest @ truth > np.cos(np.radians(2))


def test_predictions_look_like_the_photographs(factorized, capture):
    folder, _ = factorized
    predicted = read_image(folder / "images" / "0_predicted.exr").pixels
    photograph = read_image(capture / "images" / "0.exr").pixels[..., :3]
    inside = photograph.sum(axis=-1) > 0.2 * photograph.sum(axis=-1).max()
    ratio = predicted[inside] / photograph[inside]
    assert np.median(np.abs(ratio - 1)) < 0.02


def test_too_few_pixels_are_refused(capture):
    with pytest.raises(InputError, match="50 samples for light of 16 coefficients"):
        _run(capture, "factorize", "", count=50)


@pytest.mark.slow
def test_a_recovered_light_renders_the_photographs(factorized, capture, tmp_path):
    folder, _ = factorized
    out = render_config(folder, tmp_path / "again")
    image = read_image(out / "0.exr")
    photograph = read_image(capture / "images" / "0.exr").pixels[..., :3]
    inside = photograph.sum(axis=-1) > 0.2 * photograph.sum(axis=-1).max()
    assert np.median(np.abs(image.pixels[..., :3][inside] / photograph[inside] - 1)) < 0.02


@pytest.mark.slow
def test_sources_are_rendered_as_they_stand_beside_the_picture(factorized, tmp_path):
    """Twice the irradiance beside the picture of slow light makes highlights twice as bright."""
    folder, result = factorized
    changed = tmp_path / "changed"
    shutil.copytree(folder, changed)
    for one in result["lighting"]["directional"]:
        np.testing.assert_allclose(one["irradiance_shown"], one["irradiance"], rtol=0.02)
    edited = json.loads((changed / "result.json").read_text())
    for one in edited["lighting"]["directional"]:
        one["irradiance_shown"] = [2 * value for value in one["irradiance_shown"]]
    (changed / "result.json").write_text(json.dumps(edited))
    usual = render_config(folder, tmp_path / "usual")
    brighter = render_config(changed, tmp_path / "brighter")
    before, after = (read_image(next(out.glob("**/0*.exr"))).pixels for out in (usual, brighter))
    assert after.max() > 1.5 * before.max()


def test_relighting_by_another_environment(factorized, tmp_path):
    """White light on kd + ks = 1 with a specular lobe: a bright ball, the same from every side."""
    folder, result = factorized
    write_environment(tmp_path / "white.exr", Environment(np.ones((32, 64, 3))))
    scene = Scene(tmp_path / "white.exr")
    out = render_config(folder, tmp_path / "white", scene=scene)
    pixels = read_image(out / "0.exr").pixels[..., :3]
    middle = pixels[18:22, 18:22].mean(axis=(0, 1))
    kd, ks = np.array(result["brdf"]["kd"]), np.array(result["brdf"]["ks"])
    # Head-on the lobe reflects all but a few per cent of itself.
    np.testing.assert_allclose(middle, np.pi * kd + ks, rtol=0.05)


def test_missing_environment_is_named(factorized, tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.exr: no such file"):
        render_config(factorized[0], tmp_path / "out", scene=Scene(tmp_path / "nowhere.exr"))
    assert not (tmp_path / "out").exists()


def test_a_source_with_a_width_is_rendered_with_it(factorized, tmp_path):
    folder, _ = factorized
    changed = tmp_path / "wide"
    shutil.copytree(folder, changed)
    edited = json.loads((changed / "result.json").read_text())
    sources = edited["lighting"]["directional"]
    assert [one["width_degrees"] for one in sources] == [0] * len(sources)
    sources[0]["width_degrees"] = 5.0
    (changed / "result.json").write_text(json.dumps(edited))
    before, after = (light_of_run(read_run(one), None).directional for one in (folder, changed))
    count = len(np.asarray(before.directions))
    # Its seven points share its energy.
    assert len(np.asarray(after.directions)) == count + 6
    whole = [np.asarray(one.irradiance).sum(axis=0) for one in (before, after)]
    np.testing.assert_allclose(whole[1], whole[0], rtol=1e-6)
    nearest = np.asarray(after.directions) @ np.asarray(sources[0]["direction"])
    assert np.count_nonzero(nearest > np.cos(np.radians(5 * np.sqrt(2) + 0.1))) == 7
