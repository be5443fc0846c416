"""A BRDF measured with one source that moves (T 2.1, 6.4.1: the method of Marschner and others).

Under a single directional source every pixel of a curved object is one value of its BRDF,
rho = B / (E cos t_i).  A few photographs fill a table, the independent measurement of T figure 6.3.
The thesis's model is then fitted to the table.  Objects must not shadow themselves.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF, Microfacet
from jaxrender.geometry import Components, to_local, world_from_local
from jaxrender.imaging import NoiseModel
from jaxrender.inverse.brdf_table.table import BRDFSamples, BRDFTable
from jaxrender.inverse.elimination import Data, Problem
from jaxrender.inverse.intervals import Uncertain
from jaxrender.inverse.models import Columns, LinearisedModel, Numbers, Rows
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.search import search
from jaxrender.inverse.uncertainty import uncertain_parameters
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.lighting import DirectionalSources
from jaxrender.shapes import AnyArray, Float

_STARTS = 4
# A cell at the rim of what was measured may reach below the horizon.
_SMALLEST_COSINE = 1e-2


class TableFit(NamedTuple):
    """The material fitted to a table, its uncertainty, and the relative rms error of the fit."""

    brdf: Microfacet
    parameters: Uncertain
    relative_rms: float
    converged: bool


def brdf_samples(
    observations: Observations,
    sources: Sequence[DirectionalSources],
    noise: NoiseModel,
    min_cosine: float = 0.1,
) -> BRDFSamples:
    """Turn pixels into values of the BRDF; ``sources`` holds the one source of each photograph.

    Pixels whose incident or exit cosine is below ``min_cosine`` are left out.  The measurement is
    divided by the incident cosine; a small exit cosine is a silhouette.  Raises ``ValueError``
    unless every photograph has one source, with light in every channel.
    """
    frame = np.asarray(observations.frame)
    if frame.size and frame.max() >= len(sources):
        raise ValueError(
            f"photograph {frame.max()} has no source: {len(sources)} given; give one for each"
        )
    for number, source in enumerate(sources):
        if source.directions.shape[0] != 1 or not np.all(np.asarray(source.irradiance) > 0):
            raise ValueError(
                f"photograph {number} has {source.directions.shape[0]} sources: give it one, with "
                "irradiance above 0 in every channel"
            )
    towards = np.concatenate([np.asarray(source.directions) for source in sources])[frame]
    irradiance = np.concatenate([np.asarray(source.irradiance) for source in sources])[frame]
    frames = world_from_local(jnp.asarray(observations.samples.normals))
    incoming, outgoing = (
        np.asarray(to_local(frames, jnp.asarray(d)))
        for d in (towards, observations.samples.outgoing)
    )
    kept = np.minimum(incoming[:, 2], outgoing[:, 2]) >= min_cosine
    incoming, outgoing = incoming[kept], outgoing[kept]
    received = irradiance[kept] * incoming[:, 2:]
    radiance = np.asarray(observations.radiance)[kept]
    deviation = np.asarray(noise.standard_deviation(radiance))
    return BRDFSamples(incoming, outgoing, radiance / received, deviation / received)


class CellModel(eqx.Module):
    """The columns of kd and ks averaged over the cells of a table: 1, and the specular lobe."""

    variant: Microfacet
    incoming: Float[AnyArray, "sample node 3"]
    outgoing: Float[AnyArray, "sample node 3"]
    channels: int = eqx.field(static=True)

    def columns(self, numbers: Numbers) -> Columns:
        """Evaluate both lobes, divided by cos t_i."""
        incoming, outgoing = Components.of(self.incoming), Components.of(self.outgoing)
        lobe = self.variant.with_numbers(numbers).specular_transfer(incoming, outgoing)
        mean = jnp.mean(lobe / jnp.maximum(incoming.z, _SMALLEST_COSINE), axis=1)
        specular = jnp.repeat(mean[:, None], self.channels, axis=1)
        return Columns(jnp.ones_like(specular), specular)

    def take(self, index: Rows) -> "CellModel":
        """Keep the cells of the given indices."""
        incoming, outgoing = self.incoming[index], self.outgoing[index]
        return CellModel(self.variant, incoming, outgoing, self.channels)


def fit_table(table: BRDFTable, unknowns: Unknowns, variant: Microfacet) -> TableFit:
    """Fit kd, ks, sigma and mu of T 6.2 to a tabulated BRDF.

    Cells are weighed by their standard errors, so that the highlight does not decide alone as in
    the thesis's linear RMS error.  Of ``variant`` only the Fresnel angle, the masking and
    ``mu=None`` (a metal) count.  Raises ``ValueError`` for a table with too few cells, and for a
    reciprocal table where the variant is not reciprocal.
    """
    if table.grid.reciprocal and not variant.reciprocal:
        raise ValueError(
            "the table exchanges the two directions at will, but the model is not reciprocal: "
            'tabulate with reciprocal=False, or fit fresnel="half"'
        )
    there = table.filled
    values, deviation = table.mean[there], table.standard_error[there]
    usable = np.all(np.isfinite(deviation) & (deviation > 0), axis=1)
    values, deviation = values[usable], deviation[usable]
    problem = Problem.of(unknowns, values.shape[1])
    if values.size < max(10, 2 * (len(problem.unknowns.names) + problem.mix.shape[1])):
        raise ValueError(f"{len(values)} cells with known errors cannot determine a material")
    incoming, outgoing = (directions[usable] for directions in table.nodes())
    model = CellModel(variant, incoming, outgoing, values.shape[1])
    data = Data(values, 1 / deviation, np.zeros(len(values), int))
    fit = search(problem, model, data, unknowns.starts(_STARTS))
    physical = problem.unknowns.unpack(fit.solution.point)
    near = LinearisedModel.about(model, physical.numbers, problem.unknowns.free_numbers)
    found = uncertain_parameters(problem, near, data, fit, noise_given=True)
    value = found.value
    lobe = variant.with_numbers({name: float(number) for name, number in value.numbers.items()})
    brdf = lobe.with_amplitudes(np.asarray(value.kd), np.asarray(value.ks))
    return TableFit(brdf, found, table_error(table, brdf), bool(fit.solution.converged))


def table_error(table: BRDFTable, brdf: BRDF) -> float:
    """Compute sqrt(sum (measured - model)^2 / sum measured^2) over the filled cells."""
    incoming, outgoing = table.nodes()
    values = table.mean[table.filled]
    model = np.asarray(brdf.evaluate(incoming, outgoing)).mean(axis=1)
    return float(np.sqrt(np.sum((values - model) ** 2) / np.sum(values**2)))
