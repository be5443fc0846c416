"""How far an exported material is from the recovered one: in itself, and in a picture."""

from typing import NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.geometry import Pinhole, Sphere, look_at
from jaxrender.io.exports import Contents
from jaxrender.lighting import Environment, Light, to_latlong
from jaxrender.reflection import render_lit
from jaxrender.shapes import Float

# Incoming angles, and half vectors for each.
_ANGLES, _POLAR, _AROUND = 10, 40, 12
# Azimuths at which anisotropic ones are compared, too.
_TURNS = 6
# Pixels a side of the picture, and the most rows of its environment.
_PICTURE, _ROWS = 24, 32
_evaluate = eqx.filter_jit(BRDF.evaluate)


class Pairs(NamedTuple):
    """Pairs of directions with weights, for int int g (cos t_i cos t_o)^2 dw_i dw_o.

    With one cosine each, models without masking would be compared at grazing alone.
    """

    incoming: Float[np.ndarray, "pair 3"]
    outgoing: Float[np.ndarray, "pair 3"]
    weights: Float[np.ndarray, "pair"]

    def values(self, brdf: BRDF) -> Float[np.ndarray, "pair channel"]:
        """Evaluate a BRDF in 1/sr."""
        return np.asarray(_evaluate(brdf, self.incoming, self.outgoing), float)

    def roots(self, brdf: BRDF) -> Float[np.ndarray, "pair channel"]:
        """Evaluate square roots of rho cos t_i cos t_o, times the roots of the weights."""
        cosines = (self.incoming[:, 2] * self.outgoing[:, 2])[:, None]
        seen = np.sqrt(np.maximum(self.values(brdf), 0) * cosines)
        return np.sqrt(self.weights)[:, None] * seen


class Difference(NamedTuple):
    """Two materials apart: rms over the first's own, and how far their pictures are.

    ``picture`` is the mean absolute difference over the mean, ``median`` that of pixels over their
    own values; None where there is no light.
    """

    relative_rms: float
    picture: float | None = None
    median: float | None = None

    @property
    def sentence(self) -> str:
        """Say how far they are apart."""
        said = f"{100 * self.relative_rms:.2g} % rms in the BRDF"
        if self.picture is None or self.median is None:
            return said
        return (
            f"{said}, {100 * self.picture:.2g} % in a picture of a ball in the result's light "
            f"(median of its pixels {100 * self.median:.2g} %)"
        )


def turned_pairs() -> Pairs:
    """The same for surfaces that change as they turn: about each of several azimuths."""
    pairs, found = dense_pairs(), []
    for angle in np.arange(_TURNS) * np.pi / _TURNS:
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        found.append(Pairs(pairs.incoming @ turn, pairs.outgoing @ turn, pairs.weights / _TURNS))
    return Pairs(*(np.concatenate(parts) for parts in zip(*found)))


def dense_pairs() -> Pairs:
    """List pairs that are dense about the mirror direction, however narrow the highlight."""
    cosines = (np.arange(_ANGLES) + 0.5) / _ANGLES
    across = (np.arange(_POLAR) + 0.5) / _POLAR
    azimuth = (np.arange(_AROUND) + 0.5) * (2 * np.pi / _AROUND)
    cosine, u, phi = (a.ravel() for a in np.meshgrid(cosines, across, azimuth, indexing="ij"))
    polar, sine = np.pi / 2 * u**2, np.sqrt(1 - cosine**2)
    incoming = np.stack([sine, 0 * sine, cosine], axis=-1)
    half = np.stack(
        [np.sin(polar) * np.cos(phi), np.sin(polar) * np.sin(phi), np.cos(polar)], axis=-1
    )
    facing = np.sum(incoming * half, axis=-1)
    outgoing = 2 * facing[:, None] * half - incoming
    # dw_o = 4 (i . h) dw_h, dw_h = sin t pi u du dp; dw_i = 2 pi dcos.
    weights = 4 * facing * np.sin(polar) * u * (cosine * outgoing[:, 2]) ** 2
    seen = (facing > 0) & (outgoing[:, 2] > 0)
    return Pairs(incoming[seen], outgoing[seen], weights[seen])


def difference(material: BRDF, exported: BRDF, contents: Contents) -> Difference:
    """Compare two materials, in a picture too where the contents have a light."""
    is_even = material.isotropic and exported.isotropic
    pairs = dense_pairs() if is_even else turned_pairs()
    own, other = pairs.values(material), pairs.values(exported)
    weights = pairs.weights[:, None]
    rms = float(np.sqrt(np.sum(weights * (own - other) ** 2) / np.sum(weights * own**2)))
    light = light_of_contents(contents)
    if light is None:
        return Difference(rms)
    pose = look_at(np.array([0.0, -4.0, 1.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    camera = Pinhole(_PICTURE, _PICTURE, pose, fl_x=1.8 * _PICTURE)
    pictures = [
        np.asarray(render_lit(one, light, Sphere(), camera)) for one in (material, exported)
    ]
    own, apart = pictures[0], np.abs(pictures[1] - pictures[0])
    lit = own > 0
    if not lit.any():
        return Difference(rms)
    return Difference(rms, float(apart.sum() / own.sum()), float(np.median(apart[lit] / own[lit])))


def light_of_contents(contents: Contents) -> Light | None:
    """Put sources and a coarse environment together; None where all is dark."""
    if not contents.is_lit:
        return None
    if contents.environment is None:
        return contents.all_distant
    radiance = np.asarray(contents.environment.radiance)
    if len(radiance) > _ROWS:
        radiance = to_latlong(radiance, "z-up", _ROWS)
    return Environment(radiance) + contents.all_distant
