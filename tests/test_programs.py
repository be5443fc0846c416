"""Traced programs that are kept: found again, made anew where they must be, and never felt.

- What a kept program computes is what ``jit`` computes, to the last bit, LAPACK included.
- It is traced once for all processes.
- Damaged files are made anew; what cannot be exported, or has no place to be kept, is only
  compiled.
- Inside another transformation, and without a folder, there is nothing but the compiled function.
"""

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
from kept_programs import VECTOR, Weighted, in_a_new_process, keeping, kept, material, same

from jaxrender import programs
from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.programs import stored


@pytest.fixture
def folder(tmp_path):
    with keeping(tmp_path / "programs") as folder:
        yield folder


class Counted:
    """A function, and how often it has been traced."""

    def __init__(self):
        self.traces = 0

    def stored(self, compile_with=eqx.filter_jit):
        def scaled(x, power=2, shift=0.0):
            self.traces += 1
            return jnp.sin(x) ** power * jnp.exp(-x) + shift

        return stored(compile_with)(scaled)


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
