"""Tables of a BRDF as NetCDF.

- What is written is read back bit for bit, in either precision, errors and attributes included.
- xarray reads the names of all dimensions; both embeddings are known by name.
- Numbers that are no measurements become zero and are counted.
- What is no table is refused by name.
"""

import h5netcdf
import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.geometry import EMBEDDINGS, NUSSELT
from jaxrender.io.tables import BRDFTable, read_table, write_table

SHAPE = (2, 3, 4, 5, 3)


def table(dtype=np.float64, embedding=NUSSELT):
    values = np.random.default_rng(0).random(SHAPE).astype(dtype)
    return BRDFTable(values, values / 100, embedding, 0, {"source": "a test", "samples": 7})


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("embedding", EMBEDDINGS.values(), ids=EMBEDDINGS)
def test_round_trip(tmp_path, dtype, embedding):
    given = table(dtype, embedding)
    write_table(tmp_path / "a.nc", given)
    found = read_table(tmp_path / "a.nc")
    assert found.values.dtype == dtype
    np.testing.assert_array_equal(found.values, given.values)
    np.testing.assert_array_equal(found.standard_errors, given.standard_errors)
    assert found.embedding == embedding
    assert found.masked == 0
    assert found.about == given.about
    assert [path.name for path in tmp_path.iterdir()] == ["a.nc"]


def test_others_read_it(tmp_path):
    xarray = pytest.importorskip("xarray")
    write_table(tmp_path / "a.nc", table())
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as found:
        assert found["brdf"].dims == ("kappa_i", "lambda_i", "kappa_r", "lambda_r", "channel")
        np.testing.assert_allclose(found["lambda_i"], [1 / 6, 1 / 2, 5 / 6])
        assert found["brdf"].attrs["units"] == "1/sr"
        assert "Z the normal" in found.attrs["convention"]


def test_errors_may_be_missing_and_numbers_broken(tmp_path):
    values = table().values
    values[0, 1, 2, 3, 0], values[1, 1, 1, 1, 1], values[0, 0, 0, 0, 2] = np.nan, -0.5, np.inf
    write_table(tmp_path / "a.nc", BRDFTable(values, None))
    found = read_table(tmp_path / "a.nc")
    assert found.standard_errors is None
    assert found.masked == 3
    assert found.values[0, 1, 2, 3, 0] == 0
    assert (found.values >= 0).all()


def test_an_unknown_embedding_is_refused(tmp_path):
    write_table(tmp_path / "a.nc", table())
    with h5netcdf.File(tmp_path / "a.nc", "a") as file:
        file.attrs["embedding"] = "mercator"
    with pytest.raises(
        InputError, match=r"a\.nc: `embedding` is 'mercator'; wanted one of nusselt"
    ):
        read_table(tmp_path / "a.nc")


def test_other_dimensions_are_refused(tmp_path):
    path = tmp_path / "a.nc"
    with h5netcdf.File(path, "w") as file:
        file.attrs.update({"format": "jaxrender BRDF table", "format_version": 1})
        file.attrs["embedding"] = "nusselt"
        file.dimensions = {"row": 3}
        file.create_variable("brdf", ("row",), data=np.zeros(3))
    with pytest.raises(InputError, match="row"):
        read_table(path)


def test_nothing_impossible_is_written(tmp_path):
    given = table()
    with pytest.raises(ValueError, match="one shape"):
        write_table(tmp_path / "a.nc", given._replace(standard_errors=given.values[:1]))
    with pytest.raises(InputError, match="no such folder"):
        write_table(tmp_path / "b" / "a.nc", given)
    assert not list(tmp_path.iterdir())
