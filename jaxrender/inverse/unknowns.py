"""Which numbers of a material are free, and how they enter the model.

Amplitudes, such as kd and ks, enter linearly and are eliminated.  The model's other numbers do not,
and are searched in unconstrained variables: an S-shaped curve maps them to where
log(value - origin) lies between its bounds.  Gains of single photographs join the search as
logarithms, relative to the first photograph.
"""

from collections.abc import Mapping
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Parametric, Searched
from jaxrender.inverse.stated import Prior, Stated, Unknown
from jaxrender.shapes import Array, Bool, Float, checked

# Within this fraction of the logarithmic range a parameter counts as being at its bound.
_AT_BOUND = 0.005
# A search variable is kept this far from where it is infinite.
_CLOSEST = 1e-9


class Physical(eqx.Module):
    """The searched numbers in their own units, by their names, and the gains.

    A number that varies over a surface has a value for each sample.
    """

    numbers: dict[str, Float[Array, "*sample"]]
    gains: Float[Array, "frame"]


class Unknowns(eqx.Module):
    """What is unknown of a material, and what else is unknown about the photographs.

    ``amplitudes`` are those of the model's lobes by their names, in the order of the lobes; of the
    ``coloured`` ones each channel has its own, of the others all channels share one; ``summed``
    ones stand in for one another, so that only their sum is told; ``shaped`` are the places of
    those lobes that numbers shape.  ``numbers`` are those of the model, in the order
    of ``searched``, which says what they are.  ``free_gains`` is the number of photographs whose
    exposure is unknown (0: all known); ``free_scale`` says that the light is known up to one
    factor.
    """

    amplitudes: tuple[Unknown, ...]
    numbers: tuple[Unknown, ...]
    amplitude_names: tuple[str, ...] = eqx.field(static=True)
    searched: tuple[Searched, ...] = eqx.field(static=True)
    coloured: tuple[str, ...] = eqx.field(static=True)
    shaped: tuple[int, ...] = eqx.field(static=True)
    free_gains: int = eqx.field(static=True, default=0)
    free_scale: bool = eqx.field(static=True, default=False)
    summed: tuple[str, ...] = eqx.field(static=True, default=())

    def __getitem__(self, name: str) -> Unknown:
        """What is known of an amplitude or a number; ``KeyError`` where there is none."""
        own = dict(zip(self.amplitude_names, self.amplitudes))
        return (own | {one.name: unknown for one, unknown in zip(self.searched, self.numbers)})[
            name
        ]

    def __contains__(self, name: str) -> bool:
        """Whether the model searches for a number of this name."""
        return any(one.name == name for one in self.searched)

    @property
    def free_amplitudes(self) -> tuple[str, ...]:
        """The amplitudes that are solved for, in the order of the lobes."""
        own = zip(self.amplitude_names, self.amplitudes)
        return tuple(name for name, unknown in own if unknown.free)

    @property
    def free_numbers(self) -> tuple[str, ...]:
        """The numbers that are searched for, in the order of the search vector."""
        return tuple(one.name for one, unknown in zip(self.searched, self.numbers) if unknown.free)

    @property
    def with_prior(self) -> tuple[str, ...]:
        """The amplitudes and numbers of which a prior is stated."""
        every = (*self.amplitude_names, *(one.name for one in self.searched))
        return tuple(name for name in every if self[name].prior is not None)

    @property
    def names(self) -> tuple[str, ...]:
        """The nonlinear unknowns in the order of the search vector: free numbers, then gains."""
        return (*self.free_numbers, *(f"gain {frame}" for frame in range(1, self.free_gains)))

    @property
    def origins(self) -> dict[str, float]:
        """Each number's origin: its logarithm above there is what is searched."""
        return {one.name: one.origin for one in self.searched}

    @property
    def ends(self) -> dict[str, tuple[float, float]]:
        """What each free number that is closed lies between."""
        closed = {one.name for one in self.searched if one.closed}
        return {name: self.range_of(name) for name in self.free_numbers if name in closed}

    def range_of(self, name: str) -> tuple[float, float]:
        """Tell what bounds a search for an amplitude or a number keeps to."""
        return self[name].lower, self[name].upper

    @eqx.filter_jit
    @checked
    def unpack(self, point: Float[Array, "unknown"]) -> Physical:
        """Turn a search vector into parameters in their own units."""
        free = iter(point)
        numbers = {
            one.name: one.origin + jnp.exp(_inside(unknown, next(free), one.origin))
            if unknown.free
            else jnp.asarray(unknown.first(one.start), point.dtype)
            for one, unknown in zip(self.searched, self.numbers)
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
        parts = {one.name for one in self.searched if one.expected}
        varied = [at for at, name in enumerate(self.free_numbers) if name not in parts]
        spread = (0.5 + np.outer(np.arange(len(points)), _lattice(len(varied)))) % 1
        points[1:, varied] = _search_variable(0.15 + 0.7 * spread[1:])
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
    def range_information(self, point: Float[Array, "unknown"]) -> Float[Array, "unknown"]:
        """Say what their bounds alone tell of the nonlinear unknowns: 1 / variance at a point.

        A parameter that is spread evenly between its bounds (in the logarithm) has a logit of
        variance pi^2 / 3.  This is used half-way between the bounds.  Near a bound the curve is
        flat: the search variable goes further for the same part of the range.
        """
        flatness = (1 + (point / 2) ** 2) ** -3
        return jnp.where(jnp.asarray(self.bounded), 3 / np.pi**2 * flatness, 0)

    @checked
    def between(
        self, one: Float[np.ndarray, "unknown"], other: Float[np.ndarray, "unknown"]
    ) -> Float[np.ndarray, "unknown"]:
        """Find the point half-way: between the parameters, since search variables have no end."""
        halves = np.array([_fraction(one), _fraction(other)]).mean(axis=0)
        centred = 2 * np.clip(halves, _CLOSEST, 1 - _CLOSEST) - 1
        inside = 2 * centred / np.sqrt(1 - centred**2)
        return np.where(self.bounded, inside, (one + other) / 2)

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
    stated: Mapping[str, Stated] | None = None,
    *,
    diffuse: bool = False,
    ks_per_channel: bool = False,
    free_gains: int = 0,
    free_scale: bool = False,
    expected: bool = True,
) -> Unknowns:
    """Put what is stated of a model's own numbers, by their names, in the words of a search.

    What is not stated is free, unless the model has settled it.  ``diffuse`` leaves all but the
    base black.  With ``ks_per_channel`` every amplitude has a value for each channel, not only
    those that the model colours.  ``expected`` says whether what the model expects of its numbers
    counts where no prior is stated; data without a noise do not know how much.

    Raises ``ValueError`` that begins with the name of a number whose start is outside its bounds,
    or whose bounds reach its origin (as a ``mu`` of 1) or are infinite; for a name that there is
    none of; and for a model whose numbers contradict its class.
    """
    settled = {name: Stated(fixed=value) for name, value in lobe.settled.items()}
    stated = {**settled, **(stated or {})}
    _check_numbers(lobe)
    # Of amplitudes that stand in for one another nobody states one, but of a base.
    summed = {part for names in lobe.sums.values() for part in names}
    parts = summed - {*lobe.bases}
    own = [name for name in lobe.amplitude_names if name not in parts]
    own += [one.name for one in lobe.searched]
    for name in stated:
        if name not in own:
            raise ValueError(f"{name}: the model has {', '.join(own)}")

    usual = {one.name: Prior(*one.expected) for one in lobe.searched if one.expected and expected}

    def sought(name: str, lowest: float, highest: float, origin: float | None = None) -> Unknown:
        try:
            own = stated.get(name, Stated())
            if own.fixed is None and own.prior is None:
                own = own._replace(prior=usual.get(name))
            unknown = own.unknown(lowest, highest)
            if origin is not None:
                _check_logarithm(unknown, origin)
            return unknown
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None

    black = Unknown(fixed=(0.0,))
    amplitudes = tuple(
        black if diffuse and name not in lobe.bases else sought(name, 0.0, float("inf"))
        for name in lobe.amplitude_names
    )
    numbers = tuple(sought(one.name, one.lowest, one.highest, one.origin) for one in lobe.searched)
    if diffuse:
        numbers = tuple(Unknown(fixed=(float(value),)) for value in lobe.numbers.values())
    return Unknowns(
        amplitudes,
        numbers,
        lobe.amplitude_names,
        lobe.searched,
        lobe.amplitude_names if ks_per_channel else lobe.coloured,
        lobe.shaped(),
        free_gains=free_gains,
        free_scale=free_scale,
        summed=tuple(sorted(summed)),
    )


def _check_logarithm(unknown: Unknown, origin: float) -> None:
    """Refuse bounds between which a search for log(value - origin) has no start."""
    if unknown.free and not origin < unknown.lower < unknown.upper < float("inf"):
        raise ValueError(
            f"bounds [{unknown.lower:g}, {unknown.upper:g}]: the lower must be above {origin:g}, "
            "and the upper finite"
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


def _inside(unknown: Unknown, x: Float[Array, ""], origin: float) -> Float[Array, ""]:
    """Map a search variable to the logarithm of (value - origin) between the bounds."""
    low, high = np.log(unknown.lower - origin), np.log(unknown.upper - origin)
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
