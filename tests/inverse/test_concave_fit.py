"""A BRDF from photographs of a concave object under known light.

Pinned down: from data of the exact integral, its visibility that of tests of every triangle, the
frequency fit and the refined one recover the material, and without shadows they do not; so they do
under sources of single photographs; the table with shadows is T 6.12; masks stay with their samples
when some are drawn; a convex shape changes nothing; samples without places are refused.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import SOURCES, material, microfacet_unknowns, parameter_vector, unit

from jaxrender import reflection
from jaxrender.geometry import (
    Mesh,
    SurfacePlaces,
    SurfaceSamples,
    fibonacci_sphere,
    sculpture,
    visible,
    visible_along,
)
from jaxrender.inverse import (
    FitSettings,
    KnownLight,
    Observations,
    fit_brdf,
    variants,
)
from jaxrender.inverse.models import ExactModel
from jaxrender.inverse.passes import values_of
from jaxrender.inverse.shadowing import hidden_fraction, nodes_seen, shadows_of, with_transfer
from jaxrender.inverse.variants import fit_variants
from jaxrender.lighting import DirectionalSources, LightNodes, SmoothLobes
from jaxrender.reflection import (
    DualLight,
    FrameNodes,
    cast_shadows,
    integral_columns,
    integral_columns_by_frame,
    radiance,
    roughness_table,
)

dual_columns = eqx.filter_jit(reflection.dual_columns)
STATUE = sculpture(3, seed=1)
BRDF = material()
TRUTH = np.array([*BRDF.kd, BRDF.ks[0], 0.16, 1.62])
COUNT, VIEWS, NODES = 320, 3, 3000
LOBE = SmoothLobes(
    unit(np.array([[1.0, 0.3, 0.8]])), np.radians([22.0]), np.array([[3.0, 2.8, 2.4]])
)
KNOWN = KnownLight(LOBE.to_environment(64), SOURCES)
# kd of three channels, ks, sigma, mu: what 64 rows, a lobe in 3000 nodes and few samples leave.
REFINED = np.array([0.01, 0.01, 0.01, 0.015, 0.01, 0.02])
FREQUENCY = np.array([0.02, 0.02, 0.02, 0.03, 0.02, 0.04])
UNKNOWNS = microfacet_unknowns()
SETTINGS = FitSettings(starts=3)


def drawn(seed=0):
    """Samples of the statue's faces that face one of the views."""
    rng = np.random.default_rng(seed)
    azimuth = 2 * np.pi * np.arange(VIEWS) / VIEWS
    views = unit(np.stack([np.cos(azimuth), np.sin(azimuth), np.full(VIEWS, 0.3)], axis=-1))
    face = rng.integers(len(STATUE.faces), size=8 * COUNT)
    weights = rng.dirichlet(np.ones(3), len(face))
    frame = np.arange(len(face)) % VIEWS
    normals = unit(np.einsum("pk,pki->pi", weights, STATUE.normals[STATUE.faces[face]]))
    places = SurfacePlaces.on_faces(STATUE, face, weights)
    cosines = np.einsum("pi,pi->p", normals, views[frame])
    flat = np.einsum("pi,pi->p", places.geometric_normals, views[frame])
    kept = np.flatnonzero((cosines > 0.2) & (flat > 0.1))[:COUNT]
    places = SurfacePlaces(*(a[kept] for a in places))
    return SurfaceSamples(normals[kept], views[frame[kept]]), frame[kept], places


SAMPLES, FRAME, PLACES = drawn()
ARRAYS = SurfaceSamples(*(jnp.asarray(a) for a in SAMPLES))


def brute_force_sees(chosen, directions):
    """Test every triangle, for the chosen samples and all directions."""
    points, normals = (a[chosen] for a in PLACES)
    seen = normals @ directions.T > 0
    place, direction = np.nonzero(seen)
    origins = points + 1e-4 * STATUE.diagonal() * normals
    seen[seen] = ~STATUE.occluded_brute_force(origins[place], directions[direction])
    return seen


@pytest.fixture(scope="module")
def photographs():
    """The integral over a lobe, at the nodes of no image, and two sources."""
    directions = fibonacci_sphere(NODES)
    light = 4 * np.pi / NODES * np.asarray(LOBE.radiance(directions))
    lit = light.max(axis=1) > 1e-4 * light.max()
    nodes = LightNodes(
        np.concatenate([directions[lit], SOURCES.directions]),
        np.concatenate([light[lit], SOURCES.irradiance]),
    )
    seen = visible(STATUE, PLACES, nodes.directions)
    # All of them would take minutes.
    chosen = np.arange(0, COUNT, 40)
    np.testing.assert_array_equal(seen[chosen], brute_force_sees(chosen, nodes.directions))
    columns = integral_columns(BRDF, ARRAYS, nodes, seen)
    return Observations(SAMPLES, np.asarray(radiance(BRDF, columns)), FRAME, PLACES)


@pytest.fixture(scope="module")
def fitted(photographs):
    return fit_brdf(photographs, KNOWN, UNKNOWNS, BRDF, SETTINGS, shape=STATUE)


def errors(stop):
    return np.abs(parameter_vector(values_of(stop)) / TRUTH - 1)


@pytest.mark.slow
def test_the_material_is_recovered(fitted):
    assert fitted.exact is not None
    assert np.all(errors(fitted.exact) < REFINED), errors(fitted.exact)
    assert np.all(errors(fitted.frequency) < FREQUENCY), errors(fitted.frequency)


@pytest.mark.slow
def test_without_shadows_it_is_not(photographs, fitted):
    blind = fit_brdf(photographs, KNOWN, UNKNOWNS, BRDF, SETTINGS._replace(refine=False))
    assert hidden_fraction(fitted.frequency.observations.transfer) > 0.03
    assert np.any(errors(blind.final) > 3 * FREQUENCY)
    assert blind.final.relative_rms > 5 * fitted.frequency.relative_rms


@pytest.mark.slow
def test_variants_keep_the_shadows(fitted, monkeypatch):
    """Without them kd would be off as that of a blind fit is."""
    monkeypatch.setattr(variants, "_others", lambda _: [material(fresnel="half")])
    (half,) = fit_variants(fitted, KNOWN, SETTINGS, STATUE)
    assert np.all(np.abs(half.parameters.kd / TRUTH[:3] - 1) < 0.02)


@pytest.mark.slow
def test_sources_of_single_photographs(photographs):
    """No environment: every photograph has a source of its own, hidden from some samples."""
    towards = unit(np.array([[0.9, 0.4, 0.7], [-0.5, 0.8, 0.6], [0.1, -1.0, 0.5]]))
    frames = FrameNodes(towards[:, None], np.full((VIEWS, 1, 3), 2.0), FRAME)
    every = brute_force_sees(np.arange(COUNT), towards)
    seen = np.take_along_axis(every, FRAME[:, None], axis=1)
    assert 0.05 < 1 - seen.mean() < 0.7
    columns = integral_columns_by_frame(BRDF, ARRAYS, frames, seen)
    shots = photographs._replace(radiance=np.asarray(radiance(BRDF, columns)))
    sources = tuple(DirectionalSources(d[None], np.full((1, 3), 2.0)) for d in towards)
    light = KnownLight(None, DirectionalSources.none(), sources)
    found = fit_brdf(shots, light, UNKNOWNS, BRDF, SETTINGS, shape=STATUE)
    # Nothing is approximated here but the table, to 1e-4 of the lobe's peak; one source a
    # photograph says little about mu.
    assert found.exact is not None
    assert np.all(errors(found.frequency) < [1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 2e-2])
    assert np.all(errors(found.exact) < [1e-5, 1e-5, 1e-5, 1e-3, 1e-3, 5e-3])


def test_the_table_is_t_6_12():
    rng = np.random.default_rng(3)
    light = DualLight(rng.normal(size=(49, 3)), SOURCES)
    shadows = cast_shadows(STATUE, PLACES, SAMPLES, light, rng.normal(size=(COUNT, 81)))
    assert 0.02 < 1 - shadows.reflected.mean() < 0.5
    table = roughness_table(BRDF, SAMPLES, light, (0.1, 0.3), shadows=shadows)
    expected = np.asarray(dual_columns(BRDF, ARRAYS, light, shadows=shadows))
    specular = np.asarray(table.specular(jnp.asarray(0.16), jnp.asarray(1.62)))
    np.testing.assert_allclose(table.diffuse, expected[:, 0], rtol=1e-10, atol=1e-12)
    assert np.abs(specular - expected[:, 1]).max() < 1e-4 * np.abs(expected[:, 1]).max()


def test_samples_that_moved_get_new_transfer_vectors(photographs):
    slow = np.zeros((16, 3))
    known = with_transfer(photographs, STATUE, 3)
    assert photographs.transfer is None
    again = shadows_of(STATUE, photographs, DualLight(slow, SOURCES))
    np.testing.assert_array_equal(again.transfer, known.transfer)


@pytest.mark.slow
def test_an_object_that_may_have_moved(photographs):
    """The fit ends with other samples than it began with, and states its errors of these."""
    # Of the samples some lie behind other parts, where no ray of a camera meets them.
    seen = np.flatnonzero(visible_along(STATUE, PLACES, np.asarray(SAMPLES.outgoing)))
    assert len(seen) > 0.8 * COUNT
    told = photographs.take(seen)
    pixel = np.stack([np.arange(len(seen)), np.zeros(len(seen), int)], axis=-1)
    settings = SETTINGS._replace(free=("object",), diagnose=False)
    fit = fit_brdf(told._replace(pixel=pixel), KNOWN, UNKNOWNS, BRDF, settings, shape=STATUE)
    assert fit.final.observations.transfer is None
    assert np.all(errors(fit.final) < REFINED), errors(fit.final)


def test_masks_stay_with_their_samples(photographs):
    chosen = np.array([5, 17, 200, 201])
    whole = with_transfer(photographs, STATUE, 2)
    some = whole.take(chosen)
    assert whole.transfer is not None
    assert some.places is not None
    np.testing.assert_array_equal(some.places.points, PLACES.points[chosen])
    np.testing.assert_array_equal(np.asarray(some.transfer), whole.transfer[chosen])
    nodes = (SOURCES.nodes(),)
    seen, few = (np.asarray(nodes_seen(STATUE, o, nodes))[0] for o in (whole, some))
    np.testing.assert_array_equal(few, seen[chosen])
    model = ExactModel(BRDF, ARRAYS, nodes, (seen,))
    numbers = {"sigma": jnp.asarray(0.16), "mu": jnp.asarray(1.62)}
    thinned = model.take(slice(None, None, 3)).columns(numbers)
    for kept, every in zip(thinned, model.columns(numbers)):
        np.testing.assert_allclose(kept, every[::3], rtol=1e-12)
    by_hand = np.asarray(integral_columns(BRDF, ARRAYS, nodes[0], seen))
    np.testing.assert_allclose(model.columns(numbers).diffuse, by_hand[:, 0], rtol=1e-12)


@pytest.mark.slow
def test_a_convex_shape_changes_nothing(photographs):
    light = KnownLight(None, SOURCES)
    nowhere = photographs._replace(places=None)
    with_shape, without = (
        fit_brdf(nowhere, light, UNKNOWNS, BRDF, SETTINGS._replace(refine=False), shape=shape)
        for shape in (Mesh.icosphere(2), None)
    )
    assert with_shape.frequency.observations.transfer is None
    np.testing.assert_array_equal(
        parameter_vector(values_of(with_shape.final)), parameter_vector(values_of(without.final))
    )


def test_a_concave_shape_needs_places(photographs):
    with pytest.raises(ValueError, match="give observations"):
        fit_brdf(photographs._replace(places=None), KNOWN, UNKNOWNS, BRDF, SETTINGS, shape=STATUE)
