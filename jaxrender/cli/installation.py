"""The commands about the installation itself: ``doctor``."""

from __future__ import annotations

from jaxrender.cli import process
from jaxrender.cli.app import DONE, NOT_CONVERGED, app


@app.command
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
