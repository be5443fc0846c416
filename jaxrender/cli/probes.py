"""The commands about light: ``prefilter``, ``analyze`` and ``light``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from jaxrender.cli import process
from jaxrender.cli.app import DONE, app, examples
from jaxrender.cli.reporting import AS_USUAL, Reporting
from jaxrender.errors import InputError

# Order and degree of the nine coefficients, as T table 4.1 lists them.
_HARMONICS = ("00", "1-1", "10", "11", "2-2", "2-1", "20", "21", "22")


@app.command(
    help_epilogue=examples(
        "prefilter probe.exr --out maps",
        "prefilter probe.hdr --out maps --convention angular --brdf phong:exponent=32 --shrm",
    )
)
def prefilter(
    probe: Path,
    /,
    *,
    out: Path,
    convention: str = "z-up",
    axes: Literal["probe", "world"] = "probe",
    brdf: list[str] | None = None,
    shrm: bool = False,
    tolerance: float | None = None,
    view_degree: int | None = None,
    degree: int | None = None,
    window: str = "none",
    force: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Filter a light probe for rendering: irradiance coefficients, and a map for each lobe.

    irradiance.json holds the nine coefficients and their 4 x 4 matrices.  Each lobe gives a
    latitude-longitude image and the cross of a cube, both EXR.  A contact sheet shows them all.

    Parameters
    ----------
    probe
        Panorama of radiance (EXR, HDR or PFM).
    out
        Folder to write into.
    convention
        Layout of the panorama: z-up, y-up, angular, cross or mirror-ball.
    axes
        Axes of the results: probe (its own axes) or world (those of the scene).
    brdf
        A lobe such as phong:exponent=32 or microfacet:sigma=0.1, or a material: a file of
        measurements, a table, a tree or a result folder.  May be given several times.
    shrm
        Also write a spherical harmonic reflection map of each lobe (NAME_shrm.nc).  Its texels
        depend on the viewer.  NAME_shrm.png shows a sphere to six viewers.
    tolerance
        Part of a lobe's energy that its reflection map may miss; 0.03 by default.  Small bright
        sources still ring at 0.03, but not at 0.003.  The command prints the degrees it needs.
    view_degree
        Degree P of the viewer's direction, 0 to 12; by default chosen by tolerance.  A map has
        (P + 1)^2 parts.  Lobes of one angle, such as lambertian, always have P = 0.
    degree
        Degree F of the light's direction; by default chosen by tolerance.  At most 128, and at
        most what the probe resolves.
    window
        Removes the dark rings that a truncated lobe draws around small bright sources: hann,
        lanczos, or minimal (no stronger than a lobe needs).  none keeps the lobes as they are.
    force
        Replace an earlier result of another probe.
    """
    options = {"tolerance": tolerance, "view-degree": view_degree, "degree": degree}
    for name, value in options.items():
        if value is not None and not shrm:
            raise InputError(f"--{name} goes with --shrm; add that, or leave --{name} out")
    process.set_up_jax()
    from jaxrender.pipelines import prefilter as prefiltering
    from jaxrender.pipelines.lobe_orders import TOLERANCE, OrdersGoal

    lobes = tuple(brdf) if brdf else prefiltering.DEFAULT_LOBES
    goal = OrdersGoal(TOLERANCE if tolerance is None else tolerance, view_degree, degree)
    done = prefiltering.prefilter(
        probe,
        out,
        convention,
        axes,
        lobes,
        force=force,
        progress=reporting.progress(),
        shrm=goal if shrm else None,
        window=window,
    )
    for name, row in zip(_HARMONICS, done.coefficients.tolist()):
        process.say(f"L{name:4s}" + "".join(f"{value:12.5g}" for value in row))
    for line in done.reflection:
        process.say(line)
    process.say(f"maps: {out}")
    return DONE


@app.command(
    help_epilogue=examples(
        "analyze configs/teflon_sphere.yaml --suppose sigma=0.1",
        "analyze probe.exr --brdf microfacet:sigma=0.2 --figure spectra.png",
    )
)
def analyze(
    subject: Path,
    /,
    *overrides: str,
    convention: str = "z-up",
    brdf: list[str] | None = None,
    band_limit: int | None = None,
    tolerance: float | None = None,
    noise: float | None = None,
    samples: int = 12_000,
    figure: Path | None = None,
    suppose: list[str] | None = None,
    suggest: Literal["views", "sources"] | None = None,
    aim: str = "worst",
    count: int = 5,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Predict what photographs can determine, before they are taken.

    With a config: the standard errors that a fit will state, the identifiable degrees of the light,
    and why something is not identifiable.  The material is supposed: from --suppose, the config's
    fixed or start values, its recipe, or a typical plastic.  With a panorama: the spectra of light
    and BRDF, the well-posed degrees, and the degrees that a rendering needs.

    Parameters
    ----------
    subject
        A run's config (.yaml, .yml), or a panorama of radiance (EXR, HDR or PFM).  Of a config only
        cameras, shape and light need exist.
    overrides
        Values that replace those of the config, such as samples.min_cosine=0.3.
    convention
        Layout of the panorama: z-up, y-up, angular, cross or mirror-ball.
    brdf
        With a panorama: a lobe such as phong:exponent=32 or microfacet:sigma=0.1; may be given
        several times.
    band_limit
        The highest degree.  Default: 32 for a panorama, chosen by the roughness for a config.
    tolerance
        With a panorama: the part of the energy that the degrees of light and viewer may miss; 0.03
        by default.
    noise
        Standard deviation of a sample, relative to the reflected light.  Default: that of the
        config, or 0.01.
    samples
        With a panorama: the number of samples in all photographs.
    figure
        Picture of spectra and predicted errors to write (PNG, PDF or SVG).
    suppose
        With a config: a number of the material, such as sigma=0.1 or kd=0.3,0.2,0.1; may be given
        several times.
    suggest
        Rank further camera positions or sources by what one more photograph would add.
    aim
        The parameter that suggestions should improve, by the model's own name, or worst.
    count
        Number of suggestions to print.
    """
    if subject.suffix.lower() in (".yaml", ".yml"):
        if brdf:
            raise InputError("--brdf goes with a panorama; with a config: --suppose sigma=0.1")
        if tolerance is not None:
            raise InputError("--tolerance goes with a panorama; leave it out with a config")
        from jaxrender.pipelines.config import load_run_config

        config = load_run_config(process.bundled(subject), overrides)
        process.set_up_jax()
        from jaxrender.pipelines.analysis import Options, analyze_config

        options = Options(tuple(suppose or ()), noise, band_limit, figure, suggest, aim, count)
        process.say(analyze_config(config, options, reporting.progress()).text)
    else:
        if overrides or suppose or suggest:
            raise InputError(
                f"{subject}: overrides, --suppose and --suggest go with a run's config (.yaml), "
                "not with a panorama"
            )
        process.set_up_jax()
        from jaxrender.pipelines import analyze as analysis

        lobes = tuple(brdf) if brdf else analysis.DEFAULT_LOBES
        relative = analysis.DEFAULT_MEASUREMENT.noise if noise is None else noise
        limit = 32 if band_limit is None else band_limit
        with reporting.progress().stage("analyze"):
            found = analysis.analyze(
                subject,
                convention,
                lobes,
                limit,
                analysis.Measurement(relative, samples),
                tolerance=analysis.TOLERANCE if tolerance is None else tolerance,
            )
        if figure is not None:
            found.draw(figure)
        process.say(found.table.rstrip())
    if figure is not None:
        process.say(f"figure: {figure}")
    return DONE


@app.command(
    help_epilogue=examples(
        "light ball_1.jpg ball_2.jpg ball_3.jpg --ball 550 756 69 --out probe",
        "light sky_1.jpg sky_2.jpg sky_3.jpg --fisheye 180 --out probe",
    )
)
def light(
    *photographs: Path,
    out: Path,
    response: str | None = None,
    exposures: list[float] | None = None,
    exposure: Literal["stated", "measured"] = "stated",
    ball: tuple[float, float, float] | None = None,
    mask: Path | None = None,
    fisheye: float | None = None,
    panorama: bool = False,
    focal: float | None = None,
    reflectance: float | None = None,
    camera_angle: float | None = None,
    height: int | None = None,
    sigma: float = 0.1,
    align: bool = False,
    shift: float = 0.5,
    force: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Make an environment from photographs of a mirror ball, or of the light itself.

    probe.exr is the light as a latitude-longitude image (z-up), deviation.exr its standard
    deviation, confidence.exr how well each direction was seen.  light.json states what was done,
    and lists the lamps; light.png shows it.

    Parameters
    ----------
    photographs
        One view of the ball, or of the light, at one exposure or several, or a transforms.json with
        several views.  Without one the camera looks along +Y, with +Z up.
    out
        Folder to write into.
    response
        Of PNG, JPEG, TGA and TIFF: linear, srgb, or the file of a curve.  recover finds it from
        several exposures, which is the default for these.
    exposures
        Of each photograph, in seconds; by default those of the files.
    exposure
        measured replaces the ratios of the exposures by what the pixels tell.
    ball
        Row, column and radius of the ball's outline in pixels, from the top left corner.  Without
        it, and without a mask, the ball is found by its edges.
    mask
        A picture that is white on the ball.
    fisheye
        The photographs show the light itself, in a circle as high as the picture, or as wide where
        that is less.  Its angle of view in degrees; distance from the middle is the angle.  Other
        fisheyes are stated in a transforms.json; the angle is then where they end.
    panorama
        The photographs are panoramas of all directions, twice as wide as high, level, +Y in the
        middle.
    focal
        Focal length in pixels.  Without it, and without a transforms.json, the camera is distant.
    reflectance
        Of the ball; by default 0.65, that of chromium.
    camera_angle
        Degrees about the camera's own reflection in the ball that are left out; 5 by default.
    height
        Rows of the environment; by default the ball's radius in pixels, or what a lens resolves, at
        most 512.
    sigma
        Roughness at which light counts as slow, for the list of lamps.
    align
        Move photographs of a camera that did not stand still back, by whole pixels.
    shift
        The largest movement between photographs, in pixels, that is let pass.
    force
        Replace an earlier result.
    """
    process.set_up_jax()
    from jaxrender.pipelines import light_probe as probing
    from jaxrender.pipelines.probe_views import Reading

    times = None if exposures is None else tuple(exposures)
    if fisheye is not None and panorama:
        raise InputError("--fisheye and --panorama are two kinds of photographs: give one of them")
    lens = "fisheye" if fisheye is not None else "panorama" if panorama else None
    if lens is not None and (reflectance is not None or camera_angle is not None):
        raise InputError(f"--{lens} shows no ball: leave out --reflectance and --camera-angle")
    field = 360.0 if fisheye is None else fisheye
    reading = Reading(response, times, exposure, align, shift, focal, lens, field)
    share = 0.65 if reflectance is None else reflectance
    angle = 5.0 if camera_angle is None else camera_angle
    options = probing.ProbeOptions(reading, mask, ball, share, angle, height, sigma)
    done = probing.light_probe(photographs, out, options, reporting.progress(), force)
    for line in done.lines:
        process.say(line)
    process.say(f"light: {out}")
    return DONE
