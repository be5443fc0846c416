"""The process that a command runs in: how it starts, and how it ends.

- No traceback for bad input; 141 when nobody reads on.
- ``--help`` imports neither JAX nor NumPy nor pydantic.
- Float64 and the compilation cache are set before the numerics start; the cache is the user's own.
- What image files need is let go without a word.
"""

import os
import re
import subprocess
import sys

from jaxrender.cli import process


def run_process(*arguments, **environment):
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        timeout=120,
        check=False,
    )


def test_a_process_shows_no_traceback(tmp_path):
    found = run_process("-m", "jaxrender", "fit", str(tmp_path / "nope.yaml"))
    assert (found.returncode, found.stdout) == (2, "")
    assert found.stderr == f"{tmp_path / 'nope.yaml'}: no such file; mend the path\n"


def test_a_reader_that_has_read_enough_is_no_trouble():
    # ``jaxrender schema | head -1``
    command = [sys.executable, "-m", "jaxrender", "schema"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert (process.stderr.read(), process.wait()) == (b"", 141)


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from jaxrender import cli; code = cli.main(['--help']);"
        "heavy = {'jax', 'numpy', 'scipy', 'equinox', 'pydantic', 'matplotlib', 'ruamel'};"
        "sys.exit(f'{code} {sorted(heavy & set(sys.modules))}')"
    )
    found = run_process("-c", code)
    assert found.stderr.strip() == "0 []"
    commands = re.findall(r"^│ ([a-z]+) ", found.stdout, flags=re.MULTILINE)
    assert commands == [
        "analyze",
        "batch",
        "check",
        "complete",
        "compress",
        "demo",
        "doctor",
        "evaluate",
        "export",
        "fit",
        "import",
        "light",
        "measure",
        "nearest",
        "prefilter",
        "render",
        "schema",
        "synth",
        "view",
    ]


def test_jax_is_set_up_in_the_users_own_cache(tmp_path):
    code = (
        "from jaxrender.cli import process; process.set_up_jax(); import jax, jax.numpy as jnp;"
        "print(jnp.zeros(1).dtype, jax.config.jax_compilation_cache_dir,"
        "jax.config.jax_persistent_cache_min_compile_time_secs <= 0.1,"
        "jax.config.jax_persistent_cache_min_entry_size_bytes)"
    )
    found = run_process("-c", code, XDG_CACHE_HOME=str(tmp_path), JAX_COMPILATION_CACHE_DIR="")
    folder = tmp_path / "jaxrender"
    assert found.stdout.split() == ["float64", str(folder), "True", "-1"]
    assert folder.stat().st_mode & 0o777 == 0o700


def test_the_cache_folder_may_be_chosen(monkeypatch, tmp_path):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "mine"))
    assert process.cache_folder() == tmp_path / "mine"


def test_a_cache_that_others_may_write_to_is_not_used(monkeypatch, tmp_path, caplog):
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "jaxrender").mkdir()
    (tmp_path / "jaxrender").chmod(0o777)
    assert process.cache_folder() is None
    assert "others may write to it" in caplog.text
    (tmp_path / "jaxrender").chmod(0o755)
    assert process.cache_folder() == tmp_path / "jaxrender"


def test_no_cache_where_none_can_be_made(monkeypatch, tmp_path, caplog):
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    (tmp_path / "file").write_text("")
    assert process.cache_folder() is None
    assert "no compilation cache" in caplog.text


def test_a_relative_cache_home_is_ignored(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(sys, "platform", "linux")
    assert process.user_cache() == tmp_path / ".cache"


def test_the_pipelines_leave_without_a_word():
    """A class that JAX keeps for ever, defined above the image files, would keep their library."""
    left = run_process("-c", "import jaxrender.pipelines.run")
    assert (left.returncode, left.stdout, left.stderr) == (0, "", "")
