"""A material as a table that a shader interpolates: lobes over half and difference angles.

A node of the table is a pair of directions, by u = t / (t + 1.5) with t = tan(theta_h) / sigma, by
cos(theta_d) and by (1 + cos(phi_d)) / 2.  The first of them takes most of the change with sigma out
of a lobe, so that tables of a few widths are interpolated well.  What is kept is a logarithm to the
base two, of a lobe or of the lobe times 4 cos t_i cos t_o, whichever is smoother.

The red, green and blue of a node are the lobe of the highlight, its alpha is the base.  A material
is base amplitude x base + lobe amplitude x lobe; several lobes over the base are added up before.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF, WIDTH_BOUNDS, MetallicRoughness, Parametric
from jaxrender.errors import InputError
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Float

# The numbers of nodes of u, cos(theta_d) and cos(phi_d).
NODES = (96, 32, 12)
# What u is one half at, in widths.
MIDDLE = 1.5
# The factors between the fitted width and those of the other tables.
_WIDTHS = (0.25, 0.5, 1.0, 2.0, 4.0)
# Logarithms are kept from here up: 2^-24 is nothing beside the peak.
FLOOR = -24.0
# Directions below the horizon are lifted to this cosine, so that a table goes on smoothly.
_LIFTED = 0.01
_PAIRS, _SEED = 20_000, 0


class MaterialTable(NamedTuple):
    """The tables of some widths, and what multiplies them.

    ``logarithms`` are those of red, green, blue and base, one table for each of ``widths``; the
    width of the fit is number ``fitted``.  ``weighted`` says that a lobe was multiplied by
    4 cos t_i cos t_o.  ``error`` is the mean error of an interpolated lobe relative to its mean.
    Of maps of metal red is the lobe, green its edge, ``base`` the colour, ``lobe`` the share of
    metal, and ``head_on`` what the interface reflects at normal incidence.
    """

    logarithms: Float[np.ndarray, "width u difference azimuth 4"]
    widths: Float[np.ndarray, "width"]
    fitted: int
    weighted: bool
    base: Float[np.ndarray, "3"]
    lobe: Float[np.ndarray, "3"]
    base_name: str | None
    lobe_name: str | None
    roughness_name: str | None
    error: float
    head_on: float | None = None

    @property
    def width(self) -> float:
        """The width of the fit."""
        return float(self.widths[self.fitted])


class _Parts(NamedTuple):
    """A material apart: the rows of the base and of the lobes, and how much of these there is."""

    base: int | None
    lobes: tuple[int, ...]
    weights: Float[np.ndarray, "lobe 3"]
    amount: Float[np.ndarray, "3"]
    base_name: str | None
    lobe_name: str | None

    def values(
        self,
        brdf: BRDF,
        incoming: Float[np.ndarray, "*batch 3"],
        outgoing: Float[np.ndarray, "*batch 3"],
    ) -> Float[np.ndarray, "*batch 4"]:
        """Evaluate the lobe of each channel, and the base, times the incoming cosine."""
        columns = _columns(brdf, incoming, outgoing)
        lobe = np.einsum("...k,kc->...c", columns[..., list(self.lobes)], self.weights)
        base = np.zeros(lobe.shape[:-1]) if self.base is None else columns[..., self.base]
        return np.concatenate([lobe, base[..., None]], axis=-1)


class _MetalParts(_Parts):
    """glTF's material apart: (1 - P) / pi under an interface, and (1 - P) S and P S of it."""

    def values(
        self,
        brdf: BRDF,
        incoming: Float[np.ndarray, "*batch 3"],
        outgoing: Float[np.ndarray, "*batch 3"],
    ) -> Float[np.ndarray, "*batch 4"]:
        """Evaluate lobe, edge, nothing and base: a metal is the first two, a dielectric the last.

        All of the material is linear in its share of metal.
        """
        assert isinstance(brdf, MetallicRoughness)
        metal, plastic = (
            _columns(brdf.with_numbers({"metallic": jnp.asarray(share)}), incoming, outgoing)
            for share in (1.0, 0.0)
        )
        base = plastic[..., 0] / (1 - float(brdf.head_on))
        return np.stack([metal[..., 0], metal[..., 1], np.zeros_like(base), base], axis=-1)


def metal_table(brdf: MetallicRoughness) -> MaterialTable:
    """Tabulate the parts of glTF's material, for maps of its colour and of its metalness."""
    parts = _MetalParts(
        None,
        (),
        np.ones((1, 3)),
        np.full(3, float(brdf.metallic)),
        "base_color",
        "metallic",
    )
    table = _tabulated(brdf, parts, float(brdf.width), True)
    return table._replace(base=_as_three(brdf.base_color), head_on=float(brdf.head_on))


def material_table(brdf: BRDF, width: float) -> MaterialTable:
    """Tabulate an isotropic material at several widths, if it has a width that a fit looks for.

    Raises ``InputError`` for an anisotropic one, and for other channels than one or three.
    """
    if not brdf.isotropic:
        raise InputError(
            "the page shows isotropic materials, and this one changes as the surface turns about "
            "its normal; use jaxrender render"
        )
    parts = _parts_of(brdf)
    named = isinstance(brdf, Parametric) and brdf.shape.name in brdf.numbers and bool(parts.lobes)
    return _tabulated(brdf, parts, width, named)


def _tabulated(brdf: BRDF, parts: _Parts, width: float, named: bool) -> MaterialTable:
    """Tabulate at several widths where the width is named; choose how a lobe is kept."""
    widths = np.array([width])
    if named:
        every = np.clip(width * np.array(_WIDTHS), min(width, WIDTH_BOUNDS[0]), WIDTH_BOUNDS[1])
        widths = np.unique(np.append(every, width))
    best = None
    for weighted in (False, True):
        own = _logarithms(brdf, parts, float(width), weighted)
        error = _error(own, brdf, parts, float(width), weighted)
        if best is None or error < best[0]:
            best = error, weighted
    assert best is not None
    error, weighted = best
    tables = []
    for one in widths:
        own = brdf
        if named and isinstance(brdf, Parametric):
            own = brdf.with_roughness(float(one), brdf.mu)
        tables.append(_logarithms(own, parts, float(one), weighted))
    shape_name = brdf.shape.name if named and isinstance(brdf, Parametric) else None
    return MaterialTable(
        np.stack(tables),
        widths,
        int(np.argmin(np.abs(widths - width))),
        weighted,
        _as_three(brdf.amplitudes[parts.base]) if parts.base is not None else np.zeros(3),
        parts.amount,
        parts.base_name,
        parts.lobe_name,
        shape_name,
        error,
    )


def _parts_of(brdf: BRDF) -> _Parts:
    """Find the base, and all lobes over it with their weights."""
    amplitudes = np.asarray(brdf.amplitudes, float)
    if amplitudes.shape[1] not in (1, 3):
        raise InputError(
            f"a page shows one or three channels, and the material has {amplitudes.shape[1]}"
        )
    every = [_as_three(row) for row in amplitudes]
    base, names = None, None
    if isinstance(brdf, Parametric):
        names = brdf.amplitude_names
        bases = [at for at, name in enumerate(names) if name in brdf.bases]
        base = bases[0] if len(bases) == 1 else None
        if len(names) != len(every):
            names = None
            base = 0
    lobes = tuple(at for at, row in enumerate(every) if at != base and np.any(row > 0))
    base_name = None if base is None else (names[base] if names else "kd")
    if len(lobes) == 1:
        # One lobe is kept without its amount, so that a slider may change that.
        weights, amount = np.ones((1, 3)), every[lobes[0]]
        return _Parts(base, lobes, weights, amount, base_name, names[lobes[0]] if names else "ks")
    weights = np.array([every[at] for at in lobes]).reshape(-1, 3)
    return _Parts(base, lobes, weights, np.ones(3), base_name, "lobes" if lobes else None)


def with_amounts(
    brdf: Parametric, table: MaterialTable, base: Float[np.ndarray, "3"], lobe: AnyArray
) -> Parametric:
    """Put other amounts into a material that was tabulated: of its base and of its lobes.

    Raises ``ValueError`` for a material whose lobes have no amplitudes of their own.
    """
    if table.head_on is not None:
        metal = brdf.with_numbers({"metallic": np.asarray(lobe[0])})
        return metal.with_amplitudes(base, np.ones(3))
    parts = _parts_of(brdf)
    if len(brdf.amplitude_names) != len(brdf.amplitudes):
        raise ValueError(
            f"the lobes of a {type(brdf).__name__} share amplitudes; read base, lobe and roughness"
        )
    rows = [_as_three(row) for row in np.asarray(brdf.amplitudes, float)]
    if parts.base is not None:
        rows[parts.base] = base
    for at, weight in zip(parts.lobes, parts.weights):
        rows[at] = weight * lobe
    return brdf.with_amplitudes(*rows)


def _as_three(amplitude: AnyArray) -> Float[np.ndarray, "3"]:
    return np.broadcast_to(np.asarray(amplitude, float), 3).copy()


def node_directions(
    width: float,
) -> tuple[
    Float[np.ndarray, "u difference azimuth 3"], Float[np.ndarray, "u difference azimuth 3"]
]:
    """Make the incoming and outgoing directions of all nodes; some lie below the horizon."""
    u, difference, azimuth = (np.linspace(0, 1, count) for count in NODES)
    with np.errstate(divide="ignore"):
        half = np.arctan(width * MIDDLE * u / (1 - u))
    return pair_of(half[:, None, None], difference[None, :, None], 2 * azimuth[None, None] - 1)


def pair_of(
    half: AnyArray, difference: AnyArray, azimuth: AnyArray
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
    """Make a pair of its half angle (radians), cos(theta_d) and cos(phi_d)."""
    half, cosine, turned = np.broadcast_arrays(half, difference, azimuth)
    sine = np.sqrt(np.maximum(1 - cosine**2, 0))
    across = np.sqrt(np.maximum(1 - turned**2, 0))
    middle = np.stack([np.sin(half), np.zeros_like(half), np.cos(half)], axis=-1)
    towards = np.stack([-np.cos(half), np.zeros_like(half), np.sin(half)], axis=-1)
    sideways = np.array([0.0, 1.0, 0.0])
    offset = sine[..., None] * (turned[..., None] * towards + across[..., None] * sideways)
    along = cosine[..., None] * middle
    return along + offset, along - offset


def _lifted(directions: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    lifted = directions.copy()
    lifted[..., 2] = np.maximum(lifted[..., 2], _LIFTED)
    return lifted / np.linalg.norm(lifted, axis=-1, keepdims=True)


def _values(
    brdf: BRDF,
    parts: _Parts,
    incoming: Float[np.ndarray, "*batch 3"],
    outgoing: Float[np.ndarray, "*batch 3"],
    weighted: bool,
) -> Float[np.ndarray, "*batch 4"]:
    """Evaluate lobes and base in 1/sr at amplitude one, as they are kept."""
    values = parts.values(brdf, incoming, outgoing) / incoming[..., 2:]
    if weighted:
        values[..., :3] *= 4 * incoming[..., 2:] * outgoing[..., 2:]
    return values


def _columns(
    brdf: BRDF, incoming: Float[np.ndarray, "*batch 3"], outgoing: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch lobe"]:
    return np.asarray(_transferred(brdf, jnp.asarray(incoming), jnp.asarray(outgoing)))


@jax.jit
def _transferred(brdf, incoming, outgoing):
    lobes = brdf.transfer(Components.of(incoming), Components.of(outgoing))
    return jnp.stack([jnp.broadcast_to(lobe, incoming.shape[:-1]) for lobe in lobes], axis=-1)


def _logarithms(
    brdf: BRDF, parts: _Parts, width: float, weighted: bool
) -> Float[np.ndarray, "u difference azimuth 4"]:
    incoming, outgoing = (_lifted(one) for one in node_directions(width))
    values = _values(brdf, parts, incoming, outgoing, weighted)
    return np.maximum(np.log2(np.maximum(values, 2.0 ** (FLOOR - 1))), FLOOR)


def interpolated(
    logarithms: Float[np.ndarray, "u difference azimuth 4"],
    width: float,
    half: Float[np.ndarray, "pair"],
    difference: Float[np.ndarray, "pair"],
    azimuth: Float[np.ndarray, "pair"],
) -> Float[np.ndarray, "pair 4"]:
    """Interpolate as the shader does: the logarithm linearly in each coordinate."""
    ratio = np.tan(half) / width
    places = (ratio / (ratio + MIDDLE), difference, (1 + azimuth) / 2)
    lower, share = [], []
    for place, count in zip(places, logarithms.shape[:3]):
        at = np.clip(place, 0, 1) * (count - 1)
        first = np.minimum(at.astype(int), count - 2)
        lower.append(first)
        share.append(at - first)
    total = np.zeros((len(half), 4))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod([s if c else 1 - s for c, s in zip(corner, share)], axis=0)
        total += weight[:, None] * logarithms[tuple(f + c for f, c in zip(lower, corner))]
    return np.where(total <= FLOOR, 0, 2.0**total)


def _error(
    table: Float[np.ndarray, "u difference azimuth 4"],
    brdf: BRDF,
    parts: _Parts,
    width: float,
    weighted: bool,
) -> float:
    """Compare with the material at random pairs, half of them in the highlight."""
    random = np.random.default_rng(_SEED)
    count = _PAIRS
    spread = width * np.abs(np.tan(random.uniform(0, 0.47 * np.pi, count)))
    half = np.arctan(spread)
    difference, azimuth = random.uniform(0, 1, count), np.cos(random.uniform(0, np.pi, count))
    incoming, outgoing = pair_of(half, difference, azimuth)
    seen = (incoming[:, 2] > 0.05) & (outgoing[:, 2] > 0.05)
    incoming, outgoing = incoming[seen], outgoing[seen]
    true = _values(brdf, parts, incoming, outgoing, weighted)
    found = interpolated(table, width, half[seen], difference[seen], azimuth[seen])
    factor = incoming[:, 2:]
    if weighted:
        factor = np.concatenate(
            [np.repeat(1 / (4 * outgoing[:, 2:]), 3, axis=1), incoming[:, 2:]], axis=1
        )
    off, whole = np.abs(found - true) * factor, true * factor
    scale = np.maximum(whole.mean(axis=0), 1e-12)
    return float(np.max(np.where(whole.mean(axis=0) > 0, off.mean(axis=0) / scale, 0)))
