"""Rendering with a sigma of its own at every sample, by any forward model.

The model renders whole samples with one sigma at a time: at a few knots, between which the specular
column is interpolated in log sigma.
"""

import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import SurfacePlaces, SurfaceSamples
from jaxrender.reflection.render import ForwardModel, ShadowedModel, render_samples
from jaxrender.shapes import Float

# Knots are at most so far apart in log sigma, which leaves 1e-3 of the column at most.
_STEP = 0.05


def render_widths(
    brdf: Glossy,
    widths: Float[np.ndarray, "sample"],
    samples: SurfaceSamples,
    model: ForwardModel | ShadowedModel,
    places: SurfacePlaces | None = None,
) -> Float[np.ndarray, "sample channel"]:
    """Compute the radiance of every sample, the lobe of ``brdf`` having the sample's own width.

    Raises ``ValueError`` for a width that is not a positive number.
    """
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
            own = SurfaceSamples(*(np.asarray(part)[rows] for part in samples))
            where = None
            if places is not None:
                where = SurfacePlaces(*(np.asarray(part)[rows] for part in places))
            lobe = brdf.with_roughness(float(np.exp(knot)), brdf.mu)
            values = render_samples(lobe, own, model, where)
            found[rows] += share[rows, None] * values
    return found
