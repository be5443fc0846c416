"""Basis images of diffuse objects and the principal components of a view.

- A picture under any light is its basis images mixed by the light's coefficients.
- From photographs the basis images come back, texture included, without any geometry; their noise
  is as the condition says; too few photographs or lights that repeat themselves are refused.
- The principal components are those of many pictures under single sources, found by SVD.
- On the whole sphere they are the harmonics; on the visible half they mix.
"""

import numpy as np
import pytest
from reflection_problems import unit_vectors

from jaxrender.reflection import (
    basis_from_photographs,
    basis_images,
    irradiance,
    principal_components,
    relit,
)

ROUNDING = 1e-11


def front(count, seed=0):
    normals = unit_vectors(count, seed)
    return normals * np.sign(normals[:, 2:])


def diffuse_scene(photographs=12, pixels=40):
    rng = np.random.default_rng(3)
    normals, albedo = front(pixels, 1), rng.uniform(0.2, 0.9, (pixels, 3))
    lights = rng.normal(size=(photographs, 9, 3))
    lights[:, 0] += 3
    pictures = np.stack([albedo * np.asarray(irradiance(light, normals)) for light in lights])
    return normals, albedo, lights, pictures


def test_a_picture_is_its_basis_images_mixed():
    normals, albedo, lights, pictures = diffuse_scene(1)
    images = basis_images(normals)[..., None] * albedo[None]
    np.testing.assert_allclose(relit(images, lights[0]), pictures[0], atol=ROUNDING)


def test_basis_images_come_back_from_photographs():
    normals, albedo, lights, pictures = diffuse_scene()
    found = basis_from_photographs(pictures, lights)
    expected = basis_images(normals)[..., None] * albedo[None]
    np.testing.assert_allclose(found.images, expected, atol=ROUNDING)
    new = np.random.default_rng(8).normal(size=(9, 3))
    by_geometry = albedo * np.asarray(irradiance(new, normals))
    np.testing.assert_allclose(relit(found.images, new), by_geometry, atol=1e-10)


def test_noise_grows_by_the_condition_at_most():
    _, _, lights, pictures = diffuse_scene(30)
    noise = 1e-3 * np.random.default_rng(5).normal(size=pictures.shape)
    clean, noisy = (basis_from_photographs(p, lights) for p in (pictures, pictures + noise))
    assert clean.condition == pytest.approx(
        max(np.linalg.cond(lights[..., channel]) for channel in range(3))
    )
    moved = np.linalg.norm(noisy.images - clean.images) / np.linalg.norm(clean.images)
    assert 0 < moved < clean.condition * np.linalg.norm(noise) / np.linalg.norm(pictures)


def test_photographs_that_cannot_tell():
    _, _, lights, pictures = diffuse_scene()
    with pytest.raises(ValueError, match="8 photographs cannot tell 9"):
        basis_from_photographs(pictures[:8], lights[:8])
    with pytest.raises(ValueError, match="12 photographs and 11 lights"):
        basis_from_photographs(pictures, lights[:11])
    same = np.concatenate([lights[:8], lights[:4]])
    with pytest.raises(ValueError, match="channel 0 are mixtures of 8 lights"):
        basis_from_photographs(pictures, same)


@pytest.mark.parametrize("about_mean", [False, True])
def test_components_are_those_of_many_pictures(about_mean):
    """SVD of exact pictures (clamped cosines) under 3,000 sources spread over the sphere."""
    normals = front(400, 2)
    k = np.arange(3000) + 0.5
    heights, azimuths = 1 - 2 * k / 3000, k * np.pi * (1 + 5**0.5)
    radii = np.sqrt(1 - heights**2)
    sources = np.stack([radii * np.cos(azimuths), radii * np.sin(azimuths), heights], axis=1)
    pictures = np.maximum(sources @ normals.T, 0)
    if about_mean:
        pictures = pictures - pictures.mean(axis=0)
    _, sizes, vectors = np.linalg.svd(pictures, full_matrices=False)
    expected = sizes**2 / np.sum(sizes**2)
    found = principal_components(normals, 12, about_mean)
    np.testing.assert_allclose(found.fractions[:6], expected[:6], atol=2e-3)
    first = found.images(normals)[0]
    cosine = abs(first @ vectors[0]) / np.linalg.norm(first)
    assert cosine == pytest.approx(1, abs=1e-3)


def test_on_the_whole_sphere_they_are_the_harmonics():
    k = np.arange(20000) + 0.5
    heights, azimuths = 1 - 2 * k / 20000, k * np.pi * (1 + 5**0.5)
    radii = np.sqrt(1 - heights**2)
    normals = np.stack([radii * np.cos(azimuths), radii * np.sin(azimuths), heights], axis=1)
    found = principal_components(normals)
    transfer = np.array([np.pi, *[2 * np.pi / 3] * 3, *[np.pi / 4] * 5])
    np.testing.assert_allclose(found.fractions, transfer**2 / np.sum(transfer**2), rtol=1e-3)


def test_images_are_orthonormal_over_the_view():
    normals = front(500, 4)
    images = principal_components(normals).images(normals)
    np.testing.assert_allclose(images @ images.T / 500, np.eye(9), atol=1e-9)
