"""Which parameters of a microfacet material are free, and how they enter the model.

kd and ks enter linearly and are eliminated; sigma and mu do not, and are searched in unconstrained
variables: an S-shaped curve maps them to where log sigma, or log(mu - 1), lies between its bounds.
Gains of single photographs join the search as logarithms, relative to the first photograph.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.shapes import Array, Bool, Float, checked

# The search space where the user names no bounds: from nearly mirror to nearly diffuse, and from
# nearly no interface to well above diamond.
SIGMA_BOUNDS = (0.01, 1.0)
MU_BOUNDS = (1.02, 6.0)
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


def sigma_unknown(
    lower: float = SIGMA_BOUNDS[0], upper: float = SIGMA_BOUNDS[1], start: float | None = None
) -> Unknown:
    """A free roughness, within ``SIGMA_BOUNDS`` unless said otherwise."""
    return Unknown(None, lower, upper, start)


def mu_unknown(
    lower: float = MU_BOUNDS[0], upper: float = MU_BOUNDS[1], start: float | None = None
) -> Unknown:
    """A free refractive index, within ``MU_BOUNDS`` unless said otherwise."""
    return Unknown(None, lower, upper, start)


def index_bounds(brdf: Parametric | type[Parametric]) -> tuple[float, float]:
    """Bound the index of a model, or what its own second number stands for as an index."""
    highest = brdf.index.highest
    return MU_BOUNDS[0], MU_BOUNDS[1] if highest is None else brdf.index.index_of(highest)


class Told(NamedTuple):
    """What is told of one of a model's own numbers: nothing, its value, or where it lies.

    ``fixed`` is one value, or one for each channel; ``bounds`` are the lowest and the highest;
    ``start`` is where the search starts.
    """

    fixed: float | tuple[float, ...] | None = None
    bounds: tuple[float, float] | None = None
    start: float | None = None

    def through(self, function: Callable[[float], float]) -> "Told":
        """Tell the same of a number that this one stands for; it may fall where this one rises."""
        fixed = self.fixed
        if fixed is not None:
            values = [float(function(float(value))) for value in np.atleast_1d(fixed)]
            fixed = values[0] if len(values) == 1 else tuple(values)
        low, high = sorted(float(function(float(end))) for end in self.bounds or (1.0, 1.0))
        start = None if self.start is None else float(function(float(self.start)))
        return Told(fixed, None if self.bounds is None else (low, high), start)

    def unknown(self, lowest: float, highest: float) -> Unknown:
        """Make the unknown of a search, within these bounds unless told otherwise."""
        if self.fixed is not None:
            return Unknown(fixed=tuple(float(value) for value in np.atleast_1d(self.fixed)))
        return Unknown(None, *(self.bounds or (lowest, highest)), self.start)


class Physical(eqx.Module):
    """The nonlinear parameters in their own units; ``mu`` is None for a metal.

    Where sigma varies over a surface it is one for each sample.
    """

    sigma: Float[Array, "*sample"]
    mu: Float[Array, ""] | None
    gains: Float[Array, "frame"]


class MicrofacetUnknowns(eqx.Module):
    """kd, ks, sigma and mu of T 6.2, and what else is unknown about the photographs.

    ``mu=None`` means a metal; ``free_gains`` is the number of photographs whose exposure is
    unknown (0: all known); ``free_scale`` says that the light is known up to one factor.
    """

    kd: Unknown = Unknown()
    ks: Unknown = Unknown()
    sigma: Unknown = sigma_unknown()
    mu: Unknown | None = mu_unknown()
    ks_per_channel: bool = eqx.field(static=True, default=False)
    free_gains: int = eqx.field(static=True, default=0)
    free_scale: bool = eqx.field(static=True, default=False)

    @property
    def names(self) -> tuple[str, ...]:
        """The nonlinear unknowns in the order of the search vector."""
        searched = [("sigma", self.sigma), ("mu", self.mu)]
        names = [name for name, unknown in searched if unknown is not None and unknown.free]
        return (*names, *(f"gain {frame}" for frame in range(1, self.free_gains)))

    @eqx.filter_jit
    @checked
    def unpack(self, point: Float[Array, "unknown"]) -> Physical:
        """Turn a search vector into parameters in their own units."""
        values = dict(zip(self.names, point))
        sigma = jnp.exp(_inside(self.sigma, values.get("sigma"), 0.0, point.dtype))
        mu = None
        if self.mu is not None:
            mu = 1 + jnp.exp(_inside(self.mu, values.get("mu"), 1.0, point.dtype))
        logs = [values[name] for name in self.names if name.startswith("gain")]
        gains = jnp.exp(jnp.stack([jnp.zeros((), point.dtype), *logs]))
        return Physical(sigma, mu, gains)

    def pack(self, sigma: float, mu: float | None) -> Float[np.ndarray, "unknown"]:
        """Turn parameters in their own units into a search vector, all gains 1."""
        given = {"sigma": (self.sigma, sigma, 0.0), "mu": (self.mu, mu, 1.0)}
        packed = [_outside(*given[name]) if name in given else 0.0 for name in self.names]
        return np.array(packed, float)

    def starts(self, count: int) -> Float[np.ndarray, "start unknown"]:
        """Spread ``count`` starting points over the bounds, the user's own first."""
        middle = self.pack(*self._start_values())
        points = np.tile(middle, (max(count, 1), 1))
        # Successive multiples of irrational numbers fill the square evenly (a Kronecker lattice).
        spread = (0.5 + np.outer(np.arange(len(points)), [0.7548776662, 0.5698402910])) % 1
        for column, name in enumerate(self.names[:2]):
            if not name.startswith("gain"):
                points[1:, column] = _search_variable(0.15 + 0.7 * spread[1:, column])
        return points

    @checked
    def at_bound(self, point: Float[Array, "unknown"]) -> Bool[np.ndarray, "unknown"]:
        """Say which searched parameters ended at a bound."""
        fraction = np.asarray(_fraction(point))
        bounded = np.array([not name.startswith("gain") for name in self.names], bool)
        return bounded & ((fraction < _AT_BOUND) | (fraction > 1 - _AT_BOUND))

    @checked
    def restarts(
        self, starts: Float[np.ndarray, "start unknown"]
    ) -> Float[np.ndarray, "more unknown"]:
        """Add, for each start at a bound, one that is pulled inside the bounds.

        At a bound the search variable hardly moves the parameter, so a search cannot leave it.
        """
        bounded = np.array([not name.startswith("gain") for name in self.names], bool)
        reach = _search_variable(1.0)
        pulled = np.where(bounded, np.clip(starts, -reach, reach), starts).astype(starts.dtype)
        return np.concatenate([starts, pulled[(pulled != starts).any(axis=1)]])

    def _start_values(self) -> tuple[float, float | None]:
        sigma = self.sigma.start or float(np.clip(0.15, self.sigma.lower, self.sigma.upper))
        if self.mu is None:
            return sigma, None
        return sigma, self.mu.start or float(np.clip(1.5, self.mu.lower, self.mu.upper))


def unknowns_of(
    lobe: Parametric,
    told: Mapping[str, Told],
    *,
    matt: bool = False,
    ks_per_channel: bool = False,
    free_gains: int = 0,
    free_scale: bool = False,
) -> MicrofacetUnknowns:
    """Put what is told of a model's own numbers, by their names, in the words of a search.

    What is not told is free.  ``matt`` leaves the lobe black.  Raises ``ValueError`` that begins
    with the name of a number whose start is outside its bounds, and for a name that there is none
    of.
    """
    kind, whole = type(lobe), Told()
    own = [*filter(None, kind.amplitude_names), kind.shape.name]
    own += [kind.index.name] * (lobe.mu is not None)
    for name in told:
        if name not in own:
            raise ValueError(f"{name}: the model has {', '.join(own)}")

    def sought(name: str, stands_for: Callable[[float], float], ends: tuple[float, float]):
        try:
            return told.get(name, whole).through(stands_for).unknown(*ends)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None

    black, reflectance = Unknown(fixed=(0.0,)), (0.0, float("inf"))
    kd, ks = (
        black if name is None else sought(name, float, reflectance) for name in kind.amplitude_names
    )
    rest = {"free_gains": free_gains, "free_scale": free_scale}
    if matt:
        return MicrofacetUnknowns(kd, black, Unknown(fixed=(0.1,)), None, **rest)
    return MicrofacetUnknowns(
        kd,
        ks,
        sought(kind.shape.name, kind.shape.width_of, SIGMA_BOUNDS),
        None
        if lobe.mu is None
        else sought(kind.index.name, kind.index.index_of, index_bounds(kind)),
        # What the model itself calls kd has a value for each channel.
        ks_per_channel=ks_per_channel or kind.amplitude_names[1] == "kd",
        **rest,
    )


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
