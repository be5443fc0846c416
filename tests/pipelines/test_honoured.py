"""What the table of honoured keys says is what a user is told, and what the schema says.

- Every task and key of the table: stated, it is refused with file, place, value, task and remedy.
- Every other case is reached by some run, and refuses what is stated; what was not stated, what
  agrees with what is done, and a switch that is off, are let pass.
- Values stated on a command line and in a sweep are stated as well.
- A config that is written out in full names what has an effect, and is read back equal.
"""

from pathlib import Path

import pytest
from stated_runs import OTHER, RUNS, others, text_of

from jaxrender.errors import InputError
from jaxrender.pipelines.config import json_schema, load_run_config, resolved_yaml
from jaxrender.pipelines.config.honoured import CASES, honouring
from jaxrender.pipelines.config.sweep import load_sweep
from jaxrender.pipelines.config.tasks import UNUSED

OF_TASK = {
    "texture under known light": "texture",
    "texture under unknown light": "texture in the dark",
}
RECIPE = "task: brdf\ncapture: {recipe: recipe.yaml}\n"
SECTIONS = {
    "lighting": "{split: off}",
    "brdf": "{model: ggx}",
    "texture": "{size: 8}",
    "spectrum": "{order: 4}",
    "solve": "{diagnose: false}",
    "brdf.model": "ward",
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def load(text, *overrides):
    Path("run.yaml").write_text(text)
    return load_run_config("run.yaml", overrides)


def values(key):
    if key in SECTIONS:
        return SECTIONS[key], *OTHER.get(key, ())
    return others(key if key in OTHER else f"{key}.fixed")


def refusal(text, key, value):
    """What is said of a key on the command line; nothing where it is let pass."""
    try:
        load(text, f"{key}={value}")
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(("task", "key"), [(task, key) for task in UNUSED for key in UNUSED[task]])
def test_what_a_task_has_no_use_for_is_refused(task, key):
    text = text_of(OF_TASK.get(task) or task)
    said = [refusal(text, key, value) for value in values(key)]
    start = f"command line: {key}={values(key)[0]}: {key}: found "
    assert said[0].splitlines()[0].startswith(start)
    assert f", but task {task} {UNUSED[task][key]}; remove it" in said[0]
    assert all(other in said[0] for other in honouring(key))


@pytest.fixture(scope="module")
def configs(tmp_path_factory):
    """Every run, loaded as it stands."""
    path = tmp_path_factory.mktemp("runs") / "run.yaml"
    found = []
    for text in (*map(text_of, RUNS), RECIPE):
        path.write_text(text)
        found.append((text, load_run_config(path)))
    return found


@pytest.mark.parametrize(
    ("number", "key"), [(n, key) for n, case in enumerate(CASES) for key in case.keys]
)
def test_every_case_is_reached_and_refuses(configs, number, key):
    case = CASES[number]
    texts = [text for text, config in configs if case.applies(config)]
    said = (refusal(text, key, value) for text in texts for value in values(key))
    assert any(f"{key}: found " in one and f"{case.keys[key]}; remove it" in one for one in said)


@pytest.mark.parametrize("name", RUNS)
def test_a_config_written_out_names_what_has_an_effect(name):
    config = load(text_of(name))
    assert load(resolved_yaml(config)) == config


@pytest.mark.parametrize(
    ("task", "agreed"),
    [
        ("factorize", "solve.transfer=exit-cosine"),
        ("factorize", "solve.interreflection=false"),
        ("factorize", "lighting={}"),
        ("texture", "solve.loss=squares"),
        ("texture", "brdf.kd=free"),
        ("texture", "brdf.ks_per_channel=false"),
    ],
)
def test_what_is_done_anyway_may_be_said(task, agreed):
    load(text_of(task), agreed)


def test_all_that_is_in_vain_is_said_at_once_and_in_place():
    solve = "solve: {method: simplex, starts: 1, transfer: gaussian}\n"
    said = refusal(f"{text_of('factorize')}{solve}", "solve.most_sources", 3).splitlines()
    assert [line.split(": ", 2)[:2] for line in said] == [
        ["run.yaml:3:17", "solve.method"],
        ["run.yaml:3:34", "solve.starts"],
        ["run.yaml:3:47", "solve.transfer"],
    ]


def test_a_sweep_states_what_it_varies():
    load(text_of("factorize"))
    Path("sweep.yaml").write_text("base: run.yaml\ngrid:\n  solve.starts: [1, 8]\n")
    with pytest.raises(InputError, match=r"^sweep.yaml:3:18: solve.starts: found 1, but task"):
        load_sweep("sweep.yaml")


@pytest.mark.parametrize("key", dict.fromkeys(key for keys in UNUSED.values() for key in keys))
def test_the_schema_says_which_tasks_use_a_key(key):
    schema = json_schema()
    section, *names = key.split(".")
    entry = schema["properties"][section]
    if names:
        entry = schema["$defs"][f"{section.capitalize()}Config"]["properties"][names[0]]
    what = f"Tasks that use {names[1]}" if names[1:] else "Tasks"
    assert f"\n{what}: {', '.join(honouring(key))}." in entry["description"]
