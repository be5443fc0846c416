"""Batches that several files of tests run: a small capture, a sweep, and a stand-in for the fit."""

from pathlib import Path

import xarray
from small_captures import Ball, write_ball

from jaxrender.pipelines.batch import in_process
from jaxrender.pipelines.batch import task as task_module
from jaxrender.pipelines.output import result_folder
from jaxrender.pipelines.result import write_json

SWEEP = (
    "base: capture/config.yaml\ngrid: {brdf.mu: [1.4, 1.6], samples.seed: [0, 1]}\noutput: out\n"
)


def working_directory(folder: Path, monkeypatch) -> Path:
    """Work where a capture and a sweep are; batches run in this process."""
    write_ball(folder / "capture", Ball(views=2, size=24))
    (folder / "sweep.yaml").write_text(SWEEP)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    monkeypatch.setattr("jaxrender.pipelines.batch.cluster", lambda *_, **__: in_process)
    return folder


class Fits:
    """A stand-in for the fit: writes a small result, after the trouble that a test asks for."""

    def __init__(self, monkeypatch):
        self.done: list[tuple[float, int]] = []
        self.trouble = lambda mu, seed: None
        monkeypatch.setattr(task_module, "fit", self)

    def __call__(self, config, force):
        mu, seed = config.brdf.mu.fixed or 1.5, config.samples.seed
        self.done.append((mu, seed))
        with result_folder(config.output, f"{mu} {seed}", force) as into:
            (into / "half").write_text("written")
            self.trouble(mu, seed)
            write_json(into / "result.json", found(mu, seed))


def found(mu, seed):
    return {
        "outcome": "converged",
        "brdf": {"model": "microfacet", "kd": [0.1, 0.2, 0.3], "ks": 0.1 * seed, "mu": mu},
        "interval90": {
            "kd": [[0.0, 0.2], [0.1, 0.3], [0.2, 0.4]],
            "ks": [0.0, 1.0],
            "mu": [mu - 1, None],
        },
        "identifiable": {"kd": True, "mu": False},
        "residual": {"relative_rms": 0.01},
        "seconds": {"load": 0.1, "total": 2.5},
    }


def opened(folder="out"):
    with xarray.open_dataset(Path(folder) / "index.nc", engine="h5netcdf") as file:
        return file.load()


def raising(error, mu, seed):
    def trouble(*run):
        if run == (mu, seed):
            raise error

    return trouble


def debris(folder="out"):
    """What a batch should not leave."""
    return [path.name for path in Path(folder).iterdir() if path.name.startswith(".")]
