"""The adaptive parameterisation of measured BRDFs (Dupuy and Jakob, 2018), isotropic or not.

For every incoming direction i of the measurement the half vector m is mapped to the unit square by

    u = (sqrt(2 t_m / pi), (p_m + pi) / 2 pi mod 1),    p_m relative to p_i if isotropic,

and on by the map that makes the density V(u; i) of visible normals uniform.  There the samples S
lie, evenly.  With D(u) the density of normals, s(u_i) the projected area seen from i,

    f cos t_o = S(flatten(u; i); i) D(u) / (4 s(u_i)),

the last factor only where ``scaled`` says that the samples were divided by it.  All tables are
interpolated linearly, also between incoming directions; beyond the measured ones they are held.
A table over less than a full turn of p_i stands for a surface with that symmetry: over pi, to
turning by pi; over pi / 2, to mirroring in x and in y.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf.half_vector import are_visible, half_vector, lifted
from jaxrender.brdf.measured import MeasuredAlbedo
from jaxrender.brdf.tables.bilinear_warp import BilinearWarp, Blend, Place, blended, interpolated
from jaxrender.geometry import Components
from jaxrender.shapes import AnyArray, Array, Float

_ISOTROPIC_AZIMUTHS = 2


class RglTables(NamedTuple):
    """What is measured, with the azimuths and polar angles of the incoming direction in radians."""

    phi_i: Float[np.ndarray, "phi"]
    theta_i: Float[np.ndarray, "theta"]
    ndf: Float[np.ndarray, "_ _"]
    sigma: Float[np.ndarray, "_ _"]
    vndf: Float[np.ndarray, "phi theta _ _"]
    samples: Float[np.ndarray, "phi theta channel row column"]


class RglBRDF(MeasuredAlbedo):
    """A measured material; make one with ``of``."""

    phi_i: Float[AnyArray, "phi"]
    theta_i: Float[AnyArray, "theta"]
    ndf: Float[AnyArray, "1 _ _"]
    sigma: Float[AnyArray, "1 _ _"]
    visible_normals: BilinearWarp
    samples: Float[AnyArray, "channel table row column"]
    scaled: bool = eqx.field(static=True)
    reduction: int = eqx.field(static=True)

    @classmethod
    def of(cls, tables: RglTables, scaled: bool = True) -> "RglBRDF":
        """Put tables together; samples that are negative become 0.

        Raises ``ValueError`` for angles that do not ascend, tables with fewer than 2 x 2 nodes,
        values that are not finite, areas that are not positive, and densities as ``BilinearWarp``.
        """
        for name, angles in (("phi_i", tables.phi_i), ("theta_i", tables.theta_i)):
            if not len(angles) or np.any(np.diff(angles) <= 0):
                raise ValueError(f"{name}={angles}: angles must ascend")
        for name in ("ndf", "sigma", "samples"):
            values = getattr(tables, name)
            if not np.isfinite(values).all() or min(values.shape[-2:]) < 2:
                raise ValueError(f"{name} {values.shape}: give 2 x 2 finite values at least")
        if np.any(tables.sigma <= 0):
            raise ValueError(f"sigma is {tables.sigma.min():.6g} somewhere: areas are positive")
        count = len(tables.phi_i) * len(tables.theta_i)
        vndf = tables.vndf.reshape(count, *tables.vndf.shape[2:])
        samples = np.moveaxis(np.maximum(tables.samples, 0), 2, 0)
        turn = 2 * np.pi
        if len(tables.phi_i) > _ISOTROPIC_AZIMUTHS:
            turn = float(tables.phi_i[-1] - tables.phi_i[0])
        return cls(
            tables.phi_i,
            tables.theta_i,
            tables.ndf[None],
            tables.sigma[None],
            BilinearWarp.of(vndf),
            samples.reshape(len(samples), count, *samples.shape[3:]),
            scaled,
            round(2 * np.pi / turn),
        )

    @property
    def amplitudes(self) -> Float[AnyArray, "lobe channel"]:
        """One: every channel has a lobe of its own."""
        return np.eye(self.samples.shape[0])

    @property
    def reciprocal(self) -> bool:
        """No promise: incoming and outgoing directions were sampled differently."""
        return False

    @property
    def isotropic(self) -> bool:
        """When it was measured at one azimuth (or two: from and to)."""
        return self.phi_i.shape[0] <= _ISOTROPIC_AZIMUTHS

    def transfer(
        self, incoming: Components, outgoing: Components
    ) -> tuple[Float[Array, "*batch"], ...]:
        """Interpolate each channel times cos t_i."""
        visible = are_visible(incoming, outgoing)
        incoming, outgoing = self._folded(lifted(incoming), lifted(outgoing))
        theta_i, phi_i = _angles(incoming)
        theta_m, phi_m = _angles(half_vector(incoming, outgoing).direction)
        around = phi_m
        if self.isotropic:
            # The tables are those of one azimuth; only the difference of the two is free.
            around = phi_m - phi_i
            phi_i = jnp.full_like(phi_i, self.phi_i[0])
        u_m = Place(_across(theta_m), _around(around))
        blends = blended((phi_i, theta_i), (self.phi_i, self.theta_i))
        flat = self.visible_normals.flatten(u_m, blends)
        factor = incoming.z / outgoing.z
        if self.scaled:
            alone = (Blend(jnp.zeros(theta_i.shape, np.int32), jnp.ones_like(theta_i)),)
            area = interpolated(self.sigma, Place(_across(theta_i), _around(phi_i)), alone)
            factor = factor * interpolated(self.ndf, u_m, alone) / (4 * area)
        return tuple(
            jnp.where(visible, factor * interpolated(channel, flat, blends), 0)
            for channel in self.samples
        )

    def _folded(self, incoming: Components, outgoing: Components) -> tuple[Components, Components]:
        """Move a pair to the azimuths that were measured, the incoming one to x, y <= 0."""
        if self.reduction < 2:
            return incoming, outgoing
        y = jnp.where(incoming.y >= 0, -1, 1).astype(incoming.z.dtype)
        x = jnp.where(incoming.x >= 0, -1, 1).astype(y.dtype) if self.reduction == 4 else y
        return (
            Components(incoming.x * x, incoming.y * y, incoming.z),
            Components(outgoing.x * x, outgoing.y * y, outgoing.z),
        )


def _angles(direction: Components) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Polar angle and azimuth in [-pi, pi], 0 at the normal and without derivatives there."""
    x, y, z = (jnp.asarray(part) for part in direction)
    square = x * x + y * y
    at_pole = square == 0
    across = jnp.sqrt(jnp.where(at_pole, 1, square))
    polar = jnp.where(at_pole, 0, jnp.arctan2(across, z))
    return polar, jnp.where(at_pole, 0, jnp.arctan2(y, jnp.where(at_pole, 1, x)))


def _across(theta: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    positive = theta > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, theta, 1) * (2 / np.pi)), 0)


def _around(phi: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    turn = (phi + np.pi) / (2 * np.pi)
    return turn - jnp.floor(turn)
