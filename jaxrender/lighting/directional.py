"""Directional sources: light from single directions, such as the sun or a distant lamp."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.geometry.directions import normalise
from jaxrender.lighting.base import Light, LightNodes
from jaxrender.shapes import AnyArray, Array, Float, as_jax


class DirectionalSources(Light):
    """Light that arrives from a few directions only.

    ``directions`` point towards the sources and are normalised; ``irradiance`` is that on a plane
    facing the source.  Raises ValueError for directions that are zero or not finite, irradiance
    that is not finite, and counts that do not match.
    """

    directions: Float[Array, "source 3"]
    irradiance: Float[Array, "source channel"]

    def __init__(
        self, directions: Float[AnyArray, "source 3"], irradiance: Float[AnyArray, "_ channel"]
    ):
        _check(directions, irradiance)
        # At least float32, and what JAX is set to hold.
        wanted = np.result_type(directions.dtype, irradiance.dtype, np.float32)
        dtype = jax.dtypes.canonicalize_dtype(wanted)
        if isinstance(directions, Tracer):
            self.directions = normalise(jnp.asarray(directions, dtype))
        else:
            # On the host: every number of sources would be one more program to compile.
            vectors = np.asarray(directions, dtype)
            lengths = np.sqrt(np.sum(vectors**2, axis=-1, keepdims=True))
            self.directions = as_jax(vectors / lengths)
        if isinstance(irradiance, np.ndarray):
            irradiance = as_jax(irradiance, dtype)
        self.irradiance = jnp.asarray(irradiance, dtype)

    @classmethod
    def none(cls, channels: int = 3) -> "DirectionalSources":
        """No source at all."""
        return cls(np.zeros((0, 3)), np.zeros((0, channels)))

    def nodes(self) -> LightNodes:
        """Each source is a node."""
        return LightNodes(self.directions, self.irradiance)


def _check(directions: AnyArray, irradiance: AnyArray) -> None:
    if directions.shape[0] != irradiance.shape[0]:
        raise ValueError(
            f"{directions.shape[0]} directions but {irradiance.shape[0]} irradiances: give one each"
        )
    # Values exist only outside a traced function; inside one there is nothing to look at.
    if not isinstance(directions, Tracer):
        vectors = np.asarray(directions)
        _refuse("direction", "finite and not zero", vectors, np.any(vectors, axis=-1))
    if not isinstance(irradiance, Tracer):
        _refuse("irradiance", "finite", np.asarray(irradiance), np.True_)


def _refuse(name: str, wanted: str, values: np.ndarray, usable: np.ndarray | np.bool) -> None:
    bad = np.flatnonzero(~(np.isfinite(values).all(axis=-1) & usable))
    if bad.size:
        raise ValueError(f"source {bad[0]} has the {name} {values[bad[0]]}: it must be {wanted}")
