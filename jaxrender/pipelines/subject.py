"""What a finished result can be rendered as: one material, or what a task has of its own."""

import abc

import numpy as np

from jaxrender.brdf import BRDF, Parametric
from jaxrender.geometry import SurfaceView
from jaxrender.reflection import ForwardModel, ShadowedModel, render_view, sensitivities
from jaxrender.shapes import Float


class Subject(abc.ABC):
    """A surface that can be rendered.

    ``lobe`` is the material for which a light is prepared; None where there is no lobe.  ``width``
    is the width of the finest detail, in radians.
    """

    lobe: Parametric | None
    width: float

    @abc.abstractmethod
    def image(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "row column channel"]:
        """Render a view; zero where nothing is hit."""

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """Name the amplitudes of the lobe."""
        return () if self.lobe is None else self.lobe.amplitude_names

    @property
    def numbers(self) -> tuple[str, ...]:
        """Name the numbers of the lobe."""
        return () if self.lobe is None else tuple(self.lobe.numbers)

    def slopes(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "pixel number channel"] | None:
        """Differentiate by amplitudes and numbers; None where it has none of these."""
        return None


class UniformSubject(Subject):
    """One material everywhere."""

    def __init__(self, lobe: Parametric):
        self.lobe, self.width = lobe, float(lobe.width)

    def image(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "row column channel"]:
        """Render a view."""
        assert self.lobe is not None
        return np.asarray(render_view(self.lobe, view, model))

    def slopes(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "pixel number channel"]:
        """Differentiate by amplitudes and numbers."""
        assert self.lobe is not None
        return np.asarray(sensitivities(self.lobe, view, model))


class CorrectedSubject(Subject):
    """A material whose values a table corrects: the integral alone renders it."""

    def __init__(self, brdf: BRDF, width: float):
        self.brdf, self.lobe, self.width = brdf, None, width

    def image(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "row column channel"]:
        """Render a view."""
        return np.asarray(render_view(self.brdf, view, model))
