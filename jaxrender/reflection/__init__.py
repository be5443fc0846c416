"""The forward model: what a surface of a known BRDF sends to the camera under a known light.

``integral`` ``polar_nodes``
    the reference: the reflection integral as a sum over the light's nodes, or by a polar quadrature
    of as many nodes as the lobe asks for
``convolution``, ``convolution_flatland``
    the convolution theorem in each of its forms (T 2.24, 2.43, 2.55, 2.57, 2.62)
``irradiance``
    the diffuse part as a sum of harmonics of the normal (T 4.10), or a quadratic polynomial of it
``prefilter``
    environment maps convolved with lobes that depend on one angle
``subspaces``
    the few images that all pictures of a diffuse object are mixed from
``shrm``
    spherical harmonic reflection maps: any light and isotropic BRDF, for any viewer (T 5)
``dual``
    the model of T 6.9: diffuse and slow light in frequency, fast light in angle (T 6.12 with
    shadows)
``interreflection`` ``indirect``
    light that parts of a concave object send to one another, matt or glossy (T 6.6)
``transfer``
    transfer vectors (T 6.10): diffuse light on shapes that shadow themselves
``tabulated`` ``knots``
    the dual model as a table over roughness, for solvers; where it is known, and joined in between
``wavelet_shading``
    light and BRDF as wavelet trees (L 6.3)
``tracing``
    paths, luminaires nearby, the virtual gonioreflectometer (L 3, 5, 8)
``render`` ``near`` ``lit`` ``sensitivity``
    camera to image with either model; under sources with a place; under any light, exactly; its
    derivatives by the material
``three_spheres``
    two lights compared by the pictures of a diffuse, a matte silver and a mirror sphere

Every model returns *columns*: the radiance of each lobe of the BRDF at amplitude one, so that
radiance = columns times amplitudes is linear in what a fit can eliminate.
"""

from jaxrender.reflection.convolution import (
    SurfacePoints,
    convolve_anisotropic,
    convolve_at_direction,
    convolve_at_exit,
    convolve_isotropic,
    convolve_radial,
    evaluate_anisotropic,
    evaluate_at_direction,
    evaluate_at_exit,
    evaluate_isotropic,
    reflect_about_mirror,
)
from jaxrender.reflection.convolution_flatland import (
    convolve_flatland,
    evaluate_flatland,
    flatland_coefficients,
)
from jaxrender.reflection.dual import (
    FACETS,
    DualGoal,
    DualLight,
    Shadows,
    SourcesNeeded,
    cast_shadows,
    dual_columns,
    dual_light,
    filled_up,
    sources_needed,
)
from jaxrender.reflection.facet_integral import facet_coefficients, reflect_by_facets
from jaxrender.reflection.integral import (
    FrameNodes,
    integral_columns,
    integral_columns_by_frame,
    polar_coefficients,
    polar_columns,
    radiance,
    visible_nodes,
)
from jaxrender.reflection.irradiance import (
    IrradianceError,
    irradiance,
    irradiance_error,
    irradiance_matrix,
    matrix_irradiance,
    quadratic_constants,
    quadratic_irradiance,
)
from jaxrender.reflection.lit import forward_of, render_lit
from jaxrender.reflection.near import NearForward
from jaxrender.reflection.polar_nodes import polar_nodes_for
from jaxrender.reflection.prefilter import reflection_map_by_sum, reflection_maps
from jaxrender.reflection.render import (
    DualForward,
    ExactForward,
    ForwardModel,
    ShadowedDual,
    ShadowedForward,
    ShadowedModel,
    render,
    render_samples,
    render_view,
    render_views,
)
from jaxrender.reflection.sensitivity import sensitivities
from jaxrender.reflection.shrm import (
    AzimuthalTexture,
    GlobalShrm,
    IcosahedralMaps,
    LightFieldTable,
    LocalShrm,
    PrincipalMaps,
    Shrm,
    SphereFit,
    ViewerGoal,
    ViewerRule,
    ViewFilter,
    central_coefficients,
    global_shrm,
    least_rows,
    local_from_global,
    local_shrm,
    mirror_light,
    principal_maps,
    reflect_mirror_light,
    shrm_from_photographs,
)
from jaxrender.reflection.slow_light import reflect_slow_light, slow_light_columns
from jaxrender.reflection.subspaces import (
    PrincipalComponents,
    RecoveredBasis,
    basis_from_photographs,
    basis_images,
    principal_components,
    relit,
)
from jaxrender.reflection.tabulated import RoughnessTable, roughness_table
from jaxrender.reflection.three_spheres import LightDifference, compare_lights, three_spheres
from jaxrender.reflection.transfer import (
    Quadrature,
    TransferVectors,
    interpolated,
    shadowed_irradiance,
    transfer_vectors,
)
from jaxrender.reflection.varying_width import render_widths

__all__ = [
    "AzimuthalTexture",
    "GlobalShrm",
    "IcosahedralMaps",
    "LightFieldTable",
    "LocalShrm",
    "PrincipalMaps",
    "Shrm",
    "SphereFit",
    "ViewFilter",
    "ViewerGoal",
    "ViewerRule",
    "central_coefficients",
    "global_shrm",
    "least_rows",
    "local_from_global",
    "local_shrm",
    "mirror_light",
    "principal_maps",
    "reflect_mirror_light",
    "shrm_from_photographs",
    "SurfacePoints",
    "convolve_isotropic",
    "evaluate_isotropic",
    "convolve_at_exit",
    "evaluate_at_exit",
    "convolve_anisotropic",
    "convolve_at_direction",
    "evaluate_anisotropic",
    "evaluate_at_direction",
    "convolve_radial",
    "reflect_about_mirror",
    "reflect_slow_light",
    "slow_light_columns",
    "facet_coefficients",
    "forward_of",
    "reflect_by_facets",
    "convolve_flatland",
    "evaluate_flatland",
    "flatland_coefficients",
    "reflection_map_by_sum",
    "reflection_maps",
    "IrradianceError",
    "NearForward",
    "PrincipalComponents",
    "RecoveredBasis",
    "basis_from_photographs",
    "basis_images",
    "irradiance_error",
    "irradiance_matrix",
    "matrix_irradiance",
    "principal_components",
    "quadratic_constants",
    "quadratic_irradiance",
    "relit",
    "FACETS",
    "DualForward",
    "DualGoal",
    "DualLight",
    "ExactForward",
    "ForwardModel",
    "FrameNodes",
    "Quadrature",
    "RoughnessTable",
    "Shadows",
    "ShadowedDual",
    "ShadowedForward",
    "ShadowedModel",
    "SourcesNeeded",
    "TransferVectors",
    "cast_shadows",
    "dual_columns",
    "dual_light",
    "filled_up",
    "integral_columns",
    "integral_columns_by_frame",
    "interpolated",
    "irradiance",
    "polar_coefficients",
    "polar_columns",
    "polar_nodes_for",
    "radiance",
    "render",
    "render_lit",
    "render_samples",
    "render_view",
    "render_views",
    "sensitivities",
    "roughness_table",
    "shadowed_irradiance",
    "sources_needed",
    "transfer_vectors",
    "LightDifference",
    "compare_lights",
    "three_spheres",
    "visible_nodes",
    "render_widths",
]
