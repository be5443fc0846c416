"""BRDFs whose coefficients a small quadrature rule integrates exactly."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF


class Polynomial(BRDF):
    """One lobe, visible above the horizon."""

    @property
    def amplitudes(self):
        return np.ones((1, 1))

    @property
    def reciprocal(self):
        return True

    @property
    def conserves_energy(self):
        return False

    def lobe(self, incoming, outgoing):
        raise NotImplementedError

    def transfer(self, incoming, outgoing):
        visible = (incoming.z > 0) & (outgoing.z > 0)
        return (jnp.where(visible, self.lobe(incoming, outgoing) * incoming.z, 0),)


class Brushed(Polynomial):
    """rho = (a.i)(a.o) + 1: anisotropic, its axis along neither x nor y."""

    axis: ClassVar = (0.6, 0.5, 0.2)

    @property
    def isotropic(self):
        return False

    def lobe(self, incoming, outgoing):
        a, b, c = self.axis
        toward = a * incoming.x + b * incoming.y + c * incoming.z
        return toward * (a * outgoing.x + b * outgoing.y + c * outgoing.z) + 1


class Sheen(Polynomial):
    """rho = (1 + i.o)^2: isotropic."""

    @property
    def isotropic(self):
        return True

    def lobe(self, incoming, outgoing):
        return (1 + incoming.dot(outgoing)) ** 2
