"""Result folders: whole or not at all, and nobody's files are deleted for them.

- The fingerprint follows the config, the contents of the inputs and the purpose, not ``output``.
- Fresh, finished, another run's, foreign: each is told apart, with its message.
- After an error or an interrupt nothing is left behind and an older result is as it was, also when
  the last rename fails.
- A folder without our marker is never replaced, ``force`` or not.
"""

import json
import os
import stat
from pathlib import Path

import pytest

from jaxrender.errors import InputError
from jaxrender.pipelines import output as output_module
from jaxrender.pipelines.config import RecipeConfig, RunConfig
from jaxrender.pipelines.output import (
    MARKER,
    FolderState,
    fingerprint,
    prepare,
    result_folder,
)

RUN = RunConfig.model_validate({"task": "brdf", "capture": {"recipe": "a.yaml"}})
RECIPE = RecipeConfig.model_validate(
    {
        "geometry": {"sphere": {}},
        "brdf": {"model": "lambertian", "kd": 0.1},
        "lighting": {"directional": [{"direction": [0, 0, 1], "irradiance": 1}]},
    }
)


def write(folder, text="new", mark="f1", force=False):
    with result_folder(folder, mark, force) as inside:
        (inside / "result.json").write_text(text)


def write_half(folder, error, mark="f1", force=False):
    with result_folder(folder, mark, force) as inside:
        (inside / "result.json").write_text("half")
        raise error


def contents(folder):
    return (folder / "result.json").read_text()


def marked(folder):
    return json.loads((folder / MARKER).read_text())["fingerprint"]


# ---------------------------------------------------------------- fingerprint


def test_fingerprint_follows_everything_that_a_result_depends_on(tmp_path):
    file = tmp_path / "a.exr"
    file.write_bytes(b"1")
    first = fingerprint(RUN, [file])
    assert len(first) == 64
    assert fingerprint(RUN, [file]) == first
    assert fingerprint(RUN, []) != first
    assert fingerprint(RUN, [file], purpose="render dual") != first
    assert fingerprint(RECIPE, [file]) != first
    changed = RUN.model_copy(update={"samples": RUN.samples.model_copy(update={"seed": 1})})
    assert fingerprint(changed, [file]) != first
    file.write_bytes(b"2")
    assert fingerprint(RUN, [file]) != first


def test_fingerprint_follows_the_version(monkeypatch):
    first = fingerprint(RUN, [])
    monkeypatch.setattr(output_module, "__version__", "0.0.0")
    assert fingerprint(RUN, []) != first


def test_fingerprint_does_not_follow_the_output_or_the_order_of_files(tmp_path):
    files = [tmp_path / "a", tmp_path / "b"]
    for file in files:
        file.write_text(file.name)
    moved = RUN.model_copy(update={"output": tmp_path / "out"})
    assert fingerprint(moved, files) == fingerprint(RUN, files[::-1])


def test_fingerprint_does_not_confuse_the_borders_of_files(tmp_path):
    one, two = tmp_path / "a", tmp_path / "b"
    one.write_text("xy")
    two.write_text("z")
    first = fingerprint(RUN, [one, two])
    one.write_text("x")
    two.write_text("yz")
    assert fingerprint(RUN, [one, two]) != first


def test_fingerprint_names_a_missing_file(tmp_path):
    with pytest.raises(InputError, match=r"nope\.exr: cannot be read: No such file"):
        fingerprint(RUN, [tmp_path / "nope.exr"])


# ---------------------------------------------------------------- what is there


def test_nothing_and_an_empty_folder_are_fresh(tmp_path):
    assert prepare(tmp_path / "out", "f1") is FolderState.FRESH
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    assert prepare(tmp_path / "out", "f1") is FolderState.FRESH


def test_an_identical_run_is_reused_unless_forced(tmp_path):
    write(tmp_path / "out")
    assert prepare(tmp_path / "out", "f1") is FolderState.FINISHED
    assert prepare(tmp_path / "out", "f1", force=True) is FolderState.FRESH


def test_another_runs_folder_is_refused(tmp_path):
    write(tmp_path / "out")
    with pytest.raises(InputError) as caught:
        prepare(tmp_path / "out", "f2")
    assert str(caught.value) == (
        f"{tmp_path / 'out'}: holds the result of another run (other config, input or version); "
        "choose another output folder, or give --force to replace it"
    )
    assert prepare(tmp_path / "out", "f2", force=True) is FolderState.FRESH


FOREIGN = {
    "no marker": None,
    "no JSON": "{",
    "another program's": '{"fingerprint": "f1"}',
    "a list": "[]",
    "no fingerprint": '{"made_by": "jaxrender"}',
    "not text": '{"made_by": "jaxrender", "fingerprint": 1}',
}


@pytest.mark.parametrize("case", FOREIGN)
@pytest.mark.parametrize("force", [False, True])
def test_foreign_files_are_refused_and_kept(tmp_path, case, force):
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("years of work")
    if FOREIGN[case] is not None:
        (out / MARKER).write_text(FOREIGN[case])
    expected = (
        f"{out}: holds files that are not a jaxrender result (no run.json of ours); "
        "choose another output folder, or move the files away"
    )
    with pytest.raises(InputError) as caught:
        prepare(out, "f1", force)
    assert str(caught.value) == expected
    with pytest.raises(InputError):
        write(out, force=force)
    assert (out / "thesis.tex").read_text() == "years of work"
    assert os.listdir(tmp_path) == ["out"]


def test_a_file_in_the_way(tmp_path):
    (tmp_path / "out").write_text("mine")
    with pytest.raises(
        InputError, match=r"out: a file is in the way; choose another output folder$"
    ):
        prepare(tmp_path / "out", "f1", force=True)


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match=r"file/out: cannot be made: "):
        write(tmp_path / "file" / "out")


# ---------------------------------------------------------------- whole or not at all


def test_a_result_appears_when_it_is_complete(tmp_path):
    out = tmp_path / "deep" / "out"
    with result_folder(out, "f1") as inside:
        (inside / "result.json").write_text("new")
        assert inside.parent == out.parent
        assert not out.exists()
    assert contents(out) == "new"
    assert os.listdir(out.parent) == ["out"]
    marker = json.loads((out / MARKER).read_text())
    assert set(marker) == {"made_by", "version", "fingerprint", "finished"}
    assert marker["fingerprint"] == "f1"


def test_a_result_takes_the_place_of_an_empty_folder(tmp_path):
    (tmp_path / "out").mkdir()
    write(tmp_path / "out")
    assert contents(tmp_path / "out") == "new"


def test_a_result_has_the_permissions_of_an_ordinary_folder(tmp_path):
    write(tmp_path / "out")
    (tmp_path / "ordinary").mkdir()
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("out", "ordinary")]
    assert modes[0] == modes[1]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_after_an_error_nothing_is_left(tmp_path, error):
    with pytest.raises(error):
        write_half(tmp_path / "out", error)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_after_an_error_the_older_result_is_as_it_was(tmp_path, error):
    out = tmp_path / "out"
    write(out, "old")
    with pytest.raises(error):
        write_half(out, error, mark="f2", force=True)
    assert (contents(out), marked(out)) == ("old", "f1")
    assert os.listdir(tmp_path) == ["out"]


def test_force_replaces_the_older_result_only_at_the_end(tmp_path):
    out = tmp_path / "out"
    write(out, "old")
    with result_folder(out, "f2", force=True) as inside:
        (inside / "result.json").write_text("new")
        assert contents(out) == "old"
    assert (contents(out), marked(out)) == ("new", "f2")
    assert os.listdir(tmp_path) == ["out"]


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_the_older_result_comes_back_if_the_last_rename_fails(tmp_path, monkeypatch, error):
    out = tmp_path / "out"
    write(out, "old")
    rename = Path.rename

    def failing(self, target):
        if "unfinished" in self.name:
            raise error
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(error):
        write(out, mark="f2", force=True)
    assert (contents(out), marked(out)) == ("old", "f1")
    assert os.listdir(tmp_path) == ["out"]


def test_an_identical_run_that_was_quicker_keeps_its_result(tmp_path):
    out = tmp_path / "out"
    with result_folder(out, "f1") as inside:
        (inside / "result.json").write_text("slow")
        write(out, "quick")
    assert contents(out) == "quick"
    assert os.listdir(tmp_path) == ["out"]


def test_foreign_files_that_appeared_meanwhile_are_kept(tmp_path):
    out = tmp_path / "out"

    def write_while_another_writes():
        with result_folder(out, "f1", force=True):
            out.mkdir()
            (out / "thesis.tex").write_text("years of work")

    with pytest.raises(InputError):
        write_while_another_writes()
    assert os.listdir(tmp_path) == ["out"]
    assert os.listdir(out) == ["thesis.tex"]
