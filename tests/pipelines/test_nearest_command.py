"""``jaxrender nearest``: from a file to a table, data and a picture.

- A file of measurements made of a model gives the model back, in words, in JSON and drawn.
- A model's name needs no file; what is wrong is said with its remedy, and nothing is written.
"""

import json

import numpy as np
import pytest

from jaxrender.brdf import Phong
from jaxrender.cli import main
from jaxrender.io.alta import AltaMeasurements, write_alta
from jaxrender.pipelines.nearest import nearest


def test_a_file_of_measurements_gives_its_model_back(tmp_path, capsys):
    rng = np.random.default_rng(0)
    pair = rng.normal(size=(2, 200, 3))
    pair[..., 2] = 0.2 + np.abs(pair[..., 2])
    pair /= np.linalg.norm(pair, axis=-1, keepdims=True)
    truth = Phong(np.array([0.1, 0.2, 0.0]), np.array([0.3, 0.3, 0.3]), 12.0)
    path, out = tmp_path / "a.alta", tmp_path / "out"
    write_alta(path, AltaMeasurements.of(truth, *pair))
    assert main(["nearest", str(path), "--model", "phong", "-o", str(out)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith(f"{path}: 200 scattered measurements")
    assert printed[1].split() == ["model", "held", "out", "cube-root", "cosine-l1", "plain"]
    assert "exponent 12 ±" in printed[3]
    (found,) = json.loads((out / "nearest.json").read_text())["models"]
    assert found["parameters"]["exponent"] == pytest.approx(12, rel=1e-4)
    np.testing.assert_allclose(found["parameters"]["kd"], truth.kd, atol=1e-5)
    assert found["held_out"] < 1e-3
    assert (out / "nearest.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(one.name for one in out.iterdir()) == ["nearest.json", "nearest.png"]


def test_what_is_wrong_is_said(tmp_path, capsys):
    for arguments, message in (
        (["none.brdf"], "none.brdf: no such file"),
        (["phong:exponent=9", "--model", "marble"], "--model marble: choose of microfacet"),
        (["lambertian:kd=0"], "lambertian:kd=0: a BRDF that is zero"),
        (["phong:exponent=9", "--metric", "l2"], "l2"),
    ):
        assert main(["nearest", *arguments, "-o", str(tmp_path / "out")]) == 2
        assert message in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    with pytest.raises(Exception, match="cannot be made"):
        nearest("phong:exponent=9", models=("phong",), out=tmp_path / "file")
    assert [one.name for one in tmp_path.iterdir()] == ["file"]
