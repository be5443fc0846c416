"""Which numbers of a material are free, and how they enter the model.

kd and ks enter linearly and are eliminated.  The model's other numbers do not, and are searched in
unconstrained variables: an S-shaped curve maps them to where log(value - origin) lies between its
bounds.  Gains of single photographs join the search as logarithms, relative to the first
photograph.
"""

from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Parametric, Searched
from jaxrender.shapes import Array, Bool, Float, checked

# Within this fraction of the logarithmic range a parameter counts as being at its bound.
_AT_BOUND = 0.005


class Unknown(eqx.Module):
    """A parameter: ``fixed`` at a value (one, or one per channel), or free within its bounds."""

    fixed: tuple[float, ...] | None = eqx.field(static=True, default=None)
    lower: float = eqx.field(static=True, default=0.0)
    upper: float = eqx.field(static=True, default=float("inf"))
    start: float | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        if not self.lower < self.upper:
            raise ValueError(
                f"bounds [{self.lower}, {self.upper}]: the lower must be below the upper"
            )
        if self.start is not None and not self.lower <= self.start <= self.upper:
            raise ValueError(f"start {self.start} is outside [{self.lower}, {self.upper}]")

    @property
    def free(self) -> bool:
        """Whether the parameter is searched for."""
        return self.fixed is None

    def first(self, otherwise: float) -> float:
        """Choose where a search begins: the fixed value, the stated start, or inside the bounds."""
        if self.fixed is not None:
            return float(self.fixed[0])
        inside = float(np.clip(otherwise, self.lower, self.upper))
        return inside if self.start is None else self.start


class Told(NamedTuple):
    """What is told of one of a model's own numbers: nothing, its value, or where it lies.

    ``fixed`` is one value, or one for each channel; ``bounds`` are the lowest and the highest;
    ``start`` is where the search starts.
    """

    fixed: float | tuple[float, ...] | None = None
    bounds: tuple[float, float] | None = None
    start: float | None = None

    def unknown(self, lowest: float, highest: float) -> Unknown:
        """Make the unknown of a search, within these bounds unless told otherwise."""
        if self.fixed is not None:
            return Unknown(fixed=tuple(float(value) for value in np.atleast_1d(self.fixed)))
        low, high = map(float, self.bounds or (lowest, highest))
        return Unknown(None, low, high, None if self.start is None else float(self.start))


class Physical(eqx.Module):
    """The searched numbers in their own units, by their names, and the gains.

    A number that varies over a surface has a value for each sample.
    """

    numbers: dict[str, Float[Array, "*sample"]]
    gains: Float[Array, "frame"]


class Unknowns(eqx.Module):
    """What is unknown of a material, and what else is unknown about the photographs.

    ``numbers`` are those of the model, in the order of ``searched``, which says what they are.
    ``free_gains`` is the number of photographs whose exposure is unknown (0: all known);
    ``free_scale`` says that the light is known up to one factor.
    """

    kd: Unknown
    ks: Unknown
    numbers: tuple[Unknown, ...]
    searched: tuple[Searched, ...] = eqx.field(static=True)
    ks_per_channel: bool = eqx.field(static=True, default=False)
    free_gains: int = eqx.field(static=True, default=0)
    free_scale: bool = eqx.field(static=True, default=False)

    def __getitem__(self, name: str) -> Unknown:
        """What is known of one of the model's numbers; ``KeyError`` where there is none."""
        return {one.name: unknown for one, unknown in zip(self.searched, self.numbers)}[name]

    def __contains__(self, name: str) -> bool:
        """Whether the model has a number of this name."""
        return any(one.name == name for one in self.searched)

    @property
    def free_numbers(self) -> tuple[str, ...]:
        """The numbers that are searched for, in the order of the search vector."""
        return tuple(one.name for one, told in zip(self.searched, self.numbers) if told.free)

    @property
    def names(self) -> tuple[str, ...]:
        """The nonlinear unknowns in the order of the search vector: free numbers, then gains."""
        return (*self.free_numbers, *(f"gain {frame}" for frame in range(1, self.free_gains)))

    @property
    def origins(self) -> dict[str, float]:
        """Each number's origin: its logarithm above there is what is searched."""
        return {one.name: one.origin for one in self.searched}

    @eqx.filter_jit
    @checked
    def unpack(self, point: Float[Array, "unknown"]) -> Physical:
        """Turn a search vector into parameters in their own units."""
        free = iter(point)
        numbers = {
            one.name: one.origin
            + jnp.exp(_inside(told, next(free) if told.free else None, one.origin, point.dtype))
            for one, told in zip(self.searched, self.numbers)
        }
        gains = jnp.exp(jnp.stack([jnp.zeros((), point.dtype), *free]))
        return Physical(numbers, gains)

    def pack(self, numbers: Mapping[str, float]) -> Float[np.ndarray, "unknown"]:
        """Turn numbers in their own units into a search vector, all gains 1."""
        packed = np.zeros(len(self.names))
        for place, name in enumerate(self.free_numbers):
            packed[place] = _outside(self[name], float(numbers[name]), self.origins[name])
        return packed

    def starts(self, count: int) -> Float[np.ndarray, "start unknown"]:
        """Spread ``count`` starting points over the bounds, the user's own first."""
        first = {one.name: u.first(one.start) for one, u in zip(self.searched, self.numbers)}
        points = np.tile(self.pack(first), (max(count, 1), 1))
        spread = (0.5 + np.outer(np.arange(len(points)), _lattice(len(self.free_numbers)))) % 1
        points[1:, : spread.shape[1]] = _search_variable(0.15 + 0.7 * spread[1:])
        return points

    @checked
    def at_bound(self, point: Float[Array, "unknown"]) -> Bool[np.ndarray, "unknown"]:
        """Say which searched parameters ended at a bound."""
        fraction = np.asarray(_fraction(point))
        return self.bounded & ((fraction < _AT_BOUND) | (fraction > 1 - _AT_BOUND))

    @property
    def bounded(self) -> Bool[np.ndarray, "unknown"]:
        """Which nonlinear unknowns have bounds: the numbers, and no gain."""
        return np.arange(len(self.names)) < len(self.free_numbers)

    @checked
    def restarts(
        self, starts: Float[np.ndarray, "start unknown"]
    ) -> Float[np.ndarray, "more unknown"]:
        """Add, for each start at a bound, one that is pulled inside the bounds.

        At a bound the search variable hardly moves the parameter, so a search cannot leave it.
        """
        reach = _search_variable(1.0)
        pulled = np.where(self.bounded, np.clip(starts, -reach, reach), starts)
        pulled = pulled.astype(starts.dtype)
        return np.concatenate([starts, pulled[(pulled != starts).any(axis=1)]])


def unknowns_of(
    lobe: Parametric,
    told: Mapping[str, Told] | None = None,
    *,
    matt: bool = False,
    ks_per_channel: bool = False,
    free_gains: int = 0,
    free_scale: bool = False,
) -> Unknowns:
    """Put what is told of a model's own numbers, by their names, in the words of a search.

    What is not told is free.  ``matt`` leaves the lobe black.  Raises ``ValueError`` that begins
    with the name of a number whose start is outside its bounds, for a name that there is none of,
    and for a model whose numbers contradict its class.
    """
    told = told or {}
    _check_numbers(lobe)
    own = [*filter(None, lobe.amplitude_names), *(one.name for one in lobe.searched)]
    for name in told:
        if name not in own:
            raise ValueError(f"{name}: the model has {', '.join(own)}")

    def sought(name: str, lowest: float, highest: float) -> Unknown:
        try:
            return told.get(name, Told()).unknown(lowest, highest)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None

    black = Unknown(fixed=(0.0,))
    kd, ks = (
        black if name is None else sought(name, 0.0, float("inf")) for name in lobe.amplitude_names
    )
    numbers = tuple(sought(one.name, one.lowest, one.highest) for one in lobe.searched)
    if matt:
        ks = black
        numbers = tuple(Unknown(fixed=(float(value),)) for value in lobe.numbers.values())
    return Unknowns(
        kd,
        ks,
        numbers,
        lobe.searched,
        # What the model itself calls kd has a value for each channel.
        ks_per_channel=ks_per_channel or lobe.amplitude_names[1] == "kd",
        free_gains=free_gains,
        free_scale=free_scale,
    )


def _check_numbers(lobe: Parametric) -> None:
    """Refuse a model that contradicts itself, by its class and number."""
    kind, names = type(lobe).__name__, [one.name for one in lobe.searched]
    for one in lobe.searched:
        if not hasattr(lobe, one.name):
            raise ValueError(f"{kind}.searched: there is no field {one.name!r}")
        if names.count(one.name) > 1:
            raise ValueError(f"{kind}.searched: {one.name} is there twice")
        if not one.origin < one.lowest <= one.start <= one.highest < float("inf"):
            raise ValueError(
                f"{kind}.{one.name}: its start {one.start:g} must lie between {one.lowest:g} and "
                f"{one.highest:g}, and these above its origin {one.origin:g}"
            )


def _lattice(dimensions: int) -> Float[np.ndarray, "dimension"]:
    """Irrational numbers whose successive multiples fill a cube evenly (a Kronecker lattice).

    Powers of 1 / x, where x^(d + 1) = x + 1; of one dimension the first of those of two.
    """
    degree, root = max(dimensions, 2), 1.0
    for _ in range(60):
        root = (1 + root) ** (1 / (degree + 1))
    return root ** -np.arange(1.0, dimensions + 1)


def _inside(unknown: Unknown, x: Float[Array, ""] | None, origin: float, dtype) -> Float[Array, ""]:
    """Map a search variable to the logarithm of (value - origin) between the bounds."""
    if unknown.fixed is not None:
        return jnp.log(jnp.asarray(unknown.fixed[0] - origin, dtype))
    low, high = np.log(unknown.lower - origin), np.log(unknown.upper - origin)
    assert x is not None
    return low + (high - low) * _fraction(x)


def _outside(unknown: Unknown, value: float, origin: float) -> float:
    low, high = np.log(unknown.lower - origin), np.log(unknown.upper - origin)
    return float(_search_variable((np.log(value - origin) - low) / (high - low)))


@partial(jax.jit, inline=True)
def _fraction(x: Float[Array, "*any"]) -> Float[Array, "*any"]:
    """Map a search variable to (0, 1), flattening out as 1 / x^3.

    A step too far leaves a slope to come back on, where that of the logistic curve is gone.
    """
    half = x / 2
    return (1 + half * jax.lax.rsqrt(1 + half * half)) / 2


def _search_variable(fraction):
    # Not closer to a bound than where the search variable still moves the parameter.
    centred = 2 * np.clip(fraction, 0.01, 0.99) - 1
    return 2 * centred / np.sqrt(1 - centred**2)
