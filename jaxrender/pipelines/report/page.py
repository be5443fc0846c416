"""The page: all sections in one HTML file that works offline."""

from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from jaxrender.pipelines.report import account, parameters, wording
from jaxrender.pipelines.report.contents import Contents, Page
from jaxrender.pipelines.report.correlations import correlations
from jaxrender.pipelines.report.freed import freed, photograph_rows
from jaxrender.pipelines.report.front import front
from jaxrender.pipelines.report.photographs import gallery

_PACKAGE = "jaxrender.pipelines.report"
_STYLE = "report.css"


def write_report(folder: Path, page: Page) -> Path:
    """Write ``folder/report.html``, the same bytes for the same page."""
    path = folder / "report.html"
    path.write_text(html_of(page), encoding="utf-8")
    return path


def html_of(page: Page) -> str:
    """Fill the page's template."""
    values = _of_every_page(page.contents) | page.sections
    cards = front(page.contents, page.first, values["gallery"])
    return filled(page.template, values | {"cards": cards})


def filled(template: str, values: dict[str, Any]) -> str:
    """Fill a template with the style of all pages; every string from outside is escaped."""
    templates = Environment(
        loader=PackageLoader(_PACKAGE, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= {
        "percent": wording.percent,
        "shown": wording.shown,
        "counted": wording.counted,
    }
    assert templates.loader is not None
    style, _, _ = templates.loader.get_source(templates, _STYLE)
    return templates.get_template(template).render({"style": Markup(style)} | values)


def _of_every_page(contents: Contents) -> dict[str, Any]:
    return {
        "title": contents.title,
        "ending": account.ending(contents),
        "figures": account.figures(contents),
        "parameters": parameters.parameters(contents),
        "correlations": correlations(contents),
        "in_degrees": parameters.in_degrees(contents),
        "explanations": account.explanations(contents),
        "freed": freed(contents),
        "by_photograph": photograph_rows(contents),
        "gallery": gallery(contents.frames),
        "removed": account.removed_pixels(contents),
        "gauge": contents.result.get("lighting", {}).get("gauge"),
        "timings": account.timings(contents),
        "provenance": account.provenance(contents),
        # Of these a page of its own may have something to show.
        "variants": None,
        "evidence": None,
        "refined": False,
    }
