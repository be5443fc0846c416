"""Materials that vary over a surface: K_d and K_s of every texel or vertex.

``measurements``
    observations in the order of the sites that they show
``site_sums``, ``site_systems``, ``specular_prior``, ``coloured_sites``
    the four unknowns of every site, solved exactly; what to expect of K_s where nobody saw it; the
    six unknowns of a site whose K_s has a colour
``alternation``
    the thesis's confidence weights and iteration (T 6.14): the twin
``forward``, ``search``
    any forward model, a part at a time; sigma and mu with all of the texture eliminated
``rounds``, ``whole_surface``, ``texture``, ``account``
    the search, which estimates the noise; every site; what is known of it; the outcome
``clustered``, ``examination``, ``mixed``, ``reach``
    errors of sites that know of misfit; what is left above the noise and what would explain it;
    sites of more than one paint; how far causes move a texture
``judgement``, ``suspicion``
    what can be trusted under unknown light, and what would explain the rest there
``free_capture``, ``calibrate``, ``free_paint_and_light``
    nuisances of a capture found with its paint, on some pixels and then with all of the texture;
    found with paint and light
``fit``, ``known_light``
    the whole recovery (T 6.13), also by region, and with the light split on the way
``varying``
    a sigma that varies slowly over the surface
``site_numbers``, ``site_equations``, ``site_solver``, ``site_search``
    a sigma, a normal and a coloured K_s of each site itself: what they are; chi-squared with its
    derivatives; the search at every site; what all sites share, and what is expected of each
``site_surface``, ``site_errors``, ``site_minima``, ``site_fields``, ``site_detail``
    the same of a whole surface, with errors that know of misfit and of other minima; what sites
    near each other have in common, and how the material varies within each
``diffuse_light``, ``glossy_light``
    texture under unknown light (T 6.1.1, classes 6 and 7): the family of equally good answers of a
    diffuse object; light from what moves with the view (``view_dependent`` with all else given,
    ``view_search`` with the specular lobe unknown too, from ``view_start``; their operator is in
    ``harmonic_columns``)
``metallic`` ``metallic_search`` ``metallic_table`` ``metallic_estimate``
    maps of glTF's material: the fit, its search, what its parts send over the roughness, what was
    found
``maps``
    site values as images
``from_photographs`` ``estimate`` ``region_lobe``
    a texture from a scene and its photographs; what was found, printed and saved
``sites`` ``regions`` ``unknown_light``
    which texel or vertex each pixel shows; under known light each region by itself; light and
    texture both unknown
``prediction`` ``columns``
    the photographs predicted by a recovered texture; what K_d = 1 and K_s = 1 would send
"""

from jaxrender.inverse.texture.account import TextureFit
from jaxrender.inverse.texture.alternation import (
    Alternation,
    Confidence,
    alternate,
    confidence,
)
from jaxrender.inverse.texture.columns import texture_columns
from jaxrender.inverse.texture.diffuse_light import (
    DiffuseFactors,
    DiffuseProblem,
    diffuse_problem,
    factor_diffuse,
    texture_under,
)
from jaxrender.inverse.texture.estimate import TextureEstimate
from jaxrender.inverse.texture.fit import fit_texture, fit_texture_by_region
from jaxrender.inverse.texture.forward import (
    Forward,
    ModelOf,
    dual_forward,
    exact_forward,
)
from jaxrender.inverse.texture.free_capture import NEVER
from jaxrender.inverse.texture.free_paint_and_light import FREED_WITH_LIGHT
from jaxrender.inverse.texture.from_photographs import estimate_texture
from jaxrender.inverse.texture.glossy_light import (
    GlossyLight,
    GlossyProblem,
    GlossyTexture,
    recover_glossy,
)
from jaxrender.inverse.texture.known_light import finest_of, forward_under, recover_texture
from jaxrender.inverse.texture.maps import dilated, image_of_sites
from jaxrender.inverse.texture.measurements import (
    SiteData,
    SiteObservations,
    by_shares,
    by_site,
    whole_sites,
)
from jaxrender.inverse.texture.metallic import MetallicSites, recover_metallic
from jaxrender.inverse.texture.metallic_estimate import (
    LitMetallic,
    MetallicEstimate,
    metallic_under_known_light,
)
from jaxrender.inverse.texture.prediction import LitTexture
from jaxrender.inverse.texture.region_lobe import RegionLobe
from jaxrender.inverse.texture.regions import under_known_light
from jaxrender.inverse.texture.rounds import TextureSettings
from jaxrender.inverse.texture.site_numbers import COLOR, MAPS, METALLIC, METALLIC_MAPS, NormalMap
from jaxrender.inverse.texture.site_sums import SiteMaterial, SiteSums, site_sums
from jaxrender.inverse.texture.site_systems import (
    SpecularPrior,
    site_errors,
    solve_freely,
    solve_sites,
)
from jaxrender.inverse.texture.sites import Regions, SurfaceSites, sites_of
from jaxrender.inverse.texture.specular_prior import spread_of
from jaxrender.inverse.texture.texture import Texture
from jaxrender.inverse.texture.unknown_light import UnknownLightSettings, under_unknown_light
from jaxrender.inverse.texture.varying import SigmaField, SigmaMap
from jaxrender.inverse.texture.view_dependent import LightCoefficients, solve_view_dependent
from jaxrender.inverse.texture.whole_surface import Lobe, solve_surface

__all__ = [
    "COLOR",
    "FREED_WITH_LIGHT",
    "MAPS",
    "METALLIC",
    "METALLIC_MAPS",
    "NEVER",
    "Alternation",
    "Confidence",
    "DiffuseFactors",
    "DiffuseProblem",
    "Forward",
    "GlossyLight",
    "GlossyProblem",
    "GlossyTexture",
    "LightCoefficients",
    "LitMetallic",
    "LitTexture",
    "Lobe",
    "MetallicEstimate",
    "MetallicSites",
    "ModelOf",
    "NormalMap",
    "RegionLobe",
    "Regions",
    "SigmaField",
    "SigmaMap",
    "SiteData",
    "SiteMaterial",
    "SiteObservations",
    "SiteSums",
    "SpecularPrior",
    "SurfaceSites",
    "Texture",
    "TextureEstimate",
    "TextureFit",
    "TextureSettings",
    "UnknownLightSettings",
    "alternate",
    "by_shares",
    "by_site",
    "confidence",
    "diffuse_problem",
    "dilated",
    "dual_forward",
    "estimate_texture",
    "exact_forward",
    "factor_diffuse",
    "finest_of",
    "fit_texture",
    "fit_texture_by_region",
    "forward_under",
    "image_of_sites",
    "metallic_under_known_light",
    "recover_glossy",
    "recover_metallic",
    "recover_texture",
    "site_errors",
    "site_sums",
    "sites_of",
    "solve_freely",
    "solve_sites",
    "solve_surface",
    "solve_view_dependent",
    "spread_of",
    "texture_columns",
    "texture_under",
    "under_known_light",
    "under_unknown_light",
    "whole_sites",
]
