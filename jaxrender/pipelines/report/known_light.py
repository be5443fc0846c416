"""The page of a material that was recovered under known light."""

from jaxrender.brdf import Glossy
from jaxrender.pipelines.report import account, parameters
from jaxrender.pipelines.report.comparison import comparison
from jaxrender.pipelines.report.contents import (
    MaterialContents,
    Page,
    Pictures,
    Shown,
    is_diffuse,
    is_lambertian,
)
from jaxrender.pipelines.report.curves import curves
from jaxrender.pipelines.report.forecast import forecast
from jaxrender.pipelines.report.light import direction_discs, environment_map, surroundings
from jaxrender.pipelines.report.material import spheres
from jaxrender.pipelines.report.residuals import residual_plots
from jaxrender.pipelines.report.spectra import spectrum_plots
from jaxrender.pipelines.report.table import table


def material_page(contents: MaterialContents) -> Page:
    """Lay out the page."""
    sections = {
        "lobes": parameters.lobes(contents),
        "curves": curves(contents),
        "variants": parameters.variants(contents),
        "evidence": parameters.evidence(contents),
        "comparison": comparison(contents),
        "table": table(contents),
        "forecast": forecast(contents),
        "refined": "frequency" in contents.result,
        "by_integral": not contents.fit.light.for_dual,
        "own_environments": contents.light.environments is not None,
        "glossy": isinstance(contents.fit.brdf, Glossy),
        "map": environment_map(contents.light, contents.fit.light),
        "surroundings": surroundings(contents.light),
        "discs": direction_discs(contents.light),
        "split": account.split_of(contents),
        "spheres": spheres(contents),
        "moving": contents.light.varies,
        "residuals": residual_plots(contents),
        "spectra": spectrum_plots(contents),
        "lambertian": is_lambertian(contents),
        "diffuse": is_diffuse(contents),
    }
    caption = "A ball of the recovered material, under the given light."
    first = Pictures(Shown(sections["spheres"].given, caption))
    return Page("report.html.j2", contents, sections, first)
