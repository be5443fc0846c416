"""The names under which traced programs are kept.

- A name changes with all that tracing depends on.
- What has no lasting name is only compiled.
"""

import logging
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from kept_programs import VECTOR, Weighted, in_a_new_process, keeping, kept, material, same

from jaxrender import programs
from jaxrender.brdf import Microfacet, Phong
from jaxrender.geometry import SurfaceSamples
from jaxrender.programs import stored


@pytest.fixture
def folder(tmp_path):
    with keeping(tmp_path / "programs") as folder:
        yield folder


@stored()
def of_anything(anything, x):
    leaves = [leaf for leaf in jax.tree.leaves(anything) if eqx.is_array(leaf)]
    return sum(jnp.sum(leaf) for leaf in leaves) + x


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
