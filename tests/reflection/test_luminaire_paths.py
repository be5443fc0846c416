"""A tree's directions and a luminaire's places, joined along paths by the balance heuristic.

- A glossy table under a luminaire near by: with directions from the BRDF's tree, from the cosine,
  and with the luminaire drawn or only met, paths have the mean of the area integral; nothing counts
  twice (both ways unweighted would double it), neither frame is taken for the other (ERRATA 69).
- Drawing directions from the tree leaves less noise than the cosine where only they find the
  luminaire.
- A ray from the camera sees the luminaire, unless something is in between.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxrender.brdf import COSINE, Phong, TabulatedBRDF, TreeSampler, WaveletBRDF
from jaxrender.geometry import Mesh
from jaxrender.lighting.luminaires import Luminaire, Rectangle
from jaxrender.reflection.tracing import (
    LuminaireEmitter,
    PathSettings,
    Scene,
    ShadedPoints,
    direct_light,
    gauss_rule,
    path_radiance,
)
from jaxrender.wavelets import CoefficientTree, analyse_nonstandard, haar, keep_fraction

TABLE_TOP = Mesh(
    np.array([[-2.0, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
)
# Shines downwards: u x v = -z.
LUMINAIRE = Rectangle(np.array([0.2, -0.5, 0.8]), np.array([0.0, 1, 0]), np.array([0.8, 0, 0]))
# In the plane of incidence of its own azimuth the local x axis is the world's.
TANGENTS = np.tile([1.0, 0, 0], (2, 1))


class OnlyMet(LuminaireEmitter):
    """Never drawn, so that directions alone find it."""

    def draw(self, points, uniforms):
        drawn = super().draw(points, uniforms)
        return drawn._replace(irradiance=0 * drawn.irradiance, density=0 * drawn.density)

    def density(self, origins, directions):
        return np.zeros(len(origins))


@pytest.fixture(scope="module")
def tree():
    phong = Phong(np.array([0.05]), np.array([0.2]), 20.0)
    table = TabulatedBRDF.of(phong, 16, outside="zero").values
    kept = keep_fraction(analyse_nonstandard(haar(), jnp.asarray(table)), 0.2, joint=True)
    return CoefficientTree.of_coefficients(haar(), kept.coefficients)


def camera_rays(count=24):
    rng = np.random.default_rng(5)
    places = np.concatenate([rng.uniform(-1, 0.5, (count, 2)), np.zeros((count, 1))], axis=1)
    towards = np.array([-1.2, 0.3, 1.0]) / np.linalg.norm([-1.2, 0.3, 1.0])
    return places, towards


def test_paths_have_the_mean_of_the_integral(tree):
    brdf, light = WaveletBRDF(tree), Luminaire.uniform([LUMINAIRE], np.array([2.0]))
    places, towards = camera_rays()
    normals, outgoing = np.tile([0.0, 0, 1], (len(places), 1)), np.tile(towards, (len(places), 1))
    shaded = ShadedPoints.of(places, normals, outgoing)
    expected = np.asarray(direct_light(shaded, brdf, light, gauss_rule(64)))
    noise = {}
    for name, sampler, emitter in (
        ("tree", TreeSampler.of(tree), LuminaireEmitter(light)),
        ("cosine", COSINE, LuminaireEmitter(light)),
        ("tree alone", TreeSampler.of(tree), OnlyMet(light)),
        ("cosine alone", COSINE, OnlyMet(light)),
    ):
        scene = Scene.of(TABLE_TOP, [brdf], tangents=TANGENTS, samplers=[sampler])
        settings = PathSettings(256, 1, seed=3)
        found = path_radiance(scene, [emitter], places + 3 * towards, -outgoing, settings)
        pulls = (found.radiance - expected) / np.maximum(found.standard_error, 1e-6)
        assert abs(pulls.mean()) < 4 / np.sqrt(pulls.size)
        assert np.sqrt(np.mean(pulls**2)) < 1.8
        noise[name] = np.sqrt(np.mean(found.standard_error**2))
    assert noise["tree alone"] < 0.7 * noise["cosine alone"]
    assert noise["tree"] < noise["tree alone"]


def test_the_camera_sees_the_luminaire(tree):
    light = LuminaireEmitter(Luminaire.uniform([LUMINAIRE], np.array([2.0])))
    scene = Scene.of(TABLE_TOP, [WaveletBRDF(tree)], tangents=TANGENTS)
    origins = np.array([[0.5, 0, 0.3], [0.5, 0, -1.0], [-3, 0, 0.3]])
    up = np.tile([0.0, 0, 1], (3, 1))
    found = path_radiance(scene, [light], origins, up, PathSettings(2, 1)).radiance[:, 0]
    np.testing.assert_allclose(found, [2, 0, 0])
