"""The command line: what reaches the pipelines, what is printed where, and the exit codes.

- Commands hand over config, paths and flags; summaries go to stdout, trouble to stderr.
- 0 done, 1 not converged with --strict, 2 bad input and bad usage, 130 interrupted.
- ``configs/...`` and ``data_synth/...`` are found in the package if the working directory has none.
"""

import json
import re
import sys
import types
from pathlib import Path

import pytest

from jaxrender import cli
from jaxrender.brdf import Goal
from jaxrender.cli import process
from jaxrender.errors import InputError
from jaxrender.pipelines import compress as compression
from jaxrender.pipelines import measure as measuring
from jaxrender.pipelines.config import Parameter
from jaxrender.pipelines.progress import JsonProgress, NotedProgress, SilentProgress

CONFIG = "task: brdf\ncapture: {recipe: a.yaml}\noutput: runs/a\n"
RECIPE = """\
geometry: {sphere: {}}
brdf: {kd: 0.1, ks: 0.2, sigma: 0.1, mu: 1.5}
lighting: {directional: [{direction: [0, 0, 1], irradiance: 3}]}
"""


class Calls(dict):
    """What the stand-ins of the pipelines were called with, and what they shall do."""

    outcome = "converged"
    error: BaseException | None = None


@pytest.fixture
def calls(monkeypatch, tmp_path):
    """Stand-ins for the pipelines, in a working directory with a config and a recipe."""
    calls = Calls()

    def answer(**arguments):
        calls.update(arguments)
        if calls.error is not None:
            raise calls.error

    def fit(config, force, dry_run, progress):
        answer(config=config, force=force, dry_run=dry_run, progress=progress)
        return types.SimpleNamespace(
            outcome=calls.outcome, folder=Path("/out/a"), summary="the summary"
        )

    def synthesise(recipe, recipe_path, folder, force, progress):
        answer(recipe=recipe, recipe_path=recipe_path, folder=folder, force=force)
        return folder

    def render_config(result_folder, out, model, force, progress, scene):
        answer(result_folder=result_folder, out=out, model=model, force=force, scene=scene)
        return out

    def measure(options, out, progress, force):
        answer(options=options, out=out, progress=progress, force=force)
        return types.SimpleNamespace(text="how good it is")

    def compress(brdf, out, goal, **named):
        answer(brdf=brdf, out=out, goal=goal, **named)
        said = ("what is kept", "what is missed")
        return types.SimpleNamespace(said=said, conserves_energy=named["conserve"])

    monkeypatch.setattr(measuring, "measure", measure)
    monkeypatch.setattr(compression, "compress", compress)
    for name, function in {"run": fit, "synth": synthesise, "render": render_config}.items():
        module = types.ModuleType(f"jaxrender.pipelines.{name}")
        setattr(module, function.__name__, function)
        if name == "render":
            vars(module)["Scene"] = lambda *parts: parts
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(process, "set_up_jax", lambda: calls.update(set_up=True))
    monkeypatch.chdir(tmp_path)
    Path("fit.yaml").write_text(CONFIG)
    Path("recipe.yaml").write_text(RECIPE)
    return calls


# ---------------------------------------------------------------- commands


def test_fit_hands_over_config_and_flags(calls, capsys, tmp_path):
    assert cli.main(["fit", "fit.yaml", "brdf.mu=1.5", "solve.starts=2", "--force"]) == 0
    assert calls["config"].brdf.mu == Parameter(fixed=1.5)
    assert calls["config"].solve.starts == 2
    assert calls["config"].output == tmp_path / "runs" / "a"
    assert (calls["force"], calls["dry_run"]) == (True, False)
    assert isinstance(calls["progress"], NotedProgress)
    assert calls["set_up"]
    assert capsys.readouterr() == ("the summary\nresult: /out/a\n", "")


def test_dry_run(calls, capsys):
    calls.outcome = "not run"
    assert cli.main(["fit", "--dry-run", "--strict", "fit.yaml"]) == 0
    assert (calls["force"], calls["dry_run"]) == (False, True)
    assert capsys.readouterr().out == "the summary\n"


@pytest.mark.parametrize(
    ("outcome", "strict", "code"),
    [
        ("converged", False, 0),
        ("converged", True, 0),
        ("not_converged", False, 0),
        ("not_converged", True, 1),
        ("at_bound", True, 1),
        ("not_identifiable", True, 1),
    ],
)
def test_strict(calls, outcome, strict, code):
    calls.outcome = outcome
    assert cli.main(["fit", "fit.yaml", *["--strict"][: int(strict)]]) == code


def test_synth(calls, capsys, tmp_path):
    assert cli.main(["synth", "recipe.yaml", "--out", "photos"]) == 0
    assert calls["recipe"].brdf.mu == 1.5
    assert calls["recipe_path"] == tmp_path / "recipe.yaml"
    assert calls["folder"] == tmp_path / "photos"
    assert calls["force"] is False
    assert capsys.readouterr().out == f"capture: {tmp_path / 'photos'}\n"


def test_render(calls, capsys, tmp_path):
    assert cli.main(["render", "runs/a", "--out", "b", "--model", "dual", "--force"]) == 0
    assert calls["result_folder"] == tmp_path / "runs" / "a"
    assert (calls["out"], calls["model"], calls["force"]) == (tmp_path / "b", "dual", True)
    assert capsys.readouterr().out == f"images: {tmp_path / 'b'}\n"
    assert cli.main(["render", "runs/a", "--out", "b"]) == 0
    assert (calls["model"], calls["force"]) == ("integral", False)
    assert calls["scene"] == (None, "z-up", None)
    elsewhere = ["--environment", "probe.hdr", "--convention", "cross", "--camera", "t.json"]
    assert cli.main(["render", "runs/a", "--out", "b", *elsewhere]) == 0
    assert calls["scene"] == (tmp_path / "probe.hdr", "cross", tmp_path / "t.json")


def test_measure(calls, capsys):
    assert cli.main(["measure", "velvet:lean=20", "--out", "t.nc"]) == 0
    assert calls["options"] == measuring.MeasureOptions("velvet:lean=20")
    assert (calls["out"], calls["force"]) == (Path("t.nc"), False)
    assert isinstance(calls["progress"], NotedProgress)
    assert calls["set_up"]
    assert capsys.readouterr() == ("how good it is\ntable: t.nc\n", "")


def test_measure_hands_over_every_option(calls):
    line = (
        "measure cloth.obj --out t.nc --brdf lambertian:kd=0.2 --brdf microfacet:sigma=0.2 "
        "--size 4 --size 5 --size 6 --size 7 --embedding polar --samples 11 --bounces 2 --seed 3 "
        "--region 0.1 0.2 0.8 0.9 --relief 0.4 --force"
    )
    assert cli.main(line.split()) == 0
    assert calls["options"]._asdict() == {
        "patch": "cloth.obj",
        "brdfs": ("lambertian:kd=0.2", "microfacet:sigma=0.2"),
        "size": (4, 5, 6, 7),
        "embedding": "polar",
        "samples": 11,
        "bounces": 2,
        "seed": 3,
        "region": (0.1, 0.2, 0.8, 0.9),
        "relief": 0.4,
    }
    assert calls["force"] is True


def test_compress(calls, capsys):
    for option in ("--out", "-o"):
        calls.clear()
        assert cli.main(["compress", "phong:exponent=32", option, "a.nc"]) == 0
        assert (calls["brdf"], calls["out"]) == ("phong:exponent=32", Path("a.nc"))
        assert capsys.readouterr() == ("what is kept\nwhat is missed\ntree: a.nc\n", "")
    assert calls["goal"] is None
    assert (calls["size"], calls["wavelet"], calls["spectral"]) == (32, None, False)
    assert (calls["embedding"], calls["transform"]) == ("nusselt", None)
    assert calls["cell_samples"] == compression.CELL_SAMPLES
    assert isinstance(calls["progress"], NotedProgress)
    assert calls["set_up"]


def test_compress_hands_over_every_option(calls):
    line = (
        "compress a.bsdf --out a.nc --keep 0.2 --error 0.05 --size 8 --wavelet cdf-2-2 --spectral "
        "--cell-samples 4 --embedding half-difference --transform log --conserve"
    )
    assert cli.main(line.split()) == 0
    assert calls["goal"] == Goal(fraction=0.2, error=0.05)
    assert (calls["size"], calls["wavelet"], calls["spectral"]) == (8, "cdf-2-2", True)
    assert calls["cell_samples"] == 4
    assert (calls["embedding"], calls["transform"]) == ("half-difference", "log")
    assert calls["conserve"]
    assert compression.goal_of(None, "5%") == Goal(error=0.05)


@pytest.mark.parametrize(("flags", "code"), [("", 0), ("--strict", 1), ("--strict --conserve", 0)])
def test_a_tree_that_creates_light_fails_if_strict(calls, flags, code):
    assert cli.main(["compress", "phong", "--out", "a.nc", *flags.split()]) == code


def test_how_progress_is_reported(calls, capsys):
    for option, kind in {"--quiet": SilentProgress, "--json": JsonProgress}.items():
        assert cli.main(["fit", "fit.yaml", option]) == 0
        assert type(calls["progress"]) is kind
    calls.clear()
    assert cli.main(["fit", "fit.yaml", "--quiet", "--json"]) == 2
    error = json.loads(capsys.readouterr().err)
    assert error["event"] == "error"
    assert "--quiet and --json" in error["text"]


def test_trouble_for_programs(calls, capsys):
    calls.error = KeyboardInterrupt()
    calls.error.add_note('3 "rows" are kept')
    assert cli.main(["fit", "fit.yaml", "--json"]) == 130
    assert json.loads(capsys.readouterr().err) == {
        "event": "interrupted",
        "text": '3 "rows" are kept',
    }


def test_demo(calls, capsys, monkeypatch, tmp_path):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda page: opened.append(page) or True)
    assert cli.main(["demo", "--out", "a = #b"]) == 0
    assert calls["config"].output == tmp_path / "a = #b"
    assert calls["config"].task == "brdf"
    assert calls["config"].capture.recipe.name == "teflon_12.yaml"
    page = Path("/out/a/report.html")
    assert capsys.readouterr().out == f"the summary\nresult: /out/a\npage: {page}\n"
    # Nobody looks at this output.
    assert opened == []
    monkeypatch.setattr(process, "can_open_pages", lambda: True)
    assert cli.main(["demo", "--no-open"]) == 0
    assert opened == []
    assert cli.main(["demo"]) == 0
    assert opened == ["file:///out/a/report.html"]
    monkeypatch.setattr("webbrowser.open", lambda page: False)
    assert cli.main(["demo"]) == 0
    assert "no browser was found" in capsys.readouterr().out


def test_schema(calls, capsys):
    assert cli.main(["schema"]) == 0
    assert "capture" in json.loads(capsys.readouterr().out)["properties"]
    assert cli.main(["schema", "--recipe"]) == 0
    assert "views" in json.loads(capsys.readouterr().out)["properties"]
    assert "set_up" not in calls


# ---------------------------------------------------------------- trouble


def test_a_bad_config_is_said_and_ends_with_2(calls, capsys):
    Path("bad.yaml").write_text(CONFIG + "ligting: {}\n")
    assert cli.main(["fit", "bad.yaml", "brdf.m=2"]) == 2
    assert capsys.readouterr() == (
        "",
        "bad.yaml:4:1: unknown key 'ligting', did you mean 'lighting'?\n"
        "command line: brdf.m=2: unknown key 'm', did you mean 'mu'?\n",
    )
    assert not calls


@pytest.mark.parametrize(
    "arguments",
    [["fit", "nope.yaml"], ["synth", "nope.yaml", "--out", "x"], ["fit", "configs/nope.yaml"]],
)
def test_a_missing_file_ends_with_2(calls, capsys, arguments):
    assert cli.main(arguments) == 2
    assert capsys.readouterr() == ("", f"{arguments[1]}: no such file; mend the path\n")


@pytest.mark.parametrize(
    "arguments",
    [
        ["fit", "fit.yaml"],
        ["synth", "recipe.yaml", "--out", "x"],
        ["render", "runs/a", "--out", "x"],
        ["measure", "velvet", "--out", "x.nc"],
        ["compress", "a.binary", "--out", "x.nc"],
    ],
)
def test_trouble_in_a_pipeline(calls, capsys, arguments):
    calls.error = InputError("a.exr: channel R, pixel (3, 4): NaN; set capture.invalid: mask")
    assert cli.main(arguments) == 2
    assert capsys.readouterr() == ("", f"{calls.error}\n")
    calls.error = KeyboardInterrupt()
    assert cli.main(arguments) == 130
    kept = "nothing was written; an earlier result is as it was"
    assert capsys.readouterr() == ("", f"interrupted: {kept}\n")
    calls.error = RuntimeError("a mistake of ours keeps its traceback")
    with pytest.raises(RuntimeError):
        cli.main(arguments)


USAGE = {
    "fitt a.yaml": 'Did you mean "fit"?',
    "fit": "CONFIG requires an argument",
    "fit fit.yaml --forc": "Did you mean --force?",
    "render a --out b --model dul": 'Did you mean "dual"?',
    "synth recipe.yaml": "--out",
    "synth recipe.yaml --out a b": "b",
    "measure velvet": "--out",
    "measure velvet --out x.nc --embedding nuselt": 'Did you mean "nusselt"?',
    "measure velvet --out x.nc --region 0 0 1": "--region",
    "compress": "BRDF requires an argument",
    "compress a.binary -o x.nc --keep much": "much",
    "compress a.binary -o x.nc --no-spectral": "--no-spectral",
    "--bogus": "--bogus",
}


@pytest.mark.parametrize("line", USAGE)
def test_wrong_usage_ends_with_2(calls, capsys, line):
    assert cli.main(line.split()) == 2
    out, err = capsys.readouterr()
    words = re.sub(r"[│╭╮╰╯─\s]+", " ", err)
    assert (out, calls) == ("", {})
    assert USAGE[line] in words


# ---------------------------------------------------------------- bundled examples


def test_bundled_examples(calls, monkeypatch, tmp_path):
    package = tmp_path / "installed"
    (package / "package_data" / "configs").mkdir(parents=True)
    example = package / "package_data" / "configs" / "teflon.yaml"
    example.write_text(CONFIG.replace("a.yaml", "../data_synth/teflon.yaml"))
    monkeypatch.setattr(process.resources, "files", lambda name: package)
    assert cli.main(["fit", "configs/teflon.yaml"]) == 0
    recipe = package / "package_data" / "data_synth" / "teflon.yaml"
    assert calls["config"].capture.recipe == recipe
    assert calls["config"].output == tmp_path / "runs" / "a"
    # The working directory's own file goes first, and other folders are not looked up.
    Path("configs").mkdir()
    Path("configs/teflon.yaml").write_text(CONFIG)
    assert process.bundled(Path("configs/teflon.yaml")) == Path("configs/teflon.yaml")
    assert process.bundled(Path("other/teflon.yaml")) == Path("other/teflon.yaml")
