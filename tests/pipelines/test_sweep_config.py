"""Sweeps: which runs a file means, and what is said about one that is wrong.

- A grid is the product of its values, the last key fastest; a list is its entries; values are
  checked and spelt as on the command line, and reach nested sections.
- Paths resolve against the file that names them, base or sweep; output against the working
  directory; the base's own output is ignored.
- Every error names file, line and column of the sweep (or of the base, where that is wrong), once.
"""

import json
from pathlib import Path

import pytest
from small_captures import jaxrender

from jaxrender.errors import InputError
from jaxrender.pipelines.config import json_schema
from jaxrender.pipelines.config.sweep import SweepConfig, load_sweep, shown

BASE = """\
task: brdf
capture: {transforms: photos/transforms.json, geometry: {sphere: {radius: 1}}}
lighting: {directional: [{direction: [0, 0, 1], irradiance: 1}]}
output: runs/base
"""


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a sweep into sweeps/, beside a base in bases/; the working directory is above both."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sweeps").mkdir()
    (tmp_path / "bases").mkdir()
    (tmp_path / "bases/base.yaml").write_text(BASE)

    def write(text, base="../bases/base.yaml"):
        (tmp_path / "sweeps/s.yaml").write_text(f"base: {base}\n{text}")
        return "sweeps/s.yaml"

    return write


def message(path):
    with pytest.raises(InputError) as caught:
        load_sweep(path)
    return str(caught.value)


def test_a_grid_is_a_product_with_the_last_key_fastest(write):
    sweep = load_sweep(
        write("grid:\n  brdf.mu: [1.3, {start: 1.5}]\n  samples.seed: [0, 1e1]\noutput: out\n")
    )
    assert sweep.keys == ("brdf.mu", "samples.seed")
    assert [run.parameters for run in sweep.runs] == [
        {"brdf.mu": mu, "samples.seed": seed} for mu in (1.3, {"start": 1.5}) for seed in (0, 10)
    ]
    found = [(run.config.brdf.mu.fixed, run.config.samples.seed) for run in sweep.runs]
    assert found == [(1.3, 0), (1.3, 10), (None, 0), (None, 10)]
    assert sweep.runs[2].config.brdf.mu.start == 1.5
    assert shown(sweep.runs[2].parameters) == 'brdf.mu={"start": 1.5} samples.seed=0'


def test_a_list_is_its_entries(write):
    sweep = load_sweep(
        write(
            "list:\n  - {brdf: {model: lambertian}, samples.count: 50}\n  - {}\n  - {brdf.mu: 2}\n"
        )
    )
    assert sweep.keys == ("brdf", "samples.count", "brdf.mu")
    assert [run.config.brdf.model for run in sweep.runs] == ["lambertian", *["microfacet"] * 2]
    assert sweep.runs[1].parameters == {}
    assert shown(sweep.runs[1].parameters) == "the base itself"
    assert sweep.runs[2].config.brdf.mu.fixed == 2


def test_a_list_of_the_base_is_reached_by_number(write):
    sweep = load_sweep(write("grid: {lighting.directional.0.irradiance: [2, [1, 2, 3]]}\n"))
    found = [run.config.lighting.directional[0].irradiance for run in sweep.runs]
    assert found == [(2, 2, 2), (1, 2, 3)]


def test_paths_belong_to_the_file_that_names_them(write, tmp_path):
    sweep = load_sweep(write("grid: {capture.transforms: [a.json, /b.json]}\noutput: out/s\n"))
    assert [str(run.config.capture.transforms) for run in sweep.runs] == [
        str(tmp_path / "sweeps/a.json"),
        "/b.json",
    ]
    assert sweep.output == tmp_path / "out/s"
    sweep = load_sweep(write("list: [{samples.seed: 1}, {lighting.per_frame: l.json}]\n"))
    assert sweep.runs[0].config.capture.transforms == tmp_path / "bases/photos/transforms.json"
    assert sweep.runs[1].config.lighting.per_frame == tmp_path / "sweeps/l.json"
    assert sweep.output == tmp_path / "runs/s"


def test_the_output_of_the_base_is_ignored(write):
    assert load_sweep(write("list: [{}]\n")).runs[0].config.output is None


def test_the_example_is_six_runs_of_one_capture():
    sweep = load_sweep(Path(__file__).parents[2] / "configs/sweep_teflon.yaml")
    assert len(sweep.runs) == 6
    assert len({run.config.capture.recipe for run in sweep.runs}) == 1
    assert sweep.runs[0].config.capture.recipe.is_file()


MESSAGES = {
    "no runs": (
        "output: a\n",
        "{s}:1:1: no runs given; a sweep needs grid: {{key: [values]}} or list: [{{key: value}}]",
    ),
    "grid and list": (
        "grid: {samples.seed: [1]}\nlist: [{}]\n",
        "{s}:3:1: found grid and list; give one of them, or write two sweeps",
    ),
    "an empty grid": ("grid: {}\n", "{s}:2:7: grid is empty; it needs at least one run"),
    "an empty list": ("list: []\n", "{s}:2:7: list is empty; it needs at least one run"),
    "no values": (
        "grid: {samples.seed: []}\n",
        "{s}:2:22: grid.samples.seed: the list is empty; give values",
    ),
    "no list of values": (
        "grid:\n  samples.seed: 3\n",
        "{s}:3:17: grid.samples.seed: found 3, accepted: a list of values",
    ),
    "a misspelt key": (
        "grid:\n  brdf.m: [1.3, 1.5]\n",
        "{s}:3:3: unknown key 'm', did you mean 'mu'?",
    ),
    "a misspelt key in a list": (
        "list:\n  - {brdf.mu: 1.4}\n  - {brdf.m: 1.3}\n",
        "{s}:4:6: unknown key 'm', did you mean 'mu'?",
    ),
    "a misspelt key of the sweep": (
        "gird: {samples.seed: [1]}\n",
        "{s}:2:1: unknown key 'gird', did you mean 'grid'?",
    ),
    "a wrong value": (
        "grid:\n  brdf.mu: [1.5, 0.5]\n  samples.seed: [0, 1]\n",
        "{s}:3:18: brdf.mu: found 0.5; every value here must be above 1",
    ),
    "a wrong word": (
        "list:\n  - solve: {loss: square}\n",
        "{s}:3:19: solve.loss: found 'square', accepted: 'auto', 'squares', 'huber' or 'cauchy', "
        "did you mean 'squares'?",
    ),
    "a key that is no key": (
        "grid:\n  brdf..mu: [1]\n",
        "{s}:3:3: found the key 'brdf..mu', accepted: words joined by dots, such as brdf.mu",
    ),
    "a folder for a run": (
        "list: [{output: a}]\n",
        "{s}:2:9: each run's folder is named by its hash; remove output here",
    ),
    "beyond a list": (
        "grid: {lighting.directional.1.irradiance: [1]}\n",
        "{s}:2:8: lighting.directional has no entry '1'; it is a list of one entry, counted from 0",
    ),
    "the same run twice in a grid": (
        "grid:\n  samples.seed: [0]\n  brdf.mu: [1.5, {fixed: 1.5}]\n",
        '{s}:4:18: samples.seed=0 brdf.mu={{"fixed": 1.5}} is the same run as '
        "samples.seed=0 brdf.mu=1.5; remove one of them",
    ),
    "the same run twice in a list": (
        "list:\n  - {samples.seed: 0}\n  - {}\n",
        "{s}:4:5: the base itself is the same run as samples.seed=0; remove one of them",
    ),
    "too many": (
        "grid:\n" + "".join(f"  a{k}: {list(range(10))}\n" for k in range(6)),
        "{s}:2:1: grid: 1000000 combinations; at most 100000 runs make a sweep",
    ),
    "no mapping": (
        "list: [3]\n",
        "{s}:2:7: list: found [3], accepted: a list of {{key: value, ...}}, such as "
        "[{{brdf.mu: 1.3}}, {{samples.seed: 1}}]",
    ),
    "a key twice": (
        "grid:\n  samples.seed: [1]\n  samples.seed: [2]\n",
        "{s}:4:3: duplicate key 'samples.seed', first given at line 3",
    ),
}


@pytest.mark.parametrize("case", MESSAGES)
def test_what_is_wrong_is_said_with_its_place(write, case):
    text, expected = MESSAGES[case]
    assert message(write(text)) == expected.format(s="sweeps/s.yaml")


def test_a_wrong_base_is_said_once_and_with_its_own_place(write, tmp_path):
    path = tmp_path / "bases/base.yaml"
    path.write_text(BASE + "solve: {lss: huber}\n")
    found = message(write("grid: {samples.seed: [0, 1, 2], brdf.mu: [0.1, 1.5]}\n"))
    assert found == (
        f"{path}:5:9: unknown key 'lss', did you mean 'loss'?\n"
        "sweeps/s.yaml:2:43: brdf.mu: found 0.1; every value here must be above 1"
    )
    # What the sweep writes over may be anything.
    load_sweep(write("list: [{solve: {loss: huber}}]\n"))


def test_a_base_that_is_missing_or_no_config(write, tmp_path):
    missing = f"{tmp_path}/sweeps/no.yaml: no such file; mend the path"
    assert message(write("list: [{}]\n", "no.yaml")) == missing
    (tmp_path / "sweeps/list.yaml").write_text("- 1\n")
    assert "list.yaml:1:1: found a list, accepted: a mapping" in message(
        write("list: [{}]\n", "list.yaml")
    )
    (tmp_path / "sweeps/s.yaml").write_text("list: [{}]\n")
    assert message("sweeps/s.yaml") == "sweeps/s.yaml:1:1: missing key 'base', accepted: a path"


def test_the_schema_knows_grid_and_list(capsys):
    properties = json_schema(SweepConfig)["properties"]
    assert jaxrender("schema", "--sweep") == 0
    assert json.loads(capsys.readouterr().out)["properties"] == properties
    assert set(properties) == {"base", "grid", "list", "output"}
    assert properties["grid"]["anyOf"][0]["additionalProperties"] == {
        "type": "array",
        "minItems": 1,
    }
