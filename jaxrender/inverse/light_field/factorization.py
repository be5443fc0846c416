"""The analytic factorization of a light field into light and BRDF (T 2.4.3, eq 2.68).

    B~_lmpq = Lambda_l L_lm rho~_lpq                                       (T 2.59)

where rho~ = rho cos t_i cos t_o about the *normal* and B~ = B cos t_o: only these are reciprocal,
rho~_lpq = rho~_plq (ERRATA 11).  Of one degree the field is a product, so it gives the light and
the BRDF of that degree up to a factor t_l.  Reciprocity then ties degrees together: where rho~_lpq
does not vanish, t_l / t_p follows.  T 2.68 ties every degree to 0 through rho~_l00 = rho~_0l0.
(Its middle lines have lost a Lambda_l^-1: ERRATA 10.)  Here degrees are tied by the p and q that
are surest, in a chain if need be.  Then all m, p, q are fitted at once by least squares.

The gauge is T's: L_00 = Lambda_0^-1, in every channel.  Degrees that no chain ties to degree 0
form components with a factor of their own, which the field does not determine: a mirror's family
f(l) (T 3.26).  Where the light lacks a degree, reciprocity alone gives BRDF coefficients, from
other degrees.  If one of those is not zero, the light's are known to be zero.  Host, float64.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.harmonics import band_limit_of, degrees, orders, real_from_complex
from jaxrender.inverse.light_field.account import sentences
from jaxrender.inverse.light_field.bilinear import Bilinear, Factors, refine, standard_errors
from jaxrender.inverse.light_field.degrees import (
    CLEARLY,
    UNLIT,
    DegreeFactors,
    split_degree,
    tie_degrees,
    wavelength,
)
from jaxrender.shapes import AnyArray, Bool, Complex, Float, Int

# Where no noise is given: what rounding leaves of a coefficient, relative to the largest one.
_ROUNDING = 1e-12


class LightField(NamedTuple):
    """B~_lmpq in real harmonics, of q = 0 ... Q, with the standard deviation of each.

    Flat (l, m) first; zero where q > min(l, p).
    """

    values: Float[np.ndarray, "coefficient outgoing_degree order channel"]
    deviation: Float[np.ndarray, "coefficient outgoing_degree order channel"]

    @classmethod
    def of(
        cls,
        field: Complex[AnyArray, "degree order outgoing_degree outgoing_order channel"],
        deviation: float
        | Float[AnyArray, "degree order outgoing_degree outgoing_order channel"] = 0,
    ) -> "LightField":
        """Fold the complex coefficients of ``reflection.convolve_isotropic``.

        Light is real and rho_lpq = rho_lp-q, so that half of them repeat the others; they are
        averaged.  ``deviation`` is the root mean square error of a complex coefficient; what is
        below 1e-12 of the largest coefficient counts as rounding.
        """
        field = np.asarray(field)
        spread = np.broadcast_to(np.asarray(deviation, float), field.shape)
        by_order = _fold(field)
        flat = np.asarray(real_from_complex(by_order.reshape(len(by_order), -1)))
        values = flat.reshape(by_order.shape)
        most = (field.shape[3] - 1) // 2
        # Of a real field B_l-mp-q is (-1)^m conj(B_lmpq): q and -q are independent measurements.
        halves = np.where(np.arange(most + 1) > 0, 0.5, 1.0)[None, None, :, None]
        noise = np.sqrt(_fold(spread**2) * halves)
        least = _ROUNDING * np.max(np.abs(values), axis=(0, 1, 2), keepdims=True)
        return cls(values, np.maximum(noise, np.maximum(least, np.finfo(float).tiny)))


class FactoredField(NamedTuple):
    """Light and BRDF of a light field, per channel, and what of them the field determines.

    ``light`` is in real harmonics; ``brdf`` is rho~_lpq.  ``component`` says which degrees share a
    factor: 0 those tied to degree 0, whose factor is the gauge; 1, 2, ... with one of their own;
    ``UNLIT`` degrees that the field does not contain.  ``light_known`` and ``brdf_known`` mark what
    is determined in the gauge; what is neither known nor of a component of its own is 0.  Errors
    are standard errors.  ``residual`` is sqrt(sum (B~ - Lambda L rho~)^2 / sum B~^2), and
    ``chi_squared`` that of the fit for one degree of freedom.
    """

    light: Float[np.ndarray, "coefficient channel"]
    light_error: Float[np.ndarray, "coefficient channel"]
    brdf: Float[np.ndarray, "degree outgoing_degree order channel"]
    brdf_error: Float[np.ndarray, "degree outgoing_degree order channel"]
    component: Int[np.ndarray, "degree channel"]
    light_known: Bool[np.ndarray, "degree channel"]
    brdf_known: Bool[np.ndarray, "degree outgoing_degree order channel"]
    residual: Float[np.ndarray, "channel"]
    chi_squared: Float[np.ndarray, "channel"]

    def rescaled(self, factors: Float[np.ndarray, "degree"]) -> "FactoredField":
        """Return the member of the family with L_lm f(l) and rho~_lpq / f(l): the same field.

        Raises ``ValueError`` for a factor of zero, and for factors that the field rules out: other
        than 1 where the degree is tied to degree 0, or unequal within a component.
        """
        factors = np.asarray(factors, float)
        if not np.all(factors):
            raise ValueError("a factor of zero: give every degree one that can be divided by")
        for channel in range(self.component.shape[1]):
            _check_family(self.component[:, channel], factors)
        own = np.where(self.component > 0, factors[:, None], 1.0)
        rows = own[degrees(len(factors) - 1)]
        inverse = 1 / own[:, None, None, :]
        # Entries known from the other side of the symmetry are divided by the other's factor.
        square = min(self.brdf.shape[:2])
        borrowed = np.broadcast_to(inverse, self.brdf.shape).copy()
        other = np.swapaxes(borrowed[:square, :square], 0, 1)
        unlit = (self.component == UNLIT)[:square, None, None, :]
        borrowed[:square, :square] = np.where(unlit, other, borrowed[:square, :square])
        borrowed = np.where(self.brdf_known, 1.0, borrowed)
        return self._replace(
            light=self.light * rows,
            light_error=self.light_error * np.abs(rows),
            brdf=self.brdf * borrowed,
            brdf_error=self.brdf_error * np.abs(borrowed),
        )

    def sentences(self, channel: int = 0) -> tuple[str, ...]:
        """Say which degrees are determined and which are not, and why."""
        return sentences(
            self.component[:, channel],
            self.light_known[:, channel],
            self.brdf_known[..., channel],
            self._relative_errors(channel),
            self.chi_squared[channel],
        )

    def _relative_errors(self, channel: int) -> Float[np.ndarray, "degree"]:
        """Compute the error of each degree of the light over its size."""
        count = self.component.shape[0]
        degree = degrees(count - 1)
        size, error = (
            np.sqrt(np.bincount(degree, values[:, channel] ** 2, count))
            for values in (self.light, self.light_error)
        )
        return np.where(size > 0, error / np.maximum(size, np.finfo(float).tiny), np.inf)


def factor_light_field(field: LightField) -> FactoredField:
    """Factor a light field into light and BRDF, as far as it determines them (T 2.68).

    Raises ``ValueError`` for a field that is zero or not finite.
    """
    values, deviation = field
    if not (np.all(np.isfinite(values)) and np.all(deviation > 0)):
        raise ValueError("the light field is not finite, or has no noise: use LightField.of")
    if not np.all(np.any(values, axis=(0, 1, 2))):
        raise ValueError("a channel of the light field is zero: nothing is lit")
    parts = [
        _factor_channel(values[..., channel], deviation[..., channel])
        for channel in range(values.shape[3])
    ]
    return FactoredField(*(np.stack(arrays, axis=-1) for arrays in zip(*parts)))


def _factor_channel(values: np.ndarray, deviation: np.ndarray) -> FactoredField:
    """Factor the field of one channel; what is returned has no axis of channels."""
    band_limit = band_limit_of(values.shape[0])
    count, outgoing_count, order_count = band_limit + 1, *values.shape[1:]
    n, p, q = np.ogrid[:count, :outgoing_count, :order_count]
    exists = q <= np.minimum(n, p)
    of_row = degrees(band_limit)
    parts = [
        split_degree(values[of_row == k], deviation[of_row == k], exists[k]) for k in range(count)
    ]
    component, scale = tie_degrees(parts)
    light, light_error = np.zeros(len(of_row)), np.zeros(len(of_row))
    brdf, brdf_error = np.zeros(exists.shape), np.zeros(exists.shape)
    unknowns = 0
    for which in range(int(component.max()) + 1):
        members = np.flatnonzero(component == which)
        if not len(members):
            continue
        problem, start = _joint(members, parts, scale, values, deviation, exists)
        found = refine(problem, start)
        error = standard_errors(problem, found)
        rows = np.isin(of_row, members)
        light[rows], light_error[rows] = found.light, error.light
        first = np.searchsorted(of_row[rows], members)
        place = problem.unknown[first]
        brdf[members] = np.where(exists[members], found.brdf[place], 0)
        brdf_error[members] = np.where(exists[members], error.brdf[place], 0)
        unknowns += len(found.light) + len(found.brdf) - 1
    brdf_known = _borrow(component, brdf, brdf_error, exists)
    light_known = component == 0
    for degree in np.flatnonzero(component == UNLIT):
        rows = of_row == degree
        sure = np.abs(brdf[degree]) > CLEARLY * brdf_error[degree]
        if np.any(sure):
            kernel = wavelength(degree) * brdf[degree] / deviation[rows]
            power = np.sum(kernel**2, axis=(1, 2))
            light[rows] = np.sum(kernel * values[rows] / deviation[rows], axis=(1, 2)) / power
            light_error[rows], light_known[degree] = power**-0.5, True
    predicted = (wavelength(of_row) * light)[:, None, None] * brdf[of_row]
    left = np.where(exists[of_row], values - predicted, 0)
    residual = np.sqrt(np.sum(left**2) / np.sum(values**2))
    freedom = max(np.count_nonzero(exists[of_row]) - unknowns, 1)
    misfit = np.sum((left / deviation) ** 2) / freedom
    known = light_known, brdf_known
    return FactoredField(
        light, light_error, brdf, brdf_error, component, *known, residual, np.asarray(misfit)
    )


def _joint(
    members: Int[np.ndarray, "member"],
    parts: list[DegreeFactors],
    scale: Float[np.ndarray, "degree"],
    values: Float[np.ndarray, "coefficient outgoing_degree order"],
    deviation: Float[np.ndarray, "coefficient outgoing_degree order"],
    exists: Bool[np.ndarray, "degree outgoing_degree order"],
) -> tuple[Bilinear, Factors]:
    """Set up the least squares of the degrees of one component, starting from the chain's."""
    place = np.zeros(exists.shape, int)
    brdf: list[float] = []
    for degree in members:
        start = parts[degree].brdf / (wavelength(degree) * scale[degree])
        for p, q in np.argwhere(exists[degree]):
            if p in members and p < degree:
                place[degree, p, q] = place[p, degree, q]
            else:
                place[degree, p, q] = len(brdf)
                brdf.append(start[p, q])
    of_row = degrees(exists.shape[0] - 1)
    rows = np.isin(of_row, members)
    light = np.concatenate([scale[k] * parts[k].light for k in members])
    weights = np.where(exists[of_row[rows]], deviation[rows] ** -2.0, 0)
    first = of_row[rows] == members[0]
    held = int(np.argmax(np.where(first, np.abs(light), -1)))
    problem = Bilinear(values[rows], weights, wavelength(of_row[rows]), place[of_row[rows]], held)
    return problem, Factors(light, np.array(brdf))


def _borrow(
    component: np.ndarray, brdf: np.ndarray, error: np.ndarray, exists: np.ndarray
) -> np.ndarray:
    """Fill in by reciprocity what other degrees know, and mark what is known in the gauge."""
    known = exists & (component == 0)[:, None, None]
    square = min(brdf.shape[:2])
    for degree, other in np.ndindex(square, square):
        mine, theirs = component[degree], component[other]
        if mine != 0 and (theirs == 0 or (mine == UNLIT and theirs > 0)):
            brdf[degree, other], error[degree, other] = brdf[other, degree], error[other, degree]
            known[degree, other] = exists[degree, other] & (theirs == 0)
    return known


def _fold(field: np.ndarray) -> np.ndarray:
    """Average orders q and -q, and list (l, m) flat: [coefficient, p, q, channel]."""
    band_limit, most = field.shape[0] - 1, (field.shape[3] - 1) // 2
    flat = field[degrees(band_limit), orders(band_limit) + band_limit]
    return (flat[:, :, most:] + flat[:, :, most::-1]) / 2


def _check_family(component: np.ndarray, factors: np.ndarray) -> None:
    if factors.shape != component.shape:
        raise ValueError(f"{len(factors)} factors for {len(component)} degrees: give one each")
    for which in range(int(component.max()) + 1):
        members = np.flatnonzero(component == which)
        wanted = 1.0 if which == 0 else factors[members[0]] if len(members) else 1.0
        if not np.all(factors[members] == wanted):
            raise ValueError(
                f"degrees {members.tolist()} are tied to one another"
                + (" and to the gauge: their factors must be 1" if which == 0 else "")
                + ("" if which == 0 else ": give them one factor")
            )
