"""The walls of the house, as contracts of import-linter and bans of ruff in pyproject.toml.

- Every module keeps to them: levels, homes of libraries, configs that are data, a root that imports
  nothing, no ``print``, no precision set but by the command line.
- Each of them goes red where a module that breaks it is planted into a copy of the sources.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parents[1]
LINT_IMPORTS = """
import sys
from importlinter.cli import lint_imports
sys.exit(lint_imports(no_cache=True, no_logo=True))
"""
LINTERS = {
    "contracts": ["-c", LINT_IMPORTS],
    "bans": ["-m", "ruff", "check", "--no-cache", "--select=T20,TID251", "jaxrender"],
}
# Where a line is planted, the line, what is said about it.
PLANTED = [
    ("brdf/one", "def f():\n    from jaxrender.reflection import dual", "reflection.dual (l.2)"),
    ("brdf/two", "from ..lighting import sky", "brdf.two -> jaxrender.lighting.sky (l.1)"),
    ("pipelines/one", "from jaxrender import cli", "pipelines.one -> jaxrender.cli (l.1)"),
    ("misc", "", "jaxrender.misc"),
    ("io/one", "from jaxrender import fit", "jaxrender.io.one -> jaxrender (l.1)"),
    ("inverse/one", "import jaxopt", "jaxrender.inverse.one -> jaxopt (l.1)"),
    ("pipelines/two", "from lineax import QR", "jaxrender.pipelines.two -> lineax (l.1)"),
    ("pipelines/three", "import h5netcdf", "jaxrender.pipelines.three -> h5netcdf (l.1)"),
    ("io/two", "import matplotlib.pyplot", "jaxrender.io.two -> matplotlib (l.1)"),
    ("pipelines/config/one", "import numpy", "jaxrender.pipelines.config.one -> numpy (l.1)"),
    ("pipelines/config/two", "from ..run import fit", "two -> jaxrender.pipelines.run (l.1)"),
    ("pipelines/__init__", "import jax", "jaxrender.pipelines -> jax (l.1)"),
    ("io/three", "print(1)", "io/three.py:1:1: T201"),
    ("io/four", "import jax\njax.config.update('a', 1)", "io/four.py:2:1: TID251"),
    ("io/five", "import importlib\nimportlib.import_module('a')", "io/five.py:2:1: TID251"),
]


def linted(linter: str, place: Path) -> subprocess.CompletedProcess:
    command = [sys.executable, *LINTERS[linter]]
    # One line says one finding.
    plain = {**os.environ, "COLUMNS": "200", "RUFF_OUTPUT_FORMAT": "concise"}
    return subprocess.run(command, cwd=place, env=plain, capture_output=True, text=True)


@pytest.mark.parametrize("linter", LINTERS)
def test_every_module_keeps_to_its_walls(linter):
    found = linted(linter, HERE)
    assert found.returncode == 0, found.stdout + found.stderr


def test_planted_modules_are_found(tmp_path):
    shutil.copy(HERE / "pyproject.toml", tmp_path)
    shutil.copytree(HERE / "jaxrender", tmp_path / "jaxrender")
    for name, line, _ in PLANTED:
        (tmp_path / f"jaxrender/{name}.py").write_text(line)
    found = [linted(linter, tmp_path) for linter in LINTERS]
    assert [run.returncode for run in found] == [1, 1]
    said = "".join(run.stdout for run in found)
    assert "0 kept" in said
    assert [expected for _, _, expected in PLANTED if expected not in said] == []
