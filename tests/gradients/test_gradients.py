"""Derivatives of all public functions: finite, right, forward and reverse, in both precisions.

- The first row of every function but the longest passes; see ``page`` for what that means.  All
  rows, in single precision too, are among the slow tests.
- Every public function, and every array that it takes, is on a row or among the exceptions.
- The checker finds a wrong derivative, a NaN, an infinity, precision lost and gained, cancellation.
"""

import importlib
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from . import CHAPTERS, Chapter, Row, check, unlisted

ROWS = [(name, row) for name, chapter in CHAPTERS.items() for row in chapter.rows]
# The first row of each function; what else is tried of it is among the slow tests.
FIRST = {f"{name}: {row.function}": row for name, row in reversed(ROWS)}
# Rows of so many numbers that they take many seconds: these are among the slow tests alone.
LONG = {
    "brdf: FreeFacets",
    "brdf: HeTorrance",
    "brdf: HeTorranceLobe",
    "brdf: OpenPBR",
    "brdf: PolarNodesTable",
    "brdf: PoulinFournier",
    "reflection: AzimuthalTexture.at",
    "reflection: DualForward.columns",
    "reflection: IcosahedralMaps.at",
    "reflection: LocalShrm.at",
    "reflection: facet_coefficients",
    "reflection: polar_columns",
    "reflection: reflect_mirror_light",
    "reflection: reflect_slow_light",
    "reflection: render_views",
    "reflection: render_widths",
    "reflection: sensitivities",
    "reflection: slow_light_columns",
    "spectra: azimuthal_transfer",
    "spectra: azimuthal_transfer_of_samples",
    "spectra: central_spectrum_of",
    "spectra: clear_coefficients",
    "spectra: facet_azimuthal_transfer",
    "spectra: facet_transfer",
    "spectra: transfer_of_samples",
    "spectra: transfer_table",
}


every_row = pytest.mark.parametrize(
    "row", [row for _, row in ROWS], ids=[f"{name}: {row.name}" for name, row in ROWS]
)


@pytest.mark.parametrize("key", [key for key in FIRST if key not in LONG])
def test_derivatives_are_differences(key):
    failing = [found for found in check(FIRST[key], in_single=False) if not found.passes]
    assert not failing, "\n".join(map(str, failing))


@pytest.mark.slow
@every_row
def test_every_row_passes_in_both_precisions(row):
    failing = [found for found in check(row) if not found.passes]
    assert not failing, "\n".join(map(str, failing))


@pytest.mark.parametrize("name", CHAPTERS)
def test_nothing_public_is_left_out(name):
    package = importlib.import_module(f"jaxrender.{name}")
    assert unlisted(package, CHAPTERS[name]) == []


def test_long_rows_are_rows():
    assert set(FIRST) >= LONG


@pytest.mark.parametrize("name", CHAPTERS)
def test_rows_have_names_of_their_own(name):
    names = [row.name for row in CHAPTERS[name].rows]
    assert len(set(names)) == len(names)


@jax.custom_jvp
def _wrong(x):
    return x**2


@_wrong.defjvp
def _wrong_jvp(primals, tangents):
    return primals[0] ** 2, 2.001 * primals[0] * tangents[0]


FAULTS = {
    "a wrong derivative": (_wrong, np.ones(2), ("double",)),
    "a NaN": (lambda x: jnp.where(x > 0, jnp.sqrt(x), x), np.zeros(2), ("double", "single")),
    "an infinity": (lambda x: jnp.cbrt(x), np.zeros(2), ("double", "single")),
    "lost precision": (lambda x: jnp.float32(1) * x.astype(jnp.float32), np.ones(2), ("double",)),
    "gained precision": (lambda x: x.astype(jnp.float64), np.ones(2), ("single",)),
    "cancellation": (lambda x: 1e7 * x - (1e7 * x - x**2), np.full(2, 1.3), ("single",)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_the_checker_finds(fault):
    function, x, precisions = FAULTS[fault]
    [found] = check(Row("f", function, {"x": x}))
    assert not found.passes
    bounds = {"double": 1e-6, "single": 1e-2}
    failing = {name for name in bounds if not getattr(found, name) <= bounds[name]}
    assert failing == set(precisions)


def test_the_checker_lets_pass_what_is_right():
    [found, at_zero] = check(Row("f", lambda x: x**3, {"x": np.ones(2)}, {"0": {"x": np.zeros(2)}}))
    assert found.passes
    assert at_zero.passes


def test_a_list_that_lacks_something_is_found():
    def listed(x: "Float[Array, '3']", y: "Float[Array, '3']"):
        return x

    package = SimpleNamespace(__all__=["listed", "other"], listed=listed, other=lambda: None)
    chapter = Chapter([Row("listed", listed, {"x": np.ones(3)})], {"gone": "it was there"})
    complaints = unlisted(package, chapter)
    assert [text.split(":")[0] for text in complaints] == ["listed", "other", "gone"]
