"""A BRDF about its central direction, the reflected ray: rho_lpq of T 5.7 (T 2.3.4, 5.3.1).

With the reflected direction R as the axis, i' and o' the light and the viewer seen from it, and the
normal half way between R and V, an isotropic transfer function is

    rho^(i', o') = sum_lp sum_q rho_lp|q| Y_lq(i') Y_pq(o')        real harmonics, q = -min ... min

since the complex pair Y*_lq Y_pq + Y*_l,-q Y_p,-q is the real pair (T 5.22).  t'_o is the angle
between R and V, twice the exit angle, and runs to pi (ERRATA 35).

A lobe that rises as 1 / cos t_o towards grazing exit (T 3.42, 6.2) has no finite energy about R,
hence no such series (ERRATA 24).  ``weighted`` spectra are those of rho^ cos t_o, as T 5.34 is; the
reflected light they give is B cos t_o.

``central_spectrum_of`` integrates any isotropic BRDF about R with the horizon of each exit angle;
``tabulated_spectrum`` is the three sums of T 5.22 over a table of rho^(t'_i, t'_o, phi).
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.geometry import Components
from jaxrender.harmonics import associated, coefficient_count, real_basis
from jaxrender.shapes import AnyArray, Array, Float, checked
from jaxrender.spectra.mirror_frame import Lobe, azimuthal_transfer, exit_angles_of, mean_transfer

# Exit angles that the dependence on the viewer is integrated over: fewer than these only where
# more than a quarter as many degrees are asked for.
_EXITS = 48
_EXITS_PER_DEGREE = 4
# Tangent of half the narrowest lobe that the nodes of a BRDF of unknown extent are spread for.
_NARROWEST = 0.05


class CentralSpectrum(eqx.Module):
    """rho_lpq about a central direction, q = 0 ... min(F, P), and what it is a part of.

    ``energy`` is the integral of rho^2 over both spheres, of which T 5.18 asks what part the
    coefficients hold.
    """

    coefficients: Float[AnyArray, "degree outgoing_degree order channel"]
    energy: Float[AnyArray, "channel"]
    weighted: bool = eqx.field(static=True, default=False)

    @property
    def band_limits(self) -> tuple[int, int]:
        """The highest degrees l and p: F and P."""
        return self.coefficients.shape[0] - 1, self.coefficients.shape[1] - 1

    def cut(self, band_limits: tuple[int, int]) -> "CentralSpectrum":
        """Keep degrees to F and P; ValueError where that is more than there are."""
        have = self.band_limits
        if not all(0 <= want <= most for want, most in zip(band_limits, have)):
            raise ValueError(
                f"(F, P) = {band_limits} of a spectrum to {have}: ask for degrees from 0 up to "
                "those, or compute the spectrum to more"
            )
        first, second = band_limits
        kept = self.coefficients[: first + 1, : second + 1, : min(band_limits) + 1]
        return CentralSpectrum(kept, self.energy, self.weighted)

    @checked
    def windowed(
        self,
        by_light: Float[AnyArray, "degree"],
        by_viewer: Float[AnyArray, "outgoing_degree"],
    ) -> "CentralSpectrum":
        """Multiply each degree l and each degree p by a weight; the energy stays the BRDF's.

        ``windowed_spectrum`` knows windows by name.  Raises ``ValueError`` for weights of other
        degrees.
        """
        have, given = self.band_limits, (len(by_light) - 1, len(by_viewer) - 1)
        if have != given:
            raise ValueError(
                f"windows to degrees (F, P) = {given} of a spectrum to {have}: give a weight for "
                "each degree"
            )
        rho = jnp.asarray(self.coefficients)
        first, second = jnp.asarray(by_light), jnp.asarray(by_viewer)
        weights = first[:, None, None, None] * second[None, :, None, None]
        return CentralSpectrum(rho * weights.astype(rho.dtype), self.energy, self.weighted)

    @checked
    def transfer_at(
        self, exit_cosines: Float[AnyArray, "sample"]
    ) -> Float[Array, "sample degree order channel"]:
        """Sum over p: h_lq(t_o) = Lambda_l sum_p rho_lpq Y_pq(t'_o, 0), to degree P of the viewer.

        Of a weighted spectrum h_lq cos t_o.
        """
        rho = jnp.asarray(self.coefficients)
        around = _meridian(2 * exit_angles_of(exit_cosines), rho.shape[1:])
        summed = jnp.einsum("spq,lpqc->slqc", around, rho, precision="highest")
        return summed * _like(_wavelengths(rho.shape[0])[None, :, None, None], summed)


class ExitRule(NamedTuple):
    """Angles t'_o between R and V with the weights sin t'_o dt'_o."""

    angles: Float[np.ndarray, "exit"]
    weights: Float[np.ndarray, "exit"]

    @classmethod
    def for_degree(cls, band_limit: int) -> "ExitRule":
        """Gauss-Legendre nodes in the angle itself, where cos t_o = cos(t'_o / 2) is smooth."""
        count = max(_EXITS, _EXITS_PER_DEGREE * (band_limit + 1))
        nodes, weights = np.polynomial.legendre.leggauss(count)
        angles = (nodes + 1) * np.pi / 2
        return cls(angles, weights * np.pi / 2 * np.sin(angles))


@eqx.filter_jit
@checked
def central_spectrum(
    lobe: Lobe,
    band_limits: tuple[int, int],
    reach: Float[Array, ""],
    tail: Float[Array, ""] | None = None,
    weighted: bool = False,
) -> CentralSpectrum:
    """Compute rho_lpq of one lobe, its reach and tail given as to ``mirror_frame``.

    Differentiable in what the lobe is made of.  Raises ``ValueError`` for negative degrees.
    """
    first, second = band_limits
    for limit in band_limits:
        coefficient_count(limit)
    rule = ExitRule.for_degree(second)
    cosines = jnp.asarray(np.cos(rule.angles / 2), jnp.asarray(reach).dtype)

    def seen(incoming: Components, outgoing: Components) -> Array:
        values = lobe(incoming, outgoing)
        return values * outgoing.z if weighted else values

    def squared(incoming: Components, outgoing: Components) -> Array:
        return seen(incoming, outgoing) ** 2

    most = min(band_limits)
    by_exit = azimuthal_transfer(seen, cosines, (first, most), reach, tail)
    energy = mean_transfer(squared, cosines, 0, reach, tail)[:, 0]
    weights = jnp.asarray(rule.weights, cosines.dtype)
    around = _meridian(jnp.asarray(rule.angles, cosines.dtype), (second + 1, most + 1))
    # Of the waves cos(q phi) the squares are pi in the mean for q > 0 and 2 pi for q = 0.
    share = np.where(np.arange(most + 1) > 0, np.pi, 2 * np.pi)[None, None, :]
    share = share / _wavelengths(first + 1)[:, None, None]
    values = jnp.einsum("e,elq,epq->lpq", weights, by_exit, around, precision="highest")
    values = values * _like(share, values)
    total = 2 * jnp.pi * jnp.sum(weights * energy)
    return CentralSpectrum(values[..., None], total[None], weighted)


def central_spectrum_of(
    brdf: BRDF, band_limits: tuple[int, int], weighted: bool = False
) -> CentralSpectrum:
    """Compute rho_lpq of a whole BRDF, each channel; lobes of unknown extent included.

    Raises ``ValueError`` for negative degrees and for an anisotropic BRDF.
    """
    # Asked outside of what is compiled: whether some models are isotropic depends on their values.
    if not brdf.isotropic:
        raise ValueError(
            f"{type(brdf).__name__} is anisotropic: about R its orders mix; a lobe about its own "
            "tangent is given as a table (tabulated_spectrum), or take the mean over turns: "
            "IsotropicMean(brdf)"
        )
    return _spectrum_of(brdf, band_limits, weighted)


@eqx.filter_jit
def _spectrum_of(brdf: BRDF, band_limits: tuple[int, int], weighted: bool) -> CentralSpectrum:
    amplitudes = jnp.asarray(brdf.amplitudes)
    reach = jnp.asarray(jnp.pi, amplitudes.dtype)
    tail = jnp.asarray(_NARROWEST, amplitudes.dtype)

    def of_channel(weights: Float[Array, "lobe"]) -> tuple[Array, Array]:
        def lobe(incoming: Components, outgoing: Components) -> Array:
            everywhere = Components(*(jnp.broadcast_to(c, incoming.z.shape) for c in outgoing))
            values = brdf.transfer(incoming, everywhere)
            return sum((w * v for w, v in zip(weights, values)), start=jnp.zeros((), reach.dtype))

        found = central_spectrum(lobe, band_limits, reach, tail, weighted)
        return jnp.asarray(found.coefficients)[..., 0], jnp.asarray(found.energy)[0]

    # The lobes are evaluated once for all channels, and traced once.
    coefficients, energy = jax.vmap(of_channel, in_axes=1, out_axes=(-1, 0))(amplitudes)
    return CentralSpectrum(coefficients, energy, weighted)


class CentralTable(NamedTuple):
    """rho^(t'_i, t'_o, phi) about a central direction, and where it was sampled.

    Polar nodes are Gauss-Legendre's in the cosine over the whole sphere, increasing in angle;
    azimuths phi = phi_o - phi_i are equal steps from 0.
    """

    values: Float[AnyArray, "incoming outgoing azimuth channel"]

    @staticmethod
    def polar_angles(count: int) -> Float[np.ndarray, "node"]:
        """The nodes t' of a table with so many rows."""
        return np.arccos(np.polynomial.legendre.leggauss(count)[0])[::-1]

    @staticmethod
    def azimuths(count: int) -> Float[np.ndarray, "node"]:
        """The nodes phi of a table with so many columns."""
        return np.arange(count) * 2 * np.pi / count


@checked
def tabulated_spectrum(
    table: CentralTable, band_limits: tuple[int, int], weighted: bool = False
) -> CentralSpectrum:
    """Compute rho_lpq by the three sums of T 5.22, at their cost P S T^2 + P^2 S T + F P^2 S.

    Raises ``ValueError`` for degrees that the table does not carry.
    """
    values = jnp.asarray(table.values)
    rows, exits, columns, _ = values.shape
    first, second = band_limits
    most = min(band_limits)
    for limit in band_limits:
        coefficient_count(limit)
    # A function of one angle alone is given as one column.
    azimuthal = most if columns > 1 else 0
    if first >= rows or second >= exits or 2 * azimuthal >= max(columns, 2):
        raise ValueError(
            f"(F, P) = {band_limits} of a BRDF table of {rows} x {exits} x {columns} nodes: it "
            f"carries l to {rows - 1}, p to {exits - 1} and q to {(columns - 1) // 2}; ask for "
            "less, or tabulate it more finely"
        )
    order = np.arange(most + 1)
    waves = np.cos(order * CentralTable.azimuths(columns)[:, None]) * 2 * np.pi / columns
    if columns == 1:
        waves = waves * (order == 0)
    incoming, outgoing = (
        meridian_table(CentralTable.polar_angles(count), (limit + 1, most + 1))
        * np.polynomial.legendre.leggauss(count)[1][::-1, None, None]
        for count, limit in ((rows, first), (exits, second))
    )
    # Real pairs carry sqrt(2) on either side for q > 0, which the integral over phi takes off once.
    share = 2 * np.pi * np.where(order > 0, 0.5, 1.0)
    by_order = jnp.einsum("ioac,aq->ioqc", values, _like(waves * share, values))
    by_degree = jnp.einsum("ioqc,opq->ipqc", by_order, _like(outgoing, values))
    found = jnp.einsum("ipqc,ilq->lpqc", by_degree, _like(incoming, values), precision="highest")
    weights = [_like(np.polynomial.legendre.leggauss(n)[1], values) for n in (rows, exits)]
    mean_square = jnp.mean(values**2, axis=2)
    energy = jnp.einsum("ioc,i,o->c", mean_square, *weights) * (2 * np.pi) ** 2
    return CentralSpectrum(found, energy, weighted)


def _like(values: np.ndarray, other: Array) -> Array:
    return jnp.asarray(values, other.dtype)


def _meridian(
    angles: Float[Array, "exit"], shape: tuple[int, ...]
) -> Float[Array, "exit degree order"]:
    """Y_pq at polar angles on azimuth 0, for q >= 0; zero where q > p."""
    index, exists = _places(shape[0], shape[1])
    on_circle = jnp.stack([jnp.sin(angles), jnp.zeros_like(angles), jnp.cos(angles)], axis=-1)
    return jnp.where(exists, real_basis(on_circle, shape[0] - 1)[..., index], 0)


def meridian_table(
    angles: Float[np.ndarray, "node"], shape: tuple[int, int]
) -> Float[np.ndarray, "node degree order"]:
    """Tabulate Y_pq at polar angles on azimuth 0, as many degrees and orders; zero where q > p."""
    table = associated(np.cos(angles), np.sin(angles), shape[0] - 1)[:, : shape[1]]
    missing = shape[1] - table.shape[1]
    return np.moveaxis(np.pad(table, ((0, 0), (0, missing), (0, 0))), -1, 0)


def _places(degree_count: int, order_count: int) -> tuple[np.ndarray, np.ndarray]:
    degree, order = np.arange(degree_count)[:, None], np.arange(order_count)[None, :]
    exists = order <= degree
    return np.where(exists, degree * (degree + 1) + order, 0), exists


def _wavelengths(count: int) -> Float[np.ndarray, "degree"]:
    """Lambda_l = sqrt(4 pi / (2l + 1)) (T 2.51)."""
    return np.sqrt(4 * np.pi / (2 * np.arange(count) + 1))
