"""jaxrender: inverse rendering as deconvolution on the sphere.

Light is the signal, the BRDF is the filter, a photograph of a curved surface is the filtered light.
The packages follow the theory, and each imports only from those above it in this list:

``shapes`` ``errors``
    array types and the glossary of axis words; the error for input that can be mended
``harmonics`` ``wavelets`` ``geometry`` ``imaging``
    functions on the sphere; wavelets over any number of axes; directions, cameras and surfaces;
    pixels as measurements
``brdf`` ``lighting``
    reflectance and incoming radiance as functions of direction
``spectra`` ``io``
    the same as coefficients by degree; files to and from these objects
``reflection``
    the forward model: exact integral, irradiance, dual model, rendering
``inverse``
    the division: material from photographs, with error bars
``pipelines``
    files in, files out: configuration, runs, results, reports
"""

import importlib

__version__ = "0.1.0"

_PACKAGES = (
    "brdf",
    "geometry",
    "harmonics",
    "imaging",
    "inverse",
    "io",
    "lighting",
    "pipelines",
    "reflection",
    "spectra",
    "wavelets",
)

__all__ = ["__version__", *_PACKAGES]


def __getattr__(name: str):
    """Import a package when it is first asked for, so that ``import jaxrender`` stays quick."""
    if name in _PACKAGES:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
