"""Spherical harmonic reflection maps in files.

- What is read is what was written, bit for bit: both frames, both grids, both precisions, the
  weight and everything a map was made from.
- Others open the file, and find the value of a map with what stands in it alone.
- What no map is made of is refused by name, place and remedy.
"""

import h5netcdf
import numpy as np
import pytest
import scipy.special

from jaxrender.errors import InputError
from jaxrender.harmonics import CubeGrid, GaussLegendreGrid, LatLongGrid
from jaxrender.pipelines.shrm_files import read_about, read_shrm, write_shrm
from jaxrender.pipelines.shrm_layout import ShrmAbout
from jaxrender.reflection.shrm import GlobalShrm, LocalShrm

ABOUT = ShrmAbout(
    "probe.hdr",
    "phong:exponent=3",
    "probe",
    "reflected",
    "radiance",
    "cross",
    0.25,
    0.5,
    "F 3, P 1",
)


GRID = LatLongGrid(10, 20)


def a_map(kind=GlobalShrm, grid=GRID, dtype=np.float64, weighted=False):
    maps = np.random.default_rng(1).normal(size=(*grid.shape, 4, 3)).astype(dtype)
    return kind(maps, grid, 3, weighted)


@pytest.fixture
def path(tmp_path):
    write_shrm(tmp_path / "map.nc", a_map(), ABOUT)
    return tmp_path / "map.nc"


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("grid", [GRID, CubeGrid(4)])
@pytest.mark.parametrize("kind", [GlobalShrm, LocalShrm])
def test_round_trip(tmp_path, kind, grid, dtype):
    written = a_map(kind, grid, dtype, weighted=kind is LocalShrm)
    write_shrm(tmp_path / "map.nc", written, ABOUT)
    found, about = read_shrm(tmp_path / "map.nc")
    assert type(found) is kind
    assert (found.grid, found.band_limit, found.weighted) == (grid, 3, written.weighted)
    assert found.maps.dtype == dtype
    assert found.maps.tobytes() == written.maps.tobytes()
    assert about == ABOUT == read_about(tmp_path / "map.nc")
    assert [p.name for p in tmp_path.iterdir()] == ["map.nc"]


def test_what_is_not_known_stays_so(tmp_path):
    write_shrm(tmp_path / "map.nc", a_map(), ShrmAbout("light.exr", "lambertian"))
    about = read_about(tmp_path / "map.nc")
    assert np.isnan(about.light_missing)
    assert about.convention == about.comment == ""


def test_the_file_explains_itself(tmp_path):
    """A value from names, coordinates and sentences of the file, with SciPy's own harmonics."""
    xarray = pytest.importorskip("xarray")
    shrm = a_map(weighted=True)
    write_shrm(tmp_path / "map.nc", shrm, ABOUT)
    with xarray.open_dataset(tmp_path / "map.nc", engine="h5netcdf") as data:
        maps, attributes = data.maps.load(), data.attrs
        texel = maps.sel(row=4, column=7)
        centre_at = float(texel.polar_angle), float(texel.azimuth)
        p, q = texel.degree.values, texel.order.values
    assert maps.dims == ("row", "column", "outgoing", "channel")
    assert (attributes["frame"], attributes["axes"]) == ("global", "probe")
    assert "divide by cos t_o = sqrt((1 + C . o) / 2)" in attributes["weighted_meaning"]
    polar, azimuth = 0.7, 2.1
    wave = scipy.special.sph_harm_y(p, np.abs(q), polar, azimuth) * (-1.0) ** q
    around = np.where(q > 0, np.sqrt(2) * wave.real, np.where(q < 0, np.sqrt(2) * wave.imag, 0))
    around = np.where(q == 0, wave.real, around)
    centre, outgoing = (
        np.array([np.sin(t) * np.cos(f), np.sin(t) * np.sin(f), np.cos(t)])
        for t, f in (centre_at, (polar, azimuth))
    )
    value = np.einsum("kc,k->c", texel.values, around) / np.sqrt((1 + centre @ outgoing) / 2)
    expected = shrm.at(centre[None], outgoing[None])[0]
    np.testing.assert_allclose(value, expected, rtol=1e-10)


def test_a_cube_has_its_texels_directions(tmp_path):
    write_shrm(tmp_path / "map.nc", a_map(grid=CubeGrid(4)), ABOUT)
    with h5netcdf.File(tmp_path / "map.nc", "r") as file:
        assert file.variables["direction"].dimensions == ("row", "column", "component")
        np.testing.assert_array_equal(file["direction"][...], CubeGrid(4).directions())


@pytest.mark.parametrize(
    ("shrm", "about", "message"),
    [
        (a_map(grid=GaussLegendreGrid(10, 20)), ABOUT, "GlobalShrm on GaussLegendreGrid about"),
        (a_map(dtype=np.float16), ABOUT, "maps of float16: give finite float32 or float64"),
        (a_map(), ABOUT._replace(central_direction="half"), "about reflected or normal"),
        (a_map(), ABOUT._replace(axes="camera"), "in axes world or probe"),
        (a_map(weighted=True), ABOUT._replace(central_direction="normal"), "divide it out"),
    ],
)
def test_misuse_writes_nothing(tmp_path, shrm, about, message):
    with pytest.raises(ValueError, match=message):
        write_shrm(tmp_path / "map.nc", shrm, about)
    assert not list(tmp_path.iterdir())


def test_non_finite_maps_are_not_written(tmp_path):
    shrm = a_map()
    shrm.maps[2, 3, 1, 0] = np.inf
    with pytest.raises(ValueError, match="give finite"):
        write_shrm(tmp_path / "map.nc", shrm, ABOUT)
    with pytest.raises(InputError, match="no such folder"):
        write_shrm(tmp_path / "none" / "map.nc", a_map(), ABOUT)
    assert not list(tmp_path.iterdir())


CHANGED_ATTRIBUTES = {
    "frame": ("camera", "`frame` is 'camera'; wanted one of local, global"),
    "grid": ("octahedron", "wanted one of latitude-longitude, cube"),
    "weighted": (2, "`weighted` is 2; wanted one of 0, 1"),
    "band_limit": (-1, "`band_limit` is -1; wanted a whole number from 0"),
    "view_degree": (
        2,
        r"`maps` has 4 outgoing indices, and `view_degree` 2 wants \(P \+ 1\)\^2 = 9",
    ),
    "brdf": ([1.5, 2.5], r"`brdf` is \[1.5, 2.5\]; wanted a text"),
    "central_direction": ("up", "wanted one of reflected, normal"),
    "axes": ("own", "wanted one of world, probe"),
    "source": (3, "`source` is 3; wanted a text"),
    "light_missing": ("much", "`light_missing` is 'much'; wanted a number"),
}


@pytest.mark.parametrize("name", CHANGED_ATTRIBUTES)
def test_wrong_attributes(path, name):
    value, message = CHANGED_ATTRIBUTES[name]
    with h5netcdf.File(path, "a") as file:
        file.attrs[name] = value
    with pytest.raises(InputError, match=message):
        read_shrm(path)


def test_a_missing_attribute(path):
    with h5netcdf.File(path, "a") as file:
        del file.attrs["frame"]
    with pytest.raises(InputError, match=r"map\.nc: no attribute `frame`; write it again"):
        read_shrm(path)


def rewritten(path, change):
    """Copy a file's arrays, changed, into a new one: names to (dimensions, values)."""
    with h5netcdf.File(path, "r") as file:
        arrays = {n: (v.dimensions, np.asarray(v[...])) for n, v in file.variables.items()}
        attributes = dict(file.attrs)
    arrays = change(arrays)
    with h5netcdf.File(path, "w") as file:
        file.attrs.update(attributes)
        sizes = {}
        for dimensions, values in arrays.values():
            sizes |= zip(dimensions, values.shape)
        file.dimensions = sizes
        for name, (dimensions, values) in arrays.items():
            file.create_variable(name, dimensions, data=values)


def with_nan(values):
    values = values.copy()
    values[2, 3, 1, 0] = np.nan
    return values


CHANGED_ARRAYS = {
    "no maps": (lambda a: {n: v for n, v in a.items() if n != "maps"}, "no array `maps`"),
    "no degree": (lambda a: {n: v for n, v in a.items() if n != "degree"}, "no array `degree`"),
    "transposed": (
        lambda a: a | {"maps": (("column", "row", *a["maps"][0][2:]), a["maps"][1].swapaxes(0, 1))},
        r"has the dimensions \(column, row, outgoing, channel\); wanted \(row, column,",
    ),
    "other rows": (
        lambda a: a | {"polar_angle": (("row",), np.linspace(0, np.pi, 10))},
        "`polar_angle` is not that of this program's maps",
    ),
    "not a number": (
        lambda a: a | {"maps": (a["maps"][0], with_nan(a["maps"][1]))},
        "`maps` at row 2, column 3, outgoing 1, channel 0 is nan",
    ),
    "whole numbers": (
        lambda a: a | {"maps": (a["maps"][0], np.ones_like(a["maps"][1], np.int32))},
        "`maps` is int32; wanted float32 or float64",
    ),
}


@pytest.mark.parametrize("case", CHANGED_ARRAYS)
def test_wrong_arrays(path, case):
    change, message = CHANGED_ARRAYS[case]
    rewritten(path, change)
    with pytest.raises(InputError, match=message):
        read_shrm(path)


def test_no_cube(path):
    with h5netcdf.File(path, "a") as file:
        file.attrs["grid"] = "cube"
    with pytest.raises(InputError, match="10 rows and 20 columns are no cube"):
        read_shrm(path)


def test_no_opposite_columns(path):
    def narrower(arrays):
        cut = {"maps": lambda v: v[:, :-1], "azimuth": lambda v: v[:-1]}
        return {n: (d, cut.get(n, lambda v: v)(values)) for n, (d, values) in arrays.items()}

    rewritten(path, narrower)
    with pytest.raises(InputError, match="19 columns cannot be looked up over the poles"):
        read_shrm(path)
