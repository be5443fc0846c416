"""Reflectance as a function of two directions.

``base``
    what a BRDF is: lobes times amplitudes, seen through its transfer function, and what it promises
``fresnel`` ``distributions`` ``masking`` ``facets`` ``half_vector``
    the factors that microfacet models share
``lambertian`` ``oren_nayar``
    diffuse surfaces, smooth and rough
``microfacet``
    the thesis's own model (T 6.2), which the fits recover
``parametric`` ``glossy``
    a base and one lobe: what a fit can recover; those whose lobe is about the reflected direction
``phong`` ``blinn_phong`` ``lafortune``
    powers of cosines
``torrance_sparrow`` ``cook_torrance`` ``he_torrance``
    rough surfaces by geometric and by physical optics
``two_ggx`` ``free_facets``
    a sharp highlight in a haze; facets of any slopes and any Fresnel curve
``layered`` ``metallic_roughness`` ``principled`` ``openpbr``
    the materials of renderers: a base under an interface, a coat and a fuzz
``burley`` ``sheen`` ``layer_albedo``
    parts of these, and how much light an interface takes from what lies below
``ward`` ``anisotropic_ggx`` ``kajiya_kay`` ``poulin_fournier`` ``tangents``
    brushed and fibrous surfaces, their direction along +X; that direction turned
``mixture`` ``bank``
    a weighted sum of any of these; many lobes of set shapes, whose weights a fit finds
``tables``
    measured reflectance: tables and series over two directions
``wavelet`` ``scattering_trees``
    a coefficient tree over pairs of directions; four of them, where light passes too
``half_difference_tree`` ``compression``
    a tree over half and difference angles; how trees are made of any BRDF, and their energy
``isotropic_mean`` ``exchanged`` ``recoloured``
    the isotropic part of any BRDF; it with its two directions exchanged; it in other channels
``textures``
    texels that are BRDFs, bump maps, and their pyramids (L 7)
``samplers`` ``tree_sampler``
    random directions and their density: by the cosine; by a coefficient tree (L 8)
``registry`` ``properties``
    every model by its name; reciprocity and albedo, measured
"""

from jaxrender.brdf.anisotropic_ggx import AnisotropicGGX
from jaxrender.brdf.bank import Bank, BankLobe, standard_lobes
from jaxrender.brdf.base import BRDF
from jaxrender.brdf.blinn_phong import BlinnPhong
from jaxrender.brdf.compression import Compressed, Goal, compressed, conserving
from jaxrender.brdf.cook_torrance import CookTorrance
from jaxrender.brdf.distributions import (
    DISTRIBUTIONS,
    Beckmann,
    Distribution,
    Gaussian,
    TrowbridgeReitz,
)
from jaxrender.brdf.exchanged import Exchanged
from jaxrender.brdf.free_facets import FreeDistribution, FreeFacets
from jaxrender.brdf.fresnel import (
    FRESNEL_ANGLES,
    conductor_fresnel,
    fresnel,
    head_on_reflectance,
    normalised_fresnel,
    schlick_fresnel,
)
from jaxrender.brdf.glossy import Glossy
from jaxrender.brdf.half_difference_tree import HalfDifferenceTree
from jaxrender.brdf.he_torrance import HeTorrance, HeTorranceLobe
from jaxrender.brdf.isotropic_mean import IsotropicMean
from jaxrender.brdf.kajiya_kay import KajiyaKay
from jaxrender.brdf.lafortune import CosineLobe, Lafortune
from jaxrender.brdf.lambertian import Lambertian
from jaxrender.brdf.masking import (
    FACET_MASKINGS,
    MASKINGS,
    smith_facet_masking,
    smith_masking,
    v_groove_masking,
)
from jaxrender.brdf.metallic_roughness import MetallicRoughness
from jaxrender.brdf.microfacet import Microfacet, microfacet_distribution
from jaxrender.brdf.mixture import Mixture
from jaxrender.brdf.openpbr import OpenPBR
from jaxrender.brdf.oren_nayar import OrenNayar, OrenNayarLobe
from jaxrender.brdf.parametric import (
    INDEX_BOUNDS,
    WIDTH_BOUNDS,
    ByOwnNumber,
    IndexParameter,
    Parametric,
    Searched,
    ShapeParameter,
    WithoutIndex,
)
from jaxrender.brdf.phong import Phong
from jaxrender.brdf.poulin_fournier import PoulinFournier
from jaxrender.brdf.principled import Principled
from jaxrender.brdf.properties import (
    directional_albedo,
    isotropy_error,
    lobe_width,
    max_albedo,
    reciprocity_error,
    separability_error,
)
from jaxrender.brdf.recoloured import Recoloured
from jaxrender.brdf.registry import (
    BRDFS,
    PARAMETRIC,
    brdf_named,
    lobe_named,
    material_named,
)
from jaxrender.brdf.samplers import COSINE, CosineSampler, DirectionSampler
from jaxrender.brdf.scattering_trees import ScatteringTrees
from jaxrender.brdf.tables.cell_means import Samples, tabulate
from jaxrender.brdf.tables.cells import Masked, masked
from jaxrender.brdf.tables.corrected import CorrectedBRDF
from jaxrender.brdf.tables.isotropic import HalfDifference, IsotropicTable, half_difference
from jaxrender.brdf.tables.measurements import METRICS, Measurements, Metric
from jaxrender.brdf.tables.nearest import (
    Nearest,
    nearest_energy_conserving,
    nearest_isotropic,
    nearest_reciprocal,
    nearest_separable,
)
from jaxrender.brdf.tables.polar_isotropic import PolarIsotropicTable
from jaxrender.brdf.tables.polar_nodes import PolarNodesTable
from jaxrender.brdf.tables.reconstruction import RECONSTRUCTIONS
from jaxrender.brdf.tables.rgl import RglBRDF
from jaxrender.brdf.tables.rgl_tabulation import RglSize, tabulate_rgl
from jaxrender.brdf.tables.scattered import ScatteredFit, fit_isotropic_table
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.brdf.tables.zernike import ZernikeBRDF
from jaxrender.brdf.tables.zernike_fit import ZernikeFit, fit_zernike
from jaxrender.brdf.torrance_sparrow import TorranceSparrow
from jaxrender.brdf.tree_sampler import TreeSampler
from jaxrender.brdf.two_ggx import TwoGGX
from jaxrender.brdf.ward import WARD_NORMALISATIONS, AnisotropicWard, Ward
from jaxrender.brdf.wavelet import WaveletBRDF

__all__ = [
    "HalfDifferenceTree",
    "METRICS",
    "Measurements",
    "Metric",
    "AnisotropicGGX",
    "Bank",
    "BankLobe",
    "AnisotropicWard",
    "BRDF",
    "BRDFS",
    "COSINE",
    "DISTRIBUTIONS",
    "FACET_MASKINGS",
    "FRESNEL_ANGLES",
    "MASKINGS",
    "RECONSTRUCTIONS",
    "WARD_NORMALISATIONS",
    "WIDTH_BOUNDS",
    "Beckmann",
    "BlinnPhong",
    "ByOwnNumber",
    "Compressed",
    "CookTorrance",
    "CorrectedBRDF",
    "CosineLobe",
    "CosineSampler",
    "DirectionSampler",
    "Distribution",
    "Exchanged",
    "Gaussian",
    "Glossy",
    "Goal",
    "HalfDifference",
    "HeTorrance",
    "HeTorranceLobe",
    "INDEX_BOUNDS",
    "IndexParameter",
    "IsotropicMean",
    "IsotropicTable",
    "KajiyaKay",
    "Lafortune",
    "Lambertian",
    "Masked",
    "MetallicRoughness",
    "Microfacet",
    "Mixture",
    "Nearest",
    "OpenPBR",
    "OrenNayar",
    "OrenNayarLobe",
    "PARAMETRIC",
    "Parametric",
    "Phong",
    "PolarIsotropicTable",
    "PolarNodesTable",
    "PoulinFournier",
    "Principled",
    "Recoloured",
    "RglBRDF",
    "RglSize",
    "Samples",
    "ScatteredFit",
    "ScatteringTrees",
    "Searched",
    "ShapeParameter",
    "TabulatedBRDF",
    "TorranceSparrow",
    "TreeSampler",
    "TrowbridgeReitz",
    "FreeDistribution",
    "FreeFacets",
    "TwoGGX",
    "Ward",
    "WaveletBRDF",
    "WithoutIndex",
    "ZernikeBRDF",
    "ZernikeFit",
    "brdf_named",
    "compressed",
    "conserving",
    "lobe_named",
    "material_named",
    "conductor_fresnel",
    "directional_albedo",
    "fit_isotropic_table",
    "fit_zernike",
    "fresnel",
    "half_difference",
    "head_on_reflectance",
    "isotropy_error",
    "lobe_width",
    "masked",
    "max_albedo",
    "microfacet_distribution",
    "nearest_energy_conserving",
    "nearest_isotropic",
    "nearest_reciprocal",
    "nearest_separable",
    "normalised_fresnel",
    "reciprocity_error",
    "schlick_fresnel",
    "standard_lobes",
    "separability_error",
    "smith_facet_masking",
    "smith_masking",
    "tabulate",
    "tabulate_rgl",
    "v_groove_masking",
]
