"""What public functions do with the arrays they are given, before they compute anything.

- Every public function and method with array arguments is ``checked``; a new one fails here.
- Any batch of directions gives what the flat list gives; an empty one gives an empty answer.
- Grey arrays, lists, integers, and lights instead of their coefficients are taken.
- What does not fit raises ``ValueError`` that says what was given and what is wanted, under ``jit``
  too; the compiled program is the same as without the check.
"""

import importlib
import inspect
import typing

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import Lambertian
from jaxrender.geometry import Components, Incoming
from jaxrender.harmonics import (
    LatLongGrid,
    analyse,
    apply_transfer,
    complex_from_real,
    degree_table,
    evaluate,
    real_basis,
    real_from_complex,
    rotate,
    synthesise,
)
from jaxrender.lighting import (
    DirectionalSources,
    Environment,
    HarmonicLight,
    SmoothLobes,
    positive_part_of,
)
from jaxrender.reflection import (
    AzimuthalTexture,
    IcosahedralMaps,
    SurfacePoints,
    basis_images,
    convolve_isotropic,
    convolve_radial,
    evaluate_isotropic,
    global_shrm,
    irradiance,
    irradiance_matrix,
    local_shrm,
    matrix_irradiance,
    quadratic_irradiance,
    relit,
)
from jaxrender.shapes import AnyArray, Array, Float, _read, checked
from jaxrender.spectra import (
    CentralSpectrum,
    isotropic_coefficients,
    light_coefficients,
    sum_lobes,
)

PACKAGES = (
    "harmonics",
    "spectra",
    "reflection",
    "brdf",
    "lighting",
    "geometry",
    "imaging",
    "inverse",
)
RANDOM = np.random.default_rng(21)
COEFFICIENTS = RANDOM.normal(size=(16, 3))
BATCH = RANDOM.normal(size=(4, 5, 3))
BATCH /= np.linalg.norm(BATCH, axis=-1, keepdims=True)
SOURCES = DirectionalSources(BATCH[0, :2], np.ones((2, 3)))
SPECTRUM = CentralSpectrum(RANDOM.normal(size=(3, 2, 2, 3)), np.ones(3))
GRID = LatLongGrid(8, 16)
SHRM = local_shrm(COEFFICIENTS[:9], SPECTRUM, GRID)
BY_NORMAL = {
    "real_basis": lambda n: real_basis(n, 3),
    "evaluate": lambda n: evaluate(COEFFICIENTS, n),
    "degree_table": lambda n: degree_table(COEFFICIENTS, n),
    "irradiance": lambda n: irradiance(COEFFICIENTS, n),
    "matrix_irradiance": lambda n: matrix_irradiance(irradiance_matrix(COEFFICIENTS), n),
    "quadratic_irradiance": lambda n: quadratic_irradiance(irradiance_matrix(COEFFICIENTS), n),
    "HarmonicLight.radiance": HarmonicLight(COEFFICIENTS).radiance,
    "SmoothLobes.radiance": SmoothLobes(BATCH[0], np.full(5, 0.3), np.ones((5, 3))).radiance,
    "LocalShrm.at": lambda n: SHRM.at(n, n[..., ::-1]),
    "GlobalShrm.at": lambda n: global_shrm(SHRM).at(n, n[..., ::-1]),
    "IcosahedralMaps.at": lambda n: IcosahedralMaps.of(global_shrm(SHRM)).at(n, n[..., ::-1]),
    "AzimuthalTexture.at": lambda n: AzimuthalTexture.of(SHRM, 9).at(n, n[..., ::-1]),
    "Lambertian.evaluate": lambda n: Lambertian(np.ones(3)).evaluate(n, n[..., ::-1]),
}


def _functions():
    """Every public function and method with arguments that are arrays, with its wrapper."""
    for package in PACKAGES:
        module = importlib.import_module(f"jaxrender.{package}")
        for name in module.__all__:
            thing = getattr(module, name)
            if inspect.isclass(thing):
                for method, held in vars(thing).items():
                    plain = getattr(held, "__func__", held)
                    if not method.startswith("_") and callable(plain):
                        yield f"{package}.{name}.{method}", plain, False
            elif callable(thing):
                yield f"{package}.{name}", thing, True


def _has_arrays(function, named_tuples: bool) -> bool:
    hints = typing.get_type_hints(function)
    wanted = [
        _read(hints[name]) for name in inspect.signature(function).parameters if name in hints
    ]
    return any(w is not None and (w.choices or named_tuples) for w in wanted)


def test_every_public_function_checks_its_arrays():
    unchecked = []
    for name, wrapper, is_function in _functions():
        layers, inner = [wrapper], wrapper
        while hasattr(inner, "__wrapped__"):
            inner = inner.__wrapped__
            layers.append(inner)
        abstract = any(getattr(layer, "__isabstractmethod__", False) for layer in layers)
        is_checked = any(getattr(layer, "checks_arrays", False) for layer in layers)
        # Named tuples of samples are checked where light meets them, not in every BRDF.
        named_tuples = is_function and name.split(".")[0] in ("spectra", "reflection")
        if abstract or is_checked or not inspect.isfunction(inner):
            continue
        if _has_arrays(inner, named_tuples):
            unchecked.append(name)
    assert unchecked == []


@pytest.mark.parametrize("name", BY_NORMAL)
def test_any_batch_of_directions_is_taken(name):
    function = BY_NORMAL[name]
    flat = np.asarray(function(BATCH.reshape(-1, 3)))
    batch = np.asarray(function(BATCH))
    assert batch.shape == (4, 5, *flat.shape[1:])
    np.testing.assert_allclose(batch.reshape(flat.shape), flat, atol=1e-13)
    single = np.asarray(function(BATCH[1, 2]))
    np.testing.assert_allclose(single, batch[1, 2], atol=1e-13)
    assert np.asarray(function(np.zeros((0, 3)))).shape == (0, *flat.shape[1:])


def test_basis_images_of_any_batch():
    flat = basis_images(BATCH.reshape(-1, 3))
    np.testing.assert_array_equal(basis_images(BATCH), flat.reshape(9, 4, 5))
    assert basis_images(np.zeros((0, 3))).shape == (9, 0)


def test_grey_arrays_are_taken_and_answered_in_grey():
    grey = COEFFICIENTS[:, 0]
    image = synthesise(GRID, grey)
    assert image.shape == GRID.shape
    np.testing.assert_allclose(analyse(GRID, image, 3), grey, atol=1e-13)
    np.testing.assert_allclose(
        evaluate(grey, BATCH), evaluate(COEFFICIENTS, BATCH)[..., 0], atol=1e-13
    )
    there = complex_from_real(grey)
    assert there.shape == (16,)
    np.testing.assert_allclose(real_from_complex(there), grey, atol=1e-13)


def test_one_transfer_for_all_channels_does_not_make_light_grey():
    falling = np.array([1.0, 0.5, 0.2, 0.1])
    assert apply_transfer(COEFFICIENTS, falling).shape == (16, 3)
    assert apply_transfer(COEFFICIENTS[:, 0], falling).shape == (16,)
    assert apply_transfer(COEFFICIENTS, np.stack([falling] * 3, axis=1)).shape == (16, 3)


def test_lists_and_integers_become_floats():
    expected = real_basis(np.array([[0.0, 0.0, 1.0]]), 2)[0]
    for up in ([0, 0, 1], (0.0, 0.0, 1.0), np.array([0, 0, 1]), jnp.array([0, 0, 1])):
        found = real_basis(up, 2)
        assert found.dtype == expected.dtype
        np.testing.assert_allclose(found, expected, atol=1e-15)


def test_single_precision_stays_single():
    found = evaluate(COEFFICIENTS.astype(np.float32), BATCH.astype(np.float32))
    assert found.dtype == np.float32


def test_lights_stand_for_their_coefficients():
    image = Environment(np.abs(RANDOM.normal(size=(16, 32, 3))))
    for light in (SOURCES, image, HarmonicLight(COEFFICIENTS)):
        own = light_coefficients(light, 2)
        by_light, by_own = (local_shrm(given, SPECTRUM, GRID) for given in (light, own))
        np.testing.assert_array_equal(by_light.maps, by_own.maps)
        np.testing.assert_array_equal(irradiance_matrix(light), irradiance_matrix(own))
        transfer = RANDOM.normal(size=(3, 2, 2, 3))
        np.testing.assert_allclose(
            convolve_isotropic(light, transfer),
            convolve_isotropic(complex_from_real(own), transfer),
            atol=1e-13,
        )
        falling = np.array([1.0, 0.5, 0.2])
        np.testing.assert_array_equal(
            convolve_radial(light, falling), convolve_radial(own, falling)
        )


def test_lobes_are_summed_before_they_meet_light():
    brdf = Lambertian(np.array([0.2, 0.3, 0.4]))
    by_lobe = isotropic_coefficients(brdf, (3, 2))
    summed = sum_lobes(by_lobe, brdf.amplitudes)
    np.testing.assert_allclose(summed[..., 1], 0.3 * by_lobe[0], atol=1e-15)
    light = complex_from_real(COEFFICIENTS)
    assert convolve_isotropic(light, summed).shape[-1] == 3
    with pytest.raises(ValueError, match=r"spectra\.sum_lobes"):
        convolve_isotropic(light, by_lobe[..., :1])


WRONG = {
    "complex for real": (
        lambda: evaluate(COEFFICIENTS + 1j, BATCH),
        r"evaluate: coefficients is complex128\[16, 3\], wanted float\[coefficient, channel\]: "
        r"harmonics\.real_from_complex",
    ),
    "real for complex": (
        lambda: convolve_isotropic(COEFFICIENTS, np.ones((4, 2, 2, 3))),
        r"convolve_isotropic: light is float64\[16, 3\], wanted complex.*complex_from_real",
    ),
    "last axis": (
        lambda: evaluate(COEFFICIENTS, BATCH[..., :2]),
        r"directions is float64\[4, 5, 2\], wanted float\[\*batch, 3\]: the axis of 3 has 2",
    ),
    "last axis of a matrix": (
        lambda: rotate(COEFFICIENTS, np.eye(4)),
        r"rotate: world_from_local is float64\[4, 4\], wanted float\[\*batch, 3, 3\]",
    ),
    "band limits": (
        lambda: relit(np.ones((9, 7, 3)), COEFFICIENTS),
        r"relit: coefficients is .*: coefficient is 16 \(band limit 3\) here and "
        r"9 \(band limit 2\) in images",
    ),
    "band limits of light and filter": (
        lambda: convolve_isotropic(complex_from_real(COEFFICIENTS), np.ones((3, 2, 2, 3))),
        "light to degree 3 and a transfer to degree 2",
    ),
    "half precision": (
        lambda: real_basis(BATCH.astype(np.float16), 2),
        "directions is float16.*give float32 or float64",
    ),
    "words": (lambda: irradiance(COEFFICIENTS, "up"), "normals is str, wanted float"),
    "ragged lists": (lambda: real_basis([[0, 0, 1], [1, 0]], 2), "directions is list, wanted"),
    "truth values": (lambda: real_basis(BATCH > 0, 2), r"directions is bool\[4, 5, 3\], wanted"),
    "a light to a degree that nothing tells": (
        lambda: irradiance(SOURCES, BATCH),
        r"coefficients is DirectionalSources, .*spectra\.light_coefficients\(light, F\)",
    ),
    "colours": (
        lambda: apply_transfer(COEFFICIENTS, np.ones((4, 2))),
        "transfer is .*: channel is 2 here and 3 in coefficients",
    ),
    "fields of a named tuple": (
        lambda: evaluate_isotropic(
            np.ones((2, 3, 2, 3, 3), complex),
            SurfacePoints(np.ones(4), np.ones(4), np.ones(4), BATCH[0]),
        ),
        r"points\.outgoing is float64\[5, 3\], .*: point is 5 here and 4 in points\.alpha",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_does_not_fit_is_named(name):
    call, message = WRONG[name]
    with pytest.raises(ValueError, match=message):
        call()


def test_what_does_not_fit_is_named_where_the_function_is_traced():
    with pytest.raises(ValueError, match="the axis of 3 has 2"):
        jax.jit(lambda n: evaluate(COEFFICIENTS, n) * 2.0)(BATCH[..., :2])
    with pytest.raises(ValueError, match="works on the host"):
        jax.jit(positive_part_of)(COEFFICIENTS)


def test_a_named_tuple_that_fits_is_passed_on_as_it_is():
    """A pair holds the sum of both directions beside its three fields."""

    @checked
    def same(incoming: Components, scale: Float[AnyArray, ""]) -> Components:
        return incoming

    direction = Components.of(jnp.asarray(BATCH[0]))
    pair = Incoming.of_pair(direction, direction)
    assert same(pair, 1.0) is pair
    assert same(Components([0, 0], [0, 0], [1, 1]), 1.0).z.dtype == np.float64


def test_the_compiled_program_is_the_same_as_without_the_check():
    @checked
    def lit(coefficients: Float[AnyArray, "coefficient channel"]) -> Float[Array, "channel"]:
        return 2.0 * jnp.sum(jnp.asarray(coefficients), axis=0)

    with_check, without = (
        jax.jit(one).lower(COEFFICIENTS).as_text() for one in (lit, lit.__wrapped__)
    )
    assert with_check == without
