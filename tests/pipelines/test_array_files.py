"""Every kind of NetCDF file that the program reads, as others leave it.

- One that is missing, cut short or of another kind is refused by name, with the command that writes
  it; so is a result without what a task's result holds.
"""

import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.harmonics import LatLongGrid
from jaxrender.inverse.intervals import Uncertain
from jaxrender.inverse.parameters import Parameters
from jaxrender.io import BRDFTable, TreeAbout, read_table, read_tree, write_table, write_tree
from jaxrender.io.netcdf import Format, Group, write
from jaxrender.pipelines.brdf_sources import source_of
from jaxrender.pipelines.deviation import covariance_groups, read_covariance
from jaxrender.pipelines.result import ARRAYS_FORMAT
from jaxrender.pipelines.shrm_files import read_about, read_shrm, write_shrm
from jaxrender.pipelines.shrm_layout import ShrmAbout
from jaxrender.pipelines.tasks.brdf_spectrum import read_spectrum
from jaxrender.reflection.shrm import GlobalShrm
from jaxrender.wavelets import CoefficientTree, haar

MATRIX = np.diag(np.arange(1.0, 12.0))


def a_tree(path):
    tree = CoefficientTree.of_coefficients(haar(), np.ones((4, 4, 4, 4, 3)))
    write_tree(path, tree, TreeAbout("a test"))


def a_table(path):
    write_table(path, BRDFTable(np.ones((4, 4, 4, 4, 3)), None))


def a_map(path):
    grid = LatLongGrid(8, 16)
    write_shrm(path, GlobalShrm(np.ones((*grid.shape, 4, 3)), grid, 3), ShrmAbout("a", "b"))


def a_covariance(path):
    one, three = np.ones(()), np.ones(3)
    numbers = {"sigma": one, "mu": one}
    parameters = Parameters({"kd": three, "ks": three}, numbers, np.ones(2), one)
    found = Uncertain(*[parameters] * 4, MATRIX)
    write(path, ARRAYS_FORMAT, Group(groups=covariance_groups(found)))


KINDS = {
    "tree": (a_tree, read_tree, "jaxrender compress"),
    "table": (a_table, read_table, "jaxrender measure"),
    "map": (a_map, read_shrm, "jaxrender prefilter --shrm"),
    "about a map": (a_map, read_about, "jaxrender prefilter --shrm"),
    "covariance": (a_covariance, read_covariance, "jaxrender fit --force"),
    "spectrum": (a_covariance, read_spectrum, "jaxrender fit --force"),
    "tree or table": (a_tree, lambda path: source_of(str(path)), "jaxrender compress"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_such_file_is_refused(tmp_path, kind):
    made, read, command = KINDS[kind]
    path = tmp_path / "a.nc"
    with pytest.raises(InputError, match=r"a\.nc: no such file; mend the path"):
        read(path)
    made(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=rf"a\.nc: damaged or cut short .*write.*`{command}`"):
        read(path)
    write(path, Format("a song", 1, "singer"), Group())
    with pytest.raises(
        InputError, match=r"a\.nc: `format` is 'a song'; wanted .*jaxrender .* wrote"
    ):
        read(path)


def test_a_covariance_is_read_as_written(tmp_path):
    a_covariance(tmp_path / "a.nc")
    found = read_covariance(tmp_path / "a.nc")
    np.testing.assert_array_equal(found.matrix, MATRIX)
    assert found.channels == 3


def test_a_result_of_another_task_has_no_coefficients(tmp_path):
    a_covariance(tmp_path / "a.nc")
    with pytest.raises(
        InputError, match=r"a\.nc: no group `spectrum`; write it again with `jaxrender"
    ):
        read_spectrum(tmp_path / "a.nc")
