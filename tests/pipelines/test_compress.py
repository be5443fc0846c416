"""Any BRDF to a tree in a file, and back.

- Models, the recovered material of a result folder, tables and trees become trees; what the file
  says of its error is what the samples say (an independent table), and errors asked for are met.
- As much is kept as was asked; rounding is no coefficient: a constant BRDF has those of the disc.
- Light that a tree creates is an outcome, in words and numbers, which ``conserve`` takes away.
- A cell has the mean of the BRDF over it, what is above the horizon of it.
- A sphere of the tree looks as the material within the error that the tree states.
- Holes and negative values are filled or cleared, and counted.
- Everything wrong is refused by name and remedy.
"""

import json

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import pywt
from small_captures import CONFIG, write_json

from jaxrender.brdf import BRDF, Microfacet, Phong, WaveletBRDF
from jaxrender.brdf.compression.squares import Goal, compression_of
from jaxrender.brdf.tables.cell_means import albedo_of, tabulate
from jaxrender.errors import InputError
from jaxrender.geometry import NUSSELT, Pinhole, Sphere, look_at
from jaxrender.harmonics import LatLongGrid
from jaxrender.io.measured import read_cornell
from jaxrender.io.tables import BRDFTable, write_table
from jaxrender.io.trees import read_tree
from jaxrender.lighting import Environment
from jaxrender.pipelines.brdf_sources import source_of
from jaxrender.pipelines.compress import compress
from jaxrender.reflection import ExactForward
from jaxrender.reflection.render import render
from jaxrender.wavelets import haar, linear_spline

evaluate = eqx.filter_jit(BRDF.evaluate)
WIDE = "microfacet:sigma=0.4,kd=0.1,fresnel=half,masking=smith"


def missed(brdf: BRDF, tree: WaveletBRDF, size: int) -> float:
    """Relative rms over the samples, by evaluating both at all pairs of cells."""
    cells = NUSSELT.cell_directions((size, size)).reshape(-1, 3)
    cells = cells[cells[:, 2] > 0]
    pairs = np.broadcast_arrays(cells[:, None], cells[None])
    expected, found = (np.asarray(evaluate(b, *pairs)) for b in (brdf, tree))
    return float(np.sqrt(np.sum((found - expected) ** 2) / np.sum(expected**2)))


@pytest.mark.parametrize("wavelet", ["haar", pytest.param("cdf-2-2", marks=pytest.mark.slow)])
def test_a_model(tmp_path, wavelet):
    goal, centres = Goal(0.2), {"cell_samples": 1}
    done = compress(WIDE, tmp_path / "t.nc", goal, size=8, wavelet=wavelet, **centres)
    tree, about = read_tree(tmp_path / "t.nc")
    assert (tree.size, tree.wavelet.name, about.channels) == (8, wavelet, "plain")
    assert abs(tree.count - 0.2 * about.non_zero) <= 1
    true = missed(source_of(WIDE).brdf, WaveletBRDF(tree), 8)
    assert about.relative_rms == pytest.approx(true, rel=1e-3)
    if wavelet == "haar":
        assert 0.5 * done.compression.predicted < true <= done.compression.predicted
    assert any("1/sr" in word or "rms" in word for word in done.said)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["t.nc", "t.nc.json"]


def test_light_that_is_created_is_an_outcome(tmp_path):
    """T 6.2 without masking sends out more than arrives at grazing; dimmed, it does not."""
    bare = "microfacet:sigma=0.2,kd=0.05,ks=0.3,mu=1.5,fresnel=half,masking=none"
    options = {"size": 8, "cell_samples": 2}
    for more, outcome in (({}, "brdf_creates_energy"), ({"conserve": True}, "conserves_energy")):
        done = compress(bare, tmp_path / "t.nc", Goal(0.1), **options, **more)
        written = json.loads((tmp_path / "t.nc.json").read_text())
        assert written["outcome"] == done.energy.outcome == outcome
        assert done.conserves_energy == (outcome == "conserves_energy")
        assert any(line.startswith(f"energy: {outcome}; largest albedo") for line in done.said)
        samples = np.asarray(read_tree(tmp_path / "t.nc").tree.samples())
        assert albedo_of(np.maximum(samples, 0)).max() == pytest.approx(
            written["albedo"]["largest"], rel=1e-3
        )
        assert (written["albedo"]["largest"] > 1.02) == (not more)
        assert (written["lost_by_conserve"] > 0.02) == bool(more)
        assert written["coefficients"]["kept"] == done.compression.tree.count
        assert written["errors"]["cosine-l1"]["standard_error"] > 0
    assert any("g(t_i) g(t_r)" in line and "is lost" in line for line in done.said)


@pytest.mark.slow
def test_cells_have_their_means():
    """Against many random samples of the same cells; a reciprocal BRDF's table is reciprocal."""
    lobe = source_of("microfacet:sigma=0.15,fresnel=half,masking=smith").brdf
    table = tabulate(lobe, 8, cell_samples=512).values[..., 0]
    np.testing.assert_allclose(table, table.transpose(2, 3, 0, 1), rtol=1e-5)
    rng = np.random.default_rng(4)
    for cell in ((5, 4, 2, 3), (4, 4, 3, 3), (5, 3, 2, 6)):
        places = (np.array(cell) + rng.uniform(size=(40_000, 4))) / 8
        pair = [NUSSELT.direction_from_square(places[:, i : i + 2]) for i in (0, 2)]
        mean = float(np.mean(lobe.evaluate(*pair)))
        assert table[cell] == pytest.approx(mean, rel=0.06)
        assert tabulate(lobe, 8, cell_samples=1).values[cell][0] != pytest.approx(mean, rel=0.06)


def test_a_cell_on_the_horizon_has_the_mean_of_what_is_above():
    white = tabulate(source_of("lambertian:kd=0.3").brdf, 8, cell_samples=16).values[..., 0]
    np.testing.assert_allclose(white[white > 0], 0.3, rtol=1e-6)
    assert np.count_nonzero(white) > np.count_nonzero(
        tabulate(source_of(WIDE).brdf, 8, cell_samples=1).values
    )


@pytest.mark.parametrize("wavelet", [haar(), linear_spline()], ids=lambda w: w.name)
@pytest.mark.parametrize("error", [0.02, 0.2])
def test_an_error_is_met_with_little_to_spare(wavelet, error):
    table = tabulate(source_of(WIDE).brdf, 8, cell_samples=2).values
    found = compression_of(table, wavelet, Goal(error=error))
    assert 0.6 * error < found.measured <= error
    fewer = compression_of(table, wavelet, Goal(0.6 * found.tree.count / found.non_zero))
    assert fewer.measured > error


def test_rounding_is_no_coefficient():
    """Lambert's BRDF is constant in the disc: as many coefficients as an indicator of the disc."""
    white = tabulate(source_of("lambertian:kd=0.3183").brdf, 16, cell_samples=1).values
    found = compression_of(white, haar(), Goal(1.0))
    disc = NUSSELT.covers(NUSSELT.centres((16, 16))).astype(float)
    exact = np.einsum("ij,kl->ijkl", disc, disc)[..., None]
    coefficients = pywt.coeffs_to_array(pywt.wavedecn(exact[..., 0], "haar"))[0]
    assert found.non_zero == np.count_nonzero(np.abs(coefficients) > 1e-9)
    assert found.measured < 1e-6


class Holey(BRDF):
    """Phong's lobe with holes; negative on one side."""

    amplitudes = np.eye(1)
    reciprocal = conserves_energy = isotropic = False
    hole: float = np.nan

    def transfer(self, incoming, outgoing):
        """Not a number where both directions lie in a corner."""
        (lobe,) = (Phong(np.zeros(1), np.ones(1), 3.0).transfer(incoming, outgoing)[1],)
        return (jnp.where((incoming.x > 0.5) & (outgoing.y > 0.3), self.hole, lobe),)


@pytest.mark.parametrize("hole", [np.nan, -1.0, np.inf])
def test_holes_are_counted_and_filled(hole):
    found = tabulate(Holey(hole), 8, cell_samples=1)
    cells = NUSSELT.cell_directions((8, 8))
    above = np.asarray(NUSSELT.covers(NUSSELT.centres((8, 8))))
    holes = ((cells[..., 0] > 0.5) & above).sum() * ((cells[..., 1] > 0.3) & above).sum()
    assert found.masked == holes
    assert np.isfinite(found.values).all()
    assert (found.values >= 0).all()
    beyond = found.values[~above], found.values[:, :, ~above]
    assert all((part == 0).all() for part in beyond)
    inside = found.values[above][:, above]
    cleared = tabulate(Holey(hole), 8, "zero", cell_samples=1).values[above][:, above]
    assert np.count_nonzero(inside) > np.count_nonzero(cleared)


@pytest.mark.slow
def test_a_tree_of_a_table_and_of_that_tree(tmp_path):
    brdf = Phong(np.array([0.1, 0.2, 0.3]), np.array([0.3, 0.2, 0.1]), 4.0)
    values = tabulate(brdf, 4, dtype=np.float64, cell_samples=1).values
    write_table(tmp_path / "table.nc", BRDFTable(values, None))
    done = compress(str(tmp_path / "table.nc"), tmp_path / "t.nc", Goal(1.0), size=4)
    assert done.compression.measured < 1e-6
    tree, about = read_tree(tmp_path / "t.nc")
    assert about.channels == "rgb"
    np.testing.assert_allclose(tree.samples(), values, atol=1e-5 * values.max())
    assert not any("resampled" in line for line in done.said)
    again = compress(str(tmp_path / "t.nc"), tmp_path / "u.nc", Goal(1.0), size=4)
    assert again.compression.measured < 1e-6
    finer = compress(str(tmp_path / "table.nc"), tmp_path / "v.nc", Goal(0.5), size=8)
    assert any("resampled from 4 x 4 x 4 x 4 (nusselt) to 8^4" in line for line in finer.said)


def test_anisotropic_models_are_welcome(tmp_path):
    compress("ward:roughness=0.3,roughness_y=0.6", tmp_path / "t.nc", size=8)
    assert read_tree(tmp_path / "t.nc")[0].size == 8


def test_wavelengths_are_kept(tmp_path):
    """A small Cornell file: three wavelengths in, three or RGB out."""
    rng = np.random.default_rng(0)
    angles = rng.uniform([0, 0, 0, 0], [1.2, 6.2, 1.2, 6.2], (120, 4))
    rows = [" ".join(f"{a:.4f}" for a in row) + " 0.1 0.2 -1" for row in angles[:40]]
    rows += [" ".join(f"{a:.4f}" for a in row) + " 0.1 0.2 0.3" for row in angles[40:]]
    path = tmp_path / "flat.brdf"
    path.write_text("3 450 550 650\n" + "\n".join(rows) + "\n")
    assert len(read_cornell(path).values) == 120
    options = {"size": 4, "spectral": True, "cell_samples": 1}
    done = compress(str(path), tmp_path / "t.nc", Goal(0.5), **options)
    tree, about = read_tree(tmp_path / "t.nc")
    assert about.wavelengths == (450.0, 550.0, 650.0)
    assert any("40 negative or unknown values masked" in line for line in done.said)
    disc = (NUSSELT.covers(NUSSELT.centres((4, 4)))).mean()
    mean = np.asarray(tree.root) / disc**2
    np.testing.assert_allclose(mean, [0.1, 0.2, 0.3], rtol=1e-3)


def test_a_recovered_material_looks_the_same_as_its_tree(tmp_path):
    found = {"model": "microfacet", "kd": [0.2, 0.15, 0.1], "ks": 0.12, "sigma": 0.4, "mu": 1.6}
    found |= {"fresnel": "exit", "masking": "none"}
    (tmp_path / "config.yaml").write_text(CONFIG)
    write_json(tmp_path / "result.json", {"task": "brdf", "outcome": "converged", "brdf": found})
    compress(str(tmp_path), tmp_path / "t.nc", Goal(0.3), size=8, cell_samples=1)
    tree, about = read_tree(tmp_path / "t.nc")
    material = Microfacet(np.array(found["kd"]), np.full(3, 0.12), 0.4, 1.6, "exit", "none")
    assert about.channels == "rgb"
    assert about.relative_rms == pytest.approx(missed(material, WaveletBRDF(tree), 8), rel=1e-3)


def test_a_sphere_looks_as_the_material_within_the_stated_error(tmp_path):
    """Under a sky of slow colour, so that cells of the table are finer than the light."""
    compress(WIDE, tmp_path / "t.nc", Goal(0.05), size=16, wavelet="haar")
    tree, about = read_tree(tmp_path / "t.nc")
    grid = LatLongGrid(24, 48)
    sky = 1 + 0.5 * grid.directions()[..., :1] + grid.directions()[..., 2:] ** 2
    light = ExactForward(Environment(sky).nodes())
    pose = look_at(np.array([6.0, 0, 0]), np.zeros(3), np.array([0.0, 0, 1]))
    camera, ball = Pinhole(24, 24, pose, fl_x=60.0), Sphere(np.zeros(3), 1.0)
    material = source_of(WIDE).brdf
    images = []
    for brdf in (material, WaveletBRDF(tree)):
        images.append(render(brdf, camera, ball, light))
    error = np.sqrt(np.sum((images[1] - images[0]) ** 2) / np.sum(images[0] ** 2))
    assert 0.02 < about.relative_rms < 0.2
    assert error < min(about.relative_rms, about.relative_rms_between)


@pytest.mark.parametrize(
    ("named", "options", "message"),
    [
        (WIDE, {"size": 12}, "--size 12: no power of two; give 16"),
        (WIDE, {"size": 1}, "no power of two; give 2"),
        (WIDE, {"size": 128}, "at most 67,108,864: give a smaller size"),
        (WIDE, {"cell_samples": 3}, "--cell-samples 3: give 1, or an even number"),
        (WIDE, {"wavelet": "harr"}, "did you mean 'haar'"),
        (WIDE, {"goal": Goal(0.0)}, "--keep 0.0: a fraction"),
        (WIDE, {"goal": Goal(error=1.5)}, "--error 1.5: a relative error"),
        (WIDE, {"spectral": True}, "leave --spectral out"),
        ("mirror", {}, "a mirror has no table"),
        ("microfacets", {}, "did you mean 'microfacet'"),
        ("none.brdf", {}, "none.brdf: no such file"),
        ("runs/none", {}, "no such file"),
        ("lambertian:kd=0", {}, "reflects nothing"),
    ],
)
def test_wrong_arguments(tmp_path, named, options, message):
    with pytest.raises(InputError, match=message):
        compress(named, tmp_path / "t.nc", **options)
    assert not list(tmp_path.iterdir())


def test_wrong_files(tmp_path):
    (tmp_path / "paint.xyz").write_text("1 2 3\n")
    (tmp_path / "paint.nc").write_text("1 2 3\n")
    (tmp_path / "empty").mkdir()
    for name, message in (
        ("paint.xyz", "unknown kind of file '.xyz'; give one of .binary"),
        (
            "paint.nc",
            "not a NetCDF-4 file; give one that `jaxrender compress` or `jaxrender measure`",
        ),
        ("empty", "holds no finished result"),
    ):
        with pytest.raises(InputError, match=message):
            source_of(str(tmp_path / name))
    with pytest.raises(InputError, match="no such folder"):
        compress(WIDE, tmp_path / "none" / "t.nc", size=4)
