"""The commands that need no input: ``doctor`` and ``demo``."""

from __future__ import annotations

from pathlib import Path

from jaxrender.cli import process
from jaxrender.cli.app import DONE, NOT_CONVERGED, app, examples
from jaxrender.cli.reporting import AS_USUAL, Reporting

_DEMO = Path("configs/teflon_sphere.yaml")


@app.command(help_epilogue=examples("doctor", "doctor --json"))
def doctor(*, json: bool = False) -> int:
    """Check the installation: libraries, devices, cache, ray tracer, pictures, solvers, extras.

    The exit code is 1 if something that commands need does not work.

    Parameters
    ----------
    json
        Print the findings as JSON.
    """
    import json as jsons

    from jaxrender.pipelines.doctor import examine, text_of

    found = examine(process.set_up_jax, process.cache_folder())
    process.say(jsons.dumps(found.as_json(), indent=2) if json else text_of(found))
    return DONE if found.is_well else NOT_CONVERGED


@app.command(help_epilogue=examples("demo", "demo --out first --no-open"))
def demo(
    *,
    out: Path = Path("jaxrender-demo"),
    no_open: bool = False,
    force: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Do the main job once: recover a material from twelve photographs, and show the page about it.

    The photographs are rendered first.  The page opens in the browser, unless nobody looks.

    Parameters
    ----------
    out
        Folder to write the result into.
    no_open
        Do not open the page in the browser.
    force
        Replace the result of another run.
    """
    from jaxrender.pipelines.config import load_run_config

    config = load_run_config(process.example(_DEMO)).model_copy(update={"output": out.resolve()})
    process.set_up_jax()
    from jaxrender.pipelines.run import fit as run_fit

    report = run_fit(config, force=force, dry_run=False, progress=reporting.progress())
    process.say(report.summary)
    page = report.folder / "report.html"
    process.say(f"result: {report.folder}")
    process.say(f"page: {page}")
    if not no_open and process.can_open_pages():
        import webbrowser

        if not webbrowser.open(page.as_uri()):
            process.say("no browser was found: open the page yourself")
    return DONE
