"""Commands about photographs: ``fit``, ``render``, ``view``, ``evaluate``, ``synth``, ``check``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from jaxrender.cli import process
from jaxrender.cli.app import DONE, NOT_CONVERGED, app, examples
from jaxrender.cli.reporting import AS_USUAL, Reporting
from jaxrender.errors import InputError
from jaxrender.pipelines.kept import keeping


@app.command(
    help_epilogue=examples(
        "fit configs/teflon_sphere.yaml", "fit cat/capture.yaml brdf.mu=1.5 output=runs/cat"
    )
)
def fit(
    config: Path,
    /,
    *overrides: str,
    force: bool = False,
    dry_run: bool = False,
    strict: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Recover what a config asks for: a material, a light, both, a texture, or a BRDF.

    The result folder holds result.json, result.nc, report.html, config.yaml and the images.

    Parameters
    ----------
    config
        Config of the run (YAML).
    overrides
        Values that replace those of the config, such as brdf.mu=1.5 or output=runs/a.
    force
        Replace the result of another run.
    dry_run
        Check everything and print what would be fitted, but fit nothing.
    strict
        Exit with 1 unless the outcome is 'converged'.
    """
    from jaxrender.pipelines.config import load_run_config

    loaded = load_run_config(process.bundled(config), overrides)
    process.set_up_jax()
    from jaxrender.pipelines.run import fit as run_fit

    report = run_fit(loaded, force=force, dry_run=dry_run, progress=reporting.progress())
    process.say(report.summary)
    if dry_run:
        return DONE
    process.say(f"result: {report.folder}")
    return NOT_CONVERGED if strict and report.outcome != "converged" else DONE


@app.command(
    help_epilogue=examples(
        "render runs/cat --out elsewhere --environment other.exr --convention y-up",
        "render paint.binary --environment probe.exr --mesh cat.ply --out painted",
    )
)
def render(
    result: str,
    /,
    *,
    out: Path,
    environment: Path | None = None,
    convention: str = "z-up",
    camera: Path | None = None,
    mesh: Path | None = None,
    model: Literal["integral", "dual"] = "integral",
    force: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Render the views of a finished result again, or a BRDF by itself, in any light.

    For one material of a result the command also writes the standard deviation of every image.

    Parameters
    ----------
    result
        Result folder of a fit, or a BRDF: a file of measurements, a table or tree, or a model such
        as ggx:sigma=0.2.
    out
        Folder to write the images into.
    environment
        A panorama of radiance that replaces the light of the result.  A BRDF needs one.
    convention
        Layout of that panorama: z-up, y-up, angular, cross or mirror-ball.
    camera
        A transforms.json whose cameras replace those of the photographs, in the same axes.
    mesh
        A shape to show a BRDF on, that of a result too; by default a ball of radius 1.
    model
        integral (the exact reflection integral) or dual (the frequency-space model).
    force
        Replace an earlier rendering of another result.
    """
    process.set_up_jax()
    light, cameras, shape = (path and path.resolve() for path in (environment, camera, mesh))
    into, progress = out.resolve(), reporting.progress()
    from jaxrender.pipelines.brdf_sources import names_result

    if mesh is None and names_result(result):
        from jaxrender.pipelines.render import Scene, render_config

        scene = Scene(light, convention, cameras)
        folder = render_config(
            Path(result).resolve(),
            out=into,
            model=model,
            force=force,
            progress=progress,
            scene=scene,
        )
    else:
        if light is None:
            raise InputError(
                f"{result}: no result folder, and a BRDF has no light of its own: give an "
                "--environment, or mend the path"
            )
        if model != "integral":
            raise InputError(f"--model {model} goes with a result; leave it out with a BRDF")
        from jaxrender.pipelines.render_brdf import Stage, render_brdf

        stage = Stage(light, convention, shape, cameras)
        folder = render_brdf(result, into, stage, force, progress)
    process.say(f"images: {out if folder is None else folder}")
    return DONE


@app.command(
    help_epilogue=examples("view runs/cat", "view runs/cat --out cat.html --force"),
)
def view(
    result: Path,
    /,
    *,
    out: Path | None = None,
    force: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Make a page of a finished result: the object to turn and to light in a browser.

    The page is one HTML file that works without a network.  It shows the material under the light
    of the result or another, photographs beside predictions, and the reflectance.

    Parameters
    ----------
    result
        Result folder of a fit.
    out
        The page to write; by default view.html in the result folder.
    force
        Replace the page of another result.
    """
    process.set_up_jax()
    from jaxrender.pipelines.view import view_result

    page = view_result(
        result.resolve(), None if out is None else out.resolve(), force, reporting.progress()
    )
    process.say(f"page: {page}")
    return DONE


@app.command(
    help_epilogue=examples(
        "evaluate runs/cat",
        "evaluate runs/cat --photographs other/transforms.json --environment other.exr",
    )
)
def evaluate(
    result: Path,
    /,
    *,
    photographs: Path | None = None,
    environment: Path | None = None,
    light: Path | None = None,
    convention: str = "z-up",
    exposure: float = 1.0,
    scale: Literal["channel", "none"] = "channel",
    out: Path | None = None,
    force: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Compare photographs with what a result predicts for their cameras.

    Prints PSNR-H, PSNR-L (dB) and SSIM as the benchmark Stanford-ORB defines them, and the rms
    relative to the photograph.  Of a recovered light it prints how far three spheres lit by it are
    from those in the true light.

    Parameters
    ----------
    result
        Result folder of a fit.
    photographs
        A transforms.json of other photographs, in the same axes; by default those of the fit.
    environment
        A panorama of the light of these photographs; by default the light of the result.
    light
        A panorama of the true light, where the fit recovered it.
    convention
        Layout of these panoramas: z-up, y-up, angular, cross or mirror-ball.
    exposure
        Factor from radiance to what a display shows, 1 being white, for PSNR-L and SSIM.
    scale
        channel: a free factor for each photograph and channel.  none: as predicted.
    out
        Folder to write the numbers, the predictions and pictures of the differences into.
    force
        Replace an earlier evaluation of another result.
    """
    process.set_up_jax()
    from jaxrender.pipelines.evaluate import Measures, evaluate_result
    from jaxrender.pipelines.render import Scene

    other, cameras, true = (path and path.resolve() for path in (environment, photographs, light))
    evaluation = evaluate_result(
        result.resolve(),
        Scene(other, convention, cameras),
        Measures(exposure, scale == "channel", true),
        None if out is None else out.resolve(),
        force,
        progress=reporting.progress(),
    )
    process.say(evaluation.summary)
    if out is not None:
        process.say(f"evaluation: {out}")
    return DONE


@app.command(
    help_epilogue=examples(
        "synth data_synth/teflon_12.yaml --out photos",
        "synth data_synth/teflon_12.yaml --out photos --force",
    )
)
def synth(
    recipe: Path,
    /,
    *,
    out: Path,
    force: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Render the photographs of a recipe, and write a config that fits them.

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

    path = process.bundled(recipe).resolve()
    loaded = load_recipe(process.bundled(recipe))
    process.set_up_jax()
    from jaxrender.pipelines.synth import synthesise

    folder = synthesise(loaded, path, out.resolve(), force=force, progress=reporting.progress())
    process.say(f"capture: {folder}")
    return DONE


@app.command(
    help_epilogue=examples("check cat --fix", "check cat/capture.yaml --out pages --strict")
)
def check(
    capture: Path,
    /,
    *,
    fix: bool = False,
    out: Path = Path("check"),
    strict: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Check a capture before it is fitted: axes, units, mirrors, how its light is meant.

    A page, check.html, shows what cameras see of the shape, and what can be recovered.

    Parameters
    ----------
    capture
        Config of a run (YAML), or a folder with a capture.yaml.
    fix
        Write what was found into the config; its comments are kept.
    out
        Folder for the page.
    strict
        Exit with 1 if something is wrong, and was not mended.
    """
    from jaxrender.pipelines.check.check import check as run_check
    from jaxrender.pipelines.check.check import config_path, summary_of, write_page
    from jaxrender.pipelines.check.check import fix as write_fix

    path = config_path(process.bundled(capture))
    process.set_up_jax()

    found = run_check(path, reporting.progress())
    if fix:
        write_fix(found)
    changed = f"{path} has what was found" if fix and found.changes else "nothing was written"
    with keeping(lambda: changed):
        page = write_page(found, out.resolve())
    process.say(summary_of(found, fix))
    process.say(f"page: {page}")
    left = found.wrong[len(found.changes) :] if fix else found.wrong
    return NOT_CONVERGED if strict and left else DONE
