"""Programs that are kept in a folder, and what they are called with."""

from contextlib import contextmanager
from pathlib import Path

import equinox as eqx
import jax
import numpy as np

from jaxrender import programs

VECTOR = np.linspace(0.1, 1, 7)


@contextmanager
def keeping(folder: Path):
    """Keep programs in a folder for a while."""
    # As in a new process: nothing is looked up that an earlier test has compiled.
    jax.clear_caches()
    programs.keep_in(folder)
    yield folder
    programs.keep_in(None)


def kept(folder):
    return sorted(path.name for path in folder.glob("*")) if folder.exists() else []


def in_a_new_process(function, *args, **kwargs):
    """Call a function with nothing in memory of what was traced and compiled."""
    jax.clear_caches()
    return function(*args, **kwargs)


def same(one, other):
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other)):
        assert a.dtype == b.dtype
        assert a.weak_type == b.weak_type
        assert a.committed == b.committed
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()


def material(kind, *numbers, **choices):
    return kind(np.full(3, 0.2), np.full(3, 0.1), *map(np.asarray, numbers), **choices)


class Weighted(eqx.Module):
    """Of this file, whose text is in no key."""

    weight: jax.Array
    power: int = eqx.field(static=True)
