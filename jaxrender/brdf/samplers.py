"""Drawing the direction that a path goes on in, so that strong reflection is looked at often.

A sampler is asked with local directions, +Z the normal, and speaks of densities per unit of *solid
angle*.  A density q over the Nusselt square (L 8.6) is q cos t / 4 of those: cos t dw is
4 dkappa dlambda, and the weight of a path becomes f cos t / p = 4 f / q (L 8.4 lacks the 4,
ERRATA 74).  With q = f / rho of L 8.6 it is 4 rho (ERRATA 75).
"""

import abc

import numpy as np

from jaxrender.shapes import Float, checked


class DirectionSampler(abc.ABC):
    """Draws incoming directions for given outgoing ones."""

    @abc.abstractmethod
    def draw(
        self, outgoing: Float[np.ndarray, "ray 3"], uniforms: Float[np.ndarray, "ray 2"]
    ) -> Float[np.ndarray, "ray 3"]:
        """Map uniform numbers in [0, 1) to unit directions above the horizon."""

    @abc.abstractmethod
    def density(
        self, outgoing: Float[np.ndarray, "ray 3"], incoming: Float[np.ndarray, "ray 3"]
    ) -> Float[np.ndarray, "ray"]:
        """Evaluate the density that ``draw`` has there, per steradian; zero below the horizon.

        It has to be positive wherever the BRDF is, or what is missed there is missed for good.
        """


class CosineSampler(DirectionSampler):
    """Uniform on the Nusselt disc whatever the BRDF: density cos t / pi."""

    @checked
    def draw(
        self, outgoing: Float[np.ndarray, "ray 3"], uniforms: Float[np.ndarray, "ray 2"]
    ) -> Float[np.ndarray, "ray 3"]:
        """Lift points of the disc, uniform by area, to the hemisphere."""
        radius, azimuth = np.sqrt(uniforms[:, 0]), 2 * np.pi * uniforms[:, 1]
        height = np.sqrt(1 - uniforms[:, 0])
        return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=-1)

    @checked
    def density(
        self, outgoing: Float[np.ndarray, "ray 3"], incoming: Float[np.ndarray, "ray 3"]
    ) -> Float[np.ndarray, "ray"]:
        """cos t / pi."""
        return np.maximum(incoming[:, 2], 0) / np.pi


COSINE = CosineSampler()
