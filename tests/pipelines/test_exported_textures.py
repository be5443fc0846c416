"""Textures that leave for Mitsuba, which renders them against our own pictures of the results.

- K_d, K_s, a coloured K_s, a sigma and a normal of every texel, on a sphere and on a mesh's own
  texture coordinates: the mean relative difference of blocks of pixels is under .5 %.
- Maps of metal: a base colour, metalness and roughness of every texel, the same.
- Vertices: what the README says is lost is what is measured, within 20 %.
- What is lost is refused without ``--lossy``, and the README names every file.
"""

import re
import runpy

import numpy as np
import pytest
from stated_textures import (
    SIZE,
    SKY,
    metal_maps,
    smooth_maps,
    texel_places,
    write_metal_result,
    write_result,
)

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh, Sphere
from jaxrender.io import read_image
from jaxrender.io.exports import mesh_of
from jaxrender.pipelines.exporting import export
from jaxrender.pipelines.render import render_config

BLOCK = 6


@pytest.fixture(scope="module")
def mitsuba():
    found = pytest.importorskip("mitsuba")
    found.set_variant("scalar_rgb")
    return found


def egg():
    """A mesh with the texture coordinates of a sphere, not the sphere's normals."""
    globe = mesh_of(Sphere(), textured=True)
    stretch = np.array([1.1, 0.8, 0.9])
    normals = globe.normals / stretch
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(globe.vertices * stretch, globe.faces, normals, globe.texture_coordinates)


def blocks(image):
    cut = image[..., :3].reshape(SIZE // BLOCK, BLOCK, SIZE // BLOCK, BLOCK, 3)
    return cut.mean(axis=(1, 3))


def pictures(mitsuba, result, exported, samples):
    """Blocks of Mitsuba's pictures, by dictionary and (noisy) by XML, and of ours."""
    by_dictionary = mitsuba.load_dict(runpy.run_path(str(exported / "scene.py"))["scene"]())
    by_xml = mitsuba.load_file(str(exported / "scene.xml"))
    theirs = [
        np.array(mitsuba.render(scene, sensor=0, spp=count))
        for scene, count in ((by_dictionary, samples), (by_xml, 32))
    ]
    ours = read_image(render_config(result, result.parent / "again") / "0.exr").pixels
    whole = blocks(np.repeat((ours.sum(-1, keepdims=True) > 0) * 1.0, 3, axis=-1)).min(-1) == 1
    assert whole.sum() > 8
    return [blocks(one)[whole] for one in (*theirs, ours)]


def off(first, second):
    return np.abs(first - second).mean() / second.mean()


@pytest.mark.parametrize(
    ("shape", "channels", "varying", "samples"),
    [
        pytest.param(egg(), 1, True, 400, id="mesh with maps"),
        pytest.param(Sphere(), 1, True, 400, id="sphere with maps", marks=pytest.mark.slow),
        pytest.param(egg(), 3, False, 400, id="mesh with coloured ks", marks=pytest.mark.slow),
    ],
)
def test_mitsuba_renders_textures(mitsuba, tmp_path, shape, channels, varying, samples):
    maps = smooth_maps(texel_places(), channels, varying)
    result = write_result(tmp_path / "cat", maps, shape)
    done = export(result, "mitsuba", lossy=varying)
    by_dictionary, by_xml, ours = pictures(mitsuba, result, done.folder, samples)
    # Noise is .3 % of the first and 1.5 % of the second.
    assert off(by_dictionary, ours) < 0.005
    assert off(by_xml, by_dictionary) < 0.03
    text = (done.folder / "README.txt").read_text()
    files = {p.name for p in done.folder.iterdir()} - {"README.txt", "run.json"}
    assert all(name in text for name in files)
    assert ("normal.exr" in files) == varying
    assert ("Lost: nothing" in text) != varying


@pytest.mark.slow
@pytest.mark.parametrize("shape", [Sphere(), egg()], ids=["ball", "mesh"])
def test_mitsuba_renders_metal(mitsuba, tmp_path, shape):
    result = write_metal_result(tmp_path / "cat", metal_maps(texel_places()), shape)
    done = export(result, "mitsuba")
    by_dictionary, by_xml, ours = pictures(mitsuba, result, done.folder, 800)
    assert off(by_dictionary, ours) < 0.005
    assert off(by_xml, by_dictionary) < 0.03
    text = (done.folder / "README.txt").read_text()
    files = {p.name for p in done.folder.iterdir()} - {"README.txt", "run.json"}
    assert all(name in text for name in files)
    assert {"metal.exr", "base_color.exr", "roughness.exr"} <= files


def test_usd_holds_textures(tmp_path):
    """The stage is valid by USD's own library, and its README says what is lost."""
    pytest.importorskip("pxr", reason="needs the extra usd: pip install 'jaxrender[usd]'")
    from pxr import Usd, UsdValidation

    result = write_result(tmp_path / "cat", smooth_maps(texel_places(), 3, True), egg())
    with pytest.raises(InputError, match=r"would lose the normals of single texels: .*; the model"):
        export(result, "usd")
    done = export(result, "usd", lossy=True)
    files = {"scene.usdc", "environment.exr", "base_color.png", "specular_color.png"}
    found = {p.name for p in done.folder.iterdir()}
    assert found == files | {"roughness.png", "README.txt", "run.json"}
    stage = Usd.Stage.Open(str(done.folder / "scene.usdc"))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert not UsdValidation.ValidationContext(validators).Validate(stage)


def stated(folder, words):
    """A percentage of the README, as a share."""
    text = " ".join((folder / "README.txt").read_text().split())
    return float(re.search(rf"{words} ([0-9.]+) %", text).group(1)) / 100


def test_tilted_normals_lose_what_is_said(mitsuba, tmp_path):
    """Under even light a matt ball with tilted normals is as much darker there as the README says.

    Grazing places are as many as others are, but smaller in a picture: 20 % of the loss.
    """
    x, y, z = np.moveaxis(texel_places(), -1, 0)
    offset = 0.5 * np.stack([-y, x, 0 * z], axis=-1) / np.hypot(x, y)[..., None]
    maps = smooth_maps(texel_places())._replace(ks=np.zeros(x.shape), offset=offset)
    result = write_result(tmp_path / "cat", maps, Sphere(), np.ones_like(SKY))
    with pytest.raises(InputError, match=r"would lose light from below.*Give --lossy to go on"):
        export(result, "mitsuba")
    done = export(result, "mitsuba", lossy=True)
    theirs, _, ours = pictures(mitsuba, result, done.folder, 64)
    lost = 1 - theirs.mean() / ours.mean()
    assert lost == pytest.approx(stated(done.folder, "would still see:"), rel=0.2)


def test_vertices_go_evenly(mitsuba, tmp_path):
    """Noise of K_d from vertex to vertex: the README's loss is the pictures' mean difference."""
    ball = Mesh.icosphere(2)
    rng = np.random.default_rng(0)
    maps = smooth_maps(ball.vertices)
    noisy = maps.kd * rng.uniform(0.3, 1.7, (len(ball.vertices), 1))
    maps = maps._replace(kd=noisy, ks=np.zeros(len(ball.vertices)))
    result = write_result(tmp_path / "cat", maps, ball, np.ones_like(SKY))
    done = export(result, "mitsuba", lossy=True)
    scene = mitsuba.load_file(str(done.folder / "scene.xml"))
    theirs = np.array(mitsuba.render(scene, sensor=0, spp=64))
    ours = read_image(render_config(result, tmp_path / "again") / "0.exr").pixels[..., :3]
    on = (ours.sum(-1) > 0) & (theirs.sum(-1) > 0)
    assert off(theirs[on], ours[on]) == pytest.approx(
        stated(done.folder, "changes K_d by"), rel=0.2
    )


def test_vertices_with_highlights(mitsuba, tmp_path):
    """Smooth values differ little from vertex to vertex: lobes and normals are at their places."""
    ball = Mesh.icosphere(3)
    maps = smooth_maps(ball.vertices, 1, True)._replace(widths=None)
    result = write_result(tmp_path / "cat", maps, ball)
    done = export(result, "mitsuba", lossy=True)
    theirs, _, ours = pictures(mitsuba, result, done.folder, 100)
    assert off(theirs, ours) < 0.01
