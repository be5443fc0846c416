"""An isotropic BRDF as a coefficient tree over the half and difference angles.

Coordinates on the unit cube, with the angles of ``tables.isotropic`` (Rusinkiewicz 1998):

    (sqrt(t_h / (pi/2)), t_d / (pi/2), p_d / pi).

A highlight lies along one face of this cube, where its samples are dense; over Nusselt's squares
(``wavelet``) it runs along a diagonal, in cells wider than itself.  p_d is periodic, as the
wavelets are, and its range makes the BRDF reciprocal.

What is in the tree is not rho but a value transform of it, since reflectances span decades:

``cube-root``   rho = u^3
``log``         rho = (e^u - 1) / k, k = ``LOG_SCALE`` sr
``none``        rho = u

Where thresholding left u below 0, rho is 0.

Three axes have few samples, so that all are synthesised and interpolated, as ``traversal`` defines
the function between them; but p_d goes round, from the last sample to the first.  The class holds
the coefficients and their places; ``tree`` is made of them when asked for, and training the values
trains the one thing there is.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.half_vector import are_visible
from jaxrender.brdf.measured import MeasuredAlbedo
from jaxrender.brdf.parameters import refuse_unlisted
from jaxrender.brdf.tables.isotropic import (
    HALF_PI,
    HalfDifference,
    half_difference,
    pair_at,
    raised,
)
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float, Int, checked
from jaxrender.wavelets import CoefficientTree, Wavelet, is_stepwise, synthesise_nonstandard

LOG_SCALE = 100.0
_AXES = 3
# Samples below the horizon take the value at this fraction of cos t_h above it.
_ABOVE_HORIZON = 0.02
_evaluate = eqx.filter_jit(BRDF.evaluate)


class ValueTransform(NamedTuple):
    """A one-to-one map of values that are not negative, and its inverse."""

    apply: Callable[[AnyArray], Array]
    undo: Callable[[AnyArray], Array]


TRANSFORMS: dict[str, ValueTransform] = {
    "cube-root": ValueTransform(jnp.cbrt, lambda u: jnp.asarray(u) ** 3),
    "log": ValueTransform(
        lambda rho: jnp.log1p(LOG_SCALE * rho), lambda u: jnp.expm1(u) / LOG_SCALE
    ),
    "none": ValueTransform(jnp.asarray, jnp.asarray),
}


class HalfDifferenceTree(MeasuredAlbedo):
    """Coefficients of transformed values over the three coordinates; a pytree throughout.

    ``places`` are flat indices of ``transform.analyse_nonstandard``'s result of ``size``^3 samples,
    ``values`` what stands there.  Raises ``ValueError`` for an unlisted transform.
    """

    wavelet: Wavelet = eqx.field(static=True)
    size: int = eqx.field(static=True)
    places: Int[AnyArray, "value"]
    values: Float[AnyArray, "value channel"]
    transform: str = eqx.field(static=True, default="cube-root")

    def __check_init__(self):
        refuse_unlisted("transform", self.transform, tuple(TRANSFORMS))

    @classmethod
    def of(cls, tree: CoefficientTree, transform: str = "cube-root") -> "HalfDifferenceTree":
        """Take a tree of transformed values.

        Raises ``ValueError`` for one of other than three axes, one whose samples do not stand at
        the centres of cells, and an unlisted transform.
        """
        if tree.axes != _AXES:
            raise ValueError(
                f"a tree of {tree.axes} axes; half and difference angles are {_AXES}, two "
                "directions 4 (WaveletBRDF)"
            )
        if tree.offset != 0.5 / tree.size:
            raise ValueError(
                f"samples at {tree.offset} of {tree.size}: a resampled tree; analyse its samples"
            )
        dense = np.asarray(tree.coefficients()).reshape(-1, tree.channels)
        places = np.flatnonzero(np.any(dense != 0, axis=1))
        places = places if len(places) else np.zeros(1, int)
        return cls(tree.wavelet, tree.size, places, dense[places], transform)

    @property
    def tree(self) -> CoefficientTree:
        """The tree of transformed values; host side."""
        return CoefficientTree.of_coefficients(self.wavelet, np.asarray(self._coefficients()))

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """One: every channel has a lobe of its own."""
        return np.eye(self.values.shape[1])

    @property
    def reciprocal(self) -> bool:
        """Always, by the range of p_d."""
        return True

    @property
    def isotropic(self) -> bool:
        """Always."""
        return True

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Evaluate each channel times cos t_i."""
        found = self._at(half_difference(incoming, outgoing))
        visible, cosine = are_visible(incoming, outgoing), jnp.asarray(incoming.z)
        return tuple(
            jnp.where(visible, found[..., c].astype(cosine.dtype) * cosine, 0)
            for c in range(found.shape[-1])
        )

    def _at(self, angles: HalfDifference) -> Float[Array, "*batch channel"]:
        samples = synthesise_nonstandard(self.wavelet, self._coefficients())
        # Each is evaluated once, and not once for each corner of a cell.
        samples, place = jax.lax.optimization_barrier((samples, coordinates_of(angles)))
        found = interpolated(samples, place, is_stepwise(self.wavelet))
        return TRANSFORMS[self.transform].undo(jnp.maximum(found, 0))

    def _coefficients(self) -> Float[Array, "root_theta_h theta_d phi_d channel"]:
        values = jnp.asarray(self.values)
        dense = jnp.zeros((self.size**_AXES, values.shape[1]), values.dtype)
        return dense.at[self.places].set(values).reshape(*(self.size,) * _AXES, -1)


def interpolated(
    samples: Float[AnyArray, "n n n channel"],
    coordinates: tuple[Float[AnyArray, "*batch"], ...],
    stepwise: bool,
) -> Float[Array, "*batch channel"]:
    """Evaluate a function given at the centres of cells: constant in each, or linear between.

    The last axis closes upon itself; the others repeat their end samples.
    """
    samples = jnp.asarray(samples)
    size = samples.shape[0]
    firsts, rests = [], []
    for axis, along in enumerate(coordinates):
        place = jnp.asarray(along) * size - (0 if stepwise else 0.5)
        if axis < _AXES - 1 or stepwise:
            place = jnp.clip(place, 0, size - 1)
        first = jnp.floor(jax.lax.stop_gradient(place))
        firsts.append(first.astype(np.int32))
        rests.append(jnp.zeros_like(place) if stepwise else place - first)
    rows, total = samples.reshape(-1, samples.shape[-1]), None
    for corner in [(0, 0, 0)] if stepwise else itertools.product((0, 1), repeat=_AXES):
        index, weight = jnp.zeros_like(firsts[0]), jnp.ones_like(rests[0])
        for axis, (bit, first, rest) in enumerate(zip(corner, firsts, rests, strict=True)):
            at = first + bit
            index = index * size + (at % size if axis == _AXES - 1 else jnp.minimum(at, size - 1))
            weight = weight * (rest if bit else 1 - rest)
        part = weight[..., None] * rows[index].astype(weight.dtype)
        total = part if total is None else total + part
    return jnp.asarray(total)


def coordinates_of(angles: HalfDifference) -> tuple[Float[Array, "*batch"], ...]:
    """Map angles to the unit cube; at t_h = 0, where a root has no derivative, it is taken as 0."""
    theta_h = jnp.asarray(angles.theta_h)
    positive = theta_h > 0
    root = jnp.where(positive, jnp.sqrt(jnp.where(positive, theta_h, 1) / HALF_PI), 0)
    return root, jnp.asarray(angles.theta_d) / HALF_PI, jnp.asarray(angles.phi_d) / np.pi


@checked
def half_difference_samples(
    brdf: BRDF, size: int, transform: str = "cube-root"
) -> Float[np.ndarray, "root_theta_h theta_d phi_d channel"]:
    """Evaluate a BRDF's transformed values at ``size``^3 centres of cells.

    Samples below the horizon take the value just above it at a smaller theta_d.  Values that are
    negative count as 0.  Host side.  Raises ``ValueError`` for a BRDF that is not isotropic, for
    values that are not finite, and for an unlisted transform.
    """
    refuse_unlisted("transform", transform, tuple(TRANSFORMS))
    if not brdf.isotropic:
        raise ValueError(
            f"{type(brdf).__name__} is anisotropic here; half and difference angles hold isotropic "
            "ones: take the mean over turns (IsotropicMean), or the nusselt embedding"
        )
    centres = (np.arange(size) + 0.5) / size
    theta_h, theta_d, phi_d = np.meshgrid(
        HALF_PI * centres**2, HALF_PI * centres, np.pi * centres, indexing="ij"
    )
    angles = HalfDifference(theta_h, theta_d, phi_d)
    pair = pair_at(raised(angles, _ABOVE_HORIZON * np.cos(theta_h)))
    rows = [part.reshape(-1, 3) for part in pair]
    step = 1 << 16
    found = np.concatenate(
        [
            np.asarray(_evaluate(brdf, *(jnp.asarray(part[at : at + step]) for part in rows)))
            for at in range(0, len(rows[0]), step)
        ]
    )
    if not np.isfinite(found).all():
        raise ValueError(f"{np.sum(~np.isfinite(found))} values are not finite; mend the BRDF")
    found = np.asarray(TRANSFORMS[transform].apply(np.maximum(found, 0)))
    return found.reshape(*(size,) * _AXES, -1)
