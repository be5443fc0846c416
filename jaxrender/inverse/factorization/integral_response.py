"""The response of a material without a frequency view to unknown light: the integral itself.

Brushed metal and fibres have no lobe about the reflected direction.  What they send to the camera
under light Y_lm is an integral over nodes about each normal (``reflection.polar_coefficients``).
It is exact for slow light, so that nothing is left to correct.  It costs a hundred times as much as
a look-up of a mirror's image.  A concave object hides some light from itself: that is summed over a
grid and subtracted.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, real_basis
from jaxrender.inverse.factorization.response import (
    Guess,
    MirrorResponse,
    Response,
    lobes_towards,
)
from jaxrender.inverse.factorization.sight import hidden_nodes
from jaxrender.lighting import LightNodes
from jaxrender.reflection import integral_columns, polar_coefficients
from jaxrender.shapes import AnyArray, Array, Bool, Float

# Nodes from the normal to the horizon: at degree 10 lobes of .1 radians are followed to two per
# mille, of .05 to nearly one per cent.
_POLAR_NODES = 32


class IntegralResponse(Response):
    """Samples of a surface of any parametric material.

    ``hidden`` marks the ``sight.hidden_nodes`` that a concave object hides from each sample.  What
    they would have sent is subtracted from the integral.
    """

    variant: Parametric
    samples: SurfaceSamples
    diffuse_basis: Float[AnyArray, "sample coefficient"]
    lit: Float[AnyArray, "sample source"]
    hidden: Bool[AnyArray, "sample node"] | None = None

    @classmethod
    def of_convex(
        cls, variant: Parametric, samples: SurfaceSamples, band_limit: int, sources: int
    ) -> "IntegralResponse":
        """Make the response of an object that never shadows itself."""
        samples = SurfaceSamples(*(jnp.asarray(a) for a in samples))
        diffuse = _under_harmonics(variant, samples, band_limit)[:, 0]
        lit = jnp.ones((samples.normals.shape[0], sources), samples.normals.dtype)
        return cls(variant, samples, diffuse, lit)

    def shadowed(self, hidden: Bool[AnyArray, "sample node"]) -> "IntegralResponse":
        """Let the object shadow itself."""
        band_limit = band_limit_of(self.slow_count)
        diffuse = _under_harmonics(self.variant, self.samples, band_limit, hidden)[:, 0]
        return dataclasses.replace(self, diffuse_basis=diffuse, hidden=hidden)

    def passed(self, guess: Guess) -> Float[Array, "sample coefficient"]:
        """Integrate the lobe against every harmonic."""
        band_limit = band_limit_of(self.slow_count)
        return _under_harmonics(self.lobe(guess), self.samples, band_limit, self.hidden)[:, 1]

    def slow_columns(
        self, passed: Float[Array, "sample coefficient"]
    ) -> Float[Array, "sample coefficient"]:
        """Keep the integrals as they are."""
        return passed

    def base_towards(
        self, directions: Float[Array, "direction 3"]
    ) -> Float[Array, "sample direction"]:
        """Evaluate the material's own base, which has no number to be searched for."""
        return lobes_towards(self.variant, self.samples, directions, base=True)


def response_of_convex(
    variant: Parametric, samples: SurfaceSamples, band_limit: int, sources: int
) -> Response:
    """Make the response of an object that never shadows itself, by frequency where it can be."""
    if isinstance(variant, Glossy):
        return MirrorResponse.of_convex(variant, samples, band_limit, sources)
    return IntegralResponse.of_convex(variant, samples, band_limit, sources)


@eqx.filter_jit
def columns_under_slow_light(
    brdf: Parametric,
    samples: SurfaceSamples,
    slow: Float[AnyArray, "coefficient channel"],
    hidden: Bool[AnyArray, "sample node"] | None = None,
) -> Float[Array, "sample 2 channel"]:
    """Integrate both lobes under light given by its coefficients, less what is hidden."""
    each = _under_harmonics(brdf, samples, band_limit_of(slow.shape[0]), hidden)
    return jnp.einsum("slk,kc->slc", each, jnp.asarray(slow), precision="highest")


@eqx.filter_jit
def _under_harmonics(
    brdf: Parametric,
    samples: SurfaceSamples,
    band_limit: int,
    hidden: Bool[AnyArray, "sample node"] | None = None,
) -> Float[Array, "sample lobe coefficient"]:
    whole = polar_coefficients(brdf, samples, band_limit, _POLAR_NODES)
    if hidden is None:
        return whole
    directions, solid_angle = (jnp.asarray(a, whole.dtype) for a in hidden_nodes())
    nodes = LightNodes(directions, solid_angle[:, None] * real_basis(directions, band_limit))
    return whole - integral_columns(brdf, samples, nodes, hidden)
