"""The runs of a sweep, their names, and their states on disk.

The name of a run is the start of a hash of its whole config, the contents of its input files and
the version.  A folder with a readable ``result.json`` is finished.  A folder with ``error.json``
has failed, and is tried again.
"""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Any, NamedTuple

from jaxrender.errors import InputError
from jaxrender.io.jsonfiles import read_json
from jaxrender.pipelines.batch.task import Failure, Job
from jaxrender.pipelines.captures import capture_of
from jaxrender.pipelines.config import CaptureConfig, FurtherCaptureConfig, RunConfig, load_recipe
from jaxrender.pipelines.config.sweep import Sweep
from jaxrender.pipelines.output import fingerprint, fingerprint_of, result_folder
from jaxrender.pipelines.result import read_result, write_json
from jaxrender.pipelines.scene import input_files

# Hexadecimal digits of a name: two of 1e5 runs share one by accident with probability 3e-10.
_NAME_LENGTH = 16

_ERROR = "error.json"


class State(enum.Enum):
    """The state of a run; the index shows its value until the run has an outcome."""

    PENDING = "pending"
    FINISHED = "finished"
    FAILED = "failed"


class Look(NamedTuple):
    """The state of a run, and its result or its error."""

    state: State
    document: dict[str, Any]


class Planned(NamedTuple):
    """One run of a batch."""

    name: str
    folder: Path
    parameters: dict[str, Any]
    config: RunConfig

    def look(self) -> Look:
        """Read the run's folder."""
        if (self.folder / _ERROR).is_file():
            return Look(State.FAILED, _read_error(self.folder))
        try:
            return Look(State.FINISHED, read_result(self.folder))
        except InputError:
            return Look(State.PENDING, {})

    def job(self) -> Job:
        """Make the job for a worker."""
        return Job(self.name, self.folder, self.config, replaces=self.folder.exists())

    def keep_error(self, failure: Failure) -> None:
        """Write the error of a run into its folder.

        Raises InputError if files that are not ours are in the way.
        """
        content = {**failure._asdict(), "parameters": self.parameters}
        with result_folder(self.folder, f"failed {self.name}", force=True) as into:
            write_json(into / _ERROR, content)


def plan_of(sweep: Sweep) -> tuple[Planned, ...]:
    """Name the runs of a sweep.

    Raises InputError for photographs, recipes and cameras that cannot be read.
    """
    data = _Data()
    planned = []
    for parameters, config in sweep.runs:
        settings = f"{config.model_dump_json()}\n{data.digest(config)}"
        name = fingerprint_of("batch", settings, [])[:_NAME_LENGTH]
        planned.append(Planned(name, sweep.output / name, parameters, config))
    return tuple(planned)


class _Data:
    """Digests of the files that runs read; each file is read once."""

    def __init__(self) -> None:
        self._captures: dict[str, list[Path]] = {}
        self._recipes: dict[Path, str] = {}
        self._digests: dict[Path, str] = {}

    def digest(self, config: RunConfig) -> str:
        """Digest the contents of all files that a run reads."""
        recipes = "".join(self._recipe(path) for path in config.recipes)
        files = [path for path in input_files(config) if path not in config.recipes]
        for capture in (config.capture, *config.captures):
            if capture.recipe is None:
                files += self._photographs(capture)
        return recipes + self._contents(files)

    def _photographs(self, capture: CaptureConfig | FurtherCaptureConfig) -> list[Path]:
        key = capture.model_dump_json()
        if key not in self._captures:
            frames = capture_of(capture).frames
            masks = [frame.mask_path for frame in frames if frame.mask_path is not None]
            self._captures[key] = [*(frame.image_path for frame in frames), *masks]
        return self._captures[key]

    def _recipe(self, path: Path) -> str:
        if path not in self._recipes:
            recipe = load_recipe(path)
            self._recipes[path] = fingerprint(recipe, input_files(recipe), purpose="synth")
        return self._recipes[path]

    def _contents(self, files: list[Path]) -> str:
        for path in files:
            if path not in self._digests:
                self._digests[path] = fingerprint_of("batch data", "", [path])
        return "".join(self._digests[path] for path in sorted(set(files)))


def _read_error(folder: Path) -> dict[str, Any]:
    try:
        found = read_json(folder / _ERROR)
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
