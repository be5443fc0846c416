"""Whatever a user states is refused, or what a fit is given is another: for every task and key.

The table of what a task honours is not asked.  Runs of every kind are made up to where the numerics
begin: what they are given is written down instead.  Then each key is given another value.
"""

import contextlib
import json
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import jax
import numpy as np
import pytest
from pydantic import BaseModel
from small_captures import Ball, write_ball, write_json
from stated_runs import OTHER, RUNS, others, text_of

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Sphere
from jaxrender.inverse import BRDFFit, Factorization
from jaxrender.inverse.comparison import Comparison
from jaxrender.inverse.photographs import Reading, read_photographs, trace_photographs
from jaxrender.inverse.texture import (
    TextureEstimate,
    metallic_estimate,
    regions,
    unknown_light,
)
from jaxrender.io import read_capture, write_environment, write_image, write_mesh
from jaxrender.lighting import Environment
from jaxrender.pipelines import captures, run
from jaxrender.pipelines.config import RunConfig, load_run_config
from jaxrender.pipelines.output import FolderState
from jaxrender.pipelines.tasks import brdf_spectrum, task
from jaxrender.pipelines.tasks.light import asked
from jaxrender.pipelines.tasks.light import recovery as light
from jaxrender.pipelines.tasks.material import recovery as material
from jaxrender.pipelines.tasks.texture import recovery as texture

USUAL = (
    "brdf under skies",
    "lighting",
    "factorize",
    "texture",
    "texture of varying sigma",
    "texture of maps",
    "brdf-spectrum",
)
# What is so, whether it is said or not.
SAID_ANYWAY = {
    "texture in the dark": ["texture.unknown_light"],
    "texture of lambertian in the dark": ["texture.unknown_light"],
}


class Reached(Exception):
    """A run has come to where the numerics begin."""


class Record:
    """Stands in for functions, and writes down what they are given."""

    def __init__(self):
        self.calls = []

    def of(self, name: str, answer=None, ends: bool = False):
        """Make a function that writes its arguments down; one that ends a run never returns."""

        def stand_in(*arguments, **options):
            self.calls.append((name, plain(arguments), plain(options)))
            if ends:
                raise Reached
            return answer(*arguments, **options) if callable(answer) else answer

        return stand_in


def plain(value):
    """Turn what a function is given into what can be compared; functions are all alike."""
    if isinstance(value, mock.NonCallableMock | types.FunctionType | types.MethodType):
        return type(value).__name__
    if isinstance(value, np.ndarray | jax.Array):
        return np.shape(value), hash(np.asarray(value).tobytes())
    if isinstance(value, tuple | list):
        return type(value).__name__, [plain(part) for part in value]
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    if hasattr(value, "__dict__") and not isinstance(value, type):
        return type(value).__name__, plain(vars(value))
    return value


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a small capture, and with every file that a key may name."""
    folder = tmp_path_factory.mktemp("stated") / "capture"
    write_ball(folder, Ball(size=16, noise=0))
    content = json.loads((folder / "transforms.json").read_text())
    write_json(folder / "other.json", {**content, "fl_x": 1.01 * content["fl_x"]})
    sky = np.random.default_rng(0).uniform(size=(16, 32, 3))
    write_environment(folder / "probe.exr", Environment(sky))
    write_environment(folder / "other.exr", Environment(sky**2))
    for name, height in (("lights.txt", 0.5), ("other.txt", 0.6)):
        (folder / name).write_text(f"1 0 {height}\n" * 4)
    (folder / "irradiance.txt").write_text("2\n" * 4)
    (folder / "curve.txt").write_text("0 0\n1 2\n")
    write_mesh(folder / "ball.ply", Mesh.icosphere(2))
    write_mesh(folder / "other.ply", Mesh.icosphere(1))
    write_image(folder / "regions.png", np.kron([[0.0], [1.0]], np.ones((4, 16, 3))))
    return folder


@pytest.fixture(scope="module")
def seen(place):
    """The photographs as they are read and traced, for a ball and for a mesh."""
    capture = read_capture(place / "transforms.json")
    images = read_photographs(capture, Reading())
    shapes = (Sphere(np.zeros(3), 1.0), Mesh.icosphere(2))
    return {type(one): trace_photographs(capture, images, one, Reading()) for one in shapes}


def trace(seen, config):
    """Write down what the numerics are given by a run."""
    record = Record()
    some = lambda observations, *how: SimpleNamespace(  # noqa: E731
        observations=observations.take(np.arange(200))
    )
    traced = lambda capture, _, shape, *__: [  # noqa: E731
        photograph._replace(frame=frame)
        for photograph, frame in zip(seen[type(shape)], capture.frames)
    ]
    of = record.of
    fit, found = (
        mock.NonCallableMock(spec=BRDFFit, calibration=None),
        mock.NonCallableMock(spec=Factorization, calibration=None),
    )
    best, brightest = (
        mock.NonCallableMock(spec=Comparison, best=SimpleNamespace(fit=one, name="ggx"))
        for one in (fit, found)
    )
    stands = {
        run: {
            "fingerprint": lambda *_: "",
            "prepare": of("prepare", FolderState.FRESH),
        },
        captures: {
            "read_capture": of("read_capture", read_capture),
            "read_photographs": of("read_photographs", []),
            "trace_photographs": of("trace_photographs", traced),
        },
        task: {
            "leverage": of("leverage"),
            "sharpness": of("sharpness"),
            "draw": of("draw", some),
        },
        material: {
            "fit_brdf": of("fit_brdf", fit),
            "compare_models": of("compare_models", best),
            "fit_variants": of("fit_variants", ()),
            "correct_by_table": of("correct_by_table"),
            "forecast_of_fit": of("forecast", ends=True),
            "sentence_of": lambda *_: "",
        },
        light: {
            "factorize": of("factorize", found),
            "compare_factorizations": of("compare_factorizations", brightest),
            "sentence_of": lambda *_: "",
            "LightRecovery": of("LightRecovery", ends=True),
        },
        asked.factorization: {"in_units_of": of("in_units_of", found)},
        regions: {
            "recover_texture": of("recover_texture", ends=True),
            "forward_under": of("forward_under", SimpleNamespace(final=lambda index: None)),
            "fit_texture": of("fit_texture", ends=True),
        },
        metallic_estimate: {"recover_metallic": of("recover_metallic", ends=True)},
        unknown_light: {
            "recover_glossy": of("recover_glossy", ends=True),
            "diffuse_problem": of("diffuse_problem"),
            "factor_diffuse": of("factor_diffuse", ends=True),
        },
        brdf_spectrum: {
            "random_subset": of("random_subset", lambda observations, *_: observations),
            "estimate_spectrum": of("estimate_spectrum", ends=True),
        },
    }
    with contextlib.ExitStack() as stack:
        for module, functions in stands.items():
            stack.enter_context(mock.patch.multiple(module, **functions))
        with contextlib.suppress(Reached):
            run.fit(config)
        if config.task == "texture":
            written, dark = object.__new__(texture.TextureRecovery), SimpleNamespace(light=None)
            maps = mock.NonCallableMock(
                TextureEstimate, light=None, calibration=None, write_maps=of("write_maps")
            )
            lit = SimpleNamespace(estimate=maps)
            vars(written).update(config=config, lit=lit, evidence=dark)
            written.write_images(Path())
    return hash(str(record.calls))


def keys_of(section: type[BaseModel], before: str = "") -> Iterator[str]:
    """List every key that holds no section; of what may be either, both."""
    for name, annotation in typing.get_type_hints(section, include_extras=True).items():
        if name not in section.model_fields:
            continue
        inner = [part for part in parts_of(annotation) if issubclass(part, BaseModel)]
        for part in inner:
            yield from keys_of(part, f"{before}{name}.")
        if not inner:
            yield f"{before}{name}"


def parts_of(annotation) -> Iterator[type]:
    """List the classes that a value may be of; a list is one."""
    if typing.get_origin(annotation) is typing.Annotated:
        yield from parts_of(typing.get_args(annotation)[0])
    elif isinstance(annotation, type):
        yield annotation
    elif typing.get_origin(annotation) is not tuple:
        for part in typing.get_args(annotation):
            yield from parts_of(part)


def test_every_key_is_tried():
    assert {*keys_of(RunConfig)} <= {*OTHER}


def changed(key, before):
    """Load the run with every other value of a key that is not refused."""
    for value in others(key):
        try:
            config = load_run_config("run.yaml", [f"{key}={value}"])
        except InputError:
            if value == "true":
                # A switch that cannot be on is off, said or not.
                return
            continue
        if config != before:
            yield config


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in USUAL else pytest.mark.slow) for n in RUNS]
)
def test_a_key_is_honoured_or_refused(place, seen, monkeypatch, name):
    monkeypatch.chdir(place)
    Path("run.yaml").write_text(text_of(name))
    config, ignored = load_run_config("run.yaml"), []
    as_it_is = trace(seen, config)
    for key in OTHER:
        for other in changed(key, config):
            with contextlib.suppress(InputError):
                if trace(seen, other) == as_it_is:
                    ignored.append(key)
    assert ignored == SAID_ANYWAY.get(name, [])
