"""``jaxrender.view``: what a fit found, as a widget to turn and to light in a notebook."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxrender.errors import InputError
from jaxrender.geometry import Shape, Sphere
from jaxrender.inverse import Estimate
from jaxrender.inverse.factorization import Factorization
from jaxrender.lighting import Light
from jaxrender.pipelines.progress import SilentProgress
from jaxrender.pipelines.result import read_run
from jaxrender.pipelines.view.layout import Facts
from jaxrender.pipelines.view.light import page_light_of
from jaxrender.pipelines.view.shown import Shown, shown_as
from jaxrender.pipelines.view.view import shown_of

if TYPE_CHECKING:
    from jaxrender.pipelines.view.widget import Viewer


def viewer(
    found: Estimate | str | Path,
    shape: Shape | None = None,
    lights: Mapping[str, Light] | None = None,
) -> "Viewer":
    """Show an estimate of a fit, or the folder of a finished result, as a widget of a notebook.

    An estimate is shown on ``shape``, a ball unless one is given, and in its own light; a result on
    its own shape.  ``lights`` are others to put it in, by their names.  The widget's traits are
    what a person chose, and Python may set them: see ``Viewer``.

    Raises ``InputError`` where the extra ``notebook`` is missing, and as ``jaxrender view`` does;
    ``ValueError`` for a result with a shape, and for names and lights that cannot be shown.
    """
    try:
        from jaxrender.pipelines.view import widget
    except ImportError:
        raise InputError(
            "jaxrender.view: needs the package anywidget: pip install 'jaxrender[notebook]'"
        ) from None
    if isinstance(found, Estimate):
        shown, facts = _of_estimate(found, shape or Sphere())
    elif shape is not None:
        raise ValueError(f"{found}: a result is shown on its own shape; leave the shape out")
    else:
        run = read_run(Path(found))
        shown = shown_of(run, SilentProgress())
        title = run.folder.resolve().name
        facts = Facts(title, "", run.summary, not run.config.knows_light, None)
    others = {}
    for name, light in (lights or {}).items():
        if not name or name in widget.LIGHTS:
            raise ValueError(
                f"lights={name!r}: every viewer has {', '.join(widget.LIGHTS)}; choose another name"
            )
        others[name] = page_light_of(light, shown.shape, shown.table.width)
    return widget.Viewer(shown._replace(others=others), facts)


def _of_estimate(found: Estimate, shape: Shape) -> tuple[Shown, Facts]:
    """Put an estimate's material on a shape, in the light that shows it."""
    width = float(found.material.width)
    shown = shown_as(found.brdf, width, page_light_of(found.shown_in, shape, width), shape)
    summary: dict[str, Any] = {
        "brdf": {"model": found.model},
        "outcome": found.outcome.value,
        "meaning": found.outcome.sentence,
        "interval90": {
            name: np.asarray(interval).tolist() for name, interval in found.interval90.items()
        },
    }
    recovered = isinstance(found.details, Factorization)
    return shown, Facts(found.title, "", summary, recovered, None)
