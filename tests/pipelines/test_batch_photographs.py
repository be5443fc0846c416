"""Photographs that the recipes of a batch ask for.

- Photographs that runs share are rendered once, also by two processes at a time.
- Those that cannot be rendered are the error of their runs, and the others go on.
"""

from concurrent.futures import ThreadPoolExecutor

import pytest
from batch_runs import Fits, opened, working_directory
from small_captures import jaxrender

from jaxrender.pipelines.batch import task as task_module
from jaxrender.pipelines.batch.plan import plan_of
from jaxrender.pipelines.config.sweep import load_sweep

RECIPE = """\
geometry: {sphere: {}}
brdf: {model: lambertian, kd: 0.1}
lighting:
  directional:
    - {direction: [0, 0, 1], irradiance: 1}
    - {direction: [1, 0, 1], irradiance: 1}
views: {count: 1, width: 8, height: 8}
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    return working_directory(tmp_path, monkeypatch)


@pytest.fixture
def fits(monkeypatch):
    return Fits(monkeypatch)


@pytest.fixture
def recipes(place, monkeypatch):
    """A sweep over two recipes and two seeds, with the synthesis counted."""
    made = []
    synthesise = task_module.synthesise

    def counted(recipe, path, *arguments, **named):
        made.append(path.name)
        return synthesise(recipe, path, *arguments, **named)

    monkeypatch.setattr(task_module, "synthesise", counted)
    (place / "a.yaml").write_text(RECIPE)
    (place / "b.yaml").write_text(RECIPE.replace("kd: 0.1", "kd: 0.2"))
    (place / "base.yaml").write_text("task: brdf\ncapture: {recipe: a.yaml}\n")
    grid = "grid: {samples.seed: [0, 1], capture.recipe: [a.yaml, b.yaml]}"
    (place / "sweep.yaml").write_text(f"base: base.yaml\n{grid}\noutput: out\n")
    return made


def test_photographs_are_rendered_once(place, fits, recipes, capsys):
    assert jaxrender("batch", "sweep.yaml", "--dry-run") == 0
    assert "the photographs of 2 recipes would be rendered" in capsys.readouterr().out
    assert recipes == []
    assert jaxrender("batch", "sweep.yaml") == 0
    assert sorted(recipes) == ["a.yaml", "b.yaml"]
    assert len(fits.done) == 4
    # A recipe is what it says, not where or how it is written; its name may follow its words.
    names = opened().run.values.tolist()
    (place / "a.yaml").write_text(f"# the same\n{RECIPE}")
    assert [run.name for run in plan_of(load_sweep("sweep.yaml"))] == names
    (place / "a.yaml").write_text(RECIPE.replace("kd: 0.1", "kd: 0.3"))
    assert jaxrender("batch", "sweep.yaml") == 0
    assert len(fits.done) == 6
    assert len(recipes) == 3


def test_photographs_that_fail_are_the_error_of_their_runs(place, fits, recipes):
    (place / "a.yaml").write_text(RECIPE.replace("irradiance: 1", "irradiance: 0"))
    assert jaxrender("batch", "sweep.yaml") == 0
    assert recipes == ["a.yaml", "b.yaml"]
    assert opened().outcome.values.tolist() == ["failed", "converged"] * 2
    assert "the light is zero" in opened().error.values[2]


def test_photographs_are_rendered_once_by_two_at_a_time(place, recipes):
    def render(_):
        return task_module.render_photographs(place / "a.yaml", print)

    with ThreadPoolExecutor(2) as both:
        assert list(both.map(render, range(2))) == [None, None]
    assert recipes == ["a.yaml"]
