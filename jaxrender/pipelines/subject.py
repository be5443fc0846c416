"""What a finished result can be rendered as: one material, or what a task has of its own."""

import abc

import numpy as np

from jaxrender.brdf import CorrectedBRDF, Parametric
from jaxrender.geometry import SurfacePlaces, SurfaceView, visible
from jaxrender.inverse.brdf_table import predict_corrected
from jaxrender.inverse.models import ExactModel
from jaxrender.inverse.photographs import camera_samples
from jaxrender.reflection import (
    ExactForward,
    ForwardModel,
    ShadowedForward,
    ShadowedModel,
    render_view,
    sensitivities,
)
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

    def deviation(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "pixel channel"] | None:
        """Predict each pixel's standard deviation; None where it follows from the slopes."""
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
    """A material whose values a table corrects, with the covariance of the table's functions.

    The integral alone renders it.
    """

    def __init__(
        self,
        brdf: CorrectedBRDF,
        covariance: Float[np.ndarray, "channel function function"],
        width: float,
    ):
        self.brdf, self.covariance = brdf, covariance
        self.lobe, self.width = None, width

    def image(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "row column channel"]:
        """Render a view."""
        return np.asarray(render_view(self.brdf, view, model))

    def deviation(
        self, view: SurfaceView, model: ForwardModel | ShadowedModel
    ) -> Float[np.ndarray, "pixel channel"]:
        """Predict the standard deviation that the table gives each pixel."""
        assert isinstance(model, ExactForward | ShadowedForward)
        assert isinstance(self.brdf.model, Parametric)
        seen = None
        if isinstance(model, ShadowedForward):
            places = SurfacePlaces.of_views([view])
            seen = (np.asarray(visible(model.shape, places, model.nodes.directions)),)
        exact = ExactModel(self.brdf.model, camera_samples(view), (model.nodes,), seen)
        return predict_corrected(self.brdf, self.covariance, exact).deviation
