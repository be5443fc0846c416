"""The commands about photographs: ``fit``, ``render`` and ``synth``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from jaxrender.cli import process
from jaxrender.cli.app import DONE, NOT_CONVERGED, app


@app.command
def fit(
    config: Path,
    /,
    *overrides: str,
    force: bool = False,
    dry_run: bool = False,
    strict: bool = False,
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
    from jaxrender.pipelines.progress import choose
    from jaxrender.pipelines.run import fit as run_fit

    report = run_fit(loaded, force=force, dry_run=dry_run, progress=choose(sys.stderr))
    process.say(report.summary)
    if dry_run:
        return DONE
    process.say(f"result: {report.folder}")
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
    """Render the views of a finished result again, in its own light or another.

    For one material the command also writes the standard deviation of every image.

    Parameters
    ----------
    result
        Result folder of a fit.
    out
        Folder to write the images into.
    environment
        A panorama of radiance that replaces the light of the result.
    convention
        Layout of that panorama: z-up, y-up, angular, cross or mirror-ball.
    camera
        A transforms.json whose cameras replace those of the photographs.
    model
        integral (the exact reflection integral) or dual (the frequency-space model).
    force
        Replace an earlier rendering of another result.
    """
    process.set_up_jax()
    from jaxrender.pipelines.progress import choose
    from jaxrender.pipelines.render import Scene, render_config

    light, cameras = (path and path.resolve() for path in (environment, camera))
    scene = Scene(light, convention, cameras)
    into, progress = out.resolve(), choose(sys.stderr)
    folder = render_config(
        result.resolve(), out=into, model=model, force=force, progress=progress, scene=scene
    )
    process.say(f"images: {out if folder is None else folder}")
    return DONE


@app.command
def synth(recipe: Path, /, *, out: Path, force: bool = False) -> int:
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
    from jaxrender.pipelines.progress import choose
    from jaxrender.pipelines.synth import synthesise

    folder = synthesise(loaded, path, out.resolve(), force=force, progress=choose(sys.stderr))
    process.say(f"capture: {folder}")
    return DONE
