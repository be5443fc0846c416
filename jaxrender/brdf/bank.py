"""Many lobes of set shapes over a Lambertian base: a real material as a mixture of them.

rho = kd + sum_k ks_k f_k(w_i, w_o),   ks_k >= 0

The shapes are set beforehand, from narrow to wide, and a fit finds how much there is of each.  That
is least squares with weights that are not negative: it has one minimum, whatever the start.  Facets
(GGX with its tail, Beckmann without) have one curve each for a dielectric and for a metal; what
paints and cloth have besides are Burley's two diffuse curves and lobes towards where the light came
from.  Most weights of a fit are zero.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.burley import burley_diffuse
from jaxrender.brdf.distributions import DISTRIBUTIONS
from jaxrender.brdf.fresnel import normalised_fresnel
from jaxrender.brdf.half_vector import are_visible, half_vector, lifted
from jaxrender.brdf.parameters import (
    Scalar,
    refuse_other_channels,
    refuse_outside,
    refuse_unlisted,
    share_of_energy_is_bounded,
)
from jaxrender.brdf.parametric import Searched, ShapeParameter, WithoutIndex
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float, checked

# What a lobe of a bank may be.
KINDS = ("ggx", "beckmann", "retro", "burley")
# The widths of a standard bank, each so many times the one before; and what surfaces there are.
NARROWEST, _WIDEST, _RATIO = 0.01, 1.0, 1.47
_INDEX = 1.5
# From this width on a lobe is broad.
_BROAD = 0.3
_RETRO_WIDTHS = (0.2, 0.5, 1.0)
# Burley's roughness at which a surface is darkest and brightest at grazing.
_BURLEY_ROUGHNESSES = (0.0, 1.0)
# The largest directional albedo of Burley's curve for kd = 1 / pi, over all angles, and of a
# dielectric's ratio: ((mu + 1) / (mu - 1))^2.
_BURLEY_OVERSHOOT = 1.6
# Beyond this slope of a direction, in widths, nothing is masked by Walter's rational function.
_ALL_SEEN = 1.6
# Squared sines below this are those of a direction along the normal.
_HEAD_ON = 1e-12


class BankLobe(NamedTuple):
    """The shape of one lobe.

    ``ggx`` and ``beckmann`` are facets of that distribution with Smith's masking (of Beckmann's in
    the rational form of Walter and others, 2007, which is off by less than 1 %), times the Fresnel
    ratio of a dielectric of index ``mu`` at the half angle; None: of a metal, for which it is 1.
    ``retro`` is GGX about the direction that the light comes from.  ``burley`` is Burley's diffuse
    curve (2012, without its 1 / pi), whose roughness from 0 to 1 is ``width``.
    """

    kind: str
    width: float
    mu: float | None = None

    @property
    def name(self) -> str:
        """Its kind, its width and, of a dielectric, its index: ``ggx-0.1-1.5``."""
        index = "" if self.mu is None else f"-{self.mu:.3g}"
        return f"{self.kind}-{self.width:.3g}{index}"

    @property
    def about_mirror(self) -> bool:
        """Whether it is a highlight about the mirror direction, however wide."""
        return self.kind in DISTRIBUTIONS


def standard_lobes(narrowest: float = NARROWEST) -> tuple[BankLobe, ...]:
    """List the lobes of a standard bank, from narrow to wide and then what is diffuse.

    Raises ``ValueError`` for a width outside (0, 1].
    """
    refuse_outside("narrowest", narrowest, "(0, 1]", "it is the roughness of the sharpest lobe")
    count = int(np.ceil(np.log(_WIDEST / narrowest) / np.log(_RATIO) - 1e-9)) + 1
    widths = _WIDEST / _RATIO ** np.arange(count)[::-1]
    facets = (
        BankLobe(kind, float(width), mu)
        for width in widths
        for kind in ("ggx", "beckmann")
        for mu in (_INDEX, None)
    )
    retro = (BankLobe("retro", width) for width in _RETRO_WIDTHS)
    burley = (BankLobe("burley", roughness) for roughness in _BURLEY_ROUGHNESSES)
    return (*facets, *retro, *burley)


class Bank(WithoutIndex):
    """A Lambertian base ``kd`` under lobes whose weights are the rows of ``ks``.

    ``lobes`` are their shapes, each once.  There is no number that a fit searches for.

    Raises ``ValueError`` for lobes that there are none of, of another number than the rows of
    ``ks``, or twice the same, and for widths outside (0, 1] (of burley [0, 1]).
    """

    shape: ClassVar[ShapeParameter] = ShapeParameter("sigma")

    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "lobe channel"]
    lobes: tuple[BankLobe, ...] = eqx.field(static=True)

    def __init__(
        self,
        kd: Float[AnyArray, "channel"],
        ks: Float[AnyArray, "lobe channel"],
        lobes: tuple[BankLobe, ...],
    ):
        self.kd, self.ks, self.lobes = kd, ks, lobes

    def __check_init__(self):
        if len(self.lobes) != self.ks.shape[0]:
            raise ValueError(f"{len(self.lobes)} lobes where ks has {self.ks.shape[0]} rows")
        if not self.lobes:
            raise ValueError("a bank without a lobe: give one or more")
        refuse_other_channels("ks", self.ks, self.kd.shape[-1])
        for lobe in self.lobes:
            refuse_unlisted("kind", lobe.kind, KINDS)
            interval = "[0, 1]" if lobe.kind == "burley" else "(0, 1]"
            refuse_outside("width", lobe.width, interval, "the widest lobe has 1")
        names = [lobe.name for lobe in self.lobes]
        twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
        if twice:
            raise ValueError(f"the lobe {twice[0]} is there twice; give each shape once")

    @classmethod
    def black(cls, channels: int = 3, narrowest: float = NARROWEST) -> "Bank":
        """Make a standard bank whose weights are to be found."""
        lobes = standard_lobes(narrowest)
        return cls(np.zeros(channels), np.zeros((len(lobes), channels)), lobes)

    @classmethod
    def of_lobes(cls, lobes: Sequence[Mapping[str, Any]]) -> "Bank":
        """Make a bank of lobes as ``as_lobes`` lists them."""
        base = [one["weight"] for one in lobes if one["kind"] == "lambertian"]
        others = [one for one in lobes if one["kind"] != "lambertian"]
        weights = np.array([one["weight"] for one in others], float)
        shapes = tuple(BankLobe(one["kind"], one["width"], one.get("mu")) for one in others)
        kd = np.sum(np.array(base, float), axis=0) if base else np.zeros(weights.shape[1])
        return cls(kd, weights, shapes)

    def as_lobes(self) -> list[dict[str, Any]]:
        """List the base and all lobes as plain data: kind, width and index, and the weights."""
        found: list[dict[str, Any]] = [
            {"kind": "lambertian", "weight": np.asarray(self.kd, float).tolist()}
        ]
        for lobe, ks in zip(self.lobes, np.asarray(self.ks, float)):
            shape = {key: value for key, value in lobe._asdict().items() if value is not None}
            found.append({**shape, "weight": ks.tolist()})
        return found

    @property
    def amplitude_names(self) -> tuple[str, ...]:
        """The base, and every lobe by its name."""
        return ("kd", *(lobe.name for lobe in self.lobes))

    @property
    def coloured(self) -> tuple[str, ...]:
        """All of them."""
        return self.amplitude_names

    @property
    def sums(self) -> dict[str, tuple[str, ...]]:
        """All that is diffuse, as kd, and all that is not, as ks."""
        diffuse = [lobe.name for lobe in self.lobes if lobe.kind == "burley"]
        others = tuple(lobe.name for lobe in self.lobes if lobe.kind != "burley")
        return {"kd": ("kd", *diffuse), "ks": others}

    @property
    def sigma(self) -> Scalar:
        """The width of the narrowest highlight in use; where none is, of the narrowest there is."""
        used = [lobe for lobe, ks in zip(self.lobes, np.asarray(self.ks)) if np.any(ks > 0)]
        widths = [[lobe.width for lobe in some if lobe.about_mirror] for some in (used, self.lobes)]
        return min(widths[0] or widths[1] or [_WIDEST])

    @property
    def searched(self) -> tuple[Searched, ...]:
        """Nothing."""
        return ()

    @property
    def energy(self) -> float:
        """One: the weight of a metal's lobe is about its albedo at normal exitance."""
        return 1.0

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """kd, and the rows of ks."""
        return jnp.concatenate([jnp.asarray(self.kd)[None], jnp.asarray(self.ks)])

    @checked
    def with_amplitudes(self, *amplitudes: Float[AnyArray, "channel"]) -> "Bank":
        """Replace kd and the weights of all lobes, in this order."""
        kd, *ks = amplitudes
        return dataclasses.replace(self, kd=kd, ks=jnp.stack([jnp.asarray(row) for row in ks]))

    @property
    def by_width(self) -> tuple["Bank", ...]:
        """Split the material into one of narrow lobes and one of the others, with the base.

        The wide ones ask for a light of less detail.
        """
        narrow = np.array([one.about_mirror and one.width < _BROAD for one in self.lobes])
        if narrow.all() or not narrow.any():
            return (self,)
        kd, ks = np.asarray(self.kd), np.asarray(self.ks)

        def part(base: Float[np.ndarray, "channel"], kept: np.ndarray) -> "Bank":
            return Bank(base, ks[kept], tuple(one for one, use in zip(self.lobes, kept) if use))

        return part(np.zeros_like(kd), narrow), part(kd, ~narrow)

    @property
    def in_use(self) -> "Bank":
        """The same material of the lobes that are not black; of the last where all are."""
        weights = np.asarray(self.ks)
        kept = np.nonzero(np.any(weights > 0, axis=1))[0]
        kept = kept if len(kept) else np.array([len(self.lobes) - 1])
        return Bank(self.kd, weights[kept], tuple(self.lobes[at] for at in kept))

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    @property
    def conserves_energy(self) -> bool:
        """When all weights, times the largest albedo that each lobe can have, are at most 1."""
        parts = [np.pi * np.asarray(self.kd)]
        for lobe, ks in zip(self.lobes, np.asarray(self.ks)):
            most = 1.0 if lobe.mu is None else ((lobe.mu + 1) / (lobe.mu - 1)) ** 2
            parts.append(ks * (np.pi * _BURLEY_OVERSHOOT if lobe.kind == "burley" else most))
        return share_of_energy_is_bounded(*parts)

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate the clamped cosine, and each lobe times it.

        Lobes of one kind are evaluated together, those that differ in their index alone once.
        """
        visible = are_visible(incoming, outgoing)
        base = jnp.where(visible, incoming.z, 0)
        incoming, outgoing = lifted(incoming), lifted(outgoing)
        mirrored = Components(-outgoing.x, -outgoing.y, outgoing.z)
        cosine = jnp.minimum(half_vector(incoming, outgoing).cosine, 1)
        found: dict[tuple[str, float], Float[Array, "*batch"]] = {}
        for kind in dict.fromkeys(lobe.kind for lobe in self.lobes):
            widths = tuple(dict.fromkeys(one.width for one in self.lobes if one.kind == kind))
            if kind == "burley":
                curves = [burley_diffuse(width, incoming, outgoing, cosine) for width in widths]
            else:
                towards = mirrored if kind == "retro" else outgoing
                curves = _facets(kind, widths, incoming, towards)
            found |= {(kind, width): curve for width, curve in zip(widths, curves)}
        ratios = {
            mu: 1.0 if mu is None else normalised_fresnel(mu, cosine)
            for mu in dict.fromkeys(lobe.mu for lobe in self.lobes)
        }
        return base, *(
            jnp.where(visible, found[lobe.kind, lobe.width] * ratios[lobe.mu], 0)
            for lobe in self.lobes
        )


def _facets(
    kind: str, widths: tuple[float, ...], incoming: Components, outgoing: Components
) -> Float[Array, "width *batch"]:
    """Evaluate D G / (4 cos t_o) for every width."""
    distribution = "ggx" if kind == "retro" else kind
    make, shadowing = DISTRIBUTIONS[distribution], _SMITH_LAMBDAS[distribution]
    half = half_vector(incoming, outgoing).direction

    def one(width: Float[Array, ""]) -> Float[Array, "*batch"]:
        shaded = 1 + shadowing(width, incoming.z) + shadowing(width, outgoing.z)
        return make(width).density(half) / (shaded * 4 * outgoing.z)

    return jax.vmap(one)(jnp.asarray(widths, jnp.asarray(incoming.z).dtype))


def _lambda_of_ggx(
    width: Float[Array, ""], cosine: Float[AnyArray, "*batch"]
) -> Float[Array, "*batch"]:
    square = cosine * cosine
    return (jnp.sqrt(1 + width * width * (1 - square) / square) - 1) / 2


def _lambda_of_beckmann(
    width: Float[Array, ""], cosine: Float[AnyArray, "*batch"]
) -> Float[Array, "*batch"]:
    """Evaluate it without the error function, as renderers do: ten times faster."""
    slope = cosine * jax.lax.rsqrt(jnp.maximum(1 - cosine * cosine, _HEAD_ON)) / width
    rational = (1 - 1.259 * slope + 0.396 * slope**2) / (3.535 * slope + 2.181 * slope**2)
    return jnp.where(slope < _ALL_SEEN, rational, 0)


_SMITH_LAMBDAS = {"ggx": _lambda_of_ggx, "beckmann": _lambda_of_beckmann}
