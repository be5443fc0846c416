"""The page: all sections in one HTML file that works offline."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from jaxrender.brdf import Glossy
from jaxrender.pipelines.report import account, parameters, wording
from jaxrender.pipelines.report.brdf_spectrum import spectrum_sections
from jaxrender.pipelines.report.comparison import comparison
from jaxrender.pipelines.report.contents import (
    Contents,
    LightContents,
    ReportContents,
    SpectrumContents,
    TextureContents,
)
from jaxrender.pipelines.report.correlations import correlations
from jaxrender.pipelines.report.forecast import forecast
from jaxrender.pipelines.report.freed import freed, photograph_rows
from jaxrender.pipelines.report.light import direction_discs, environment_map
from jaxrender.pipelines.report.material import spheres
from jaxrender.pipelines.report.photographs import gallery
from jaxrender.pipelines.report.recovered_light import light_pictures, path_plots
from jaxrender.pipelines.report.residuals import residual_plots
from jaxrender.pipelines.report.spectra import spectrum_plots
from jaxrender.pipelines.report.texture import lobes_alone, texture_sections

_PACKAGE = "jaxrender.pipelines.report"
_STYLE = "report.css"
_KICKERS = {
    "factorize": "Material and light recovered from photographs",
    "lighting": "Light recovered from photographs",
}


def write_report(folder: Path, contents: Contents) -> Path:
    """Write ``folder/report.html``, the same bytes for the same contents."""
    path = folder / "report.html"
    path.write_text(page(contents), encoding="utf-8")
    return path


def page(contents: Contents) -> str:
    """Fill the template; every string from outside is escaped."""
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
    template, sections_of = _PAGES[type(contents)]
    sections = sections_of(contents)
    if isinstance(contents, TextureContents):
        contents = lobes_alone(contents)
    return templates.get_template(template).render(
        style=Markup(style), **_common_sections(contents), **sections
    )


def _common_sections(contents: Contents) -> dict[str, Any]:
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
    }


def _light_sections(contents: LightContents) -> dict[str, Any]:
    return {
        "kicker": _KICKERS[contents.result["task"]],
        "variants": None,
        "evidence": None,
        "refined": False,
        "pictures": light_pictures(contents),
        "comparison": comparison(contents),
        "band_limit": contents.result["lighting"]["band_limit"],
        "finer": contents.fit.rounds[-1].band_limit > contents.fit.rounds[0].band_limit,
        "clusters": len(contents.fit.scene.clusters),
        "diffuse": contents.is_diffuse,
        "identifiable": contents.result["lighting"]["sentence"],
        "path": path_plots(contents),
    }


def _sections(contents: ReportContents) -> dict[str, Any]:
    return {
        "variants": parameters.variants(contents),
        "evidence": parameters.evidence(contents),
        "comparison": comparison(contents),
        "forecast": forecast(contents),
        "refined": "frequency" in contents.result,
        "by_integral": not isinstance(contents.fit.brdf, Glossy),
        "map": environment_map(contents.light, contents.fit.light),
        "discs": direction_discs(contents.light),
        "split": account.split_of(contents),
        "spheres": spheres(contents),
        "moving": contents.light.per_frame is not None,
        "residuals": residual_plots(contents),
        "spectra": spectrum_plots(contents),
        "lambertian": contents.is_lambertian,
        "diffuse": contents.is_diffuse,
    }


# The template of each kind of contents, and what fills the sections that are its own.
_PAGES: dict[type[Contents], tuple[str, Callable[[Any], dict[str, Any]]]] = {
    ReportContents: ("report.html.j2", _sections),
    LightContents: ("light.html.j2", _light_sections),
    TextureContents: ("texture.html.j2", texture_sections),
    SpectrumContents: ("brdf_spectrum.html.j2", spectrum_sections),
}
