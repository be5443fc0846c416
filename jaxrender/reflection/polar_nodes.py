"""How many nodes about the normal a lobe asks for.

The polar quadrature has Gauss-Legendre nodes in the cosine to the normal, which do not know where
the lobe is: below so many over its width they step over it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxrender.brdf import BRDF, AnisotropicWard, Glossy, OrenNayar, Parametric, lobe_width
from jaxrender.shapes import AnyArray, Array, Float

# What smooth light and wide lobes ask for.
_LEAST = 48
# Nodes times sigma that leave 1e-6 of the largest value, at exit cosines from .15 and in light of
# degree 4: for lobes that end, and for those with a tail (1e-5 at cosines of .05 takes threefold).
_PER_WIDTH, _PER_WIDTH_OF_TAIL = 5.0, 8.0
# Values between which a table is interpolated have kinks: these leave 1e-3.
_PER_WIDTH_OF_VALUES = 3.0
# Steps that counts are rounded up in, so that few programs are compiled.
_STEP = 16


def polar_nodes_for(brdf: BRDF) -> int:
    """Say how many polar nodes leave 1e-6 of the largest value, for exit cosines from .15.

    5 / sigma, 8 / sigma for lobes with a tail, and never below 48.  A BRDF that does not state its
    width gets 3 over the width that is measured, for 1e-3.  One that is traced gets 48.
    """
    width = _width_of(brdf)
    if not isinstance(brdf, Parametric) and not _is_traced(brdf):
        # Measured now, even where a program is being compiled about it.
        with jax.ensure_compile_time_eval():
            width = lobe_width(brdf)
    if width is None or isinstance(width, Tracer):
        return _LEAST
    count = _nodes_times_width(brdf) / float(width)
    return max(_LEAST, _STEP * int(np.ceil(count / _STEP)))


def refuse_narrow(
    brdf: BRDF, polar_nodes: int, columns: Float[Array, "*shape"]
) -> Float[Array, "*shape"]:
    """Pass columns on where a traced sigma is wide enough for the nodes; fail at run time else."""
    width = _width_of(brdf)
    if not isinstance(width, Tracer):
        return columns
    least = _nodes_times_width(brdf) / polar_nodes
    return eqx.error_if(
        columns,
        jnp.any(width < least),
        f"{type(brdf).__name__}: a lobe of sigma below {least:.3g} falls between the "
        f"{polar_nodes} polar nodes; sigma is traced, so give polar_nodes yourself, "
        f"{_nodes_times_width(brdf):g} / sigma or more",
    )


def _width_of(brdf: BRDF) -> Float[AnyArray, ""] | float | None:
    # Oren and Nayar's sigma is that of the facets of diffuse paint, which has no lobe.
    if not isinstance(brdf, Parametric) or isinstance(brdf, OrenNayar):
        return None
    if isinstance(brdf, AnisotropicWard):
        return jnp.minimum(jnp.asarray(brdf.sigma), jnp.asarray(brdf.across))
    return brdf.sigma


def _is_traced(brdf: BRDF) -> bool:
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(brdf))


def _nodes_times_width(brdf: BRDF) -> float:
    if not isinstance(brdf, Parametric):
        return _PER_WIDTH_OF_VALUES
    has_tail = not isinstance(brdf, Glossy) or brdf.reach is None
    return _PER_WIDTH_OF_TAIL if has_tail else _PER_WIDTH
