"""The command about other programs' files: ``export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from jaxrender.cli import process
from jaxrender.cli.app import DONE, app, examples
from jaxrender.cli.reporting import AS_USUAL, Reporting


@app.command(
    help_epilogue=examples(
        "export runs/cat --to mitsuba", "export paint.binary --to rgl --out paint_files"
    ),
)
def export(
    result: str,
    /,
    *,
    to: str,
    out: Annotated[Path | None, Parameter(alias="-o")] = None,
    lossy: bool = False,
    force: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Write a result, or a BRDF, for other programs: material, shape, light and cameras.

    README.txt in the new folder says what each file is, and what was lost.

    Parameters
    ----------
    result
        The folder of a finished fit, or a BRDF, which is shown on a ball: a file of measurements, a
        table or tree, or a model such as ggx:sigma=0.2.
    to
        gltf, glb, mitsuba, materialx, usd, blend, rgl, merl, environment, harmonics, or all. The
        README says what each keeps.
    out
        Folder to write; by default RESULT_FORMAT beside the result.
    lossy
        Go on where the format cannot hold all of the result. The losses are printed.
    force
        Replace an earlier export of something else.
    """
    process.set_up_jax()
    from jaxrender.pipelines.exporting import export as run_export

    done = run_export(result, to, out, lossy, force, reporting.progress())
    for sentence in done.sentences:
        process.say(sentence)
    process.say(f"export: {done.folder}")
    return DONE
