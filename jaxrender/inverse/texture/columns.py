"""The columns of T 6.13 by any forward model, for textures that are known."""

import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfacePlaces, SurfaceSamples
from jaxrender.inverse.models import Columns
from jaxrender.reflection import ForwardModel, ShadowedModel, render_samples, render_widths
from jaxrender.shapes import Float


def texture_columns(
    lobe: Microfacet,
    samples: SurfaceSamples,
    model: ForwardModel | ShadowedModel,
    places: SurfacePlaces | None = None,
    widths: Float[np.ndarray, "sample"] | None = None,
) -> Columns:
    """Evaluate what K_d = 1 and K_s = 1 would send to the camera; [sample, channel] each.

    ``widths`` are the sigma of each sample, where it varies; ``places`` are for shadows.
    """
    channels = np.asarray(lobe.kd).shape[0]
    none, full = np.zeros(channels), np.ones(channels)
    diffuse_part, specular_part = lobe.with_amplitudes(full, none), lobe.with_amplitudes(none, full)
    diffuse = np.asarray(render_samples(diffuse_part, samples, model, places))
    if widths is None:
        return Columns(diffuse, np.asarray(render_samples(specular_part, samples, model, places)))
    return Columns(
        diffuse, np.asarray(render_widths(specular_part, widths, samples, model, places))
    )
