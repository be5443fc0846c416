"""``jaxrender analyze CONFIG``: before any photograph is taken.

- It needs no photographs: cameras, shape and light do; for a recipe nothing is rendered.
- Numbers come from the command line, the config, the recipe, or what is typical, and it says which.
- Uniform light seen head-on: the sentence that a user needs, and a suggestion that helps.
- Bad input is refused as a fit refuses it.
"""

import re
import shutil

import numpy as np
import pytest
from small_captures import CONFIG, edit_json, jaxrender, write_ball

from jaxrender.io import write_image


@pytest.fixture
def planned(tmp_path):
    """A capture whose photographs have not been taken."""
    config = write_ball(tmp_path)
    shutil.rmtree(tmp_path / "images")
    return config


def uniform(config, more=""):
    write_image(config.parent / "grey.exr", np.ones((32, 64, 3)))
    text = CONFIG.replace("per_frame: lights.json", "environment: {path: grey.exr}")
    config.write_text(text + more)
    return config


def test_no_photograph_is_needed(planned, capsys):
    assert jaxrender("analyze", planned, "brdf.sigma.start=0.25", "--suppose", "mu=1.6") == 0
    text = capsys.readouterr().out
    assert "4 photographs, not read; 600 samples, of which 300 for the last step" in text
    assert "sigma 0.25, mu 1.6; noise 1 %" in text
    assert "kd, ks, noise typical; sigma from the config; mu as supposed" in text
    assert re.search(r"sigma +0.25 .* yes\n", text)
    assert "Light, material known\n  the light differs from photograph to photograph" in text
    assert not (planned.parent / "images").exists()


@pytest.mark.slow
def test_uniform_light_seen_head_on(planned, capsys):
    config = uniform(planned)
    figure = planned.parent / "forecast.svg"
    options = ["samples.min_cosine=0.7", "--suggest", "sources", "--count", "2"]
    assert jaxrender("analyze", config, *options, "--figure", figure) == 0
    text = capsys.readouterr().out
    assert "no energy above degree 0" in text
    assert "every sample's exit cosine is above 0.7" in text
    assert "what would help: a source" in text
    table = text[text.index("source towards") :].splitlines()
    now, best = (row.rstrip().split("%") for row in table[1:3])
    # Columns kd, ks, sigma, mu: sigma is identifiable with the source, whatever it was before.
    assert float(best[2]) < 5
    assert "nothing" in table[1] or float(now[2]) > 20
    assert "photographed as" in table[2]
    assert figure.stat().st_size > 10_000


@pytest.mark.slow
def test_a_recipe_is_not_rendered(tmp_path, capsys):
    (tmp_path / "recipe.yaml").write_text(
        "geometry: {sphere: {radius: 1}}\n"
        "brdf: {model: microfacet, kd: [0.2, 0.2, 0.2], ks: 0.1, sigma: 0.2, mu: 1.5}\n"
        "lighting: {directional: [{direction: [1, 1, 1], irradiance: [1, 1, 1]}]}\n"
        "views: {count: 3, step_degrees: 60, axis: [0, 0, 1], width: 32, height: 32}\n"
        "noise: {relative: 0.02, floor: 0}\n"
    )
    (tmp_path / "run.yaml").write_text(
        "task: brdf\ncapture: {recipe: recipe.yaml}\n"
        "samples: {count: 600}\nsolve: {refine_samples: 300}\n"
    )
    cache = tmp_path / "cache"
    options = ["--suggest", "views", "--count", "3", "--aim", "sigma"]
    assert jaxrender("analyze", tmp_path / "run.yaml", *options, cache=cache) == 0
    text = capsys.readouterr().out
    assert "kd, ks, sigma, mu, noise from the recipe" in text
    assert "3 photographs" in text
    assert "noise 2 %" in text
    assert "to know sigma better" in text
    rows = text[text.index("camera towards") :].splitlines()[2:5]
    assert [row.split(".")[0].strip() for row in rows] == ["1", "2", "3"]
    assert not cache.exists()


@pytest.mark.slow
def test_a_lobe_with_an_exponent_is_supposed_by_it(tmp_path, capsys):
    (tmp_path / "recipe.yaml").write_text(
        "geometry: {sphere: {radius: 1}}\n"
        "brdf: {model: phong, kd: 0.1, ks: 0.2, exponent: 50}\n"
        "lighting: {directional: [{direction: [1, 1, 1], irradiance: 1}]}\n"
        "views: {count: 3, step_degrees: 60, width: 32, height: 32}\n"
    )
    (tmp_path / "run.yaml").write_text(
        "task: brdf\ncapture: {recipe: recipe.yaml}\nbrdf: {model: phong}\n"
        "samples: {count: 600}\nsolve: {refine_samples: 300}\n"
    )
    assert jaxrender("analyze", tmp_path / "run.yaml", cache=tmp_path / "cache") == 0
    text = capsys.readouterr().out
    assert "supposed: kd 0.1, ks 0.2, exponent 50; noise 1 %" in text
    assert "kd, ks, exponent, noise from the recipe" in text


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--suppose", "shine=1"], "--suppose shine=1: microfacet has kd, ks, sigma, mu"),
        (["--suppose", "sigma=-1"], "give 1 number above 0"),
        (["--suppose", "exponent=9"], "--suppose exponent=9: microfacet has kd, ks, sigma, mu"),
        (["--suppose", "kd=red"], "'red' is no number"),
        (["--noise", "0"], "--noise 0"),
        (["--count", "0"], "--count 0"),
        (["--brdf", "mirror"], "--suppose sigma=0.1"),
        (["brdf.m=2"], "did you mean 'mu'?"),
        (["samples.count=3"], "samples.count is 3"),
        (["brdf.sigma.bounds=[0.3,0.5]"], "the supposed sigma is 0.1"),
        (["capture.geometry.sphere.center=[50,0,0]"], "no camera sees the object"),
    ],
)
def test_bad_input(planned, capsys, options, message):
    assert jaxrender("analyze", planned, *options) == 2
    assert message in capsys.readouterr().err


def test_broken_cameras_are_refused_as_a_fit_does(tmp_path, capsys):
    planned = write_ball(tmp_path)
    edit_json(planned.parent / "transforms.json", lambda content: content.pop("fl_x"))
    assert jaxrender("analyze", planned) == 2
    shown = capsys.readouterr().err
    assert jaxrender("fit", planned) == 2
    assert shown.splitlines()[-1] == capsys.readouterr().err.splitlines()[-1]


def test_options_of_configs_do_not_go_with_panoramas(planned, capsys):
    uniform(planned)
    assert jaxrender("analyze", planned.parent / "grey.exr", "--suggest", "views") == 2
    assert "go with a run's config" in capsys.readouterr().err
