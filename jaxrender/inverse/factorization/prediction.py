"""Predict other samples by the light and the material that a factorization has found."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import Shape, SurfaceSamples
from jaxrender.harmonics import band_limit_of, coefficient_count
from jaxrender.inverse.factorization.correction import hidden_slow_light
from jaxrender.inverse.factorization.integral_response import columns_under_slow_light
from jaxrender.inverse.factorization.recovered_scene import RecoveredScene
from jaxrender.inverse.factorization.sight import Sight
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import concave, places_of, with_transfer
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.reflection import (
    integral_columns,
    irradiance,
    radiance,
    reflect_slow_light,
    shadowed_irradiance,
)
from jaxrender.shapes import AnyArray, Array, Bool, Float


def predict(
    brdf: Parametric,
    scene: RecoveredScene,
    observations: Observations,
    shape: Shape | None = None,
) -> Float[np.ndarray, "sample channel"]:
    """Predict samples by the exact integral; ``shape`` where it may cast shadows on itself."""
    slow, sources = jnp.asarray(scene.slow), scene.points.nodes()
    samples = observations.samples
    hiding = concave(shape)
    sight = None if hiding is None else Sight(hiding, places_of(observations))
    seen = None if sight is None else sight.of(sources.directions)
    if not isinstance(brdf, Glossy):
        hidden = None if sight is None else sight.hidden()
        columns = columns_under_slow_light(brdf, samples, slow, hidden)
        return np.asarray(radiance(brdf, columns + integral_columns(brdf, samples, sources, seen)))
    diffuse, specular, fast = _of_glossy(brdf, samples, sources, slow, seen)
    if hiding is not None and sight is not None:
        band_limit = band_limit_of(slow.shape[0])
        observations = with_transfer(observations, hiding, band_limit)
        assert observations.transfer is not None
        transfer = np.asarray(observations.transfer)[:, : coefficient_count(band_limit)]
        diffuse = shadowed_irradiance(slow, transfer)
        specular = specular - hidden_slow_light(samples, sight, brdf, slow)
    kd, ks = (np.asarray(part)[None, :] for part in brdf.amplitudes)
    predicted = kd * (diffuse + fast[:, 0]) + ks * (specular + fast[:, 1])
    return np.asarray(predicted)


class _Parts(NamedTuple):
    """What slow light sends by each lobe if nothing hides it, and what sources send by both."""

    diffuse: Float[Array, "sample channel"]
    specular: Float[Array, "sample channel"]
    fast: Float[Array, "sample lobe channel"]


@stored(effort="less")
def _of_glossy(
    brdf: Glossy,
    samples: SurfaceSamples,
    sources: LightNodes,
    slow: Float[Array, "coefficient channel"],
    seen: Bool[AnyArray, "sample source"] | None,
) -> _Parts:
    return _Parts(
        irradiance(slow, samples.normals),
        reflect_slow_light(brdf, samples, slow),
        integral_columns(brdf, samples, sources, seen),
    )
