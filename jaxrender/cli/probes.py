"""Light probes: ``prefilter`` them for rendering, ``analyze`` what they let a camera tell."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from jaxrender.cli import process
from jaxrender.cli.app import DONE, app
from jaxrender.errors import InputError

# Order and degree of the nine coefficients, as T table 4.1 lists them.
_HARMONICS = ("00", "1-1", "10", "11", "2-2", "2-1", "20", "21", "22")


@app.command
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
) -> int:
    """Filter a light probe for rendering: irradiance coefficients, and a map for each lobe.

    Parameters
    ----------
    probe
        Panorama of radiance (EXR, HDR or PFM).
    out
        Folder to write into.
    convention
        Its layout: z-up, y-up, angular, cross or mirror-ball.
    axes
        Whose axes the results are in: the probe's own, or the scene's.
    brdf
        A lobe such as phong:exponent=32 or microfacet:sigma=0.1; may be given several times.
    shrm
        Write of each lobe also a spherical harmonic reflection map, whose texels depend on the
        viewer (NAME_shrm.nc), and a sphere seen by six viewers (NAME_shrm.png).
    tolerance
        Part of a lobe's energy that its reflection map may miss; 0.03 if not given, at which small
        bright lamps still ring, 0.003 shows none. The degrees that it needs are printed.
    view_degree
        Degree P of the viewer's direction, in place of the chosen one: (P + 1)^2 maps; 0 to 12.
        Lobes of one angle, such as lambertian, have P = 0 in any case.
    degree
        Degree F of the light's direction, in place of the chosen one; at most 128, and what the
        probe carries.
    window
        Takes off the dark rings that a lobe cut at a degree draws around small bright lamps: hann,
        lanczos, or minimal, which is no stronger than a lobe needs; none keeps lobes as they are.
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
    from jaxrender.pipelines.progress import choose

    lobes = tuple(brdf) if brdf else prefiltering.DEFAULT_LOBES
    goal = OrdersGoal(TOLERANCE if tolerance is None else tolerance, view_degree, degree)
    done = prefiltering.prefilter(
        probe,
        out,
        convention,
        axes,
        lobes,
        force=force,
        progress=choose(sys.stderr),
        shrm=goal if shrm else None,
        window=window,
    )
    for name, row in zip(_HARMONICS, done.coefficients.tolist()):
        process.say(f"L{name:4s}" + "".join(f"{value:12.5g}" for value in row))
    for line in done.reflection:
        process.say(line)
    process.say(f"maps: {out}")
    return DONE


@app.command
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
    suggest: Literal["views", "lights"] | None = None,
    aim: str = "worst",
    count: int = 5,
) -> int:
    """Say what photographs could tell before they are taken: of a run's config, or under a light.

    Parameters
    ----------
    subject
        Config of a run (.yaml, .yml), of which only cameras, shape and light need exist; or a
        panorama of radiance (EXR, HDR or PFM).
    overrides
        Values written over the config's, such as samples.min_cosine=0.3.
    convention
        The panorama's layout: z-up, y-up, angular, cross or mirror-ball.
    brdf
        A lobe such as phong:exponent=32 or microfacet:sigma=0.1 to go with a panorama; may be given
        several times.
    band_limit
        The highest degree to look at; 32 for a panorama, chosen from the roughness for a config.
    tolerance
        Part of an energy that the orders of light and viewer may leave out, with a panorama; 0.03
        if not given.
    noise
        Standard deviation of a sample, as a part of the reflected light; the config's, or 0.01.
    samples
        How many samples the photographs have, with a panorama.
    figure
        Picture of spectra and predicted errors to write (PNG, PDF or SVG).
    suppose
        What to suppose of a config's material, such as sigma=0.1 or kd=0.3,0.2,0.1; may be given
        several times.
    suggest
        Rank further camera positions or lamps by what one more photograph would tell.
    aim
        The parameter that suggestions are to tell better, by the model's own name, or worst.
    count
        How many suggestions to print.
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
        from jaxrender.pipelines.progress import choose

        options = Options(tuple(suppose or ()), noise, band_limit, figure, suggest, aim, count)
        process.say(analyze_config(config, options, choose(sys.stderr)).text)
    else:
        if overrides or suppose or suggest:
            raise InputError(
                f"{subject}: overrides, --suppose and --suggest go with a run's config (.yaml), "
                "not with a panorama"
            )
        process.set_up_jax()
        from jaxrender.pipelines import analyze as analysis

        lobes = tuple(brdf) if brdf else analysis.DEFAULT_LOBES
        measurement = (0.01 if noise is None else noise, samples)
        limit = 32 if band_limit is None else band_limit
        found = analysis.analyze(
            subject,
            convention,
            lobes,
            limit,
            measurement,
            figure,
            tolerance=analysis.TOLERANCE if tolerance is None else tolerance,
        )
        process.say(found.table.rstrip())
    if figure is not None:
        process.say(f"figure: {figure}")
    return DONE
