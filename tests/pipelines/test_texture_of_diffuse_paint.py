"""``task: texture`` on diffuse paint, from config to result folder.

- A mesh file with texture coordinates gets texels, one without gets its vertices, and says so.
- Under unknown light the texture is right up to what is not identifiable, which is said; a specular
  lobe that is not there is not identifiable.
- Texels without end are marked, not made up.
- Colours of a mask are regions with a lobe each.
"""

import numpy as np
import pytest
from painted_captures import CHECKER, DIFFUSE, KD, Paint, texel_paint, write_painted
from texture_runs import DIFFUSE_TASK, ROWS, TASK, arrays, run

from jaxrender.errors import InputError
from jaxrender.geometry import Mesh
from jaxrender.geometry.texels import texel_coordinates
from jaxrender.io import read_mesh, write_image, write_mesh


@pytest.fixture(scope="module")
def diffuse(tmp_path_factory):
    return write_painted(tmp_path_factory.mktemp("diffuse") / "capture", DIFFUSE)


@pytest.mark.slow
def test_a_mesh_without_coordinates_has_vertices(tmp_path):
    mesh = Mesh.icosphere(2)
    plain = Paint(np.tile(KD[:1], (2, 1)), np.zeros(2))
    folder = write_painted(tmp_path / "capture", plain, 3, mesh)
    write_mesh(folder / "ball.ply", mesh)
    with pytest.raises(InputError, match=r"texture\.size: found 16, but the mesh has no texture"):
        run(folder, DIFFUSE_TASK, shape="mesh: ball.ply")
    out, result = run(folder, DIFFUSE_TASK, "texture.size=auto", shape="mesh: ball.ply")
    said = result["texture"]
    assert said["sentence"] == (
        "162 vertices: the mesh has no texture coordinates, or not everywhere"
    )
    assert said["files"] == {"vertices": "textures/vertices.ply"}
    texture = arrays(out)
    sure = texture["kd_marked"] == 0
    off = (texture["kd"] - KD[0]) / texture["kd_error"]
    assert sure.sum() > 60
    assert 0.8 < np.sqrt(np.mean(off[sure] ** 2)) < 1.2
    assert len(read_mesh(out / "textures/vertices.ply").vertices) == 162
    assert "vertices.ply" in (out / "report.html").read_text()


class Folded(Paint):
    """Checks of x and y, alike on both sides of the ball: texels that are flat on a flat face."""

    def of(self, points):
        which = (np.floor(2 * points[:, 0]) + np.floor(2 * points[:, 1])).astype(int) % 2
        return self.kd[which], self.ks[which]


@pytest.mark.slow
def test_a_mesh_file_with_coordinates_has_texels(tmp_path):
    """An .obj whose texture is its upper side beside its lower one: vertices between have both."""
    ball, paint = Mesh.icosphere(3), Folded(ks=np.zeros(2))
    corners = ball.vertices[ball.faces]
    lower = corners[..., 2].mean(axis=1, keepdims=True) < 0
    u, v = (corners[..., 0] + 1) / 4 + lower / 2, (corners[..., 1] + 1) / 2
    mesh = Mesh(ball.vertices, ball.faces, ball.normals, np.stack([u, v], axis=-1))
    folder = write_painted(tmp_path / "capture", paint, 3, mesh)
    write_mesh(folder / "ball.obj", mesh)
    out, result = run(folder, DIFFUSE_TASK, shape="mesh: ball.obj")
    assert result["texture"]["sentence"] == "16 x 16 texels of the mesh's texture coordinates"
    texture = arrays(out)
    u, v = texel_coordinates((16, 16)).T
    kd, _ = paint.of(np.stack([4 * u % 2 - 1, 2 * v - 1], axis=-1))
    sure = texture["kd_marked"].ravel() == 0
    off = (texture["kd"].reshape(-1, 3) - kd) / texture["kd_error"].reshape(-1, 3)
    assert sure.sum() > 60
    assert 0.8 < np.sqrt(np.mean(off[sure] ** 2)) < 1.2


@pytest.mark.slow
def test_diffuse_paint_under_unknown_light(diffuse):
    folder, result = run(diffuse, DIFFUSE_TASK, lighting="")
    assert result["outcome"] == "not_identifiable"
    assert "T 6.1.1, class 6" in result["ambiguity"]
    assert "total-variation" in result["ambiguity"]
    assert "0.18 / pi" in result["lighting"]["gauge"]
    texture = arrays(folder)
    kd, _ = texel_paint(ROWS, DIFFUSE)
    good = (texture["seen"].ravel() > 3) & np.isfinite(texture["kd"]).all(axis=-1).ravel()
    ratio = texture["kd"].reshape(-1, 3)[good] / kd[good]
    # Neighbouring cells of different paint: what varies faster than the surface is identifiable.
    within = np.abs(np.log(ratio / np.median(ratio, axis=0)))
    assert np.median(within) < 0.1
    assert (folder / "lighting.exr").is_file()
    assert "What is not identifiable" in (folder / "report.html").read_text()


@pytest.mark.slow
def test_a_specular_lobe_that_is_not_there_is_not_identifiable(diffuse):
    _, result = run(diffuse, TASK)
    assert result["outcome"] in ("not_identifiable", "at_bound")
    assert any("sigma" in reason for reason in result["reasons"])


@pytest.mark.slow
def test_texels_without_end_are_marked_not_made_up(diffuse):
    _, result = run(diffuse, DIFFUSE_TASK, "texture.size=96")
    said = result["texture"]
    assert said["unseen"] > said["seen"]
    assert said["median_observations"] <= 2


def test_regions_are_put_together(diffuse, tmp_path):
    kd, _ = texel_paint(ROWS, CHECKER)
    which = (kd[:, 0] > 0.1).reshape(ROWS, 2 * ROWS)
    write_image(tmp_path / "mask.png", np.repeat(which[..., None] * 1.0, 3, axis=-1))
    folder, result = run(diffuse, DIFFUSE_TASK, f"texture.regions={tmp_path / 'mask.png'}")
    assert [region["name"] for region in result["regions"]] == ["#000000", "#ffffff"]
    assert sum(region["sites"] for region in result["regions"]) == result["texture"]["seen"]
    texture = arrays(folder)
    np.testing.assert_array_equal(texture["region"], which)
    good = texture["kd_marked"].ravel() == 0
    off = (texture["kd"].reshape(-1, 3) - kd) / texture["kd_error"].reshape(-1, 3)
    assert 0.8 < np.sqrt(np.mean(off[good] ** 2)) < 1.2
    assert "#ffffff" in (folder / "report.html").read_text()
