"""Array types, the glossary of axis words, and the check of arrays at the door of the public API.

Axis words: ``point`` a place on a surface; ``sample`` one usable pixel of one photograph;
``row column`` an image; ``frame`` a photograph; ``ray`` a ray; ``node`` a direction with a
quadrature weight; ``source`` a directional light; ``channel`` a colour channel; ``degree`` l from
0 to the band limit; ``coefficient`` the flat index l(l+1)+m of a real harmonic; ``lobe`` one of the
functions whose linear combination is a BRDF; ``*batch`` any number of axes, or none.

``Array`` is a JAX array.  ``AnyArray`` is a JAX or a NumPy array: what functions accept that hand
their input to either.

``checked`` holds the arguments of a public function against these annotations.  Below ``jax.jit``
it runs where the function is traced, so that a compiled call does not pay for it:

    @jax.jit
    @checked
    def evaluate(coefficients: Coefficients, directions: Directions) -> ...
"""

import functools
import inspect
import math
import types
import typing
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import AbstractArray, Array, Bool, Complex, Float, Int, jaxtyped

AnyArray = jax.Array | np.ndarray

_Function = TypeVar("_Function", bound=Callable)
_Values = TypeVar("_Values")


def as_jax(values: np.ndarray | Array, dtype: np.dtype | None = None) -> Array:
    """Copy a host array to JAX, where ``jnp.asarray`` would compile a program for every shape."""
    return jax.device_put(np.array(values, dtype))


def in_precision(dtype: type[np.floating] | np.dtype, values: _Values) -> _Values:
    """Convert the arrays of real numbers in a tree, to single precision for example."""
    # Without 64 bits JAX knows no double precision.
    kept = jax.dtypes.canonicalize_dtype(dtype)

    def converted(leaf: Any) -> Any:
        real = isinstance(leaf, AnyArray) and jnp.issubdtype(leaf.dtype, jnp.floating)
        return jnp.asarray(leaf, kept) if real else leaf

    return jax.tree.map(converted, values)


Directions = Float[AnyArray, "*batch 3"]
Coefficients = Float[AnyArray, "coefficient channel"]
ImageArray = Float[AnyArray, "row column channel"]

_HALF = (jnp.float16, jnp.bfloat16)
_NUMBERS = "biufc"


def checked(function: _Function) -> _Function:
    """Hold the arrays that a function is called with against its annotations.

    - Axes of one name have one length in all arguments, in the fields of named tuples too.
    - Numbers, lists and integers become floats.  A JAX array becomes a NumPy array where the
      function works on the host, and the reverse.
    - An array without its ``channel`` axis is grey.  The function is given one channel, and its
      result has no such axis unless another argument has.

    All else raises ``ValueError``, which names the argument, what was given and what is wanted:
    half precision too, and real numbers for complex ones.
    """
    signature = inspect.signature(function)
    name = getattr(function, "__qualname__", str(function))

    @functools.cache
    def wanted() -> dict[str, "_Wanted"]:
        hints = typing.get_type_hints(inspect.unwrap(function))
        read = {argument: _read(hint) for argument, hint in hints.items()}
        return {argument: wish for argument, wish in read.items() if wish is not None}

    @functools.wraps(function)
    def door(*args, **kwargs):
        given = signature.bind(*args, **kwargs)
        visit = _Visit(name, [], set())
        for argument, value in given.arguments.items():
            wish = wanted().get(argument)
            if wish is None:
                continue
            if signature.parameters[argument].kind is inspect.Parameter.VAR_POSITIONAL:
                each = (visit.admit(f"{argument}[{k}]", one, wish) for k, one in enumerate(value))
                given.arguments[argument] = tuple(each)
            else:
                given.arguments[argument] = visit.admit(argument, value, wish)
        result = function(*given.args, **given.kwargs)
        return _grey(result, wanted().get("return")) if visit.coloured == {False} else result

    door.__dict__["checks_arrays"] = True
    return typing.cast(_Function, door)


class _Admitted(NamedTuple):
    """An array that a call has got past the door, and what it was held against."""

    name: str
    array: AnyArray
    axes: "_Axes"


class _Axes(NamedTuple):
    """One array annotation, whatever keeps the array: its kind of number and its axes."""

    annotation: type[AbstractArray]
    kind: str
    names: tuple[str, ...]
    keepers: tuple[type, ...]

    @property
    def described(self) -> str:
        return f"{self.kind}[{', '.join(self.names)}]"

    @property
    def channel(self) -> int | None:
        """The place of the channel axis, counted from the end."""
        plain = [name.lstrip("#") for name in self.names]
        return plain.index("channel") - len(plain) if "channel" in plain else None

    def fits(self, array: AnyArray, admitted: list[_Admitted]) -> bool:
        """Whether kind and shape do, with the axes that the arrays admitted so far have bound."""
        if array.dtype in _HALF:
            return False
        with jaxtyped("context"):
            bound = [isinstance(one.array, one.axes.annotation) for one in admitted]
            return all(bound) and isinstance(array, self.annotation)

    def lengths(self, array: AnyArray) -> dict[str, int]:
        """The length of each axis, by name; none where the numbers of axes differ."""
        if any("*" in name or "..." in name for name in self.names):
            around = [name for name in self.names if "*" not in name and "..." not in name]
            last = self.names[len(self.names) - len(around) :]
            if tuple(around) != last or array.ndim < len(around):
                return {}
            return dict(zip(around, array.shape[array.ndim - len(around) :], strict=True))
        if array.ndim != len(self.names):
            return {}
        return dict(zip((n.lstrip("#") for n in self.names), array.shape, strict=True))


class _Wanted(NamedTuple):
    """What an annotation asks for: one of some arrays, or something else; or a named tuple."""

    choices: tuple[_Axes, ...]
    others: tuple[type, ...]
    fields: dict[str, "_Wanted"]


def _read(hint: Any) -> _Wanted | None:
    """Read an annotation; None where it has no array in it."""
    if isinstance(hint, type) and issubclass(hint, tuple) and hasattr(hint, "_fields"):
        fields = {name: _read(own) for name, own in typing.get_type_hints(hint).items()}
        held = {name: wish for name, wish in fields.items() if wish is not None}
        return _Wanted((), (hint,), held) if held else None
    members = typing.get_args(hint) if _is_union(hint) else (hint,)
    arrays = [m for m in members if isinstance(m, type) and issubclass(m, AbstractArray)]
    if not arrays:
        return None
    others = [typing.get_origin(m) or m for m in members if m not in arrays]
    by_shape: dict[tuple, list[type]] = {}
    for array in arrays:
        by_shape.setdefault((array.dtype, array.dim_str), []).append(array.array_type)
    choices = tuple(
        _Axes(dtype[Any, axes], dtype.__name__.lower(), tuple(axes.split()), tuple(keepers))
        for (dtype, axes), keepers in by_shape.items()
    )
    return _Wanted(choices, tuple(others), {})


def _is_union(hint: Any) -> bool:
    return isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union


class _Visit(NamedTuple):
    """One call: whose it is, the arrays admitted so far, and whether they came with channels."""

    function: str
    admitted: list[_Admitted]
    coloured: set[bool]

    def admit(self, name: str, value: Any, wanted: _Wanted) -> Any:
        """Return what the function is to get for an argument; ``ValueError`` if nothing fits."""
        if any(isinstance(value, other) for other in wanted.others):
            if not wanted.fields:
                return value
            mended = {
                field: self.admit(f"{name}.{field}", getattr(value, field), wish)
                for field, wish in wanted.fields.items()
            }
            # Made anew only where it must be: a subclass may hold more than its fields.
            new = {field: one for field, one in mended.items() if one is not getattr(value, field)}
            return value._replace(**new) if new else value
        if not wanted.choices:
            return value
        array = _as_array(value, integers=any(c.kind == "int" for c in wanted.choices))
        if array is not None:
            for axes in wanted.choices:
                if axes.fits(array, self.admitted):
                    self.coloured.update({True} if axes.channel is not None else ())
                    return self._taken(name, array, axes)
            for axes in wanted.choices:
                if axes.channel is not None and array.ndim >= -axes.channel - 1:
                    grey = _with_axis(array, axes.channel)
                    if axes.fits(grey, self.admitted):
                        self.coloured.add(False)
                        return self._taken(name, grey, axes)
        given = type(value).__name__ if array is None else f"{array.dtype}{list(array.shape)}"
        choices = " or ".join(axes.described for axes in wanted.choices)
        why = "" if array is None else self._why_not(array, wanted.choices)
        if hasattr(value, "nodes"):
            why = ": spectra.light_coefficients(light, F) expands a light to degree F"
        raise ValueError(f"{self.function}: {name} is {given}, wanted {choices}{why}")

    def _taken(self, name: str, array: Any, axes: _Axes) -> AnyArray:
        self.admitted.append(_Admitted(name, array, axes))
        # A named tuple holds what it was made of: the function asks for the tuple, not the field.
        if isinstance(array, axes.keepers) or "." in name:
            return array
        if np.ndarray not in axes.keepers:
            return jnp.asarray(array)
        if isinstance(array, jax.core.Tracer):
            raise ValueError(
                f"{self.function}: {name} is traced, and this function works on the host: "
                "call it outside of jit, grad and vmap"
            )
        return np.asarray(array)

    def _why_not(self, array: AnyArray, choices: tuple[_Axes, ...]) -> str:
        """Say which rule the array breaks, and the remedy where there is one."""
        kinds = {axes.kind for axes in choices}
        if array.dtype in _HALF:
            return ": half precision has too few digits, give float32 or float64"
        if np.iscomplexobj(array) and kinds <= {"float", "int"}:
            return ": harmonics.real_from_complex makes real coefficients of complex ones"
        if not np.iscomplexobj(array) and kinds == {"complex"}:
            return ": harmonics.complex_from_real makes complex coefficients of real ones"
        for axes in choices:
            for axis, length in axes.lengths(array).items():
                if axis.isdigit() and length != int(axis):
                    return f": the axis of {axis} has {length} entries"
                for other, earlier, others in self.admitted:
                    known = others.lengths(earlier).get(axis, length)
                    if known != length:
                        here, there = (_described(axis, count) for count in (length, known))
                        return f": {axis} is {here} here and {there} in {other}"
        return ""


def _described(axis: str, length: int) -> str:
    """A length, with the band limit that it stands for."""
    band_limit = {"coefficient": math.isqrt(max(length, 1)) - 1, "degree": length - 1}.get(axis)
    return f"{length}" if band_limit is None else f"{length} (band limit {band_limit})"


def _as_array(value: Any, integers: bool) -> Any:
    """Make an array of numbers or lists, of floats unless integers are wanted; None if none."""
    array = value
    if not isinstance(array, AnyArray):
        try:
            # Numbers keep JAX's weak type: they take the precision of what they meet.
            array = jnp.asarray(value) if np.isscalar(value) or _traced(value) else np.array(value)
        except (TypeError, ValueError):
            return None
    kind = "f" if array.dtype == jnp.bfloat16 else array.dtype.kind
    if kind not in _NUMBERS:
        return None
    if kind in "iu" and not integers:
        return array.astype(jax.dtypes.canonicalize_dtype(float))
    return array


def _traced(value: Any) -> bool:
    return any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(value))


def _with_axis(array: AnyArray, place: int) -> AnyArray:
    """Put an axis of length 1 at a place counted from the end of the result."""
    cut = array.ndim + 1 + place
    return array.reshape(*array.shape[:cut], 1, *array.shape[cut:])


def _grey(result: Any, wanted: _Wanted | None) -> Any:
    """Drop the channel axis of a result whose annotation has one."""
    if wanted is None or not wanted.choices or not isinstance(result, AnyArray):
        return result
    place = wanted.choices[0].channel
    return result if place is None else result.squeeze(place)


__all__ = [
    "AnyArray",
    "Array",
    "Bool",
    "Coefficients",
    "Complex",
    "Directions",
    "Float",
    "ImageArray",
    "Int",
    "as_jax",
    "checked",
]
