"""What BRDFs that are known by their values share: a lobe a channel, an albedo that is measured."""

import equinox as eqx
import numpy as np

from jaxrender.brdf.base import BRDF
from jaxrender.brdf.properties import max_albedo
from jaxrender.shapes import AnyArray, Float

# The sum over directions that the albedo is measured by is good to this.
_ALBEDO_ROUNDING = 1e-4


class MeasuredAlbedo(BRDF):
    """A BRDF whose values promise no energy by themselves: the albedo is measured."""

    @property
    def conserves_energy(self) -> bool:
        """When the albedo measured from head-on to grazing is at most 1 (to 1e-4)."""
        return max_albedo(self) <= 1 + _ALBEDO_ROUNDING


class ValuesPerChannel(MeasuredAlbedo):
    """A table of the BRDF itself (1/sr), channels last."""

    values: eqx.AbstractVar[Float[AnyArray, "*table channel"]]

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """One: every channel has a lobe of its own."""
        return np.eye(self.values.shape[-1])
