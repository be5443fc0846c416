"""Traced programs that are kept: found again, made anew where they must be, and never felt.

- What a kept program computes is what ``jit`` computes, to the last bit, LAPACK included.
- It is traced once for all processes; its name changes with all that tracing depends on.
- Damaged files are made anew; what has no lasting name, or no place to be kept, is only compiled.
- Inside another transformation, and without a folder, there is nothing but the compiled function.
"""

import logging
import os
import subprocess
import sys
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
import pytest

from jaxrender import programs
from jaxrender.brdf import Microfacet, Phong
from jaxrender.geometry import SurfaceSamples
from jaxrender.programs import stored

VECTOR = np.linspace(0.1, 1, 7)


@pytest.fixture
def folder(tmp_path):
    # As in a new process: nothing is looked up that an earlier test has compiled.
    jax.clear_caches()
    programs.keep_in(tmp_path / "programs")
    yield tmp_path / "programs"
    programs.keep_in(None)


def kept(folder):
    return sorted(path.name for path in folder.glob("*")) if folder.exists() else []


class Counted:
    """A function, and how often it has been traced."""

    def __init__(self):
        self.traces = 0

    def stored(self, compile_with=eqx.filter_jit):
        def scaled(x, power=2, shift=0.0):
            self.traces += 1
            return jnp.sin(x) ** power * jnp.exp(-x) + shift

        return stored(compile_with)(scaled)


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


def test_a_program_is_traced_once_for_all_processes(folder):
    counted = Counted()
    function = counted.stored()
    first = function(VECTOR)
    assert (counted.traces, len(kept(folder))) == (1, 1)
    function(VECTOR + 1)
    again = in_a_new_process(function, VECTOR)
    assert counted.traces == 1
    same(first, again)
    programs.keep_in(None)
    same(first, in_a_new_process(function, VECTOR))


def test_without_a_folder_it_is_jit(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    counted = Counted()
    function = counted.stored()
    for _ in range(2):
        function(VECTOR)
    assert counted.traces == 1
    assert not list(tmp_path.iterdir())


@stored(jax.jit, effort="less")
def doubled(x):
    return 2 * x


def test_within_another_function_options_are_that_one_s(folder):
    # Of constants alone, too: they look the same as outside.
    inside = jax.jit(lambda x: x * doubled(VECTOR))(2.0)
    np.testing.assert_allclose(inside, 4 * VECTOR, rtol=1e-15)
    np.testing.assert_allclose(jax.grad(lambda x: (x * doubled(VECTOR)).sum())(1.0), 2 * 3.85)
    assert not kept(folder)
    np.testing.assert_array_equal(doubled(VECTOR), 2 * VECTOR)
    assert len(kept(folder)) == 1


@stored(partial(jax.jit, static_argnames="power"))
def raised(x, power):
    return x**power


class Weighted(eqx.Module):
    """Of this file, whose text is in no key."""

    weight: jax.Array
    power: int = eqx.field(static=True)


@stored()
def of_anything(anything, x):
    leaves = [leaf for leaf in jax.tree.leaves(anything) if eqx.is_array(leaf)]
    return sum(jnp.sum(leaf) for leaf in leaves) + x


def material(kind, *numbers, **choices):
    return kind(np.full(3, 0.2), np.full(3, 0.1), *map(np.asarray, numbers), **choices)


# Each with a call that differs from it in one thing that tracing depends on.
DIFFERENT = {
    "shape": ((VECTOR,), (VECTOR[1:],)),
    "kind of number": ((VECTOR,), (VECTOR.astype(np.float32),)),
    "weak type": ((jnp.asarray(1.0),), (jnp.asarray(1.0, float),)),
    "structure": (((VECTOR, VECTOR),), ([VECTOR, VECTOR],)),
    "names": (({"a": VECTOR},), ({"b": VECTOR},)),
    "static number": (((VECTOR, 2),), ((VECTOR, 3),)),
    "static word": (((VECTOR, "a"),), ((VECTOR, "b"),)),
    "nothing": (((VECTOR, None),), ((VECTOR, ()),)),
    "class": ((material(Microfacet, 0.2, 1.5),), (material(Phong, 20.0),)),
    "static field": (
        (material(Microfacet, 0.2, 1.5),),
        (material(Microfacet, 0.2, 1.5, fresnel="half"),),
    ),
    "function": (((VECTOR, programs.stored),), ((VECTOR, programs.keep_in),)),
    "partial": (((VECTOR, partial(stored, 1)),), ((VECTOR, partial(stored, 2)),)),
    "named tuple": ((SurfaceSamples(VECTOR, VECTOR),), ((VECTOR, VECTOR),)),
}


@pytest.mark.parametrize("case", DIFFERENT)
def test_what_is_traced_otherwise_has_another_name(case, folder):
    for number, (arguments, _) in enumerate((DIFFERENT[case], DIFFERENT[case][::-1])):
        of_anything(arguments, 1.5)
        assert len(kept(folder)) == number + 1
    in_a_new_process(of_anything, DIFFERENT[case][0], 1.5)
    assert len(kept(folder)) == 2


@pytest.mark.parametrize(
    "change",
    [
        partial(jax.default_matmul_precision, "highest"),
        partial(jax.numpy_dtype_promotion, "standard"),
        partial(jax.enable_x64, False),
    ],
)
def test_settings_are_part_of_the_name(change, folder):
    x = jnp.ones(3, jnp.float32)
    of_anything(x, x)
    with change():
        of_anything(x, x)
    assert len(kept(folder)) == 2
    in_a_new_process(of_anything, x, x)
    assert len(kept(folder)) == 2


@pytest.mark.parametrize("which", range(len(programs._surroundings())))
def test_source_and_versions_are_part_of_the_name(which, folder, monkeypatch):
    of_anything(VECTOR, 1.5)
    changed = list(programs._surroundings())
    changed[which] += "+1"
    monkeypatch.setattr(programs, "_surroundings", lambda: tuple(changed))
    in_a_new_process(of_anything, VECTOR, 1.5)
    assert len(kept(folder)) == 2


def test_a_changed_file_of_the_package_changes_the_source(tmp_path, monkeypatch):
    module = tmp_path / "programs.py"
    module.write_text("one = 1")
    monkeypatch.setattr(programs, "__file__", str(module))
    found = []
    for text in ("one = 1", "one = 2"):
        module.write_text(text)
        found.append(programs._surroundings.__wrapped__())
    assert found[0][0] != found[1][0]
    assert found[0][1:] == found[1][1:]


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[: len(content) // 2],
        lambda content: content[:-1] + bytes([content[-1] ^ 1]),
        lambda content: bytes([content[0] ^ 1]) + content[1:],
    ],
)
def test_a_damaged_file_is_made_anew(damage, folder):
    counted = Counted()
    function = counted.stored()
    first = function(VECTOR)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    same(first, in_a_new_process(function, VECTOR))
    assert counted.traces == 2
    assert [path] == list(folder.iterdir())
    same(first, in_a_new_process(function, VECTOR))
    assert counted.traces == 2


def test_where_nothing_can_be_written_it_is_only_compiled(tmp_path):
    (tmp_path / "file").write_text("")
    programs.keep_in(tmp_path / "file")
    try:
        np.testing.assert_array_equal(raised(VECTOR, power=2), VECTOR**2)
    finally:
        programs.keep_in(None)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("anything", "why"),
    [
        ((VECTOR, stored(jax.jit)), "does not stand at the top"),
        ((VECTOR, material), "may change while versions do not"),
        ((VECTOR, object()), "no name that another process would give it"),
        (Weighted(jnp.ones(3), 2), "may change while versions do not"),
    ],
)
def test_what_has_no_lasting_name_is_only_compiled(anything, why, folder, caplog):
    with caplog.at_level(logging.DEBUG, "jaxrender.programs"):
        found = of_anything(anything, 1.5)
    assert why in caplog.text
    assert not kept(folder)
    programs.keep_in(None)
    same(found, of_anything(anything, 1.5))


TRANSFORMATIONS = {
    "grad": lambda f: jax.grad(lambda x: jnp.sum(f(x)))(jnp.asarray(VECTOR)),
    "jacfwd": lambda f: jax.jacfwd(f)(jnp.asarray(VECTOR)),
    "vmap": lambda f: jax.vmap(f)(jnp.ones((3, 7))),
    "jit": lambda f: jax.jit(f)(VECTOR),
    "map": lambda f: jax.lax.map(f, jnp.ones((3, 7))),
}


@pytest.mark.parametrize("name", TRANSFORMATIONS)
def test_inside_another_transformation_it_is_the_function(name, folder):
    function = Counted().stored()
    found = TRANSFORMATIONS[name](function)
    assert not kept(folder)
    # Kept programs in between change nothing about that.
    function(VECTOR)
    same(found, TRANSFORMATIONS[name](function))


@stored()
def of_all_kinds(x):
    return SurfaceSamples(x + 1, jnp.asarray(2.0)), "word", None, {"a": (x > 0.5, 3), "b": [x]}


def test_results_come_back_as_they_were(folder):
    found = of_all_kinds(VECTOR)
    again = in_a_new_process(of_all_kinds, VECTOR)
    assert len(kept(folder)) == 1
    programs.keep_in(None)
    plain = of_all_kinds(VECTOR)
    assert plain[0].outgoing.weak_type
    for result in (found, again):
        assert (*result[1:3], result[3]["a"][1]) == ("word", None, 3)
        same(*(eqx.filter(some, eqx.is_array) for some in (result, plain)))


@stored()
def of_no_lasting_kind(x):
    return Weighted(x, 2)


@stored()
def told_the_host(x):
    return jax.pure_callback(lambda x: np.asarray(x) + 1, jax.typeof(x), x)


@pytest.mark.parametrize("function", [of_no_lasting_kind, told_the_host])
def test_what_cannot_be_exported_is_only_compiled(function, folder):
    found = function(VECTOR)
    assert not kept(folder)
    programs.keep_in(None)
    same(found, function(VECTOR))


@stored()
def refusing(x):
    raise ValueError("not this one")


def test_errors_of_the_function_are_its_own(folder):
    for _ in range(2):
        with pytest.raises(ValueError, match="not this one"):
            refusing(VECTOR)
    assert not kept(folder)


def test_where_nothing_is_to_be_compiled_the_function_runs_as_it_is(folder):
    with jax.disable_jit():
        np.testing.assert_array_equal(raised(VECTOR, power=2), VECTOR**2)
    assert not kept(folder)


LAPACK = {
    "cholesky": jnp.linalg.cholesky,
    "eigh": jnp.linalg.eigh,
    "qr": lambda a: jnp.linalg.qr(a, mode="r"),
    "solve": lambda a: jnp.linalg.solve(a, a[0]),
    "triangular": lambda a: jax.scipy.linalg.solve_triangular(a, a[0], lower=True),
    "svd": jnp.linalg.svd,
    "determinant": jnp.linalg.slogdet,
}


@pytest.mark.parametrize("name", LAPACK)
def test_lapack_is_called_as_ever(name, folder):
    rows = np.random.default_rng(0).normal(size=(20, 6))
    function = stored(jax.jit)(LAPACK[name])
    found = function(rows.T @ rows)
    again = in_a_new_process(function, rows.T @ rows)
    assert len(kept(folder)) == 1
    for result in (found, again):
        same(result, jax.jit(LAPACK[name])(rows.T @ rows))


def test_an_evaluated_material_is_the_same_to_the_last_bit(folder):
    directions = np.random.default_rng(1).normal(size=(2, 50, 3))
    incoming, outgoing = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    function = stored()(Microfacet.evaluate)
    arguments = (material(Microfacet, 0.2, 1.5), incoming, outgoing)
    function(*arguments)
    same(in_a_new_process(function, *arguments), eqx.filter_jit(Microfacet.evaluate)(*arguments))
    assert len(kept(folder)) == 1


ANOTHER_PROCESS = """
import sys
from pathlib import Path
import numpy as np
from jaxrender import programs
from jaxrender.brdf import Microfacet

def evaluated(brdf, samples, words):
    print("traced")
    return brdf.amplitudes

evaluated = programs.stored()(evaluated)
programs.keep_in(Path(sys.argv[1]))
brdf = Microfacet(np.full(3, 0.2), np.full(3, 0.1), 0.2, 1.5, fresnel="half")
evaluated(brdf, {"b": np.ones(3), "a": (1, 2.5, None, "word", Microfacet)}, ["x", np.float64(0.1)])
"""


def test_another_process_finds_it(tmp_path):
    found = []
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        arguments = [sys.executable, "-c", ANOTHER_PROCESS, str(tmp_path)]
        found.append(subprocess.check_output(arguments, env=environment, text=True).split())
    assert found == [["traced"], []]
    assert len(kept(tmp_path)) == 1
