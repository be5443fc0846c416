"""How the material varies within each site, as its neighbours tell.

A texel that holds many pixels is not of one colour, roughness and normal: these go on from texel to
texel.  Taken for one of each, a site leaves several times the noise.  What sites near each other
share (:mod:`.site_fields`) says how each pixel differs from the mean of its site.  That is given to
the model, and the site's own numbers are those of the mean.
"""

from typing import NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import SurfaceSamples
from jaxrender.inverse.models import Columns, DualModel, ExactModel, Model, Numbers, Rows
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.shapes import AnyArray, Bool, Float, Int


class Detail(NamedTuple):
    """How each observation differs from its site.

    ``kd`` and ``ks`` are factors, ``log_sigma`` is added to the logarithm of sigma (None where that
    is one for all), and ``offset`` to the normal before it is made unit.
    """

    kd: Float[np.ndarray, "observation channel"]
    ks: Float[np.ndarray, "observation *channel"]
    log_sigma: Float[np.ndarray, "observation"] | None
    offset: Float[np.ndarray, "observation 3"]

    def applied(self, model_of: ModelOf) -> ModelOf:
        """Let models of observations vary so."""

        def detailed(index: Int[np.ndarray, "kept"]) -> DetailedModel:
            model = model_of(index)
            assert isinstance(model, DualModel | ExactModel)
            normals = _unit(np.asarray(model.samples.normals) + self.offset[index])
            log_sigma = None if self.log_sigma is None else self.log_sigma[index]
            kd = self.kd[index]
            ks = self.ks[index].reshape(len(index), -1) * np.ones(kd.shape[1])
            return DetailedModel(with_normals_of(model, normals), kd, ks, log_sigma)

        return detailed

    def tilted(self, observations: Observations) -> Observations:
        """Tilt the normals of all observations so."""
        samples = observations.samples
        normals = _unit(np.asarray(samples.normals, float) + self.offset)
        return observations._replace(
            samples=SurfaceSamples(normals, np.asarray(samples.outgoing, float))
        )

    def only(self, chosen: Bool[np.ndarray, "observation"]) -> "Detail":
        """Let nothing vary but chosen observations."""
        one, along = chosen[:, None], chosen if self.ks.ndim == 1 else chosen[:, None]
        return Detail(
            np.where(one, self.kd, 1.0),
            np.where(along, self.ks, 1.0),
            None if self.log_sigma is None else np.where(chosen, self.log_sigma, 0.0),
            np.where(one, self.offset, 0.0),
        )

    @classmethod
    def none(cls, count: int, channels: int, coloured: bool, sigma: bool) -> "Detail":
        """Let nothing vary."""
        ks = np.ones((count, channels) if coloured else count)
        logs = np.zeros(count) if sigma else None
        return cls(np.ones((count, channels)), ks, logs, np.zeros((count, 3)))


class DetailedModel(eqx.Module):
    """A model whose amplitudes and sigma differ from sample to sample by what is known of them."""

    model: DualModel | ExactModel
    kd: Float[AnyArray, "sample channel"]
    ks: Float[AnyArray, "sample channel"]
    log_sigma: Float[AnyArray, "sample"] | None

    @property
    def samples(self) -> SurfaceSamples:
        """What the samples are seen as."""
        return self.model.samples

    def columns(self, numbers: Numbers) -> Columns:
        """Evaluate the columns; ``numbers`` are those of the sites."""
        if self.log_sigma is not None:
            numbers = {**numbers, "sigma": numbers["sigma"] * jnp.exp(jnp.asarray(self.log_sigma))}
        found = self.model.columns(numbers)
        parts = found.diffuse * jnp.asarray(self.kd), found.specular * jnp.asarray(self.ks)
        return Columns(*parts, shaped=found.shaped)

    def take(self, index: Rows) -> "DetailedModel":
        """Keep the samples of the given indices."""
        kd, ks = (np.asarray(part)[index] for part in (self.kd, self.ks))
        logs = None if self.log_sigma is None else np.asarray(self.log_sigma)[index]
        return DetailedModel(self.model.take(index), kd, ks, logs)


# Models of samples whose normals can be others.
Tiltable = DualModel | ExactModel | DetailedModel


_Tiltable = TypeVar("_Tiltable", bound=Tiltable)


def with_normals_of(model: _Tiltable, normals: Float[AnyArray, "sample 3"]) -> _Tiltable:
    """Give a model other normals."""
    samples = SurfaceSamples(normals, model.samples.outgoing)
    return eqx.tree_at(_samples_of, model, samples)


def without_detail(model: Model) -> Model:
    """Return what a detailed model is made of; any other is itself."""
    return model.model if isinstance(model, DetailedModel) else model


def _samples_of(model: Tiltable) -> SurfaceSamples:
    return model.model.samples if isinstance(model, DetailedModel) else model.samples


def _unit(vectors: Float[np.ndarray, "any 3"]) -> Float[np.ndarray, "any 3"]:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
