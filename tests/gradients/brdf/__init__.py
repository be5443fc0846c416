"""Rows of ``jaxrender.brdf``."""

from . import factors, models, tables

ROWS = [*models.ROWS, *tables.ROWS, *factors.ROWS]

_FIT = "a fit on the host, of measurements"
_SETS = "numbers that are found on the host, for a whole table"
_NUMBER = "one number of a whole BRDF, found on the host by quadrature or random directions"
_BASE = "what such a BRDF is: its rows are those of the models"
_GIVEN = "what a function gives: numbers, no function"
EXCEPTIONS = {
    "*.transfer": "what evaluate is made of, and differentiated with it",
    "*.specular_transfer": "what evaluate is made of, and differentiated with it",
    "*.attenuated": "what evaluate is made of, and differentiated with it",
    "*.masked": "what evaluate is made of, and differentiated with it",
    "*.fresnel_ratio": "what evaluate is made of, and differentiated with it",
    "*.curves": "what evaluate is made of, over angles",
    "*.evaluate": "the rows named after a model are its evaluate",
    "*.with_amplitudes": "replaces numbers",
    "*.with_roughness": "replaces numbers",
    "*.draw": "random directions on the host, which jump from cell to cell",
    "*.density": "the density of random directions, constant in each cell",
    **dict.fromkeys(("BRDF", "Glossy", "Parametric", "WithoutIndex", "ByOwnNumber"), _BASE),
    "Distribution": "what a distribution is: its rows are those of the four",
    **dict.fromkeys(("fit_isotropic_table", "fit_zernike"), _FIT),
    **dict.fromkeys(("masked", "tabulate", "tabulate_rgl"), _SETS),
    **dict.fromkeys(("compressed", "conserving"), _SETS),
    **dict.fromkeys(("Compressed", "Goal"), _GIVEN),
    "RglSize": "numbers of nodes",
    "Recoloured": "another BRDF with its amplitudes weighted: its rows are that one's",
    "Exchanged": "another BRDF at the pair exchanged: its rows are that one's",
    **dict.fromkeys(
        (
            "nearest_energy_conserving",
            "nearest_isotropic",
            "nearest_reciprocal",
            "nearest_separable",
        ),
        _SETS,
    ),
    **dict.fromkeys(
        (
            "directional_albedo",
            "isotropy_error",
            "lobe_width",
            "max_albedo",
            "reciprocity_error",
            "separability_error",
        ),
        _NUMBER,
    ),
    **dict.fromkeys(("brdf_named", "lobe_named", "material_named"), "of a name"),
    **dict.fromkeys(("HalfDifference", "Masked", "Measurements", "Nearest", "Samples"), _GIVEN),
    **dict.fromkeys(("ScatteredFit", "Searched", "ZernikeFit"), _GIVEN),
    "Metric": "one number of two sets of values",
    **dict.fromkeys(("BankLobe", "standard_lobes"), "set shapes"),
    **dict.fromkeys(("ShapeParameter", "IndexParameter"), "a power, and a sum, of one number"),
    **dict.fromkeys(
        ("CosineSampler", "DirectionSampler", "TreeSampler"),
        "random directions, and a density that is constant in each cell",
    ),
    **dict.fromkeys(
        ("HalfDifferenceTree", "ScatteringTrees", "WaveletBRDF"),
        "of a tree: constant in each cell, or linear",
    ),
    "RglBRDF": "of a measured file: its warps are inverted in the file's cells",
}
