"""Files in, files out.

``config``
    the settings of a run, as data
``run`` ``synth`` ``render`` ``evaluate``
    a fit; synthetic photographs from a recipe; a finished result's views rendered again, or
    compared with photographs
``brdf_sources`` ``render_brdf``
    a BRDF by its name: a file, a model, a result; its pictures on a ball or a mesh
``importing`` ``photographs_found`` ``imported_config``
    the capture of another program as one of ours, with its config
``exporting``
    a result in the files of other programs
``light_probe`` ``probe_views`` ``probe_unwrapping``
    light from photographs of a mirror ball, through a fisheye, or of a panorama
``tasks``
    what a run may recover: a module for each task
``output`` ``progress`` ``kept``
    result folders that appear whole or not at all; the stages of a run and their seconds; what is
    left when a person stops one
``plots`` ``notebook``
    a light, a BRDF or an estimate on matplotlib axes; the same in notebooks, unasked
``doctor`` ``cache_place``
    what works of an installation; where caches lie

The functions of one step are imported when they are first asked for, so that reading a config
does not import the numerics.
"""

import importlib

_HOME = {
    "fit": "run",
    "synthesise": "synth",
    "render_config": "render",
    "plot": "plots",
    "viewer": "view.viewer",
    "load_ipython_extension": "notebook",
    "unload_ipython_extension": "notebook",
    "RecipeConfig": "config",
    "RunConfig": "config",
    "load_recipe": "config",
    "load_run_config": "config",
}

__all__ = list(_HOME)


def __getattr__(name: str):
    """Import a function's module when the function is first asked for."""
    if name in _HOME:
        return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
