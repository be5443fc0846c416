"""Rendering with a sigma of its own at every sample, by any forward model.

The model renders whole samples with one sigma at a time: at a few knots, between which the specular
column is interpolated in log sigma.  Widths that are traced have no range to put knots in: there
every sample is rendered with its own, which has a derivative everywhere.
"""

import jax.numpy as jnp
import numpy as np

from jaxrender.batches import in_batches
from jaxrender.brdf import Parametric
from jaxrender.geometry import SurfacePlaces, SurfaceSamples
from jaxrender.reflection.integral import radiance
from jaxrender.reflection.render import ForwardModel, ShadowedModel, is_traced, render_samples
from jaxrender.shapes import AnyArray, Array, Float, checked

# Knots are at most so far apart in log sigma, which leaves 1e-3 of the column at most.
_STEP = 0.05
# Samples of traced widths rendered at once, each with a transfer of its own.
_SAMPLES_AT_ONCE = 64


@checked
def render_widths(
    brdf: Parametric,
    widths: Float[AnyArray, "sample"],
    samples: SurfaceSamples,
    model: ForwardModel | ShadowedModel,
    places: SurfacePlaces | None = None,
) -> Float[AnyArray, "sample channel"]:
    """Compute the radiance of every sample, the lobe of ``brdf`` having the sample's own width.

    Raises ``ValueError`` for a width that is not a positive number, and for traced widths under a
    model with shadows, whose rays are traced on the host.
    """
    if is_traced(widths):
        if isinstance(model, ShadowedModel):
            raise ValueError("widths that are traced have no shadows: render without them")
        return _one_by_one(brdf, jnp.asarray(widths), samples, model)
    widths = np.asarray(widths)
    if not (np.isfinite(widths).all() and (widths > 0).all()):
        raise ValueError("a width is not a positive number: leave such samples out")
    found = np.zeros((len(widths), np.shape(brdf.amplitudes)[1]))
    if not len(widths):
        return found
    logs = np.log(widths)
    low, high = float(logs.min()), float(logs.max())
    count = 1 + int(np.ceil((high - low) / _STEP))
    position = (logs - low) / max((high - low) / max(count - 1, 1), np.finfo(float).tiny)
    for number, knot in enumerate(np.linspace(low, high, count)):
        share = np.clip(1 - np.abs(position - number), 0, 1)
        rows = np.flatnonzero(share)
        if rows.size:
            own = SurfaceSamples(*(_rows(part, rows) for part in samples))
            where = None
            if places is not None:
                where = SurfacePlaces(*(np.asarray(part)[rows] for part in places))
            lobe = brdf.with_roughness(float(np.exp(knot)), brdf.mu)
            found = _added(found, rows, share[rows], render_samples(lobe, own, model, where))
    return found


def _rows(part: Float[AnyArray, "sample 3"], rows: np.ndarray) -> Float[AnyArray, "kept 3"]:
    return part[rows] if is_traced(part) else np.asarray(part)[rows]


def _added(
    total: Float[AnyArray, "sample channel"],
    rows: np.ndarray,
    weights: Float[np.ndarray, "kept"],
    values: Float[AnyArray, "kept channel"],
) -> Float[AnyArray, "sample channel"]:
    """Add weighted values to some rows."""
    if isinstance(values, np.ndarray):
        total[rows] += weights[:, None] * values
        return total
    terms = jnp.asarray(weights[:, None], values.dtype) * values
    return jnp.asarray(total, values.dtype).at[rows].add(terms)


def _one_by_one(
    brdf: Parametric, widths: Float[Array, "sample"], samples: SurfaceSamples, model: ForwardModel
) -> Float[Array, "sample channel"]:
    """Render every sample with its own lobe."""

    def one(pair: tuple[Array, SurfaceSamples]) -> Array:
        sigma, sample = pair
        lobe = brdf.with_roughness(sigma, brdf.mu)
        alone = SurfaceSamples(*(part[None] for part in sample))
        return radiance(lobe, model.columns(lobe, alone))[0]

    pairs = widths, SurfaceSamples(*(jnp.asarray(part) for part in samples))
    return in_batches(one, pairs, _SAMPLES_AT_ONCE)
