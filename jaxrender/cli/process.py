"""The process of a command: output, bundled examples, JAX's settings, the end."""

from __future__ import annotations

import gc
import logging
import os
import sys
from importlib import resources
from pathlib import Path
from typing import NoReturn

from jaxrender.cli.app import UNREAD, main
from jaxrender.pipelines.cache_place import user_cache

# Folders of examples that travel with the package, by the names in the README.
_BUNDLED = ("configs", "data_synth")
# Compile seconds from which a program is worth keeping: all of them, since a run needs a hundred
# small ones.  JAX's own 1 s would keep almost none.
_CACHE_FROM_SECONDS = 0.0

# New objects before a collection of each generation; Python's own are 700, 10 and 10.
_COLLECT_AFTER = (100_000, 50, 100)


def console() -> NoReturn:
    """Run the process's own command line, and end the process."""
    collect_seldom()
    code = main(sys.argv[1:])
    # All results are on disk.  To take every trace apart before ending takes half a second more.
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def collect_seldom() -> None:
    """Let the garbage collector look through all objects seldom.

    JAX's traces are millions of small objects that reference counting frees; looking for cycles
    among them takes a sixth of a short run.
    """
    gc.set_threshold(*_COLLECT_AFTER)


def say(text: str) -> None:
    """Print to the output; end quietly if the reader has closed it."""
    try:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever reads it, as ``head`` does, has read enough; what is left has no reader.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(UNREAD)


def bundled(path: Path) -> Path:
    """Return the path, or the bundled example of that name if the path does not exist."""
    if path.exists() or not path.parts or path.parts[0] not in _BUNDLED:
        return path
    found = example(path)
    return found if found.exists() else path


def example(path: Path) -> Path:
    """The bundled example of that name, wherever the command is called."""
    package = Path(str(resources.files("jaxrender")))
    packed = package / "package_data"
    # An editable install has no data in the package: its clone has them beside it.
    is_clone = not packed.exists() and (package.parent / "pyproject.toml").exists()
    return (package.parent if is_clone else packed) / path


def can_open_pages() -> bool:
    """Whether a person looks at the output, on a machine that can show a page."""
    if not sys.stdout.isatty():
        return False
    has_desktop = sys.platform in ("darwin", "win32")
    return has_desktop or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def set_up_jax() -> None:
    """Float64, and programs, traced and compiled, kept from one process to the next."""
    import jax

    from jaxrender import programs

    jax.config.update("jax_enable_x64", True)
    folder = cache_folder()
    if folder is None:
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", _CACHE_FROM_SECONDS)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    programs.keep_in(folder / "programs")


def cache_folder() -> Path | None:
    """Where compiled programs are kept: JAX_COMPILATION_CACHE_DIR, or the user's cache folder.

    None where there is no such folder that the user alone may write to: what lies in the cache is
    executed.
    """
    chosen = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if chosen:
        return Path(chosen)
    folder = user_cache() / "jaxrender"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
    except OSError as error:
        logging.getLogger(__package__).warning("no compilation cache in %s: %s", folder, error)
        return None
    if hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & 0o022):
        logging.getLogger(__package__).warning(
            "no compilation cache in %s: others may write to it; chmod go-w mends that", folder
        )
        return None
    return folder
