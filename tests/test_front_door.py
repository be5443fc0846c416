"""The names of the front door, and the Python of the README as it stands there.

- Every name leads to something; what there is none of is refused as Python does.
- From files to a fitted material: photographs of an ellipsoid under a probe and a source.
- A loss of one's own finds the material that a picture was made with.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import jaxrender
from jaxrender.brdf import brdf_named
from jaxrender.geometry import Mesh, Pinhole, look_at, observe
from jaxrender.io import write_image, write_mesh
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.reflection import forward_of, render_view

README = Path(__file__).parents[1] / "README.md"
BLOCKS = re.findall(r"```python\n(import .*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
TRUTH = {"kd": np.array([0.2, 0.1, 0.15]), "ks": np.full(3, 0.1), "sigma": 0.2, "mu": 1.5}


def test_every_name_leads_somewhere():
    for name in jaxrender.__all__:
        assert getattr(jaxrender, name) is not None
    assert dir(jaxrender) == sorted(jaxrender.__all__)
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        _ = jaxrender.fitt


def photographs(folder):
    """Write cameras, pictures, mesh and probe of an ellipsoid."""
    shape = Mesh.ellipsoid(np.array([1.0, 0.9, 0.8]), 3)
    probe = Environment(np.full((8, 16, 3), 0.2))
    source = DirectionalSources(np.array([[0.0, 0.6, 0.8]]), np.ones((1, 3)))
    model, frames = forward_of(probe + source, shape), []
    rng = np.random.default_rng(0)
    for number in range(3):
        place = 8 * np.array([np.cos(number), np.sin(number), 0.4])
        pose = look_at(place, np.zeros(3), np.array([0.0, 0.0, 1.0]))
        view = observe(Pinhole(32, 32, pose, fl_x=100.0), shape)
        image = np.asarray(render_view(brdf_named("ggx", **TRUTH), view, model))
        noisy = image * (1 + 0.005 * rng.normal(size=image.shape))
        write_image(folder / f"photos/{number}.exr", np.dstack([noisy, view.hit]))
        frames.append({"file_path": f"{number}.exr", "transform_matrix": pose.tolist()})
    intrinsics = {"w": 32, "h": 32, "fl_x": 100.0}
    (folder / "photos/transforms.json").write_text(json.dumps({**intrinsics, "frames": frames}))
    write_mesh(folder / "cat.ply", shape)
    write_image(folder / "probe.exr", np.asarray(probe.radiance))


@pytest.mark.slow
def test_from_files_to_a_fitted_material(tmp_path, monkeypatch, capsys):
    (tmp_path / "photos").mkdir()
    photographs(tmp_path)
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(BLOCKS[0], names)
    estimate = names["estimate"]
    np.testing.assert_allclose(estimate.values["kd"], TRUTH["kd"], rtol=0.02)
    assert estimate.values["sigma"] == pytest.approx(0.2, rel=0.03)
    assert "ggx: the fit converged" in capsys.readouterr().out


def test_a_loss_of_ones_own(capsys):
    names = {}
    exec(BLOCKS[1], names)
    found = np.exp(names["found"].value)
    np.testing.assert_allclose(found, np.exp(names["truth"]), rtol=1e-3)
    assert "0.25" in capsys.readouterr().out
