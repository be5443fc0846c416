"""The columns of T 6.13 by any forward model, for textures that are known."""

import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfacePlaces, SurfaceSamples
from jaxrender.inverse.models import Columns
from jaxrender.programs import stored
from jaxrender.reflection import ForwardModel, ShadowedModel, render_widths
from jaxrender.reflection.render import in_batches
from jaxrender.shapes import Array, Float


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
    amplitudes = np.ones(np.shape(lobe.kd))
    unit = lobe.with_amplitudes(amplitudes, amplitudes)
    found = in_batches(_columns, unit, samples, model, np.shape(unit.amplitudes), places)
    diffuse, specular = np.asarray(found)[:, 0], np.asarray(found)[:, 1]
    if widths is None:
        return Columns(diffuse, specular)
    shiny = lobe.with_amplitudes(0 * amplitudes, amplitudes)
    return Columns(diffuse, np.asarray(render_widths(shiny, widths, samples, model, places)))


@stored()
def _columns(
    lobe: Microfacet, samples: SurfaceSamples, model: ForwardModel
) -> Float[Array, "sample lobe channel"]:
    return model.columns(lobe, samples)
