"""What the materials of renderers share: a base, diffuse or metal, under a clear interface.

rho_c = base_color_c f_b(w_i, w_o; numbers) + interface_c f_s(w_i, w_o; numbers)

``base_color`` colours the diffuse base and a metal's reflection alike.  Both are linear in it, so
that a fit solves for it outright.  What is left reflects all colours alike and is as bright as
physics says: ``interface`` is 1, unless a fit is told that the light is not known that well.
"""

import abc
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.parameters import Scalar, refuse_other_channels, refuse_outside
from jaxrender.brdf.parametric import ByOwnNumber, Searched, ShapeParameter
from jaxrender.catalogue import MODELS
from jaxrender.shapes import AnyArray, Float

# Where the roughness r = sqrt(alpha) of an interface is searched for.
ROUGHNESS_BOUNDS, _FIRST_ROUGHNESS = (0.1, 1.0), 0.4
# Shares are searched by the logarithm of how far they lie above here: nearly evenly.
_BELOW_SHARES = -0.5
_INDEX_BOUNDS = (1.1, 3.0)


class Layered(ByOwnNumber):
    """A base colour, an interface, and the numbers of both.

    The numbers of the catalogue's entry ``model`` that say what they are unless stated otherwise
    are not searched for by themselves.
    """

    amplitude_names: ClassVar[tuple[str, ...]] = ("base_color", "interface")
    bases: ClassVar[tuple[str, ...]] = ()
    coloured: ClassVar[tuple[str, ...]] = ("base_color",)
    # The catalogue's name of the model.
    model: eqx.AbstractClassVar[str]
    # The field that holds the share of the base that is metal.
    metalness: ClassVar[str] = "metallic"

    if TYPE_CHECKING:
        base_color: Float[AnyArray, "channel"]
        interface: Float[AnyArray, "channel"]

    def _check_numbers(self) -> None:
        """Refuse numbers outside the catalogue's intervals, and other channels."""
        refuse_other_channels("interface", self.interface, self.base_color.shape[-1])
        for number in MODELS[self.model].numbers:
            value = getattr(self, number.name)
            refuse_outside(number.name, value, number.domain.text, f"it is the {number.meaning}")

    @property
    def metal(self) -> Scalar:
        """The share of the base that is metal."""
        return getattr(self, self.metalness)

    @property
    @abc.abstractmethod
    def head_on(self) -> Scalar:
        """The reflectance of the clear interface at normal incidence."""

    @property
    def settled(self) -> Mapping[str, float]:
        """What the numbers are that nobody states or frees."""
        return MODELS[self.model].settled

    @property
    def closed(self) -> tuple[str, ...]:
        """Shares, and all amplitudes: a channel of a colour may be black."""
        return (*super().closed, *self.amplitude_names)

    @property
    def base_amplitude(self) -> Float[AnyArray, "channel"]:
        """The diffuse part of the base, as a BRDF value."""
        return (1 - jnp.asarray(self.metal)) * jnp.asarray(self.base_color) / np.pi

    @property
    def lobe_amplitude(self) -> Float[AnyArray, "channel"]:
        """What is reflected about the mirror direction at normal incidence."""
        metal = jnp.asarray(self.metal)
        clear = (1 - metal) * jnp.asarray(self.head_on) * jnp.asarray(self.interface)
        return metal * jnp.asarray(self.base_color) + clear

    @property
    def reciprocal(self) -> bool:
        """Always."""
        return True

    @property
    def isotropic(self) -> bool:
        """Unless the model says otherwise."""
        return True

    @property
    def energy(self) -> float:
        """One: amplitudes are albedos."""
        return 1.0


def share(name: str, start: float = 0.3) -> Searched:
    """Make a number between 0 and 1, which are values like all others."""
    return Searched(name, 0.0, 1.0, start, _BELOW_SHARES, closed=True)


def roughness(
    name: str, start: float = _FIRST_ROUGHNESS, lowest: float = ROUGHNESS_BOUNDS[0]
) -> Searched:
    """Make the roughness of an interface."""
    return Searched(name, lowest, ROUGHNESS_BOUNDS[1], start)


def index(name: str, start: float) -> Searched:
    """Make the refractive index of an interface."""
    return Searched(name, *_INDEX_BOUNDS, start, 1.0)


def shape_of(name: str) -> ShapeParameter:
    """Say that a roughness is the root of the width alpha."""
    return ShapeParameter(name, 1.0, 0.5)
