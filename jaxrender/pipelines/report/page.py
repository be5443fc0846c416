"""The page: every section's material put into one HTML file that asks for nothing from anywhere."""

from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from jaxrender.pipelines.report import account, parameters, wording
from jaxrender.pipelines.report.contents import ReportContents
from jaxrender.pipelines.report.light import direction_discs, environment_map
from jaxrender.pipelines.report.material import spheres
from jaxrender.pipelines.report.photographs import gallery
from jaxrender.pipelines.report.residuals import residual_plots
from jaxrender.pipelines.report.spectra import spectrum_plots

_PACKAGE = "jaxrender.pipelines.report"
_TEMPLATE, _STYLE = "report.html.j2", "report.css"


def write_report(folder: Path, contents: ReportContents) -> Path:
    """Write ``folder/report.html``, the same bytes for the same contents."""
    path = folder / "report.html"
    path.write_text(page(contents), encoding="utf-8")
    return path


def page(contents: ReportContents) -> str:
    """Fill the template; every string that comes from outside is escaped."""
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
    return templates.get_template(_TEMPLATE).render(style=Markup(style), **_sections(contents))


def _sections(contents: ReportContents) -> dict[str, Any]:
    return {
        "title": contents.title,
        "ending": account.ending(contents),
        "figures": account.figures(contents),
        "parameters": parameters.parameters(contents),
        "variants": parameters.variants(contents),
        "evidence": parameters.evidence(contents),
        "in_degrees": parameters.in_degrees(contents),
        "refined": contents.fit.exact is not None,
        "gallery": gallery(contents.frames),
        "removed": account.removed_pixels(contents),
        "map": environment_map(contents.light, contents.fit.light),
        "discs": direction_discs(contents.light),
        "split": account.split_of(contents),
        "gauge": contents.result.get("lighting", {}).get("gauge"),
        "spheres": spheres(contents),
        "moving": contents.light.per_frame is not None,
        "residuals": residual_plots(contents.fit.final),
        "spectra": spectrum_plots(contents),
        "lambertian": contents.is_lambertian,
        "timings": account.timings(contents),
        "provenance": account.provenance(contents),
    }
