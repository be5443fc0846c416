"""Spherical harmonic reflection maps: one function in five forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shrm_problems import any_spectrum, random_light, random_samples

from jaxrender.geometry import Orthographic, Sphere, look_at, rotation
from jaxrender.harmonics import CubeGrid, LatLongGrid, complex_from_real, evaluate, real_basis
from jaxrender.reflection import (
    AzimuthalTexture,
    GlobalShrm,
    IcosahedralMaps,
    LightFieldTable,
    LocalShrm,
    SurfacePoints,
    ViewerGoal,
    ViewerRule,
    central_coefficients,
    convolve_isotropic,
    evaluate_isotropic,
    global_shrm,
    local_from_global,
    local_shrm,
    principal_maps,
    reflection_maps,
    shrm_from_photographs,
)
from jaxrender.reflection.shrm import blending_shares, icosahedron_vertices
from jaxrender.spectra import CentralSpectrum, phong_transfer

_F, _P = 7, 3
_GRID = LatLongGrid(24, 48)


def _frames(grid):
    alpha, beta = (
        a.ravel() for a in np.meshgrid(grid.polar_angles(), grid.azimuths(), indexing="ij")
    )
    return alpha, beta, np.asarray(rotation(alpha, beta, np.zeros_like(alpha)))


@pytest.fixture(scope="module")
def made():
    rng = np.random.default_rng(3)
    light, spectrum = random_light(rng, _F), any_spectrum(rng, (_F, _P))
    return light, spectrum, local_shrm(light, spectrum, _GRID)


def test_the_three_steps_are_the_light_rotated_into_every_texels_frame(made):
    light, spectrum, local = made
    frames = _frames(_GRID)[2]
    twin = np.asarray(central_coefficients(light, spectrum, frames))
    assert np.abs(twin.reshape(local.maps.shape) - local.maps).max() < 1e-10


@pytest.mark.parametrize("band_limits", [(3, 0), (2, 4), (5, 5)])
def test_more_degrees_of_the_viewer_than_of_the_light_and_none(band_limits):
    rng = np.random.default_rng(5)
    light, spectrum = random_light(rng, band_limits[0]), any_spectrum(rng, band_limits)
    local = local_shrm(light, spectrum, _GRID)
    twin = np.asarray(central_coefficients(light, spectrum, _frames(_GRID)[2]))
    assert np.abs(twin.reshape(local.maps.shape) - local.maps).max() < 1e-10


def test_local_global_dynamic_and_the_explicit_expansion_are_one_function(made):
    light, spectrum, local = made
    alpha, beta, frames = _frames(_GRID)
    viewer = np.array([0.3, -0.5, 0.8]) / np.sqrt(0.98)
    everywhere = np.repeat(viewer[None], len(alpha), axis=0)
    # The whole sum over l, m, p, q, written in complex harmonics (T 2.54 of T 2.55).
    points = SurfacePoints(alpha, beta, 0 * alpha, frames.transpose(0, 2, 1) @ viewer)
    field = convolve_isotropic(complex_from_real(light), spectrum.coefficients)
    explicit = np.asarray(evaluate_isotropic(field, points))
    assert np.abs(explicit.imag).max() < 1e-10
    explicit = explicit.real
    centres = _GRID.directions().reshape(-1, 3)
    whole = global_shrm(local)
    for found in (
        local.at(centres, everywhere),
        whole.at(centres, everywhere),
        whole.dynamic_map(viewer).reshape(-1, 3),
    ):
        assert np.abs(np.asarray(found) - explicit).max() < 1e-10
    assert np.abs(np.asarray(local_from_global(whole).maps) - local.maps).max() < 1e-10


def test_a_cube_holds_the_same_function(made):
    light, spectrum, local = made
    cube = CubeGrid(6)
    viewer = np.array([0.3, -0.5, 0.8]) / np.sqrt(0.98)
    found = np.asarray(global_shrm(local).on(cube).dynamic_map(viewer)).reshape(-1, 3)
    x, y, z = cube.directions().reshape(-1, 3).T
    frames = np.asarray(rotation(np.arccos(z), np.arctan2(y, x), np.zeros_like(x)))
    around = np.asarray(real_basis(frames.transpose(0, 2, 1) @ viewer, _P))
    expected = np.einsum("xkc,xk->xc", central_coefficients(light, spectrum, frames), around)
    assert np.abs(found - expected).max() < 1e-10


def test_a_radial_lobe_gives_a_plain_reflection_map():
    grid, light = LatLongGrid(32, 64), random_light(np.random.default_rng(8), _F)
    image = np.asarray(evaluate(light, grid.directions().reshape(-1, 3))).reshape(32, 64, 3)
    transfer = np.asarray(phong_transfer(20.0, _F))
    # A_l = Lambda_l rho_l, and the viewer's constant harmonic is 1 / sqrt(4 pi).
    rho = transfer * np.sqrt((2 * np.arange(_F + 1) + 1) / (4 * np.pi)) * np.sqrt(4 * np.pi)
    spectrum = CentralSpectrum(rho[:, None, None, None], np.ones(1))
    maps = np.asarray(local_shrm(light, spectrum, grid).maps)[:, :, 0] / np.sqrt(4 * np.pi)
    expected = np.asarray(reflection_maps(image, transfer[None], grid))[0]
    wavelength = np.sqrt(4 * np.pi / (2 * np.arange(_F + 1) + 1))
    assert np.isclose(wavelength[0], np.sqrt(4 * np.pi))
    assert np.abs(maps - expected).max() < 1e-10


@pytest.mark.slow
def test_interpolation_is_second_order_across_poles_and_seam(made):
    light, spectrum, _ = made
    rng = np.random.default_rng(11)
    centres = rng.standard_normal((60, 3))
    centres[:20, :2] *= 0.02
    centres[20:40, 1] *= 0.01
    centres /= np.linalg.norm(centres, axis=1, keepdims=True)
    outgoing = rng.standard_normal((60, 3))
    outgoing /= np.linalg.norm(outgoing, axis=1, keepdims=True)
    x, y, z = centres.T
    frames = np.asarray(rotation(np.arccos(z), np.arctan2(y, x), np.zeros_like(x)))
    around = np.asarray(real_basis(np.einsum("xij,xi->xj", frames, outgoing), _P))
    exact = np.einsum("xkc,xk->xc", central_coefficients(light, spectrum, frames), around)
    errors = []
    for rows in (60, 120, 240):
        local = local_shrm(light, spectrum, LatLongGrid(rows, 2 * rows))
        both = [np.asarray(s.at(centres, outgoing)) for s in (local, global_shrm(local))]
        errors.append([np.abs(found - exact).max() for found in both])
    ratios = np.array(errors)[:-1] / np.array(errors)[1:]
    assert np.all(ratios > 3), (errors, ratios)


def test_a_cube_is_evaluated_and_differentiated_where_the_compiler_sees_it(made):
    whole, cube = global_shrm(made[2]), CubeGrid(24)
    on_cube, samples = whole.on(cube), random_samples(np.random.default_rng(9), 30)
    index, share = cube.neighbours(np.asarray(samples.reflected))
    maps = np.asarray(on_cube.maps).reshape(-1, *on_cube.maps.shape[2:])
    between = np.einsum("pk,pkac->pac", share, maps[index])
    expected = np.einsum("pac,pa->pc", between, np.asarray(real_basis(samples.outgoing, _P)))
    at = jax.jit(lambda centres: on_cube.at(centres, samples.outgoing))
    assert np.abs(np.asarray(at(samples.reflected)) - expected).max() < 1e-10
    centres = jnp.asarray(samples.reflected)
    across = jnp.cross(centres, jnp.asarray(samples.normals))
    _, moved = jax.jvp(at, (centres,), (across,))
    near = (at(centres + 1e-6 * across) - at(centres - 1e-6 * across)) / 2e-6
    assert np.abs(moved - near).max() < 1e-6 * np.abs(moved).max()
    by_maps = jax.jit(jax.grad(lambda s: jnp.sum(s.at(centres, samples.outgoing))))(on_cube)
    assert np.isfinite(by_maps.maps).all()


def test_derivatives_of_both_maps_at_the_poles_are_those_of_the_reflected_light(made):
    light, spectrum, _ = made
    centres = jnp.array([[0.0, 0, 1], [0, 0, -1], [1e-12, 0, 1]])
    outgoing = jnp.broadcast_to(jnp.array([0.6, 0.0, 0.8]), centres.shape)

    def exact(at):
        x, y, z = at.T
        alpha, beta = jnp.arctan2(jnp.hypot(x, y), z), jnp.arctan2(y, x)
        frames = rotation(alpha, beta, jnp.zeros_like(x))
        local = jnp.einsum("xij,xi->xj", frames, outgoing)
        around = real_basis(local, _P)
        return jnp.einsum("xkc,xk->xc", central_coefficients(light, spectrum, frames), around)

    beside = np.array(centres)
    beside[:, 0] = 1e-5
    for axis in (0, 1):
        across = np.zeros((3, 3))
        across[:, axis] = 1e-4
        # The reflected light is smooth, so its differences may be taken beside the pole.
        expected = (exact(beside + across) - exact(beside - across)) / 2e-4
        moves = jnp.asarray(across * 1e4)
        errors = []
        for rows in (60, 120):
            local = local_shrm(light, spectrum, LatLongGrid(rows, 2 * rows))
            both = [
                jax.jvp(lambda c, s=s: s.at(c, outgoing), (centres,), (moves,))[1]
                for s in (local, global_shrm(local))
            ]
            errors.append([np.abs(np.asarray(b) - expected).max() for b in both])
        scale = np.abs(expected).max()
        assert np.max(errors[1]) < 0.2 * scale, (errors, scale)
        assert np.all(np.array(errors[1]) < 0.7 * np.array(errors[0]) + 0.01 * scale), errors


def test_light_field_tables_lead_there_and_back(made):
    _, _, local = made
    rule = ViewerRule(_P + 1, 2 * _P + 1)
    table = LightFieldTable.of(local, rule)
    around = np.asarray(real_basis(rule.directions(), _P))
    expected = np.einsum("tfk,rckd->tfrcd", around, local.maps)
    assert np.abs(np.asarray(table.values) - expected).max() < 1e-10
    assert np.abs(np.asarray(table.shrm(_P, _F).maps) - local.maps).max() < 1e-10
    with pytest.raises(ValueError, match="cannot be determined from 4 x 7 viewers"):
        table.shrm(_P + 1, _F)


def test_twelve_maps_are_exact_at_their_own_viewers_and_blend_between(made):
    whole = global_shrm(made[2])
    maps, vertices = IcosahedralMaps.of(whole), icosahedron_vertices()
    assert np.allclose(blending_shares(vertices), np.eye(12), atol=1e-12)
    middle = vertices[[0, 4]].mean(axis=0)
    shares = blending_shares(middle[None] / np.linalg.norm(middle))[0]
    assert np.isclose(shares.sum(), 1)
    assert (shares >= 0).all()
    centres = _GRID.directions().reshape(-1, 3)[::7]
    for vertex in vertices[::5]:
        everywhere = np.repeat(vertex[None], len(centres), axis=0)
        expected = np.asarray(whole.at(centres, everywhere))
        assert np.abs(np.asarray(maps.at(centres, everywhere)) - expected).max() < 1e-10


def test_the_azimuthal_texture_is_the_sum_of_q_0(made):
    local = made[2]
    centres = _GRID.directions().reshape(-1, 3)[::11]
    texture = AzimuthalTexture.of(local, 3)
    across = np.cross(centres, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    # At right angles to R, the middle one of three angles; averaged over the azimuth q > 0 vanish.
    turns = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    around = [
        np.asarray(local.at(centres, np.cos(t) * across + np.sin(t) * np.cross(centres, across)))
        for t in turns
    ]
    found = np.asarray(texture.at(centres, across))
    assert np.abs(found - np.mean(around, axis=0)).max() < 1e-10


def test_principal_components_are_those_of_the_dense_light_field(made):
    _, _, local = made
    every = principal_maps(local, (_P + 1) ** 2)
    assert np.abs(np.asarray(every.expanded()) - local.maps).max() < 1e-10
    rule = ViewerRule(_P + 1, 2 * _P + 2)
    values = np.asarray(LightFieldTable.of(local, rule).values)
    root = np.sqrt(rule.weights() * np.ones((1, rule.columns)))[:, :, None, None, None]
    texel = np.sqrt(_GRID.weights())[None, None, :, :, None]
    dense = (values * root * texel).reshape(rule.rows * rule.columns, -1)
    strengths = np.linalg.svd(dense, compute_uv=False)[: (_P + 1) ** 2] ** 2
    assert np.allclose(every.energy, strengths / strengths.sum(), atol=1e-12)
    few = principal_maps(local, 5)
    left = np.asarray(few.expanded()) - local.maps
    weights = _GRID.weights()[:, :, None, None]
    part = np.sum(weights * left**2) / np.sum(weights * np.asarray(local.maps) ** 2)
    assert np.isclose(part, every.energy[5:].sum(), rtol=1e-9)


def test_an_odd_number_of_columns_is_refused_before_anything_is_computed(made):
    light, spectrum, local = made
    odd, refusal = LatLongGrid(24, 47), "24 x 47 texels: .* an even number of columns"
    pose = look_at(np.array([4.0, 0, 0]), np.zeros(3), np.array([0.0, 0, 1]))
    camera, sphere = Orthographic(8, 8, pose, scale=0.3), Sphere(np.zeros(3), 1.0)
    for refused in (
        lambda: LocalShrm(local.maps[:, :47], odd, _F),
        lambda: GlobalShrm(local.maps[:, :47], odd, _F),
        lambda: local_shrm(light, spectrum, odd),
        lambda: shrm_from_photographs([camera], [np.zeros((8, 8, 3))], sphere, odd, ViewerGoal(1)),
    ):
        with pytest.raises(ValueError, match=refusal):
            refused()
    # A face of a cube may have any side.
    side = CubeGrid(5)
    assert GlobalShrm(np.zeros((*side.shape, 1, 3)), side, 0).order == 0


def test_what_cannot_be_is_refused(made):
    light, spectrum, local = made
    with pytest.raises(ValueError, match=r"aliases.*21 rows"):
        local_shrm(light, spectrum, LatLongGrid(20, 40))
    with pytest.raises(ValueError, match="light to degree 6 and a BRDF to 7"):
        local_shrm(light[:49], spectrum, _GRID)
    with pytest.raises(ValueError, match=r"ask for degrees from 0 up to"):
        spectrum.cut((_F, _P + 1))
    with pytest.raises(ValueError, match="make the grid from their shape"):
        LocalShrm(local.maps, LatLongGrid(8, 16), _F)
    with pytest.raises(ValueError, match="17 components of 16 maps"):
        principal_maps(local, 17)
    with pytest.raises(ValueError, match="no frames"):
        local_from_global(global_shrm(local).on(CubeGrid(5)))
