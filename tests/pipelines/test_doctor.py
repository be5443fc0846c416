"""The doctor: what works is said to work, and what was broken on purpose is found.

- A sound installation is well; the exit code is 0, and 1 as soon as something essential fails.
- Libraries and extras come from the package's metadata: missing and too old ones are named, with
  the command that installs them.
- A check that raises is a finding, never a traceback.
- The cache: its place and size; a remark where there is none, it cannot be written, or is stale.
"""

import json
import os
import time
from importlib import metadata

import jax
import numpy as np
import pytest

from jaxrender import cli, io
from jaxrender.cli import process
from jaxrender.geometry import Mesh
from jaxrender.inverse import solvers
from jaxrender.pipelines import doctor


def finding(name):
    return doctor._tried(name, getattr(doctor, f"_{name}"))


@pytest.fixture
def installed(monkeypatch):
    """Let the metadata say what a test wants: requirements, and the versions that are there."""

    def say(requires, versions):
        def version(name):
            if name not in versions:
                raise metadata.PackageNotFoundError(name)
            return versions[name]

        monkeypatch.setattr(doctor.metadata, "requires", lambda _: requires)
        monkeypatch.setattr(doctor.metadata, "version", version)

    return say


def test_a_sound_installation_is_well(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    assert cli.main(["doctor"]) == 0
    said = capsys.readouterr().out
    for word in ("libraries", "devices", "cpu", "float64", "Embree", "EXR", "packets", "raw"):
        assert word in said
    assert "FAIL" not in said
    assert cli.main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["well"] is True
    assert {one["name"]: one["state"] for one in found["checks"]}["rays"] == "good"
    extras = {one["name"] for one in found["extras"]}
    assert extras == set(metadata.metadata("jaxrender").get_all("Provides-Extra"))


def test_blender_is_told(monkeypatch):
    from jaxrender.io.exports import blender

    monkeypatch.delenv(blender.VARIABLE, raising=False)
    monkeypatch.setattr(blender, "find_spec", lambda name: None)
    monkeypatch.setattr(blender.shutil, "which", lambda name: None)
    missing = finding("blender")
    assert missing.state == "remark"
    assert "only export --to blend needs it" in missing.text
    assert missing.remedy.startswith("pip install --no-deps")
    monkeypatch.setattr(blender.shutil, "which", lambda name: f"/somewhere/{name}")
    assert finding("blender").text.startswith("/somewhere/blender")


def test_a_wrong_ray_is_found(monkeypatch, capsys):
    right = Mesh.first_hits

    def shifted(mesh, origins, directions):
        hits = right(mesh, origins, directions)
        return hits._replace(points=hits.points + np.array([0, 0, 1e-3]))

    monkeypatch.setattr(Mesh, "first_hits", shifted)
    assert finding("rays").state == "bad"
    for quick in ("_solvers", "_pictures", "_devices"):
        monkeypatch.setattr(doctor, quick, lambda *_: doctor.Finding("other", "good", ""))
    assert cli.main(["doctor"]) == 1
    assert "broken: rays" in capsys.readouterr().out


def test_a_check_that_raises_is_a_finding(monkeypatch):
    def broken(*_):
        raise ImportError("libImath.so: no\n such file")

    monkeypatch.setattr("jaxrender.io.write_image", broken)
    found = finding("pictures")
    assert (found.state, found.text) == ("bad", "ImportError: libImath.so: no such file")
    assert found.remedy


def test_altered_pixels_are_found(monkeypatch):
    right = io.read_image

    def altered(path):
        found = right(path)
        return found._replace(pixels=found.pixels * (1 + 1e-6))

    monkeypatch.setattr(io, "read_image", altered)
    assert finding("pictures").state == "bad"


def test_a_solver_that_stops_early_is_found(monkeypatch):
    monkeypatch.setattr(solvers, "_MAX_STEPS", 1)
    assert finding("solvers").state == "bad"


def test_single_precision_is_found():
    with jax.enable_x64(False):
        found = finding("precision")
    assert (found.state, found.text) == ("bad", "float32: results lose digits")


def test_libraries_that_are_missing_or_too_old(installed):
    installed(
        ["here>=1.2", "old>=2", "gone", 'other; sys_platform == "nowhere"', 'x; extra == "e"'],
        {"here": "1.2.0", "old": "1.9"},
    )
    found = doctor._libraries()
    assert found.state == "bad"
    assert found.text == "missing or too old: old>=2 (has 1.9), gone (not installed)"
    assert found.remedy == 'pip install --upgrade "old>=2" "gone"'


def test_an_extra_says_what_to_install(installed):
    installed(
        ["always>=1", 'lens>=3; extra == "raw"', 'film>=1; extra == "raw"', 'y; extra == "z"'],
        {"always": "1", "film": "1.5"},
    )
    found = doctor._extra("raw")
    assert found.there == ("film 1.5",)
    assert found.missing == ("lens>=3 (not installed)",)
    assert found.install == 'pip install --upgrade "lens>=3"'
    # Nothing to install where all is there; and an extra is never essential.
    assert doctor._libraries().state == "good"


def test_without_metadata_only_a_remark(monkeypatch):
    def unknown(_):
        raise metadata.PackageNotFoundError("jaxrender")

    monkeypatch.setattr(doctor.metadata, "requires", unknown)
    monkeypatch.setattr(doctor.metadata, "metadata", unknown)
    assert doctor._libraries().state == "remark"
    assert doctor.extras() == ()


def test_the_cache(tmp_path):
    kept = tmp_path / "programs"
    kept.mkdir()
    (kept / "now").write_bytes(bytes(1_500_000))
    found = doctor._cache(tmp_path)
    assert found.state == "good"
    assert found.text == f"{tmp_path}: 1.5 MB in 1 files, writable"
    (kept / "before").write_bytes(bytes(2_500_000))
    os.utime(kept / "before", (0, time.time() - 1e9))
    found = doctor._cache(tmp_path)
    assert found.state == "remark"
    assert found.text.endswith("4.0 MB in 2 files, writable; 2.5 MB left by another version")


def test_no_cache_is_a_remark(tmp_path):
    assert doctor._cache(None).state == "remark"
    (tmp_path / "file").write_text("")
    found = doctor._cache(tmp_path / "file" / "cache")
    assert found.state == "remark"
    assert "cannot be written" in found.text


def test_the_examples_are_found_beside_an_editable_install(monkeypatch, tmp_path):
    """A clone's package has no data in it; its configs lie beside it."""
    (tmp_path / "clone/jaxrender").mkdir(parents=True)
    (tmp_path / "clone/configs").mkdir()
    (tmp_path / "clone/configs/a.yaml").write_text("")
    monkeypatch.setattr(process.resources, "files", lambda _: tmp_path / "clone/jaxrender")
    monkeypatch.chdir(tmp_path)
    asked = process.Path("configs/a.yaml")
    assert process.bundled(asked) == asked
    (tmp_path / "clone/pyproject.toml").write_text("")
    assert process.bundled(asked) == tmp_path / "clone/configs/a.yaml"
