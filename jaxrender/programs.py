"""Traced programs, kept from one process to the next beside JAX's cache of compiled ones.

JAX keeps what its compiler made.  But every process traces and lowers each function anew to learn
which program it needs, and that takes longer than to load it.  ``stored`` keeps the lowered program
too (StableHLO, by ``jax.export``), under a name made of all that tracing depends on: the source of
this package, versions, JAX's settings, the function, and its arguments but for their numbers.
Machine code is in JAX's cache alone, whose names hold what the processor can do.
"""

import dataclasses
import enum
import functools
import hashlib
import importlib.metadata
import logging
import os
import pickle
import platform
import sys
import tempfile
import types
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax import export
from jax.core import Tracer
from jax.extend.core import Primitive, get_opaque_trace_state
from jax.interpreters import mlir

_Function = TypeVar("_Function", bound=Callable)

# Whose code is traced, or reads what is kept.
_LIBRARIES = ("jax", "jaxlib", "equinox", "optimistix", "lineax", "jaxopt", "numpy", "flatbuffers")
# Settings of JAX that change where things are kept and what is said about them, but no program.
_NO_MATTER = ("cache", "log", "dump", "traceback")
_PLAIN = (type(None), bool, int, float, complex, str, bytes)

Effort = Literal["full", "more", "less", "least"]
# XLA's older emitters of loops compile in less time, and what they make is as fast or faster for
# some functions, rows of three channels above all.  LLVM's first level halves the time; what it
# makes runs up to 1.6 times as long.  Level 0 halves it once more, for 2 to 6 times as long.
_OPTIONS: dict[Effort, dict[str, bool | int]] = {
    "full": {},
    "more": {"xla_cpu_use_fusion_emitters": False},
    "less": {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1},
    "least": {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 0},
}

_logger = logging.getLogger(__name__)
# Asked for where no transformation can be under way: in a thread that does nothing else.
with ThreadPoolExecutor(1) as _thread:
    _NOT_TRACING = _thread.submit(get_opaque_trace_state, convention="flax").result()
_folder: Path | None = None


def keep_in(folder: Path | None) -> None:
    """Keep programs in a folder, or nowhere (None), which is how a process starts.

    What lies in the folder is executed, so that only the user may be able to write to it.
    """
    global _folder
    _folder = folder


def stored(compile_with: Callable[..., Callable] = eqx.filter_jit, *, effort: Effort = "full"):
    """Compile a function by ``jax.jit`` or ``equinox.filter_jit``, and keep its traced program.

    What it computes is the same to the last bit.  Inside another transformation, and where no
    folder is set, it is the compiled function and no more.  The function must stand at the top of
    a module or class of this package, whose source is part of the name under which the program is
    kept.  It must see nothing but its arguments and what never changes.

    ``effort`` is the compiler's.  ``"more"`` is for functions that are called often and were
    measured to run as fast as with ``"full"``.  With ``"less"`` it takes half the time, for
    functions that are seldom called; with ``"least"`` a quarter, for those that run but a moment.
    """
    options = {"compiler_options": _OPTIONS[effort]} if effort != "full" else {}

    def decorate(function: _Function) -> _Function:
        # Inside another function it is compiled with that one, which has options of its own.
        nested = compile_with(function)
        plain = compile_with(function, **options) if options else nested
        kept = compile_with(_looked_up(function), **options)

        @functools.wraps(function)
        def call(*args, **kwargs):
            if get_opaque_trace_state(convention="flax") != _NOT_TRACING:
                return nested(*args, **kwargs)
            if _folder is None or jax.config.jax_disable_jit:
                return plain(*args, **kwargs)
            return kept(*args, **kwargs)

        return call  # pyright: ignore[reportReturnType]

    return decorate


class _Program(NamedTuple):
    """A serialised export of arrays to arrays, and its result with a ``_Place`` for each array."""

    exported: bytes
    result: Any


@dataclasses.dataclass(frozen=True)
class _Place:
    """Where an array of the flat result belongs, and whether its type is weak."""

    index: int
    weak: bool


# An export by its own ``call`` would commit its results to a device and forget which are weak, and
# whatever is then called with them would be another program than usual.
_call = Primitive("stored_program")
_call.multiple_results = True
_call.def_abstract_eval(
    lambda *arrays, exported, weak: [
        jax.core.ShapedArray(aval.shape, aval.dtype, weak_type=is_weak)
        for aval, is_weak in zip(exported.out_avals, weak)
    ]
)
mlir.register_lowering(
    _call, mlir.lower_fun(lambda *arrays, exported, weak: exported.call(*arrays))
)


class _NotKept(Exception):
    """Why a program cannot be kept."""


def _looked_up(function: Callable) -> Callable:
    """Stand in for a function while it is traced: look its program up, or make it and keep it."""

    @functools.wraps(function)
    def traced(*args, **kwargs):
        leaves, structure = jax.tree.flatten((args, kwargs))
        arrays = [leaf for leaf in leaves if isinstance(leaf, Tracer)]

        def on_arrays(*arrays):
            rest = iter(arrays)
            given = [next(rest) if isinstance(leaf, Tracer) else leaf for leaf in leaves]
            args, kwargs = structure.unflatten(given)
            return function(*args, **kwargs)

        try:
            path = _path(function, (args, kwargs))
            program = _read(path)
            if program is None:
                program = _made(function.__name__, on_arrays, arrays)
                _write(path, program)
        except _NotKept as why:
            _logger.debug("the program of %s is not kept: %s", function.__qualname__, why)
            return function(*args, **kwargs)
        places = [leaf for leaf in jax.tree.leaves(program.result) if isinstance(leaf, _Place)]
        exported = export.deserialize(bytearray(program.exported))
        found = _call.bind(*arrays, exported=exported, weak=tuple(place.weak for place in places))
        return jax.tree.map(
            lambda leaf: found[leaf.index] if isinstance(leaf, _Place) else leaf, program.result
        )

    return traced


def _made(name: str, function: Callable, arrays: list[Tracer]) -> _Program:
    result: list[Any] = []

    def flat(*arrays):
        leaves, structure = jax.tree.flatten(function(*arrays))
        own = [leaf for leaf in leaves if eqx.is_array(leaf)]
        places = iter(_Place(k, jax.typeof(leaf).weak_type) for k, leaf in enumerate(own))
        result.append(
            structure.unflatten([next(places) if eqx.is_array(leaf) else leaf for leaf in leaves])
        )
        return own

    flat.__name__ = name
    given = [jax.typeof(array) for array in arrays]
    shapes = [jax.ShapeDtypeStruct(a.shape, a.dtype, weak_type=a.weak_type) for a in given]
    try:
        program = export.export(jax.jit(flat))(*shapes)
        serialised = bytes(program.serialize())
    except (ValueError, NotImplementedError) as error:
        # Calls back to the host, and unusual libraries; or the function's own error, once more.
        raise _NotKept(str(error)) from error
    # Whoever reads it must know the classes of the result.
    list(_described(result[-1]))
    return _Program(serialised, result[-1])


def _read(path: Path) -> _Program | None:
    """Read a program; None where there is none, or it is damaged."""
    with suppress(OSError):
        content = path.read_bytes()
        if hashlib.sha256(content[32:]).digest() == content[:32]:
            return pickle.loads(content[32:])
    return None


def _write(path: Path, program: _Program) -> None:
    """Write aside and rename, so that no other process reads half of it."""
    content = pickle.dumps(program)
    with suppress(OSError):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as stream:
            try:
                stream.write(hashlib.sha256(content).digest() + content)
            except OSError:
                Path(stream.name).unlink()
                raise
        os.replace(stream.name, path)


def _path(function: Callable, arguments: Any) -> Path:
    """Name the file of a program by all that tracing it depends on."""
    assert _folder is not None
    parts = [*_surroundings(), *_settings(), function.__module__, function.__qualname__]
    digest = hashlib.sha256("\n".join([*parts, *_described(arguments)]).encode()).hexdigest()
    return _folder / f"{function.__name__}-{digest[:40]}"


@functools.cache
def _surroundings() -> tuple[str, ...]:
    """The source of this package, and the versions of what traces it."""
    source = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        source.update(path.read_bytes())
    versions = (f"{name} {importlib.metadata.version(name)}" for name in _LIBRARIES)
    return source.hexdigest(), sys.version, platform.machine(), *versions


def _settings() -> Iterator[str]:
    """JAX's settings where the call is, also those of a ``with`` block, and the platform."""
    yield jax.default_backend()
    for name, value in sorted(jax.config.values.items()):
        if not any(word in name for word in _NO_MATTER):
            yield f"{name} {value}"


def _described(value: Any) -> Iterator[str]:
    """Write down all that tracing can see of a value, the same in every process."""
    kind = type(value)
    if isinstance(value, Tracer):
        array = jax.typeof(value)
        yield f"{array.dtype} {array.shape} {array.weak_type}"
    elif kind in _PLAIN:
        yield repr(value)
    elif isinstance(value, jax.Array | np.ndarray | np.generic):
        array = np.asarray(value)
        yield f"{array.dtype.str} {array.shape} {hashlib.sha256(array.tobytes()).hexdigest()}"
    elif isinstance(value, enum.Enum):
        yield f"{_name(kind)} {value.name}"
    elif isinstance(value, type | types.FunctionType):
        yield _name(value)
    elif isinstance(value, tuple | list):
        yield f"{_name(kind)} {len(value)}"
        for item in value:
            yield from _described(item)
    elif kind is dict:
        yield "dict"
        yield from _described([*value.items()])
    elif isinstance(value, functools.partial):
        yield from _described(("partial", value.func, value.args, value.keywords))
    elif dataclasses.is_dataclass(value):
        yield _name(kind)
        for field in dataclasses.fields(value):
            yield from _described(getattr(value, field.name))
    else:
        raise _NotKept(f"{value!r} has no name that another process would give it")


def _name(thing: Any) -> str:
    """The name under which a class or a function of known source is found."""
    if thing.__module__.partition(".")[0] not in ("builtins", __package__, *_LIBRARIES):
        raise _NotKept(f"{thing!r} may change while versions do not")
    found = sys.modules.get(thing.__module__)
    for part in thing.__qualname__.split("."):
        found = getattr(found, part, None)
    if found is not thing:
        raise _NotKept(f"{thing!r} does not stand at the top of a module or class")
    return f"{thing.__module__}.{thing.__qualname__}"
