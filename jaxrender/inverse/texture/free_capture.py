"""A capture of a painted object under known light of which something is free, and its paint.

It is looked at through some pixels: one of each photograph for each of some sites.  Each of them
keeps its site here; where it is moved, it shows what lies beside (``paint_slopes``).
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.imaging import NoiseModel
from jaxrender.inverse.calibration import Columns, Pull, Weighing
from jaxrender.inverse.calibration.search import Capture, Corrected
from jaxrender.inverse.diagnosis.grounds import Grounds
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import DiffuseModel, ExactModel, LinearisedModel, Model
from jaxrender.inverse.nuisances import Corrections, Told
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import concave, nodes_seen
from jaxrender.inverse.texture.examination import Painted, Tested
from jaxrender.inverse.texture.measurements import SiteData
from jaxrender.inverse.texture.search import LobeFit, TextureProblem, refine, search
from jaxrender.shapes import AnyArray, Float

# Nuisances that move what pixels see, and those that a texture does not free: its sites are found
# under distant light, from sharp pixels.
MOVING, NEVER = {"camera", "object", "scale"}, ("nearness", "blur")
# The light is condensed to cells of so many widths of the lobe.
_CELLS = 0.35


@dataclasses.dataclass(frozen=True)
class Repainted(Corrected):
    """Corrections, and the paint and the lobe that fit best with them.

    ``beside`` is what pixels send because they show what lies beside their sites.
    """

    corrections: Corrections
    light: KnownLight
    observations: Observations
    model: Model
    data: SiteData
    fit: LobeFit
    beside: Float[np.ndarray, "sample channel"] | None
    cost: float

    @property
    def predicted(self) -> Float[np.ndarray, "sample channel"]:
        """What the pixels should be."""
        predicted = np.asarray(self.fit.predicted)
        return predicted if self.beside is None else predicted + self.beside

    @property
    def weights(self) -> Float[np.ndarray, "sample channel"]:
        """What their residuals are multiplied by."""
        return np.asarray(self.data.weights)


@dataclasses.dataclass(frozen=True)
class FreePaint(Capture[Repainted]):
    """Some pixels of a painted object, as they were told, and what is free of the capture.

    ``some`` are these pixels with the sites that they show; ``weights`` are those of the values
    that were told; ``width`` is that of the lobe.
    """

    painted: Painted
    some: Tested
    problem: TextureProblem
    told: Told
    free: tuple[str, ...]
    weighing: Weighing
    weights: Float[np.ndarray, "sample channel"]
    width: float

    def corrected(self, corrections: Corrections, before: Repainted) -> Repainted:
        """Fit paint and lobe to pixels as they are corrected, under corrected light."""
        return self.fitted(corrections, before.fit.point)

    def fitted(self, corrections: Corrections, start: Float[AnyArray, "unknown"]) -> Repainted:
        """Fit both from a start of the lobe."""
        observed, light = corrections.observations(self.told), corrections.light(self.told)
        nodes = exact_nodes(light, observed, self.width, _CELLS)
        seen = nodes_seen(concave(self.told.shape), observed, nodes)
        model: Model = ExactModel(self.painted.variant, observed.samples, nodes, seen)
        if isinstance(self.some.model, DiffuseModel):
            model = DiffuseModel(model)
        # Values that are stretched have more noise.
        weights = self.weights / corrections.slopes(self.told)
        radiance = np.asarray(observed.radiance, float)
        data = SiteData(radiance, weights, self.some.number, len(self.some.sites))
        numbers = self.problem.unknowns.unpack(jnp.asarray(start)).numbers
        near = LinearisedModel.about(model, numbers)
        beside = None
        if self.some.slopes is not None and MOVING & {*self.free}:
            assert observed.places is not None
            points = np.asarray(observed.places.points)
            beside = self.some.slopes.beside(near.at, self.some.number, points)
            data = eqx.tree_at(lambda data: data.radiance, data, radiance - beside)
        begun = search(self.problem, near, data, np.asarray(start)[None])
        fit = refine(self.problem, model, data, begun)
        cost = 2 * self.weighing.strength * float(fit.cost)
        pull = Pull.of(corrections, *self.free).cost
        return Repainted(corrections, light, observed, model, data, fit, beside, cost + pull)

    def columns(self, state: Repainted) -> Columns:
        """Differentiate by paint and lobe, and by all that is free."""
        material, some = state.fit.material, self.some
        now = some._replace(
            observations=state.observations,
            model=state.model,
            point=state.fit.point,
            kd=np.asarray(material.kd),
            ks=np.asarray(material.ks),
            beside=state.beside,
        )
        painted = self.painted._replace(light=state.light, told=self.told.observations)
        noise = self.weighing.noise
        return columns_of(painted, now, state.corrections, self.free, noise, state.weights)

    def softened(self, state: Repainted) -> "FreePaint":
        """Nothing is blurred."""
        return self


def columns_of(
    painted: Painted,
    some: Tested,
    corrections: Corrections,
    free: tuple[str, ...],
    noise: NoiseModel,
    weights: Float[np.ndarray, "sample channel"] | None = None,
) -> Columns:
    """Differentiate some pixels by paint and lobe, and by all that is free.

    ``weights`` are those of the noise if not given.
    """
    suspect, every = some.suspect(painted, noise, weights), np.arange(len(some.number))
    return Columns.of(Grounds.of(suspect, every), suspect.derivatives(every), corrections, free)
