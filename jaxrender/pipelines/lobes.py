"""Lobes named on a command line: ``phong:exponent=32``, ``microfacet:sigma=0.1,mu=1.5``.

A specification is a model's name, and its parameters after a colon.  The lobe has amplitude one and
is seen head-on.  Its spectrum is about the normal for ``lambertian``, and about the reflected
direction for all others.  ``mirror`` passes every degree.
"""

import dataclasses
import difflib
import math
from typing import Any, NamedTuple, get_args

import numpy as np

from jaxrender.brdf import BRDF, BRDFS, brdf_named
from jaxrender.catalogue import MODELS
from jaxrender.errors import InputError
from jaxrender.shapes import Float
from jaxrender.spectra import spectrum_of

_MIRROR = "mirror"
# Where to cut a spectrum: what passes of any degree beyond is less than this part of the first.
_NEGLIGIBLE = 1e-3
_QUIET_DEGREES = 4


class Lobe(NamedTuple):
    """A lobe as its specification names it; ``brdf`` is None for the mirror.

    ``whole`` marks a material in its own channels, whose reader has ``said`` something.
    """

    specification: str
    model: str
    parameters: dict[str, Any]
    brdf: BRDF | None
    said: tuple[str, ...] = ()
    whole: bool = False

    @property
    def about(self) -> str:
        """The direction that the lobe is centred on."""
        return "normal" if self.model == "lambertian" else "reflected direction"

    @property
    def file_name(self) -> str:
        """The specification without what file systems mind."""
        given = {name: value for name, value in self.parameters.items() if value is not None}
        texts = (v if isinstance(v, str) else f"{float(np.ravel(v)[0]):g}" for v in given.values())
        return "_".join([self.model, *(f"{name}_{text}" for name, text in zip(given, texts))])

    def transfer(self, band_limit: int) -> Float[np.ndarray, "degree"]:
        """Compute A_l to a degree, the mean of the channels."""
        return self.transfers(band_limit).mean(axis=1)

    def transfers(self, band_limit: int) -> Float[np.ndarray, "degree channel"]:
        """Compute A_l to a degree in each channel; of a model there is one."""
        if self.brdf is None:
            return np.ones((band_limit + 1, 1))
        lobes = np.asarray(spectrum_of(self.brdf, band_limit))
        return lobes.T @ np.asarray(self.brdf.amplitudes)


def lobe_of(specification: str) -> Lobe:
    """Read the specification of a lobe that has a spectrum by degree: isotropic, or a mirror.

    Raises ``InputError`` as ``model_of`` does, and for an anisotropic lobe.
    """
    lobe = model_of(specification)
    if lobe.brdf is not None and not lobe.brdf.isotropic:
        raise InputError(
            f"--brdf {specification}: an anisotropic lobe has no spectrum by degree alone"
        )
    return lobe


def model_of(specification: str, option: str = "--brdf ") -> Lobe:
    """Read a specification; ``InputError`` names the unknown word and its nearest neighbour."""
    place = f"{option}{specification}"
    model, _, rest = specification.partition(":")
    model = model.strip().lower()
    known = [*BRDFS, _MIRROR]
    if model not in known:
        near = difflib.get_close_matches(model, known, n=1)
        meant = f", did you mean {near[0]!r}?" if near else ";"
        raise InputError(
            f"{place}: no BRDF is named {model!r}{meant} choose one of {', '.join(known)}"
        )
    parameters: dict[str, Any] = _typical(model)
    for pair in filter(None, (part.strip() for part in rest.split(","))):
        name, _, text = (part.strip() for part in pair.partition("="))
        parameters[name] = _value(place, model, name, text)
    if model == _MIRROR:
        if parameters:
            raise InputError(f"{place}: a mirror has no parameters; leave them out")
        return Lobe(specification, model, parameters, None)
    try:
        brdf = brdf_named(model, **{**_amplitudes(model), **parameters})
    except ValueError as error:
        raise InputError(f"{place}: {error}") from None
    return Lobe(specification, model, parameters, brdf)


def _typical(model: str) -> dict[str, Any]:
    """Find the typical numbers of a model, for a name alone; an index is left out."""
    numbers = MODELS[model].numbers if model in MODELS else ()
    searched = [number for number in numbers if number.part == "searched"]
    settled = MODELS[model].settled if model in MODELS else {}
    typical = {number.name: None if number.may_be_none else number.typical for number in searched}
    return {name: settled.get(name, value) for name, value in typical.items()}


def _amplitudes(model: str) -> dict[str, np.ndarray]:
    """Set the amplitude of the lobe to one, and that of a base under it to zero.

    What a model has settled stays so.
    """
    settled: dict[str, float] = {}
    if model in MODELS:
        names, settled = MODELS[model].names("amplitude"), MODELS[model].settled
    else:
        fields = dataclasses.fields(BRDFS[model])
        names = tuple(field.name for field in fields if field.name in ("kd", "ks"))
    alone = "ks" if "ks" in names else names[0]
    return {name: np.full(1, settled.get(name, float(name == alone))) for name in names}


def significant_degree(transfer: Float[np.ndarray, "degree"]) -> int:
    """Find the last degree of which a lobe passes more than a thousandth of degree 0.

    The search ends where several degrees in a row pass less.  Where none do, it is the last degree.
    """
    above = np.abs(transfer) > _NEGLIGIBLE * abs(transfer[0])
    # Lambert's lobe skips every other degree, so one that vanishes is not the end.
    quiet = np.convolve(~above, np.ones(_QUIET_DEGREES))[_QUIET_DEGREES - 1 : len(transfer)]
    ends = np.flatnonzero(quiet == _QUIET_DEGREES)
    last = int(ends[0]) if len(ends) else len(transfer)
    return max(0, last - 1)


def _value(place: str, model: str, name: str, text: str) -> Any:
    """Read a parameter's value: a number, or a word where the model wants one."""
    types = (
        {field.name: field.type for field in dataclasses.fields(BRDFS[model])}
        if (model in BRDFS)
        else {}
    )
    if types.get(name) is str:
        return text
    if types.get(name) is bool and text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{place}: {name} is {text!r}; give a number, as in {name}=0.5")
    # What a model has per channel it wants as an array.
    return np.array([value]) if name in types and _is_array(types[name]) else value


def _is_array(annotation: Any) -> bool:
    """Say whether a model's field holds an array with an axis, not a single number."""
    return any(getattr(part, "dims", ()) for part in get_args(annotation))
