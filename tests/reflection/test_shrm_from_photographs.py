"""Photographs of a sphere give its reflection map, and what they lack is refused."""

import numpy as np
import pytest
from shrm_problems import any_spectrum, random_light

from jaxrender.geometry import Orthographic, Sphere, SurfaceSamples, look_at, observe
from jaxrender.harmonics import LatLongGrid
from jaxrender.reflection import ViewerGoal, global_shrm, local_shrm, shrm_from_photographs
from jaxrender.reflection.shrm import icosahedron_vertices


@pytest.mark.slow
def test_photographs_of_a_sphere_give_its_map():
    rng = np.random.default_rng(6)
    light, spectrum = random_light(rng, 3), any_spectrum(rng, (3, 1))
    sphere, cameras, photographs = Sphere(np.zeros(3), 1.0), [], []
    truth = global_shrm(local_shrm(light, spectrum, LatLongGrid(120, 240)))
    for viewer in icosahedron_vertices():
        up = np.array([0.0, 0.0, 1.0]) if abs(viewer[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        pose = look_at(4 * viewer, np.zeros(3), up)
        camera = Orthographic(160, 160, pose, scale=2.1 / 160)
        view = observe(camera, sphere)
        samples = SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])
        image = np.zeros((160, 160, 3))
        image[view.hit] = np.asarray(truth.at(samples.reflected, samples.outgoing))
        cameras.append(camera)
        photographs.append(image * (1 + 0.005 * rng.standard_normal(image.shape)))
    grid = LatLongGrid(16, 32)
    fit = shrm_from_photographs(cameras, photographs, sphere, grid, ViewerGoal(1))
    assert fit.relative_rms < 0.01
    expected = np.asarray(global_shrm(local_shrm(light, spectrum, grid)).maps)
    assert (
        np.sqrt(np.mean((np.asarray(fit.shrm.maps) - expected) ** 2))
        < 0.01 * np.abs(expected).max()
    )
    with pytest.raises(ValueError, match="central directions are in no photograph"):
        shrm_from_photographs(cameras[:1], photographs[:1], sphere, grid, ViewerGoal(1))
    with pytest.raises(ValueError, match="12 cameras and 11 photographs"):
        shrm_from_photographs(cameras, photographs[1:], sphere, grid, ViewerGoal(1))
