"""``jaxrender prefilter --shrm`` and the orders that ``jaxrender analyze`` prints.

- A sphere shaded by the file of a microfacet lobe is the reflection integral's, within what the
  tolerance leaves out; that of lobes of one angle is exact, about the normal for Lambert.
- Orders are chosen by the tolerance, or given; where none suffice that is said with what is left.
- What cannot be is refused before anything is written; an identical run is reused.

Tolerances: maps are written in float32 and interpolated between ten rows a degree, 1e-2.
"""

import numpy as np
import pytest

from jaxrender.cli import main
from jaxrender.errors import InputError
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import LatLongGrid, analyse, apply_transfer, evaluate
from jaxrender.io import write_image
from jaxrender.pipelines.lobe_orders import OrdersGoal, lobe_orders, spectrum_of_lobe
from jaxrender.pipelines.lobes import lobe_of
from jaxrender.pipelines.reflection_maps import LightSpectrum, reflection_map
from jaxrender.pipelines.shrm_files import read_about, read_shrm
from jaxrender.pipelines.shrm_layout import ShrmAbout
from jaxrender.pipelines.sphere_views import sphere_pixels, sphere_radiance
from jaxrender.reflection import polar_columns
from jaxrender.spectra import central_spectrum_of, missing_energy

LIGHT = np.random.default_rng(5).normal(size=(16, 3)) * 0.2
LIGHT[0] = 4


def radiance_of(directions):
    return evaluate(LIGHT, directions)


@pytest.fixture
def probe(tmp_path):
    grid = LatLongGrid(32, 64)
    pixels = np.asarray(radiance_of(grid.directions().reshape(-1, 3))).reshape(32, 64, 3)
    write_image(tmp_path / "probe.exr", pixels)
    return tmp_path / "probe.exr"


def prefilter(probe, *arguments, out="out"):
    folder = probe.parent / out
    return main(["prefilter", str(probe), "--out", str(folder), *arguments]), folder


def sphere(shrm, about, least_cosine):
    towards = np.array([0.6, 0.0, 0.8])
    _, normals = sphere_pixels(towards, np.array([0, 0, 1.0]), 16)
    normals = normals[normals @ towards > least_cosine]
    values = sphere_radiance(shrm, normals, towards, about.central_direction == "normal")
    return SurfaceSamples(normals, np.broadcast_to(towards, normals.shape).copy()), values


@pytest.mark.slow
def test_a_microfacet_sphere_is_the_integrals(probe, capsys):
    arguments = ("--brdf", "microfacet:sigma=0.4", "--shrm", "--tolerance", "0.01")
    code, folder = prefilter(probe, *arguments)
    assert code == 0
    printed = capsys.readouterr().out
    shrm, about = read_shrm(folder / "microfacet_sigma_0.4_shrm.nc")
    assert f"microfacet_sigma_0.4_shrm.nc: {about.comment}\n" in printed
    assert f"F {shrm.band_limit}, P {shrm.order}: {(shrm.order + 1) ** 2} maps of" in about.comment
    assert shrm.weighted
    assert shrm.maps.dtype == np.float32
    assert shrm.grid.height >= 10 * shrm.band_limit
    assert (about.central_direction, about.convention) == ("reflected", "z-up")
    assert about.brdf_missing < 0.01
    assert about.light_missing < 1e-6
    samples, found = sphere(shrm, about, 0.15)
    brdf = lobe_of("microfacet:sigma=0.4").brdf
    wanted = np.asarray(polar_columns(brdf, samples, radiance_of, 32)[:, 1])
    cosines = np.asarray(samples.exit_cosines)
    # What is left out of the lobe is B cos t_o; divided by the cosine it shows towards grazing.
    for least_cosine, bound in ((0.5, 0.01), (0.15, 0.03)):
        seen = cosines > least_cosine
        error = np.sqrt(np.sum((found - wanted)[seen] ** 2) / np.sum(wanted[seen] ** 2))
        assert error < bound
    assert (folder / "microfacet_sigma_0.4_shrm.png").stat().st_size > 10_000


@pytest.mark.parametrize("name", ["lambertian", "phong:exponent=6,clipped=false"])
def test_lobes_of_one_angle_are_exact(name):
    lobe = lobe_of(name)
    light = LightSpectrum(LIGHT, float(np.sum(LIGHT**2)))
    found = reflection_map(light, lobe, OrdersGoal(light=3), ShrmAbout("", "", axes="world"))
    assert found.shrm.order == 0
    assert not found.shrm.weighted
    samples, values = sphere(found.shrm, found.about, 0)
    is_diffuse = name == "lambertian"
    assert found.about.central_direction == ("normal" if is_diffuse else "reflected")
    centres = samples.normals if is_diffuse else samples.reflected
    wanted = evaluate(apply_transfer(LIGHT, lobe.transfer(3)), centres)
    np.testing.assert_allclose(values, wanted, rtol=1e-2)
    if is_diffuse:
        integral = polar_columns(lobe.brdf, samples, radiance_of)[:, 0]
        np.testing.assert_allclose(values, integral, rtol=1e-2)


def test_energies_of_lobes_of_one_angle():
    """What Lambert leaves out beyond degree 2 is .0078 of the energy; Phong's by quadrature."""
    lambert = missing_energy(spectrum_of_lobe(lobe_of("lambertian"), (40, 0)))[:, 0]
    assert lambert[2] == pytest.approx(1 - (1 / 4 + 1 / 3 + 5 / 64) * 1.5, abs=1e-12)
    assert 0 < lambert[-1] < 1e-5
    own = spectrum_of_lobe(lobe_of("phong:exponent=6,clipped=false"), (20, 0))
    head_on = central_spectrum_of(lobe_of("phong:exponent=6").brdf, (20, 0))
    # The horizon takes a little of the clipped lobe away.
    assert float(own.energy[0]) == pytest.approx(float(head_on.energy[0]), rel=0.15)
    assert missing_energy(own)[-1, 0] == pytest.approx(0, abs=1e-9)


@pytest.mark.slow
def test_orders_are_chosen_or_given():
    lobe = lobe_of("microfacet:sigma=0.4")
    free = lobe_orders(lobe, OrdersGoal(0.03))
    assert free.reached
    assert free.orders.missing < 0.03
    missing = missing_energy(free.spectrum)
    light, viewer = free.orders.light, free.orders.viewer
    assert missing[light - 1, viewer] >= 0.03
    assert missing[-1, viewer - 1] >= 0.03
    short = lobe_orders(lobe, OrdersGoal(0.03, light=2))
    assert not short.reached
    assert short.orders.light == 2
    assert short.orders.missing < short.least_missing + 0.03
    both = lobe_orders(lobe, OrdersGoal(0.03, viewer=1, light=4))
    assert both.orders[:2] == (4, 1)
    # A lobe of one angle has no dependence on the viewer to give a degree to.
    for light in (None, 3):
        given = lobe_orders(lobe_of("lambertian"), OrdersGoal(0.03, viewer=2, light=light))
        assert given.orders[:2] == (light or 2, 0)
        assert given.kept.band_limits == given.orders[:2]
    # Light of few degrees needs no more of the lobe.
    assert lobe_orders(lobe, OrdersGoal(0.03), carried=3).orders.light <= 3
    with pytest.raises(InputError, match="a mirror's spectrum never ends"):
        lobe_orders(lobe_of("mirror"), OrdersGoal())


def test_given_degrees_and_reuse(probe, capsys):
    arguments = ("--brdf", "phong:exponent=40", "--shrm", "--degree", "4", "--view-degree", "1")
    code, folder = prefilter(probe, *arguments)
    assert code == 0
    first = capsys.readouterr().out
    path = folder / "phong_exponent_40_shrm.nc"
    shrm, about = read_shrm(path)
    assert (shrm.band_limit, shrm.order, shrm.weighted) == (4, 1, False)
    assert "above the tolerance of 3 %: as asked for" in about.comment
    written = path.stat().st_mtime_ns
    assert prefilter(probe, *arguments)[0] == 0
    again = capsys.readouterr()
    assert again.out == first
    assert "reused" in again.err
    assert path.stat().st_mtime_ns == written
    # Other degrees are another run.
    assert prefilter(probe, *arguments[:-1], "2")[0] == 2
    assert "--force" in capsys.readouterr().err
    assert read_about(path) == about


def test_a_window_is_named_with_what_it_does(probe, capsys):
    arguments = ("--brdf", "phong:exponent=40,clipped=false", "--shrm", "--degree", "4")
    code, folder = prefilter(probe, *arguments, "--window", "lanczos")
    assert code == 0
    (path,) = folder.glob("*_shrm.nc")
    shrm, about = read_shrm(path)
    assert "of its peak through the window lanczos, -13 % without" in about.comment
    # Degree 0 is what it was, the mean over the sphere.
    assert prefilter(probe, *arguments, out="plain")[0] == 0
    plain, _ = read_shrm(folder.parent / "plain" / path.name)
    mean, unchanged = (np.asarray(analyse(m.grid, m.maps[:, :, 0], 0)) for m in (shrm, plain))
    np.testing.assert_allclose(mean, unchanged, rtol=1e-5)
    assert np.ptp(shrm.maps) < 0.95 * np.ptp(plain.maps)


def test_sharper_than_the_probe(probe, capsys):
    lobe = "phong:exponent=9000,clipped=false"
    assert prefilter(probe, "--brdf", lobe, "--shrm")[0] == 0
    assert "F 15, all that the probe carries, and P 0 do not suffice" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--shrm", "--brdf", "mirror"), "a mirror has no spherical harmonic reflection map"),
        (("--tolerance", "0.1"), "--tolerance goes with --shrm"),
        (("--degree", "3"), "--degree goes with --shrm"),
        (("--view-degree", "3"), "--view-degree goes with --shrm"),
        (("--shrm", "--tolerance", "1"), "--tolerance 1: give a part of the energy"),
        (("--shrm", "--view-degree", "13"), "--view-degree 13: give a degree from 0 to 12"),
        (("--shrm", "--view-degree", "-1"), "--view-degree -1: give a degree from 0"),
        (("--shrm", "--degree", "16"), "give a degree from 0 to 15; the probe carries 15"),
        (("--shrm", "--degree", "129"), "give a degree from 0 to 128; a map is made to 128"),
    ],
)
def test_bad_input_writes_nothing(probe, capsys, arguments, message):
    code, folder = prefilter(probe, *arguments)
    assert code == 2
    assert message in capsys.readouterr().err
    assert not folder.exists()


def test_a_dark_probe(tmp_path, capsys):
    write_image(tmp_path / "dark.exr", np.zeros((8, 16, 3)))
    code, folder = prefilter(tmp_path / "dark.exr", "--shrm", "--brdf", "lambertian")
    assert code == 2
    assert "dark.exr: light without energy" in capsys.readouterr().err
    assert not folder.exists()


def analyzed(probe, capsys, *arguments):
    assert main(["analyze", str(probe), "--band-limit", "4", *arguments]) == 0
    return capsys.readouterr().out


def test_analysis_tells_the_orders(probe, capsys):
    sharp = "phong:exponent=9000,clipped=false"
    text = analyzed(probe, capsys, "--brdf", "lambertian", "--brdf", "mirror", "--brdf", sharp)
    assert "orders for 3 % missing energy: F 2, P 0 (of light alone: F 1); maps of 20" in text
    assert "rows, one explicit view\n" in text
    assert "none for a mirror, which passes every degree (of light alone: F" in text
    assert "orders for 3 % missing energy: above F 64, P 0, which leave 63 %" in text
    assert "  beyond degree 2 of this light: at most" in text


def test_analysis_to_a_tolerance(probe, capsys):
    text = analyzed(probe, capsys, "--brdf", "microfacet:sigma=0.4", "--tolerance", "0.1")
    assert "orders for 10 % missing energy: F " in text
    assert "explicit views\n" in text or "one explicit view\n" in text
    assert main(["analyze", str(probe), "--tolerance", "0"]) == 2
    assert "--tolerance 0: give a part of the energy between 0 and 1" in capsys.readouterr().err
    config = probe.parent / "run.yaml"
    config.write_text("task: brdf\n")
    assert main(["analyze", str(config), "--tolerance", "0.1"]) == 2
    assert "--tolerance goes with a panorama" in capsys.readouterr().err
