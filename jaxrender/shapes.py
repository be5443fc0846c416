"""Array types and the glossary of axis words that the annotations of every package use.

Axis words: ``point`` a place on a surface; ``sample`` one usable pixel of one photograph;
``row column`` an image; ``frame`` a photograph; ``ray`` a ray; ``node`` a direction with a
quadrature weight; ``source`` a directional light; ``channel`` a colour channel; ``degree`` l from
0 to the band limit; ``coefficient`` the flat index l(l+1)+m of a real harmonic; ``lobe`` one of the
functions whose linear combination is a BRDF.

``Array`` is a JAX array.  ``AnyArray`` is a JAX or a NumPy array: what functions accept that hand
their input to either.
"""

import jax
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

AnyArray = jax.Array | np.ndarray


def as_jax(values: np.ndarray, dtype: np.dtype | None = None) -> Array:
    """Copy a host array to JAX, where ``jnp.asarray`` would compile a program for every shape."""
    return jax.device_put(np.array(values, dtype))


Directions = Float[AnyArray, "*batch 3"]
Coefficients = Float[AnyArray, "coefficient channel"]
ImageArray = Float[AnyArray, "row column channel"]

__all__ = [
    "AnyArray",
    "Array",
    "Bool",
    "Coefficients",
    "Complex",
    "Directions",
    "Float",
    "ImageArray",
    "Int",
    "as_jax",
]
