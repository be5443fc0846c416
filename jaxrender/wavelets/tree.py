"""The coefficient tree: a sparse function on the unit cube, as flat sorted arrays (L 4.3.2).

    f(q) = s + sum over j of f_j F_j(q),      j = (nu, l, m_0, m_1, ...),                  (L 4.5)
    F_j(q) = product over axes a of Gamma_{l, m_a, nu[a]}(q_a)

where Gamma is the scaling function phi_{l,m}(x) = 2^{l/2} phi(2^l x - m) where bit a of nu is 0 and
the wavelet psi_{l,m} where it is 1; l = 0 is the coarsest level (ERRATA 56), nu = 1 .. 2^axes - 1,
and the root's scaling coefficient s, nu = 0, carries the mean (ERRATA 59).  Functions of x have
unit norm on [0, 1], so that with an orthonormal wavelet the integral of f^2 is s^2 + sum of f_j^2,
and an array of n^axes samples has coefficients n^(-axes/2) times those of ``transform``: the number
of samples is not in them, and a tree is the same at twice the resolution.

A coefficient has a number for every channel; channels share the masks.  ``nodes`` says how nodes
are numbered, ``traversal`` evaluates at points, ``cells`` does so quickly for Haar's wavelet, and
``hashing`` is the table of L 4.3.1, the twin of both.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.shapes import AnyArray, Array, Float
from jaxrender.wavelets.filters import Wavelet
from jaxrender.wavelets.layout import check_signal
from jaxrender.wavelets.nodes import (
    Entries,
    Structure,
    interleaved,
    separated,
    structure_from,
)
from jaxrender.wavelets.transform import synthesise_nonstandard

# Two masks of 16 bits a node.
_MOST_AXES = 4


class CoefficientTree(eqx.Module):
    """A function on [0, 1]^axes as the coefficients that are not zero.

    Samples stand at the centres of ``size`` cells along each axis.  A pytree whose leaves are the
    root and the values: it goes through ``jit``, ``vmap`` and ``grad``, and optimisers train it.
    Raises ``ValueError`` for more than four axes, a size that is no power of two, another number of
    values than the masks name, and nodes finer than the size.
    """

    wavelet: Wavelet = eqx.field(static=True)
    size: int = eqx.field(static=True)
    structure: Structure = eqx.field(static=True)
    """Which coefficients there are."""
    root: Float[AnyArray, "channel"]
    values: Float[AnyArray, "value channel"]
    offset: float = eqx.field(static=True, default=-1.0)
    """Where sample 0 stands; by default the centre of its cell.  ``resampled`` leaves it there."""

    def __post_init__(self):
        if self.offset < 0:
            object.__setattr__(self, "offset", 0.5 / max(self.size, 1))

    def __check_init__(self):
        if not 1 <= self.axes <= _MOST_AXES:
            raise ValueError(f"{self.axes} axes; a tree has 1 to {_MOST_AXES}")
        if self.size < 1 or self.size & (self.size - 1):
            raise ValueError(f"size {self.size} is no power of two")
        held = int(np.bitwise_count(self.structure.value_masks).sum())
        if len(self.values) != held:
            raise ValueError(f"{len(self.values)} values, and masks that name {held}")
        if self.values.shape[1] != self.root.shape[0]:
            raise ValueError(
                f"{self.values.shape[1]} channels of values, {self.root.shape[0]} at the root"
            )
        deepest = int(self.structure.level.max(initial=0))
        if deepest >= max(self.levels, 1):
            raise ValueError(f"nodes at level {deepest}; size {self.size} has {self.levels} levels")

    @classmethod
    def of_coefficients(
        cls, wavelet: Wavelet, coefficients: Float[AnyArray, "*size channel"]
    ) -> "CoefficientTree":
        """Collect the non-zero results of ``analyse_nonstandard`` of a cube.

        Raises ``ValueError`` for sides of different length and what the constructor refuses.
        """
        coefficients = np.asarray(coefficients)
        check_signal(coefficients)
        size, axes = coefficients.shape[0], coefficients.ndim - 1
        if any(side != size for side in coefficients.shape[:-1]):
            raise ValueError(
                f"an array of {coefficients.shape[:-1]} is no cube; resample it to equal sides"
            )
        norm = np.asarray(float(size) ** (-axes / 2), coefficients.dtype)
        flat = coefficients.reshape(-1, coefficients.shape[-1])
        held = np.flatnonzero(np.any(flat != 0, axis=1))
        held = held[held > 0]
        places = np.stack(np.unravel_index(held, coefficients.shape[:-1]), axis=1)
        # Index 2^l or more along some axis says the level; along each axis, whether a wavelet.
        level = np.frexp(places.max(axis=1, initial=0).astype(float))[1].astype(np.int64) - 1
        fine = places >= (1 << level)[:, None]
        code = interleaved(places - np.where(fine, (1 << level)[:, None], 0), size.bit_length())
        selector = fine @ (1 << np.arange(axes))
        entries = Entries(level, code, selector, flat[held] * norm)
        return cls.of_entries(wavelet, size, axes, entries, flat[0] * norm)

    @classmethod
    def of_entries(
        cls,
        wavelet: Wavelet,
        size: int,
        axes: int,
        entries: Entries,
        root: Float[AnyArray, "channel"],
    ) -> "CoefficientTree":
        """Arrange coefficients of ``size`` samples along each axis.  Equal places are added up."""
        structure, values = structure_from(entries, axes)
        return cls(wavelet, size, structure, root, values)

    @property
    def axes(self) -> int:
        """Of the cube."""
        return self.structure.axes

    @property
    def levels(self) -> int:
        """How many levels of coefficients the size has room for."""
        return self.size.bit_length() - 1

    @property
    def channels(self) -> int:
        """Of the values."""
        return self.root.shape[0]

    @property
    def count(self) -> int:
        """How many coefficients are held, the root's included."""
        return len(self.values) + 1

    def entries(self) -> Entries:
        """List the coefficients but the root's."""
        structure = self.structure
        node = structure.value_nodes
        places = structure.level[node], structure.code[node], structure.value_selectors
        return Entries(*places, self.values)

    def coefficients(self) -> Float[Array, "*size channel"]:
        """Lay out all coefficients in Mallat's order, normalised as ``transform`` has them."""
        entries, values = self.entries(), jnp.asarray(self.values)
        bits = (entries.selector[:, None] >> np.arange(self.axes)) & 1
        places = separated(entries.code, self.axes) + (bits << entries.level[:, None])
        dense = jnp.zeros((*(self.size,) * self.axes, self.channels), values.dtype)
        dense = dense.at[(0,) * self.axes].set(jnp.asarray(self.root, values.dtype))
        norm = float(self.size) ** (self.axes / 2)
        return dense.at[tuple(places.T)].set(values, unique_indices=True) * norm

    def samples(self) -> Float[Array, "*size channel"]:
        """Reconstruct all samples."""
        return synthesise_nonstandard(self.wavelet, self.coefficients())
