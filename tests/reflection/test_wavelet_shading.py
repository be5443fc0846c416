"""Light reflected by a plane, from coefficient trees.

Pinned down here:

- nested traversal, one direction for all pixels and one for each agree to 1e-10 with the integral
  of the two functions over their joint dyadic grid, made of samples by SciPy's interpolation, for
  every wavelet and for trees of different sizes; so does a tree resampled to more samples, and
  trees that are thresholded
- as the resolution grows they converge to the hemispherical integral over angles of smooth light
  times a glossy BRDF; a white surface under light of radiance 1 shows 1, which takes the factor 4
  of L 4.2 and the root's mean (ERRATA 59)
- the nested traversal visits exactly the pairs of nodes whose supports overlap, which it cannot
  with the lambda_r and the masks as printed (ERRATA 63, 64); thresholding makes them fewer
- channels multiply, and one serves all; results do not depend on the pieces that pixels go in
- the derivatives in roots and values of both trees are those of a linear function; float32 stays
- what cannot be shaded is refused with the remedy
"""

import dataclasses
import itertools

import equinox as eqx
import jax
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from wavelet_shading_problems import EXACT, random_tree, tree_of

from jaxrender.brdf import BRDF, BlinnPhong, Lambertian
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.geometry import NUSSELT
from jaxrender.reflection.wavelet_shading import projections, shading
from jaxrender.reflection.wavelet_shading.plane import Plane, PlaneView, shade_plane
from jaxrender.reflection.wavelet_shading.shading import reflected_cells, reflected_radiance
from jaxrender.reflection.wavelet_shading.traversal import traverse
from jaxrender.wavelets.algebra import resampled
from jaxrender.wavelets.filters import WAVELETS, daubechies, haar, linear_spline
from jaxrender.wavelets.importance import most_important
from jaxrender.wavelets.nodes import separated
from jaxrender.wavelets.tree import CoefficientTree

evaluate = eqx.filter_jit(BRDF.evaluate)
RNG = np.random.default_rng(6)
PLACES, DIRECTIONS = RNG.random((4, 2)), RNG.random((4, 2))


def values_at(samples, points, stepwise):
    """The function between samples, by SciPy, constant beyond the outermost."""
    size = samples.shape[0]
    centres = (np.arange(size) + 0.5) / size
    if stepwise or size == 1:
        cell = np.minimum((points * size).astype(int), size - 1)
        return samples[tuple(cell.T)]
    held = np.clip(points, centres[0], centres[-1])
    return RegularGridInterpolator((centres,) * 4, samples, method="linear")(held)


def integral(light, brdf, place, direction):
    """Sum over the joint grid: on its cells the light is constant, the BRDF linear in each."""
    count = 2 * max(light.size, brdf.size)
    along = (np.arange(count) + 0.5) / count
    incident = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)
    fixed = [np.broadcast_to(end, incident.shape) for end in (place, direction)]
    arriving = values_at(np.asarray(light.samples()), np.hstack([fixed[0], incident]), True)
    stepwise = brdf.wavelet.name == "haar"
    points = np.hstack([incident, fixed[1]])
    return 4 * (arriving * values_at(np.asarray(brdf.samples()), points, stepwise)).mean(axis=0)


def assert_all_paths(light, brdf, expected, nested):
    expected = np.asarray(expected)
    many = reflected_radiance(light, brdf, PLACES, DIRECTIONS)
    np.testing.assert_allclose(many, expected, atol=EXACT)
    for i in range(len(PLACES)):
        one = reflected_radiance(light, brdf, PLACES[i : i + 1], DIRECTIONS[i : i + 1])
        np.testing.assert_allclose(one[0], expected[i], atol=EXACT)
    for i in range(nested):
        slow = traverse(light, brdf, PLACES[i], DIRECTIONS[i])
        np.testing.assert_allclose(slow.radiance, expected[i], atol=EXACT)


@pytest.mark.parametrize("name", WAVELETS)
def test_every_wavelet_agrees_with_the_joint_grid(name):
    light, brdf = random_tree(haar(), 8), random_tree(WAVELETS[name], 4, seed=1)
    expected = [integral(light, brdf, p, d) for p, d in zip(PLACES, DIRECTIONS)]
    assert np.abs(expected).min() > 1e-4
    assert_all_paths(light, brdf, expected, nested=2)


@pytest.mark.parametrize(
    ("wavelet", "sizes"),
    [
        (linear_spline(), (4, 8)),
        (linear_spline(), (8, 1)),
        (haar(), (2, 8)),
        (haar(), (1, 4)),
        (daubechies(2), (1, 1)),
    ],
)
def test_sizes_may_differ(wavelet, sizes):
    light, brdf = random_tree(haar(), sizes[0]), random_tree(wavelet, sizes[1], seed=1)
    expected = [integral(light, brdf, p, d) for p, d in zip(PLACES, DIRECTIONS)]
    assert_all_paths(light, brdf, expected, nested=1)


def test_a_resampled_spline_is_the_same_function():
    light, brdf = random_tree(haar(), 8), random_tree(linear_spline(), 4, seed=1)
    finer, coarser = resampled(brdf, 8), resampled(brdf, 2)
    inside = 0.125 + 0.6 * DIRECTIONS
    # Beyond the last sample one is constant where the other still follows the series.
    dark = np.zeros((8, 8, 8, 8, 2))
    dark[:, :, 1:7, 1:7] = np.asarray(light.samples())[:, :, 1:7, 1:7]
    inner = tree_of(haar(), dark)
    expected = reflected_radiance(inner, brdf, PLACES, inside)
    found = reflected_radiance(inner, finer, PLACES, inside)
    np.testing.assert_allclose(found, expected, atol=EXACT)
    nested = traverse(light, coarser, PLACES[0], DIRECTIONS[0]).radiance
    fast = reflected_radiance(light, coarser, PLACES[:1], DIRECTIONS[:1])[0]
    np.testing.assert_allclose(nested, fast, atol=EXACT)


@pytest.mark.parametrize("wavelet", [haar(), linear_spline()])
def test_thresholded_trees_are_what_is_left_of_them(wavelet):
    light = random_tree(haar(), 8, fraction=0.02)
    brdf = random_tree(wavelet, 4, seed=1, fraction=0.1)
    expected = [integral(light, brdf, p, d) for p, d in zip(PLACES, DIRECTIONS)]
    assert_all_paths(light, brdf, expected, nested=2)


def smooth_light(u, v, kappa, lambda_):
    return (1 + u * v) * (1.5 + np.sin(3 * kappa + u) * np.cos(2 * lambda_ - v))


def hemispherical_integral(brdf, place, direction, nodes=64):
    """int L f cos dw in angles, Gauss-Legendre by the trapezoidal rule."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    theta, weights = (x + 1) * np.pi / 4, w * np.pi / 4
    phi = 2 * np.pi * np.arange(2 * nodes) / (2 * nodes)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    incoming = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    outgoing = np.broadcast_to(np.asarray(NUSSELT.direction_from_square(direction)), incoming.shape)
    f = np.asarray(evaluate(brdf, incoming, outgoing))[..., 0]
    light = smooth_light(*place, (incoming[..., 0] + 1) / 2, (incoming[..., 1] + 1) / 2)
    measure = weights[:, None] * np.pi / nodes * np.sin(t) * np.cos(t)
    return (f * light * measure).sum()


@pytest.mark.parametrize(
    ("wavelet", "gain", "error"), [(haar(), 1.6, 0.06), (linear_spline(), 3, 0.03)]
)
def test_smooth_light_converges_to_the_integral_over_angles(wavelet, gain, error):
    material = BlinnPhong(np.array([0.0]), np.array([0.8]), 12.0)
    places = np.array([[0.2, 0.7], [0.9, 0.4], [0.55, 0.1], [0.35, 0.35]])
    directions = np.array([[0.5, 0.6], [0.4, 0.3], [0.62, 0.55], [0.45, 0.5]])
    errors = []
    for size in (8, 16):
        axis = (np.arange(size) + 0.5) / size
        grid = np.meshgrid(axis, axis, axis, axis, indexing="ij")
        light = tree_of(haar(), smooth_light(*grid)[..., None])
        brdf = tree_of(wavelet, TabulatedBRDF.of(material, size, outside="zero").values)
        # The centres of the light's cells, where it was sampled.
        here = (np.floor(places * size) + 0.5) / size
        found = np.asarray(reflected_radiance(light, brdf, here, directions))[:, 0]
        exact = [hemispherical_integral(material, p, d) for p, d in zip(here, directions)]
        errors.append(np.sqrt(np.mean((found / exact - 1) ** 2)))
    assert errors[1] < error
    assert errors[1] * gain < errors[0]


def test_a_white_surface_under_even_light_is_white():
    size = 8
    # The mean alone: selectors 1 to 15 have nothing.
    light = most_important(tree_of(haar(), np.ones((size, size, size, size, 1))), 0)
    everywhere = tree_of(haar(), np.full((1, 1, 1, 1, 1), 1 / 4))
    assert light.count == 1
    np.testing.assert_allclose(
        reflected_radiance(light, everywhere, PLACES, DIRECTIONS), 1, rtol=1e-12
    )
    np.testing.assert_allclose(traverse(light, everywhere, *PLACES[:2]).radiance, 1, rtol=1e-12)
    table = TabulatedBRDF.of(Lambertian(np.array([1 / np.pi])), 16, outside="zero")
    seen = reflected_radiance(light, tree_of(haar(), table.values), PLACES, np.full((1, 2), 0.5))
    # 208 of the 256 cells have their centre in the disc.
    np.testing.assert_allclose(seen, 208 / 256 * 4 / np.pi, rtol=1e-12)


def pairs_that_overlap(light, brdf, place, direction):
    """Count pairs of nodes by their boxes, all of both trees."""
    count = 0
    nodes = []
    for tree, fixed, axes in ((light, place, (0, 1)), (brdf, direction, (2, 3))):
        structure = tree.structure
        places = separated(structure.code, 4) / 2.0 ** structure.level[:, None]
        width = 1 / 2.0 ** structure.level[:, None]
        there = (places[:, axes] <= fixed) & (fixed < places[:, axes] + width)
        free = [axis for axis in range(4) if axis not in axes]
        nodes.append([(p[free], w) for p, w, t in zip(places, width, there) if t.all()])
    for (p, w), (q, x) in itertools.product(*nodes):
        count += np.all((p < q + x) & (q < p + w))
    return count


def test_only_pairs_whose_supports_overlap_are_visited():
    light = random_tree(haar(), 8, fraction=0.05)
    brdf = random_tree(haar(), 8, seed=1, fraction=0.05)
    for place, direction in zip(PLACES[:3], DIRECTIONS[:3]):
        visited = traverse(light, brdf, place, direction)
        assert visited.nodes == pairs_that_overlap(light, brdf, place, direction)
    whole = traverse(random_tree(haar(), 8), random_tree(haar(), 8, seed=1), *PLACES[:2])
    assert visited.coefficients < whole.coefficients / 10


def test_channels_multiply_and_one_serves_all():
    light, brdf = random_tree(haar(), 4, 3), random_tree(linear_spline(), 4, 3, seed=1)
    whole = np.asarray(reflected_radiance(light, brdf, PLACES, DIRECTIONS))
    for c in range(3):
        parts = [
            dataclasses.replace(t, root=t.root[c : c + 1], values=t.values[:, c : c + 1])
            for t in (light, brdf)
        ]
        alone = reflected_radiance(*parts, PLACES, DIRECTIONS)
        np.testing.assert_allclose(whole[:, c : c + 1], alone, atol=EXACT)
    grey = reflected_radiance(light, parts[1], PLACES, DIRECTIONS)
    assert grey.shape == (4, 3)
    np.testing.assert_allclose(grey[:, 2], whole[:, 2], atol=EXACT)
    nested = traverse(light, parts[1], PLACES[0], DIRECTIONS[0]).radiance
    np.testing.assert_allclose(nested, grey[0], atol=EXACT)
    once = reflected_cells(parts[0], brdf, DIRECTIONS[0])
    assert once.shape == (4, 4, 3)


def test_pieces_do_not_matter(monkeypatch):
    light, brdf = random_tree(haar(), 4), random_tree(linear_spline(), 4, seed=1)
    rng = np.random.default_rng(2)
    places, directions = rng.random((20, 2)), rng.random((20, 2))
    whole = reflected_radiance(light, brdf, places, directions)
    monkeypatch.setattr(shading, "_PAIRS_AT_ONCE", 1000)
    monkeypatch.setattr(shading, "_PROJECTED_AT_ONCE", 1000)
    monkeypatch.setattr(projections, "_PAIRS_AT_ONCE", 3000)
    np.testing.assert_allclose(
        reflected_radiance(light, brdf, places, directions), whole, atol=EXACT
    )


@pytest.mark.parametrize("directions", [DIRECTIONS, DIRECTIONS[:1]], ids=["many", "one"])
@pytest.mark.parametrize("moved", ["light", "brdf"])
def test_derivatives_are_those_of_a_linear_function(directions, moved):
    trees = {"light": random_tree(haar(), 4), "brdf": random_tree(linear_spline(), 4, seed=1)}
    tree = trees[moved]
    sight = np.random.default_rng(3).normal(size=(4, 2))

    def total(root, values):
        changed = {**trees, moved: dataclasses.replace(tree, root=root, values=values)}
        return (sight * reflected_radiance(**changed, places=PLACES, directions=directions)).sum()

    slopes = jax.grad(total, argnums=(0, 1))(tree.root, tree.values)
    other = random_tree(tree.wavelet, 4, seed=5)
    change = total(other.root, other.values)
    linear = (slopes[0] * other.root).sum() + (slopes[1] * other.values).sum()
    assert np.abs(change) > 0.01
    np.testing.assert_allclose(linear, change, atol=EXACT)


def single(tree):
    root, values = (np.asarray(part, np.float32) for part in (tree.root, tree.values))
    return dataclasses.replace(tree, root=root, values=values)


def test_single_precision_stays():
    light, brdf = random_tree(haar(), 4), random_tree(linear_spline(), 4, seed=1)
    for directions in (DIRECTIONS, DIRECTIONS[:1]):
        expected = reflected_radiance(light, brdf, PLACES, directions)
        found = reflected_radiance(single(light), single(brdf), PLACES, directions)
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_what_cannot_be_shaded_is_refused():
    light, brdf = random_tree(haar(), 2), random_tree(haar(), 2, seed=1)
    flat = CoefficientTree.of_coefficients(haar(), np.ones((4, 4, 2)))
    wrong = [
        (random_tree(linear_spline(), 2), brdf, "radiance is in cdf-2-2"),
        (flat, brdf, "radiance has 2 axes"),
        (light, flat, "BRDF has 2 axes"),
        (light, random_tree(haar(), 2, 3), "2 channels of radiance and 3"),
    ]
    for first, second, message in wrong:
        with pytest.raises(ValueError, match=message):
            reflected_radiance(first, second, PLACES, DIRECTIONS)
        with pytest.raises(ValueError, match=message):
            traverse(first, second, PLACES[0], DIRECTIONS[0])
        with pytest.raises(ValueError, match=message):
            reflected_cells(first, second, DIRECTIONS[0])
    with pytest.raises(ValueError, match="3 directions and 4 places"):
        reflected_radiance(light, brdf, PLACES, DIRECTIONS[:3])
    view = PlaneView(np.ones((2, 2), bool), PLACES, DIRECTIONS)
    with pytest.raises(ValueError, match="2 BRDFs and no texture"):
        shade_plane(light, [brdf, brdf], view)
    with pytest.raises(ValueError, match=r"texel \(0, 1\) has BRDF 2"):
        shade_plane(light, [brdf, brdf], view, np.array([[0, 2]]))
    with pytest.raises(ValueError, match="not parallel"):
        Plane(np.zeros(3), np.ones(3), np.ones(3))
