"""Config files are written where the test works."""

import pytest


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Each test works in its own folder, so that messages start with the bare file name."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
