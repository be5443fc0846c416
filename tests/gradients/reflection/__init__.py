"""Rows of ``jaxrender.reflection``."""

from . import columns, convolution, images, irradiance, maps

ROWS = [*columns.ROWS, *irradiance.ROWS, *images.ROWS, *convolution.ROWS, *maps.ROWS]

_SIGHT = "traces rays on the host: what is seen changes in steps"
_NUMBERS = "numbers, no function: what takes them has a row"
_LINEAR = "linear algebra on the host, of all photographs or pixels together"
_COUNT = "chooses or counts on the host"
EXCEPTIONS = {
    "dual_columns.widths": "handed on to integral_columns and reflect_by_facets",
    "integral_columns_by_frame.widths": "handed on as by integral_columns",
    "reflect_by_facets.slow": "a constant by intent: it is drawn as an image that is looked up in",
    **dict.fromkeys(("cast_shadows", "visible_nodes", "transfer_vectors"), _SIGHT),
    **dict.fromkeys(("ShadowedDual", "ShadowedForward", "ShadowedModel"), _SIGHT),
    "NearForward": "looks from places at sources; test_near differentiates by where they are",
    "forward_of": "chooses a model, whose rows those are; test_lit differentiates by the light",
    "ForwardModel": "what a model is: its rows are those of the two",
    "Shrm": "what a map is: its rows are those of the two",
    **dict.fromkeys(
        (
            "DualLight",
            "FrameNodes",
            "DualGoal",
            "IrradianceError",
            "LightDifference",
            "Quadrature",
            "RecoveredBasis",
            "Shadows",
            "SourcesNeeded",
            "SphereFit",
            "SurfacePoints",
            "TransferVectors",
            "ViewFilter",
            "ViewerGoal",
            "ViewerRule",
        ),
        _NUMBERS,
    ),
    **dict.fromkeys(
        (
            "PrincipalComponents",
            "basis_from_photographs",
            "basis_images",
            "principal_components",
            "relit",
            "principal_maps",
            "shrm_from_photographs",
        ),
        _LINEAR,
    ),
    **dict.fromkeys(
        ("dual_light", "filled_up", "irradiance_error", "least_rows", "sources_needed"), _COUNT
    ),
    **dict.fromkeys(
        ("compare_lights", "three_spheres"), "a measure of a finished light, on the host"
    ),
    "quadratic_constants": "five numbers",
    "polar_nodes_for": "counts nodes on the host",
    "flatland_coefficients": "a quadrature of a function of angles that is given",
    "interpolated": "on the host, by the faces that places lie on",
    "reflection_map_by_sum": "the twin on the host, of a profile that is a NumPy function",
    "roughness_table": "tabulates on the host; RoughnessTable.specular is what is differentiated",
}
