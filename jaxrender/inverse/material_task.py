"""What a fit of a material under known light works on: the question, and what it is asked of."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import Shape
from jaxrender.inverse.elimination import Problem
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.leverage import width_range
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import ExactModel
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.passes import FitSettings, Stop, values_of
from jaxrender.inverse.shadowing import nodes_seen
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.lighting import LightNodes
from jaxrender.reflection import FrameNodes

# Under shadows the environment is condensed to cells this narrow: each is a ray for every sample.
SHADOWED_ANGLE_PER_SIGMA = 1 / 4

# A step of a fit is entered by its name, so that it can be timed and shown.
Stage = Callable[[str], AbstractContextManager]


class MaterialTask(NamedTuple):
    """A material that is sought, and the photographs and the light that it is sought in.

    ``variant`` tells the model, whatever its numbers.  ``shape`` is given where it is concave, and
    asked for shadows.
    """

    problem: Problem
    variant: Parametric
    observations: Observations
    light: KnownLight
    settings: FitSettings
    shape: Shape | None = None
    stage: Stage = lambda name: nullcontext()

    @property
    def unknowns(self) -> Unknowns:
        """Which numbers are free."""
        return self.problem.unknowns

    @property
    def glossy(self) -> Glossy:
        """The model, where it has a frequency view."""
        assert isinstance(self.variant, Glossy)
        return self.variant

    @property
    def widths(self) -> tuple[float, float]:
        """Between which widths the lobe is looked for."""
        return width_range(self.unknowns, self.variant)

    def material(self, stop: Stop) -> Parametric:
        """Put what a pass has found into the model."""
        found = values_of(stop)
        lobe = self.variant.with_numbers({n: float(v) for n, v in found.numbers.items()})
        amounts = found.in_order(lobe.amplitude_names)
        return lobe.with_amplitudes(*(np.asarray(amount) for amount in amounts))

    def integral(
        self, observations: Observations, nodes: tuple[LightNodes | FrameNodes, ...]
    ) -> ExactModel:
        """Make the exact model of some samples; where the shape is concave it traces shadows."""
        seen = nodes_seen(self.shape, observations, nodes)
        return ExactModel(self.variant, observations.samples, nodes, seen)

    def nodes(
        self,
        light: KnownLight,
        observations: Observations,
        width: float,
        cells: float | None = None,
    ) -> tuple[LightNodes | FrameNodes, ...]:
        """List a light's point masses for a lobe of some width, in cells at least under shadows."""
        if self.shape is not None and cells is None:
            cells = SHADOWED_ANGLE_PER_SIGMA
        return exact_nodes(light, observations, width, cells)

    def width(self, stop: Stop) -> float:
        """How fine a light the lobe asks for at which a pass has ended."""
        return float(self.material(stop).width)
