"""Experiments take from the package only what is there.

They run for minutes to hours, so that no test runs them.  A name that has moved shows here.
"""

import ast
import importlib
from pathlib import Path

import pytest

EXPERIMENTS = Path(__file__).parents[1] / "experiments"


@pytest.mark.parametrize("script", sorted(EXPERIMENTS.glob("*.py")), ids=lambda path: path.stem)
def test_every_import_of_an_experiment_resolves(script):
    missing = []
    for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] == "jaxrender":
                    importlib.import_module(alias.name)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "jaxrender":
            module = importlib.import_module(node.module)
            missing += [
                f"{script.name}:{node.lineno}: {node.module} has no {alias.name}"
                for alias in node.names
                if not _has(module, alias.name)
            ]
    assert missing == []


def _has(module, name: str) -> bool:
    """Whether a module has a name, or a module of that name below it."""
    if hasattr(module, name):
        return True
    try:
        importlib.import_module(f"{module.__name__}.{name}")
    except ModuleNotFoundError:
        return False
    return True
