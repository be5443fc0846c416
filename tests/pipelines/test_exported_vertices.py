"""Textures of vertices that leave for programs which take textures of texels.

- GLB, read by trimesh, and USD, read by its own library, have the colour of the nearest vertex at
  places of the surface but for the part that the README states; metal, too, and for Mitsuba.
- What is lost is refused without ``--lossy``; a mesh with coordinates keeps its own.
"""

import io
import re

import numpy as np
import pytest
import trimesh
from PIL import Image
from stated_textures import metal_maps, smooth_maps, write_metal_result, write_result

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Sphere
from jaxrender.geometry.texels import splat, vertex_sites
from jaxrender.io.exports import mesh_of
from jaxrender.pipelines.exporting import export

BALL = Mesh.icosphere(3)


def noisy(maps, name):
    random = np.random.default_rng(0)
    values = getattr(maps, name)
    return maps._replace(**{name: values * random.uniform(0.3, 1, (len(values), 1))})


@pytest.fixture(scope="module")
def painted(tmp_path_factory):
    """K_d from vertex to vertex as noise has it; the rest is smooth."""
    maps = noisy(smooth_maps(BALL.vertices, 3, True), "kd")
    folder = tmp_path_factory.mktemp("painted") / "cat"
    return maps, write_result(folder, maps, BALL)


def places(mesh, count=20_000):
    random = np.random.default_rng(3)
    face = random.integers(0, len(mesh.faces), count)
    return face, random.dirichlet(np.ones(3), count)


def linear(picture):
    codes = np.asarray(picture, float)[..., :3] / 255
    return np.where(codes > 0.04045, ((codes + 0.055) / 1.055) ** 2.4, codes / 12.92)


def looked_up(image, coordinates):
    about = splat(coordinates, image.shape[:2])
    flat = image.reshape(-1, image.shape[-1])
    return np.einsum("sk,skc->sc", about.share, flat[about.site])


def off(found, exact):
    """The mean difference of colours that are known but for one factor of a channel."""
    found = found * (exact.mean(axis=0) / found.mean(axis=0))
    return np.abs(found - exact).mean() / exact.mean()


def stated(folder):
    text = " ".join((folder / "README.txt").read_text().split())
    return float(re.search(r"which changes \w+ by ([0-9.]+) %", text).group(1)) / 100


def of_glb(folder, face, weights):
    """What trimesh reads at places of the surface: base colour, roughness, metalness, and where."""
    (mesh,) = trimesh.load_scene(folder / "scene.glb", process=False).geometry.values()
    assert len(mesh.faces) == len(BALL.faces)
    own = mesh.faces[face]
    where = np.einsum("sk,ski->si", weights, mesh.vertices[own])
    coordinates = np.einsum("sk,ski->si", weights, mesh.visual.uv[own])
    material = mesh.visual.material
    color = looked_up(linear(material.baseColorTexture), coordinates)
    rough = np.asarray(material.metallicRoughnessTexture, float)[..., :3] / 255
    return color, looked_up(rough, coordinates)[:, 1:], where


def test_glb_has_the_nearest_vertex(painted):
    maps, result = painted
    with pytest.raises(InputError, match=r"would lose that sites are vertices.*normals of single"):
        export(result, "glb")
    done = export(result, "glb", lossy=True)
    face, weights = places(BALL)
    color, rough, where = of_glb(done.folder, face, weights)
    own = np.einsum("sk,ski->si", weights, BALL.vertices[BALL.faces[face]])
    np.testing.assert_allclose(where, own @ [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-6)
    vertex = vertex_sites(BALL, face, weights)
    apart = off(color, maps.kd[vertex])
    assert 0.01 < apart < 0.08
    # Places are as many on each face here; steps of 8 bits come on top.
    assert apart == pytest.approx(stated(done.folder), rel=0.25)
    ratio = rough[:, 0] / np.sqrt(maps.widths[vertex])
    assert np.std(ratio) < 0.02 * np.mean(ratio)


def test_usd_has_the_nearest_vertex(painted):
    pytest.importorskip("pxr", reason="needs the extra usd: pip install 'jaxrender[usd]'")
    from pxr import Usd, UsdGeom, UsdValidation

    maps, result = painted
    done = export(result, "usd", lossy=True)
    stage = Usd.Stage.Open(str(done.folder / "scene.usdc"))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert not UsdValidation.ValidationContext(validators).Validate(stage)
    (prim,) = [one for one in stage.Traverse() if one.IsA(UsdGeom.Mesh)]
    st = UsdGeom.PrimvarsAPI(prim).GetPrimvar("st")
    pairs = np.array(st.ComputeFlattened(), float).reshape(-1, 3, 2)
    face, weights = places(BALL)
    picture = linear(Image.open(io.BytesIO((done.folder / "base_color.png").read_bytes())))
    color = looked_up(picture, np.einsum("sk,ski->si", weights, pairs[face]))
    apart = off(color, maps.kd[vertex_sites(BALL, face, weights)])
    assert apart == pytest.approx(stated(done.folder), rel=0.25)


def test_metal_of_vertices_leaves(tmp_path):
    maps = noisy(metal_maps(BALL.vertices), "base_color")
    metallic = (BALL.vertices[:, 1] > 0) * 1.0
    result = write_metal_result(tmp_path / "cat", maps._replace(metallic=metallic), BALL)
    done = export(result, "glb", lossy=True)
    face, weights = places(BALL)
    color, rough, _ = of_glb(done.folder, face, weights)
    vertex = vertex_sites(BALL, face, weights)
    assert off(color, maps.base_color[vertex]) == pytest.approx(stated(done.folder), rel=0.25)
    assert np.abs(rough[:, 0] - maps.roughness[vertex]).mean() < 0.005
    assert np.abs(rough[:, 1] - metallic[vertex]).mean() < 0.01


@pytest.mark.slow
def test_metal_of_vertices_leaves_for_mitsuba(tmp_path):
    result = write_metal_result(tmp_path / "cat", metal_maps(BALL.vertices), BALL)
    done = export(result, "mitsuba", lossy=True)
    assert {"metal.exr", "base_color.exr"} <= {one.name for one in done.folder.iterdir()}


def test_a_mesh_with_coordinates_keeps_them(tmp_path):
    globe = mesh_of(Sphere(), textured=True)
    rows = smooth_maps(np.ones((8, 16, 3)) + np.arange(16)[:, None])
    done = export(write_result(tmp_path / "cat", rows, globe), "glb", lossy=True)
    (mesh,) = trimesh.load_scene(done.folder / "scene.glb", process=False).geometry.values()
    assert mesh.visual.material.baseColorTexture.size == (16, 8)
    assert "sites are vertices" not in (done.folder / "README.txt").read_text()
