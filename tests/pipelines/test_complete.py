"""``jaxrender complete``: a folder of MERL files and few measurements become a whole table.

- What cannot be done is refused before anything is learnt, with the file's name and the remedy.
- The table is near to the material at pairs that were not measured, about as near as is said.
- What was learnt is kept: the second run reads no table.
"""

import json

import numpy as np
import pytest

from jaxrender.brdf import Microfacet
from jaxrender.errors import InputError
from jaxrender.io import MerlTable, read_merl, write_merl
from jaxrender.pipelines import complete as completing
from jaxrender.pipelines.complete import complete_samples

MATERIAL = Microfacet(np.full(3, 0.08), np.full(3, 0.1), 0.25, 1.5)
FLAT = "3 450 550 650\n" + "0.3 0 0.4 1 0.1 0.1 0.1\n" * 3


def pairs(count, seed):
    """Polar angles and azimuths of both directions, half of the pairs near the mirror."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0, [1.2, 3.1, 1.2, 6.2], (count, 4))
    angles[::2, 2], angles[::2, 3] = angles[::2, 0], angles[::2, 1] + np.pi
    return angles


def directions(polar, azimuth):
    across = np.sin(polar)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), np.cos(polar)], axis=1)


def values_at(brdf, angles):
    return np.asarray(brdf.evaluate(directions(*angles[:, :2].T), directions(*angles[:, 2:].T)))


@pytest.mark.parametrize(
    ("samples", "out", "following", "message"),
    [
        ("paint.brdf", "paint.nc", 0, "paint.nc: the table is written as MERL's"),
        (None, "paint.binary", 0, "nothing was measured that could be completed; give SAMPLES"),
        ("paint.brdf", None, 0, "nothing to do: give --out"),
        ("none.brdf", None, 1, "none.brdf: no such file; give a file of scattered"),
        ("whole.binary", None, 1, "whole.binary: a whole BRDF, and no scattered measurements"),
        ("paint.brdf", None, 1, "materials: 0 MERL files .* give a folder of at least 5"),
    ],
)
def test_what_cannot_be_done_is_refused(tmp_path, samples, out, following, message):
    (tmp_path / "paint.brdf").write_text(FLAT)
    (tmp_path / "whole.binary").write_bytes(b"\0")
    (tmp_path / "materials").mkdir()
    named = [None if name is None else tmp_path / name for name in (samples, out)]
    with pytest.raises(InputError, match=message):
        complete_samples(named[0], tmp_path / "materials", named[1], following=following)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["materials", "paint.brdf", "whole.binary"]


@pytest.mark.slow
def test_a_table_from_forty_measurements(tmp_path, monkeypatch):
    folder = tmp_path / "materials"
    folder.mkdir()
    rng = np.random.default_rng(0)
    for number in range(8):
        kd, ks = rng.uniform(0.02, 0.2, (2, 3))
        other = Microfacet(kd, ks, float(rng.uniform(0.15, 0.4)), 1.5)
        write_merl(folder / f"{number}.binary", MerlTable.of(other))
    angles = pairs(40, seed=1)
    rows = [
        " ".join(f"{number:.6f}" for number in (*row, *values))
        for row, values in zip(angles, values_at(MATERIAL, angles))
    ]
    samples, out = tmp_path / "paint.brdf", tmp_path / "paint.binary"
    samples.write_text("3 450 550 650\n" + "\n".join(rows) + "\n")
    done = complete_samples(samples, folder, out, following=3, components=10)
    elsewhere = pairs(500, seed=2)
    found = values_at(read_merl(out).brdf(), elsewhere)
    error = np.abs(found / values_at(MATERIAL, elsewhere) - 1)
    numbers = json.loads((tmp_path / "paint.binary.json").read_text())
    assert np.median(error) < 0.03
    assert np.median(error) < 2 * numbers["relative_error_median"]
    assert numbers["measurements"] == 40
    assert len(done.pairs.remaining) == 3
    assert sum("%" in line and ":" in line for line in done.said) >= 3

    def unread(*_):
        raise AssertionError("what was learnt is read again")

    monkeypatch.setattr(completing, "map_merl", unread)
    complete_samples(samples, folder, following=1, components=10)
    with pytest.raises(AssertionError, match="read again"):
        complete_samples(samples, folder, following=1, components=9)
