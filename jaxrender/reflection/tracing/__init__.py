"""Light followed by rays: paths, luminaires nearby, the virtual gonioreflectometer (L 3, 5, 8).

``emitters``
    lights as a path meets or samples them
``scattering``
    a scene of facet BRDFs: where paths go and what they bring back
``path_tracer``
    radiance along rays, with its standard error
``luminaires`` ``luminaire_sampling`` ``luminaire_emitter``
    direct light from a luminaire by area integration, by sampling its surface, along paths
``gonioreflectometer``
    the BRDF of micro-geometry, measured
"""

from jaxrender.reflection.tracing.emitters import (
    DirectionalEmitter,
    Emitter,
    EnvironmentEmitter,
    LightSample,
)
from jaxrender.reflection.tracing.gonioreflectometer import (
    Gonioreflectometer,
    Measurement,
    MeasureSettings,
)
from jaxrender.reflection.tracing.luminaire_emitter import LuminaireEmitter
from jaxrender.reflection.tracing.luminaire_sampling import (
    LuminaireSampler,
    balance_weight,
    sampled_light,
)
from jaxrender.reflection.tracing.luminaires import (
    ShadedPoints,
    cell_rule,
    direct_light,
    from_point_light,
    gauss_rule,
)
from jaxrender.reflection.tracing.path_tracer import Estimate, PathSettings, path_radiance
from jaxrender.reflection.tracing.scattering import Scene

__all__ = [
    "DirectionalEmitter",
    "Emitter",
    "EnvironmentEmitter",
    "Estimate",
    "Gonioreflectometer",
    "LightSample",
    "LuminaireEmitter",
    "LuminaireSampler",
    "MeasureSettings",
    "Measurement",
    "PathSettings",
    "Scene",
    "ShadedPoints",
    "balance_weight",
    "cell_rule",
    "direct_light",
    "from_point_light",
    "gauss_rule",
    "path_radiance",
    "sampled_light",
]
