"""``jaxrender measure``: what is written, going on after an interrupt, and what is refused.

- A flat height image of a diffuse colour has that colour as its table; the command says so.
- Interrupted and started again it gives the same table as in one go, without measuring rows twice;
  finished, it is reused; another recipe is refused unless forced.
- Patches and facets are made as named, colours for each material; mistakes name the word.
"""

import numpy as np
import pytest

from jaxrender import cli
from jaxrender.errors import InputError
from jaxrender.geometry import Mesh
from jaxrender.geometry.height_fields import height_field
from jaxrender.io.images import write_image
from jaxrender.io.meshes import write_mesh
from jaxrender.io.tables import read_table
from jaxrender.pipelines import measure as measuring
from jaxrender.pipelines.measure import MeasureOptions, measure
from jaxrender.pipelines.patches import facets_of, patch_of
from jaxrender.reflection.tracing.gonioreflectometer import Gonioreflectometer

SMALL = MeasureOptions("sawtooth:teeth=1", size=(3,), samples=16, bounces=2)


def test_the_command_measures_a_flat_image(tmp_path, capsys):
    write_image(tmp_path / "flat.exr", np.full((3, 4, 3), 0.5))
    out = tmp_path / "t.nc"
    arguments = ["measure", str(tmp_path / "flat.exr"), "--out", str(out), "--size", "4"]
    arguments += ["--brdf", "lambertian:kd=0.2/0.1/0.05", "--samples", "16", "--bounces", "1"]
    assert cli.main(arguments) == 0
    assert "4 x 4 x 4 x 4 directions" in capsys.readouterr().out
    found = read_table(out)
    assert found.values.shape == (4, 4, 4, 4, 3)
    np.testing.assert_allclose(found.values[1, 2, 2, 1], [0.2, 0.1, 0.05], rtol=1e-9)
    assert found.about["brdfs"] == "lambertian:kd=0.2/0.1/0.05"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["flat.exr", "t.nc"]


def test_going_on_after_an_interrupt(tmp_path, monkeypatch):
    whole = measure(SMALL, tmp_path / "whole.nc").table
    rows, honest = [], Gonioreflectometer.block

    def interrupted(self, settings, row):
        if len(rows) == 2:
            rows.append(None)
            raise KeyboardInterrupt
        rows.append(row)
        return honest(self, settings, row)

    monkeypatch.setattr(Gonioreflectometer, "block", interrupted)
    out = tmp_path / "t.nc"
    with pytest.raises(KeyboardInterrupt):
        measure(SMALL, out)
    assert not out.exists()
    with pytest.raises(InputError, match="another measurement"):
        measure(SMALL._replace(seed=1), out)
    found = measure(SMALL, out).table
    assert rows == [0, 1, None, 2]
    np.testing.assert_array_equal(found.values, whole.values)
    np.testing.assert_array_equal(found.standard_errors, whole.standard_errors)
    assert not (tmp_path / "t.nc.partial").exists()


def test_a_damaged_row_is_measured_again(tmp_path, monkeypatch):
    out = tmp_path / "t.nc"
    monkeypatch.setattr(measuring, "write_table", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        measure(SMALL, out)
    (tmp_path / "t.nc.partial" / "row_0001.npz").write_bytes(b"PK half")
    monkeypatch.undo()
    found = measure(SMALL, out).table
    np.testing.assert_array_equal(found.values, measure(SMALL, tmp_path / "b.nc").table.values)


def test_finished_results_are_reused_and_guarded(tmp_path, monkeypatch):
    out = tmp_path / "t.nc"
    first = measure(SMALL, out).table
    monkeypatch.setattr(Gonioreflectometer, "block", lambda *_: 1 / 0)
    np.testing.assert_array_equal(measure(SMALL, out).table.values, first.values)
    with pytest.raises(InputError, match="--force"):
        measure(SMALL._replace(samples=32), out)
    monkeypatch.undo()
    other = measure(SMALL._replace(samples=32), out, force=True).table
    assert not np.array_equal(other.values, first.values)


def test_patches_by_name(tmp_path):
    patch, files = patch_of("sawtooth:teeth=2,rising=30,falling=60")
    assert not files
    normals = patch.mesh.face_normals()
    angles = np.degrees(np.arctan2(normals[:, 0], normals[:, 2]))
    np.testing.assert_allclose(np.unique(angles.round(6)), [-30, 60])
    assert len(patch_of("velvet:threads=3,sides=4")[0].mesh.faces) == 2 + 3 * 10
    path = tmp_path / "bumps.ply"
    write_mesh(path, height_field(np.random.default_rng(0).random((4, 4)), (2.0, 3.0)).mesh)
    patch, files = patch_of(str(path))
    np.testing.assert_allclose(patch.size, [2, 3])
    assert files == [path]
    picture = np.zeros((2, 4, 3))
    picture[0, 1] = 1
    write_image(tmp_path / "h.exr", picture)
    patch, _ = patch_of(str(tmp_path / "h.exr"), relief=0.3)
    np.testing.assert_allclose(patch.size, [1, 0.5])
    top = patch.mesh.vertices[np.argmax(patch.mesh.vertices[:, 2])]
    # The upper row of the picture is the one at larger y.
    np.testing.assert_allclose(top, [0.25, 0.25, 0.3], atol=1e-7)
    assert isinstance(patch.mesh, Mesh)


def test_facets_by_name():
    red, facets = facets_of(["lambertian:kd=0.3/0.1/0", "microfacet:sigma=0.2,kd=0.1"], 2)
    np.testing.assert_allclose(red.kd, [0.3, 0.1, 0])
    np.testing.assert_allclose(facets.kd, [0.1] * 3)
    np.testing.assert_allclose(facets.ks, [1] * 3)
    white, same = facets_of(["lambertian"], 2)
    np.testing.assert_allclose(white.kd, [1 / np.pi])
    assert white is same


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"patch": "sawtoth:teeth=2"}, "did you mean 'sawtooth'"),
        ({"patch": "sawtooth:tooth=2"}, "no parameter 'tooth'"),
        ({"patch": "sawtooth:teeth=2.5"}, "whole number"),
        ({"patch": "sawtooth:rising=120"}, "angles"),
        ({"brdfs": ("lambertain",)}, "lambertian"),
        ({"brdfs": ("lambertian:kd=0.1/x",)}, "no colour"),
        ({"brdfs": ("microfacet:sigma=0.1/0.2",)}, "sigma has no colour"),
        ({"brdfs": ("mirror",)}, "mirror"),
        ({"brdfs": ("lambertian",) * 3}, "once for"),
        ({"brdfs": ("lambertian:kd=.1/.1", "lambertian:kd=.1/.1/.1")}, "channels"),
        ({"size": (4, 4)}, "one size or four"),
        ({"size": (0,)}, "at least 1"),
        ({"size": (500,)}, "smaller"),
        ({"embedding": "mercator"}, "nusselt"),
        ({"region": (0.5, 0.0, 0.2, 1.0)}, "region"),
    ],
)
def test_mistakes_name_the_word(tmp_path, changes, words):
    with pytest.raises(InputError, match=words):
        measure(SMALL._replace(**changes), tmp_path / "t.nc")
    assert not list(tmp_path.iterdir())
