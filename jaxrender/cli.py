"""The command line: ``jaxrender fit | batch | render | synth | prefilter | measure | compress`` ...

It sets precision, the compilation cache and logging, and hands files to ``pipelines``; nothing
else.  JAX and all that imports it are imported inside the commands, so that ``--help`` is quick.

Exit codes: 0 done; 1 ran, but not converged or not identifiable (with ``--strict``); 2 bad input;
130 interrupted.
"""

from __future__ import annotations

import gc
import logging
import os
import sys
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, NoReturn

from cyclopts import App, CycloptsError, Parameter

from jaxrender import __version__
from jaxrender.errors import InputError

DONE, NOT_CONVERGED, BAD_INPUT, INTERRUPTED, UNREAD = 0, 1, 2, 130, 141

# Folders of examples that travel with the package, by the names that the README gives them.
_BUNDLED = ("configs", "data_synth")
# Compile seconds from which a program is worth keeping: all of them, since a run needs a hundred
# small ones.  JAX's own 1 s would keep almost none.
_CACHE_FROM_SECONDS = 0.0

# New objects before a collection of each generation; Python's own are 700, 10 and 10.
_COLLECT_AFTER = (100_000, 50, 100)

# Order and degree of the nine coefficients, as T table 4.1 lists them.
_HARMONICS = ("00", "1-1", "10", "11", "2-2", "2-1", "20", "21", "22")

_NAMED = Parameter(negative=())

app = App(
    name="jaxrender",
    help="Materials and lighting from photographs of objects of known shape.",
    version=__version__,
    default_parameter=_NAMED,
    result_action="return_value",
    exit_on_error=False,
    suppress_keyboard_interrupt=False,
)


@app.command
def fit(
    config: Path,
    /,
    *overrides: str,
    force: bool = False,
    dry_run: bool = False,
    strict: bool = False,
) -> int:
    """Fit the material that a config asks for.

    Parameters
    ----------
    config
        Config of the run (YAML).
    overrides
        Values written over the config's, such as brdf.mu=1.5 or output=runs/a.
    force
        Replace the result of another run.
    dry_run
        Check everything and say what would be done, but fit nothing.
    strict
        Exit with 1 unless the outcome is 'converged'.
    """
    from jaxrender.pipelines.config import load_run_config

    loaded = load_run_config(_bundled(config), overrides)
    _set_up_jax()
    from jaxrender.pipelines.progress import choose
    from jaxrender.pipelines.run import fit as run_fit

    report = run_fit(loaded, force=force, dry_run=dry_run, progress=choose(sys.stderr))
    _say(report.summary)
    if dry_run:
        return DONE
    _say(f"result: {report.folder}")
    return NOT_CONVERGED if strict and report.outcome != "converged" else DONE


@app.command
def render(
    result: Path,
    /,
    *,
    out: Path,
    environment: Path | None = None,
    convention: str = "z-up",
    camera: Path | None = None,
    model: Literal["integral", "dual"] = "integral",
    force: bool = False,
) -> int:
    """Render the views of a finished result again, or what it would look like elsewhere.

    Parameters
    ----------
    result
        Result folder of a fit.
    out
        Folder to write the images into.
    environment
        Another light, a panorama of radiance, in place of the result's own.
    convention
        Its layout: z-up, y-up, angular, cross or mirror-ball.
    camera
        Another transforms.json, whose cameras take the place of the photographs'.
    model
        The exact reflection integral, or the frequency-space dual model.
    force
        Replace an earlier rendering of another result.
    """
    _set_up_jax()
    from jaxrender.pipelines.progress import choose
    from jaxrender.pipelines.render import Scene, render_config

    light, cameras = (path and path.resolve() for path in (environment, camera))
    scene = Scene(light, convention, cameras)
    into, progress = out.resolve(), choose(sys.stderr)
    folder = render_config(
        result.resolve(), out=into, model=model, force=force, progress=progress, scene=scene
    )
    _say(f"images: {out if folder is None else folder}")
    return DONE


@app.command
def synth(recipe: Path, /, *, out: Path, force: bool = False) -> int:
    """Render the photographs of a recipe, with all that a fit of them needs.

    Parameters
    ----------
    recipe
        Recipe of shape, material, light and cameras (YAML).
    out
        Folder to write the capture into.
    force
        Replace an earlier capture of another recipe.
    """
    from jaxrender.pipelines.config import load_recipe

    path = _bundled(recipe).resolve()
    loaded = load_recipe(_bundled(recipe))
    _set_up_jax()
    from jaxrender.pipelines.progress import choose
    from jaxrender.pipelines.synth import synthesise

    folder = synthesise(loaded, path, out.resolve(), force=force, progress=choose(sys.stderr))
    _say(f"capture: {folder}")
    return DONE


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
    force
        Replace an earlier result of another probe.
    """
    options = {"tolerance": tolerance, "view-degree": view_degree, "degree": degree}
    for name, value in options.items():
        if value is not None and not shrm:
            raise InputError(f"--{name} goes with --shrm; add that, or leave --{name} out")
    _set_up_jax()
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
    )
    for name, row in zip(_HARMONICS, done.coefficients.tolist()):
        _say(f"L{name:4s}" + "".join(f"{value:12.5g}" for value in row))
    for line in done.reflection:
        _say(line)
    _say(f"maps: {out}")
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
    aim: Literal["worst", "kd", "ks", "sigma", "mu"] = "worst",
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
        The parameter that suggestions are to tell better.
    count
        How many suggestions to print.
    """
    if subject.suffix.lower() in (".yaml", ".yml"):
        if brdf:
            raise InputError("--brdf goes with a panorama; with a config: --suppose sigma=0.1")
        if tolerance is not None:
            raise InputError("--tolerance goes with a panorama; leave it out with a config")
        from jaxrender.pipelines.config import load_run_config

        config = load_run_config(_bundled(subject), overrides)
        _set_up_jax()
        from jaxrender.pipelines.analysis import Options, analyze_config
        from jaxrender.pipelines.progress import choose

        options = Options(tuple(suppose or ()), noise, band_limit, figure, suggest, aim, count)
        _say(analyze_config(config, options, choose(sys.stderr)).text)
    else:
        if overrides or suppose or suggest:
            raise InputError(
                f"{subject}: overrides, --suppose and --suggest go with a run's config (.yaml), "
                "not with a panorama"
            )
        _set_up_jax()
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
        _say(found.table.rstrip())
    if figure is not None:
        _say(f"figure: {figure}")
    return DONE


@app.command
def measure(
    patch: str,
    /,
    *,
    out: Path,
    brdf: list[str] | None = None,
    size: list[int] | None = None,
    embedding: Literal["nusselt", "polar"] = "nusselt",
    samples: int = 256,
    bounces: int = 4,
    seed: int = 0,
    region: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0),
    relief: float = 0.1,
    force: bool = False,
) -> int:
    """Measure the BRDF of micro-geometry; interrupted, the same command goes on later.

    Parameters
    ----------
    patch
        sawtooth:teeth=4,rising=45,falling=45 (degrees), velvet:threads=600,length=0.3,lean=20, a
        mesh of one period (.obj, .ply, .glb, .stl), or an image of heights.
    out
        The table to write (.nc): values and standard errors.
    brdf
        A facet's BRDF such as lambertian:kd=0.2/0.1/0.1 or microfacet:sigma=0.2; given several
        times, that of material 0, 1, ... (rising and falling sides; base and threads).
    size
        Samples along each axis of the table; given four times, kappa_i, lambda_i, kappa_r,
        lambda_r; 16 if not given.
    embedding
        How directions lie on the table's square.
    samples
        Paths for each exit direction.
    bounces
        The most reflections between facets; 1 is direct light only.
    seed
        Of the random numbers.
    region
        The part u0 v0 u1 v1 of the period that is looked at, 0 to 1.
    relief
        Height of an image's white above its black, in units of its width.
    force
        Replace the result of another measurement, or what is left of one.
    """
    _set_up_jax()
    from jaxrender.pipelines import measure as measuring
    from jaxrender.pipelines.progress import choose

    facets = tuple(brdf) if brdf else measuring.DEFAULT_FACETS
    options = measuring.MeasureOptions(
        patch, facets, tuple(size or (16,)), embedding, samples, bounces, seed, region, relief
    )
    done = measuring.measure(options, out, choose(sys.stderr), force)
    _say(done.text)
    _say(f"table: {out}")
    return DONE


@app.command
def compress(
    brdf: str,
    /,
    *,
    out: Annotated[Path, Parameter(alias="-o")],
    keep: float = 0.01,
    error: float | None = None,
    size: int = 32,
    wavelet: str = "haar",
    spectral: bool = False,
    cell_samples: int = 16,
) -> int:
    """Compress a BRDF to a tree of wavelet coefficients, and say what that costs.

    Parameters
    ----------
    brdf
        A file (MERL .binary, Cornell .brdf, ALTA, UTIA .bin, RGL .bsdf, a table or tree .nc), a
        model such as microfacet:sigma=0.2,mu=1.5, or the result folder of a fit.
    out
        The tree to write (NetCDF).
    keep
        Fraction of the non-zero coefficients to keep, those of all channels together.
    error
        Relative rms error to meet instead, such as 0.05, with as few coefficients as that takes.
    size
        Samples along each of four axes; a power of two.
    wavelet
        haar, cdf-2-2 (linear spline), daubechies-2 or daubechies-4.
    spectral
        Keep all wavelengths of a file that has them, in place of linear RGB.
    cell_samples
        Evaluations that the mean over a cell is made of; 1 takes its centre.
    """
    _set_up_jax()
    from jaxrender.pipelines import compress as compression
    from jaxrender.pipelines.progress import choose

    goal = compression.Goal(keep, error)
    done = compression.compress(
        brdf,
        out,
        goal,
        size=size,
        wavelet=wavelet,
        spectral=spectral,
        cell_samples=cell_samples,
        progress=choose(sys.stderr),
    )
    for line in done.said:
        _say(line)
    _say(f"tree: {out}")
    return DONE


@app.command
def batch(
    sweep: Path,
    /,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    dry_run: bool = False,
    strict: bool = False,
) -> int:
    """Do all fits of a sweep, several at a time; running it again does what is missing.

    Parameters
    ----------
    sweep
        Base config and the values to be written over it (YAML).
    workers
        How many processes of this machine to use; as many as it has room for if not given.
    scheduler
        Address of a dask scheduler, such as tcp://host:8786, whose workers are used instead.
    dry_run
        Check everything and list the runs, but do none.
    strict
        Exit with 1 unless every run's outcome is 'converged'.
    """
    from jaxrender.pipelines.config.sweep import load_sweep

    loaded = load_sweep(_bundled(sweep))
    _set_up_jax()
    from jaxrender.pipelines import batch as batches
    from jaxrender.pipelines.progress import choose

    if dry_run:
        _say(batches.list_runs(loaded))
        return DONE
    processes = batches.cluster(workers, scheduler, set_up=_set_up_jax)
    report = batches.run_batch(loaded, processes, progress=choose(sys.stderr))
    _say(report.summary)
    return DONE if report.all_converged or not strict else NOT_CONVERGED


@app.command
def schema(*, recipe: bool = False, sweep: bool = False) -> int:
    """Print the JSON Schema of configs, for editors that check YAML.

    Parameters
    ----------
    recipe
        The schema of recipes instead.
    sweep
        The schema of sweeps instead.
    """
    import json

    from jaxrender.pipelines.config import RecipeConfig, RunConfig, json_schema
    from jaxrender.pipelines.config.sweep import SweepConfig

    if recipe and sweep:
        raise InputError("--recipe and --sweep are two schemas; ask for one of them")
    root = RecipeConfig if recipe else SweepConfig if sweep else RunConfig
    _say(json.dumps(json_schema(root), indent=2))
    return DONE


def console() -> NoReturn:
    """Run the process's own command line, and end the process."""
    _collect_seldom()
    code = main(sys.argv[1:])
    # All results are on disk.  To take every trace apart before ending takes half a second more.
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def main(arguments: Sequence[str]) -> int:
    """Run a command line and return its exit code."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    try:
        return app(list(arguments)) or DONE
    except CycloptsError:
        # cyclopts has said what is wrong with the arguments.
        return BAD_INPUT
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return BAD_INPUT
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return INTERRUPTED


def _collect_seldom() -> None:
    """Let the garbage collector look through all objects seldom.

    JAX's traces are millions of small objects that reference counting frees; looking for cycles
    among them takes a sixth of a short run.
    """
    gc.set_threshold(*_COLLECT_AFTER)


def _say(text: str) -> None:
    """Print to the output.  Only its own closed pipe is no trouble: any other is a failure."""
    try:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever reads it, as ``head`` does, has read enough; what is left has no reader.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(UNREAD)


def _bundled(path: Path) -> Path:
    """The path, or the example of that name which came with the package where the path is not."""
    if path.exists() or not path.parts or path.parts[0] not in _BUNDLED:
        return path
    example = Path(str(resources.files("jaxrender"))).joinpath("package_data", *path.parts)
    return example if example.exists() else path


def _set_up_jax() -> None:
    """Float64, and compiled programs kept from one process to the next."""
    import jax

    jax.config.update("jax_enable_x64", True)
    folder = _cache_folder()
    if folder is None:
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", _CACHE_FROM_SECONDS)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def _cache_folder() -> Path | None:
    """Where compiled programs are kept: JAX_COMPILATION_CACHE_DIR, or the user's cache folder.

    None where there is no such folder that the user alone may write to: what lies in the cache is
    executed.
    """
    chosen = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if chosen:
        return Path(chosen)
    folder = _user_cache() / "jaxrender"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
    except OSError as error:
        logging.getLogger(__name__).warning("no compilation cache in %s: %s", folder, error)
        return None
    if hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & 0o022):
        logging.getLogger(__name__).warning(
            "no compilation cache in %s: others may write to it; chmod go-w mends that", folder
        )
        return None
    return folder


def _user_cache() -> Path:
    """The platform's folder for a user's caches."""
    configured = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if configured.is_absolute():
        return configured
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    return Path.home() / ".cache"
