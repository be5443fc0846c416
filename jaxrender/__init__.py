"""jaxrender: inverse rendering as deconvolution on the sphere.

Light is the signal, the BRDF is the filter, a photograph of a curved surface is the filtered light.
The packages follow the theory, and each imports only from those above it in this list:

``shapes`` ``errors`` ``catalogue`` ``programs``
    array types and the glossary of axis words; the error for input that can be mended; every model
    and every stated light by its name, and what its numbers are; traced programs that the next
    process finds again
``limits`` ``batches``
    how much a file may ask for; a function of many samples, some at once
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

What everyday work needs is here by its own name: ``load_capture``, ``load_mesh``,
``load_environment``; ``Sphere``, ``Mesh``, ``Pinhole``; the lights; ``material`` of a model's name
and numbers; ``render``; ``Scene``, ``unknown`` and ``fit``; ``plot`` of a light, a BRDF or what a
fit found, and ``view`` of the latter, a widget.  ``%load_ext jaxrender`` lets notebooks show lights
and BRDFs.
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

# What stands here by its own name, or by a shorter one: its package and its name there.
_NAMES = {
    "ClearSky": "lighting.ClearSky",
    "DirectionalSources": "lighting.DirectionalSources",
    "Environment": "lighting.Environment",
    "Estimate": "inverse.Estimate",
    "FactorSettings": "inverse.FactorSettings",
    "FitSettings": "inverse.FitSettings",
    "HarmonicLight": "lighting.HarmonicLight",
    "InputError": "errors.InputError",
    "Mesh": "geometry.Mesh",
    "Observations": "inverse.Observations",
    "Orthographic": "geometry.Orthographic",
    "OvercastSky": "lighting.OvercastSky",
    "Pinhole": "geometry.Pinhole",
    "PointSources": "lighting.PointSources",
    "Scene": "inverse.Scene",
    "SmoothLobes": "lighting.SmoothLobes",
    "Sphere": "geometry.Sphere",
    "Prior": "inverse.Prior",
    "Stated": "inverse.Stated",
    "fit": "inverse.fit",
    "load_capture": "inverse.load_capture",
    "load_environment": "io.read_environment",
    "load_mesh": "io.read_mesh",
    "load_ipython_extension": "pipelines.load_ipython_extension",
    "look_at": "geometry.look_at",
    "material": "brdf.brdf_named",
    "plot": "pipelines.plot",
    "render": "reflection.render_lit",
    "unknown": "inverse.unknown",
    "unload_ipython_extension": "pipelines.unload_ipython_extension",
    "view": "pipelines.viewer",
}

__all__ = ["__version__", *_PACKAGES, *_NAMES]


def __getattr__(name: str):
    """Import what is asked for when it first is, so that ``import jaxrender`` stays quick."""
    if name in _PACKAGES:
        return importlib.import_module(f"{__name__}.{name}")
    if name in _NAMES:
        package, _, own = _NAMES[name].partition(".")
        return getattr(importlib.import_module(f"{__name__}.{package}"), own)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
