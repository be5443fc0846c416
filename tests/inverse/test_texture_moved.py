"""What a texture's pixels show once they are moved: other sites, and paint beside their own.

- Places are told the sites that the pixels of a view are told: on a sphere, and on a mesh with
  texture coordinates or without; beside the surface there is none.
- Paint that is linear in space has the slopes of a plane along the surface; at an edge of two
  paints it has none, and neither has what was not seen.
- What a pixel sends beyond its site is its derivative by place times how far it lies aside.
"""

import numpy as np
import pytest
from texture_problems import cameras

from jaxrender.geometry import Mesh, Sphere, SurfacePlaces, observe, sculpture
from jaxrender.geometry.texels import surface_sites
from jaxrender.inverse.models import Columns
from jaxrender.inverse.texture import SurfaceSites
from jaxrender.inverse.texture.paint_slopes import PaintSlopes
from jaxrender.inverse.texture.sites import Regions
from jaxrender.inverse.texture.texture import Texture

SCULPTURE = sculpture(3)
PLAIN = Mesh(SCULPTURE.vertices, SCULPTURE.faces)


def sites_on(shape, image, count):
    regions = Regions(np.zeros(count, int), ("",))
    return SurfaceSites(np.zeros(0, int), count, image, shape, np.full((count, 3), np.nan), regions)


@pytest.mark.parametrize(
    ("shape", "image"),
    [(Sphere(np.array([0.1, 0.0, -0.2]), 0.8), (12, 24)), (SCULPTURE, (16, 16)), (PLAIN, None)],
    ids=["sphere", "texels", "vertices"],
)
def test_places_have_the_sites_that_views_tell(shape, image):
    view = observe(cameras(1, 40)[0], shape)
    told = surface_sites(shape, view, image or (1, 1))
    sites = sites_on(shape, image, told.count)
    np.testing.assert_array_equal(sites.of_view(view), told.of_pixel)
    places = SurfacePlaces(view.points[view.hit], view.geometric_normals[view.hit])
    found = sites.showing(places)
    # At an edge of two faces, rounding decides.
    assert np.mean(found == told.of_pixel[view.hit]) > 0.995
    if isinstance(shape, Mesh):
        above = places._replace(points=places.points + 0.3 * places.geometric_normals)
        assert np.all(sites.showing(above) == -1)


def painted(kd, ks):
    nothing = np.zeros(len(ks))
    marks = nothing.astype(bool)
    return Texture(
        kd, ks, kd, ks, nothing, np.where(np.isfinite(ks), 9, 0), marks, marks, kd, ks, 0.0
    )


@pytest.fixture(scope="module")
def places():
    """Sites of a part of the unit sphere, about as far from each other as texels are."""
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, 21), np.linspace(-0.5, 0.5, 21))
    level = np.cos(v)
    return np.stack([level * np.cos(u), level * np.sin(u), np.sin(v)], axis=-1).reshape(-1, 3)


def test_linear_paint_has_the_slopes_of_a_plane(places):
    by_place = np.array([[0.05, 0.1, -0.08], [0.0, -0.06, 0.04], [0.02, 0.0, 0.1]])
    kd, ks = 0.2 + places @ by_place.T, 0.1 + places @ np.array([0.0, 0.05, 0.0])
    chosen = np.flatnonzero(np.abs(places[:, 1:]).max(axis=1) < 0.4)
    slopes = PaintSlopes.of(painted(kd, ks), places, chosen)
    normals = places[chosen]

    def along(vector):
        return vector - np.sum(normals * vector, axis=1, keepdims=True) * normals

    for channel in range(3):
        expected = along(by_place[channel][None])
        np.testing.assert_allclose(slopes.kd[:, channel], expected, atol=0.006)
    np.testing.assert_allclose(slopes.ks[:, 0], along(np.array([[0.0, 0.05, 0.0]])), atol=0.003)


def test_paint_has_no_slope_at_an_edge_nor_where_it_is_not_known(places):
    kd = np.where(places[:, 1:2] > 0.02, 0.3, 0.1) * np.ones(3)
    ks = np.full(len(places), 0.1)
    kd[5], ks[5] = np.nan, np.nan
    beside = np.flatnonzero(np.abs(places[:, 1]) < 0.05)
    slopes = PaintSlopes.of(painted(kd, ks), places, np.append(beside, 6))
    # A plane through both sides would rise by .2 in three texels.
    assert np.abs(slopes.kd).max() < 0.25 * 0.2 / 0.15
    assert np.all(slopes.ks == 0)
    assert np.all(slopes.kd[-1] == 0)


def test_pixels_send_what_lies_beside_their_sites(places):
    kd, ks = 0.2 + places[:, 1:2] * np.array([0.1, 0.05, 0.0]), 0.1 + 0.2 * places[:, 2]
    slopes = PaintSlopes.of(painted(kd, ks), places, np.arange(len(places)))
    rng = np.random.default_rng(0)
    diffuse, specular = rng.uniform(0.5, 1, (2, len(places), 3))
    site, aside = np.arange(len(places)), 0.01 * rng.normal(size=places.shape)
    aside -= np.sum(aside * places, axis=1, keepdims=True) * places
    found = slopes.beside(Columns(diffuse, specular), site, places + aside)
    expected = diffuse * aside[:, 1:2] * np.array([0.1, 0.05, 0.0])
    expected += specular * 0.2 * aside[:, 2:]
    inner = np.abs(places[:, 1:]).max(axis=1) < 0.4
    np.testing.assert_allclose(found[inner], expected[inner], atol=3e-4)
