"""The walls of the house, executed on the source text of every module.

- A package imports only from lower levels; packages of one level never import each other.
- Only ``inverse/solvers.py`` imports optimistix, jaxopt, lineax; matplotlib stays in ``pipelines``.
- ``pipelines/config`` is data: it knows pydantic, ruamel, ``errors``, ``catalogue`` and itself, no
  run time.
- No ``print(`` anywhere; only the command line turns on float64, in ``cli/process.py``.
- The checker itself finds each of these in small made-up sources, also inside functions, relative
  and by importlib.
"""

import ast
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

import jaxrender

ROOT = Path(jaxrender.__file__).parent

LEVELS = {
    "shapes": 0,
    "errors": 0,
    "catalogue": 0,
    "harmonics": 1,
    "wavelets": 1,
    "geometry": 1,
    "imaging": 1,
    "brdf": 2,
    "lighting": 2,
    "spectra": 3,
    "io": 3,
    "reflection": 4,
    "inverse": 5,
    "pipelines": 6,
    "cli": 7,
    "__main__": 8,
}
SOLVER_LIBRARIES = {"optimistix", "jaxopt", "lineax"}
CONFIG_LIBRARIES = {"pydantic", "pydantic_core", "ruamel"} | set(sys.stdlib_module_names)
CONFIG_MODULES = ("jaxrender.errors", "jaxrender.catalogue", "jaxrender.pipelines.config")


class Import(NamedTuple):
    """One imported name, absolute and dotted, and the line that imports it."""

    target: str
    line: int


def imports_of(tree: ast.AST, module: str, is_package: bool) -> list[Import]:
    """Every import of a module, wherever it stands."""
    # What one dot of a relative import means.
    package = module if is_package else module.rpartition(".")[0]
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [Import(alias.name, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")[: len(package.split(".")) - max(node.level - 1, 0)]
            base = ".".join(parts if node.level else []) or node.module or ""
            if node.level and node.module:
                base = f"{base}.{node.module}"
            found += [Import(f"{base}.{alias.name}", node.lineno) for alias in node.names]
        elif isinstance(node, ast.Call) and _callee(node) in ("import_module", "__import__"):
            names = [a.value for a in node.args[:1] if isinstance(a, ast.Constant)]
            found += [Import(str(name), node.lineno) for name in names]
    return found


def _callee(call: ast.Call) -> str:
    if isinstance(call.func, ast.Attribute):
        return call.func.attr
    return call.func.id if isinstance(call.func, ast.Name) else ""


def _is_within(name: str, *homes: str) -> bool:
    return any(name == home or name.startswith(f"{home}.") for home in homes)


def level_violation(module: str, target: str) -> str | None:
    """Why a module may not import a target of the project, if so."""
    if target in ("jaxrender.__version__", "__future__"):
        return None
    if target == "jaxrender":
        return "imports the whole project; import the package that is meant"
    importer, imported = module.split(".")[1:2], target.split(".")[1]
    if imported not in LEVELS:
        return f"{imported!r} has no level"
    if not importer:
        return "the root imports packages only when they are asked for"
    if importer[0] not in LEVELS:
        return f"{importer[0]!r} has no level"
    if importer[0] == imported:
        return None
    mine, other = LEVELS[importer[0]], LEVELS[imported]
    return None if other < mine else f"level {mine} may not import level {other}"


def library_violation(module: str, target: str) -> str | None:
    """Why a module may not import a library, if so."""
    library = target.split(".")[0]
    if library in SOLVER_LIBRARIES and not _is_within(module, "jaxrender.inverse.solvers"):
        return "only inverse/solvers.py imports solver libraries"
    if library == "matplotlib" and not _is_within(module, "jaxrender.pipelines"):
        return "matplotlib stays under pipelines"
    return None


def config_violation(module: str, target: str) -> str | None:
    """Why a module of the configs may not import a target, if so."""
    if not _is_within(module, "jaxrender.pipelines.config"):
        return None
    is_project = _is_within(target, "jaxrender")
    is_known = _is_within(target, *CONFIG_MODULES) if is_project else False
    if is_known or target.split(".")[0] in CONFIG_LIBRARIES:
        return None
    return "a config is data and knows no run time"


def violations(source: str, module: str, is_package: bool = False) -> list[str]:
    """Everything that one module does against the rules, as 'module:line: import: why'."""
    tree = ast.parse(source)
    found = []
    for target, line in imports_of(tree, module, is_package):
        checks = [library_violation(module, target), config_violation(module, target)]
        if _is_within(target, "jaxrender"):
            checks.append(level_violation(module, target))
        found += [f"{module}:{line}: {target}: {why}" for why in checks if why]
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and _callee(node) == "print"
        ):
            found.append(f"{module}:{node.lineno}: print: library code never prints")
        is_precision = isinstance(node, ast.Constant) and node.value == "jax_enable_x64"
        if is_precision and module != "jaxrender.cli.process":
            found.append(f"{module}:{node.lineno}: jax_enable_x64: set by the command line alone")
    return found


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def test_every_module_keeps_to_its_level():
    paths = sorted(ROOT.rglob("*.py"))
    assert paths
    found = []
    for path in paths:
        is_package = path.name == "__init__.py"
        found += violations(path.read_text(encoding="utf-8"), module_name(path), is_package)
    assert not found, "\n" + "\n".join(found)


def test_every_package_has_a_level():
    names = {path.stem for path in ROOT.glob("*.py")}
    names |= {path.parent.name for path in ROOT.glob("*/__init__.py")}
    assert names - {"__init__"} <= set(LEVELS)


BROKEN = {
    "a higher level": ("jaxrender.brdf.base", "from jaxrender.reflection import dual", "level 2"),
    "the same level": ("jaxrender.brdf.base", "import jaxrender.lighting.base", "level 2"),
    "inside a function": (
        "jaxrender.geometry.mesh",
        "def f():\n    from jaxrender.io import meshes",
        "geometry.mesh:2: jaxrender.io.meshes",
    ),
    "relative": ("jaxrender.geometry.mesh", "from ..io import meshes", "jaxrender.io.meshes"),
    "relative, by name": ("jaxrender.geometry.mesh", "from .. import io", "jaxrender.io"),
    "from the root": ("jaxrender.geometry.mesh", "from jaxrender import io", "jaxrender.io"),
    "by importlib": (
        "jaxrender.brdf.base",
        "import importlib\nimportlib.import_module('jaxrender.inverse')",
        "base:2: jaxrender.inverse",
    ),
    "the whole project": ("jaxrender.brdf.base", "import jaxrender", "package that is meant"),
    "the command line": ("jaxrender.pipelines.run", "from jaxrender import cli", "level 7"),
    "an unknown package": (
        "jaxrender.pipelines.run",
        "import jaxrender.misc",
        "'misc' has no level",
    ),
    "a package without level": ("jaxrender.misc.a", "import jaxrender.io", "'misc' has no level"),
    "a solver elsewhere": ("jaxrender.inverse.brdf", "import optimistix as optx", "solvers.py"),
    "a solver, from": ("jaxrender.pipelines.run", "from jaxopt import LBFGSB", "solvers.py"),
    "lineax": ("jaxrender.inverse.solvers_twin", "import lineax", "solvers.py"),
    "plots": ("jaxrender.inverse.brdf", "import matplotlib.pyplot as plt", "pipelines"),
    "numerics in a config": ("jaxrender.pipelines.config.brdf", "import numpy", "no run time"),
    "run time in a config": (
        "jaxrender.pipelines.config.brdf",
        "from jaxrender.brdf import base",
        "no run time",
    ),
    "a neighbour of the configs": (
        "jaxrender.pipelines.config.loader",
        "from ..output import prepare",
        "jaxrender.pipelines.output.prepare: a config",
    ),
    "a print": ("jaxrender.io.images", "def f():\n    print('x')", "io.images:2: print"),
    "precision": (
        "jaxrender.inverse.brdf",
        "jax.config.update('jax_enable_x64', True)",
        "command line alone",
    ),
    "precision in a command": (
        "jaxrender.cli.photographs",
        "jax.config.update('jax_enable_x64', True)",
        "command line alone",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_the_checker_finds(case):
    module, source, expected = BROKEN[case]
    found = violations(source, module)
    assert len(found) >= 1
    assert expected in found[0]
    assert found[0].startswith(module)


ALLOWED = {
    "a lower level": ("jaxrender.reflection.dual", "from jaxrender.harmonics import basis"),
    "itself": ("jaxrender.brdf.base", "from . import lambert\nfrom .lambert import Lambert"),
    "the version": ("jaxrender.pipelines.output", "from jaxrender import __version__"),
    "solvers at home": ("jaxrender.inverse.solvers", "import optimistix\nimport lineax, jaxopt"),
    "plots at home": ("jaxrender.pipelines.report", "import matplotlib.pyplot"),
    "config libraries": (
        "jaxrender.pipelines.config.loader",
        "import io\nfrom ruamel.yaml import YAML\nfrom jaxrender.errors import InputError\n"
        "from jaxrender.pipelines.config.run import RunConfig",
    ),
    "a method called print": ("jaxrender.io.images", "console.print('x')"),
    "precision at home": ("jaxrender.cli.process", "jax.config.update('jax_enable_x64', True)"),
    "words": ("jaxrender.io.images", '"""print(x) and import jaxrender.cli in a docstring."""'),
}


@pytest.mark.parametrize("case", ALLOWED)
def test_the_checker_lets_pass(case):
    module, source = ALLOWED[case]
    assert violations(source, module) == []


def test_relative_imports_of_a_package_start_at_itself():
    source = "from . import base\nfrom ..harmonics import basis"
    found = imports_of(ast.parse(source), "jaxrender.brdf", is_package=True)
    assert [name for name, _ in found] == ["jaxrender.brdf.base", "jaxrender.harmonics.basis"]
