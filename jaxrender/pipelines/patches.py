"""Patches and facet BRDFs named on a command line.

``sawtooth:teeth=4,rising=45,falling=45`` and ``velvet:threads=600,length=0.3,lean=20`` have
parameters as lobes do; angles are in degrees.  Anything else is a file: a mesh or an image of
heights.  The bounding rectangle of a mesh is one period.  White is ``relief`` above black in an
image, in units of its width.

A facet BRDF is a lobe's specification (``lobes``), in which an amplitude may have a colour:
``lambertian:kd=0.2/0.02/0.02``.  ``lambertian`` alone is white, kd = 1 / pi.
"""

import dataclasses
import difflib
import inspect
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.errors import InputError
from jaxrender.geometry.height_fields import Patch, height_field, sawtooth, velvet
from jaxrender.io.images import read_image
from jaxrender.io.meshes import MESH_SUFFIXES, read_mesh
from jaxrender.pipelines.brdf_sources import names_file, source_of
from jaxrender.pipelines.lobes import lobe_of

KINDS: dict[str, Callable[..., Patch]] = {"sawtooth": sawtooth, "velvet": velvet}
_DEGREES = ("rising", "falling", "lean", "azimuth")
_COLOUR = re.compile(r"(\w+)\s*=\s*([^,=]*/[^,=]*)")
_AMPLITUDES = ("kd", "ks")


class NamedPatch(NamedTuple):
    """A patch, and the files that it comes from."""

    patch: Patch
    files: list[Path]


def patch_of(specification: str, relief: float = 0.1) -> NamedPatch:
    """Make a patch from its name, a mesh or an image of heights.

    Raises ``InputError`` for an unknown name or parameter, and for a file that cannot be used.
    """
    kind, _, rest = specification.partition(":")
    try:
        if kind in KINDS:
            made = KINDS[kind](**_parameters(specification, KINDS[kind], rest))
            return NamedPatch(made, [])
        path = Path(specification)
        if not path.is_file():
            near = difflib.get_close_matches(kind, KINDS, n=1)
            meant = f", did you mean {near[0]!r}?" if near else ";"
            raise InputError(
                f"{specification}: no such file or kind of patch{meant} give one of "
                f"{', '.join(KINDS)}, a mesh or an image of heights"
            )
        if path.suffix.lower() in MESH_SUFFIXES:
            return NamedPatch(Patch.of(read_mesh(path)), [path])
        return NamedPatch(_of_image(path, relief), [path])
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{specification}: {error}") from None


def facets_of(specifications: Sequence[str], count: int) -> list[BRDF]:
    """Make a BRDF for each of ``count`` materials, with one number of channels; one may serve all.

    Raises ``InputError`` for a wrong specification, and for a wrong number of them.
    """
    facets = [_facet(specification) for specification in specifications]
    if len(facets) not in (1, count):
        raise InputError(
            f"{len(facets)} BRDFs for a patch of {count} materials: give --brdf once, or once for "
            "each of them"
        )
    channels = max(brdf.amplitudes.shape[1] for brdf in facets)
    coloured = [_of_channels(brdf, channels) for brdf in facets]
    return coloured * (count if len(coloured) == 1 else 1)


def _facet(specification: str) -> BRDF:
    if names_file(specification):
        return source_of(specification).colours
    colours = {name: _colour(specification, text) for name, text in _COLOUR.findall(specification)}
    for name in colours:
        if name not in _AMPLITUDES:
            raise InputError(f"--brdf {specification}: {name} has no colour; give one number")
    # The lobe itself is read with a colour's place taken by a number.
    lobe = lobe_of(_COLOUR.sub(r"\1=1", specification))
    if lobe.brdf is None:
        raise InputError(
            f"--brdf {specification}: a mirror's reflection is not sampled; give a narrow lobe, "
            "such as microfacet:sigma=0.05"
        )
    if lobe.model == "lambertian" and "kd" not in lobe.parameters:
        colours["kd"] = np.ones(1) / np.pi
    channels = max([len(colour) for colour in colours.values()], default=1)
    brdf = _of_channels(lobe.brdf, channels)
    whole = {name: np.resize(colour, channels) for name, colour in colours.items()}
    return dataclasses.replace(brdf, **whole)


def _of_channels(brdf: BRDF, channels: int) -> BRDF:
    fields = {field.name for field in dataclasses.fields(brdf)} & set(_AMPLITUDES)
    held = {name: np.asarray(getattr(brdf, name), float) for name in fields}
    sizes = {len(values) for values in held.values() if values.ndim}
    if sizes - {1, channels}:
        raise InputError(f"BRDFs of {max(sizes)} and {channels} channels: give colours alike")
    wide = {
        name: np.broadcast_to(values, (channels,)).copy()
        for name, values in held.items()
        if values.ndim
    }
    return dataclasses.replace(brdf, **wide)


def _colour(specification: str, text: str) -> np.ndarray:
    try:
        values = np.array([float(part) for part in text.split("/")])
    except ValueError:
        values = np.array([np.nan])
    if not (np.isfinite(values) & (values >= 0)).all():
        raise InputError(
            f"--brdf {specification}: {text!r} is no colour; give numbers from 0, as in 0.2/0.1/0"
        )
    return values


def _parameters(specification: str, kind: Callable[..., Patch], rest: str) -> dict:
    known = inspect.signature(kind).parameters
    found = {}
    for pair in filter(None, (part.strip() for part in rest.split(","))):
        name, _, text = (part.strip() for part in pair.partition("="))
        if name not in known:
            raise InputError(
                f"{specification}: no parameter {name!r}; choose from {', '.join(known)}"
            )
        is_count = isinstance(known[name].default, int)
        try:
            value = int(text) if is_count else float(text)
        except ValueError:
            wanted = "a whole number" if is_count else "a number"
            raise InputError(f"{specification}: {name} is {text!r}; give {wanted}") from None
        found[name] = np.radians(value).item() if name in _DEGREES else value
    return found


def _of_image(path: Path, relief: float) -> Patch:
    pixels = np.asarray(read_image(path).pixels, float)
    # Row 0 is at the top of a picture, and at y = 0 of a height field.
    heights = pixels.mean(axis=2)[::-1] * relief
    return height_field(heights, (1.0, heights.shape[0] / heights.shape[1]))
