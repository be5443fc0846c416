"""Numbers that each site has for itself: the width of its lobe, its metalness, and its normal.

The search knows the logarithm of a width, which is sigma or a roughness, and a share of metal as it
is.  Of the normal it knows the tilt: t_x and t_y along two tangents of the site,

    n'  ~  n + t_x e_x + t_y e_y.

A site's tangents belong to its mean normal, so that they are the same for all its observations, but
for what of them lies along an observation's own normal n.
"""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import world_from_local
from jaxrender.inverse.models import Columns, Numbers, Rows
from jaxrender.inverse.texture.forward import ModelOf
from jaxrender.inverse.texture.site_detail import Tiltable, with_normals_of
from jaxrender.inverse.texture.varying import SigmaMap
from jaxrender.inverse.unknowns import Physical, Unknowns
from jaxrender.programs import stored
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int

# What may be a map of facets, beside a coloured K_s, and the numbers that it has at each site.
MAPS: Mapping[str, tuple[str, ...]] = {"sigma": ("sigma",), "normal": ("tilt_x", "tilt_y")}
# The same of glTF's material, and what the catalogue calls it.
METALLIC = "metallic-roughness"
METALLIC_MAPS: Mapping[str, tuple[str, ...]] = {
    "roughness": ("roughness",),
    "metalness": ("metallic",),
}
# K_s of every channel, as a metal has it: an amplitude, which is no number to be searched for.
COLOR = "color"
# A normal is marked where its standard error is larger (radians): two degrees.
_TRUSTED_TILT = np.deg2rad(2.0)


class SiteNumber(NamedTuple):
    """How a number of each site is searched for: by its logarithm, or as it is.

    ``spread`` is what is expected of it before its like are known, and ``least`` the least that is
    learned: sites that show little may be unlike those that show much, however well these agree.
    ``step`` is the largest of the search, which begins at the best of ``trials`` beside what is
    expected, and begins ``again`` where a site is not yet explained.  ``of_shape`` says that the
    mean over the sites is that of the shape, which is zero.
    """

    logarithmic: bool
    spread: float
    least: float
    step: float
    trials: tuple[float, ...] = (0.0,)
    again: tuple[float, ...] = ()
    of_shape: bool = False


def _width(power: float) -> SiteNumber:
    """Make a width whose logarithm is so many times that of sigma."""
    others = [step * np.log(1.6) for step in range(-3, 4) if step]
    return SiteNumber(
        True,
        0.7 * power,
        0.3 * power,
        0.7 * power,
        tuple(power * other for other in (0.0, *others)),
        tuple(power * np.log(factor) for factor in (0.4, 1.0, 2.5)),
    )


_TILT = SiteNumber(False, 0.15, 0.04, 0.15, of_shape=True)
NUMBERS: Mapping[str, SiteNumber] = {
    "sigma": _width(1.0),
    "roughness": _width(0.5),
    # From wherever most sites are both ends are tried: what is not painted is one of them.
    "metallic": SiteNumber(False, 0.5, 0.2, 0.5, (0.0, -1.0, 1.0), (-1.0, 1.0)),
    "tilt_x": _TILT,
    "tilt_y": _TILT,
}


class TiltedModel(eqx.Module):
    """A model whose normals are tilted along two tangents of each sample.

    The numbers ``tilt_x`` and ``tilt_y`` join those of the lobe.  All columns change with them.
    """

    model: Tiltable
    axes: Float[AnyArray, "sample 2 3"]

    def columns(self, numbers: Numbers) -> Columns:
        """Evaluate the columns where normals are tilted so."""
        rest = dict(numbers)
        tilt = jnp.stack([rest.pop("tilt_x"), rest.pop("tilt_y")], axis=-1)
        samples = self.model.samples
        offset = jnp.einsum("sk,ski->si", tilt, jnp.asarray(self.axes))
        tilted = with_normals_of(self.model, _tilted(jnp.asarray(samples.normals), offset))
        columns = tilted.columns(rest)
        return Columns(*columns, shaped=tuple(range(len(columns))))

    def take(self, index: Rows) -> "TiltedModel":
        """Keep the samples of the given indices."""
        return TiltedModel(self.model.take(index), np.asarray(self.axes)[index])


class NumberMap(NamedTuple):
    """A number of every site with its standard error; NaN and infinite where nothing is known."""

    value: Float[np.ndarray, "site"]
    error: Float[np.ndarray, "site"]


class OwnSigma(eqx.Module):
    """The unknowns of samples whose sigma is that of their site: nothing is left to find of it."""

    one: Unknowns
    sigma: Float[AnyArray, "sample"]

    @property
    def names(self) -> tuple[str, ...]:
        """The unknowns of one lobe for all: of sigma, what is typical."""
        return self.one.names

    @eqx.filter_jit
    def unpack(self, point: Float[Array, "unknown"]) -> Physical:
        """Turn a search vector into numbers in their own units, with a sigma for each sample."""
        others = self.one.unpack(point)
        return Physical({**others.numbers, "sigma": jnp.asarray(self.sigma)}, others.gains)


class NormalMap(NamedTuple):
    """What to add to the shape's normals at every site before they are made unit; and how sure.

    ``normal`` is what becomes of the mean normal of what was seen of the site, NaN where that was
    nothing.  ``error`` is the standard error of the tilt along either tangent, in radians; infinite
    there.
    """

    offset: Float[np.ndarray, "site 3"]
    normal: Float[np.ndarray, "site 3"]
    error: Float[np.ndarray, "site"]

    def tilted(
        self, normals: Float[AnyArray, "pixel 3"], site: Int[np.ndarray, "pixel"]
    ) -> Float[np.ndarray, "pixel 3"]:
        """Tilt the normals of pixels that show the given sites; those of -1 stay."""
        offset = np.where((site >= 0)[:, None], self.offset[site], 0)
        return np.asarray(_tilted(jnp.asarray(normals), jnp.asarray(offset)))

    @property
    def marked(self) -> Bool[np.ndarray, "site"]:
        """Say where the normal is not to be trusted."""
        return ~(self.error <= _TRUSTED_TILT)


class SiteNumbers(NamedTuple):
    """What was found at every site, with its covariance; NaN and infinite where nothing was.

    ``names`` are those of ``NUMBERS``; in place of a width ``value`` has its logarithm.
    ``inflation`` is by how much larger the errors of K_d and K_s are for all this being unknown,
    ``wider`` by how much their means over the channels err more than noise makes them.
    """

    names: tuple[str, ...]
    value: Float[np.ndarray, "site number"]
    covariance: Float[np.ndarray, "site number number"]
    inflation: Float[np.ndarray, "site amplitude"]
    axes: Float[np.ndarray, "site 2 3"]
    wider: Float[np.ndarray, "site 2"]

    def number(self, name: str) -> NumberMap | None:
        """Pick one number in its own units, where sites have it."""
        if name not in self.names:
            return None
        at = self.names.index(name)
        value, error = self.value[:, at], np.sqrt(self.covariance[:, at, at])
        if NUMBERS[name].logarithmic:
            value = np.exp(value)
            error = value * error
        return NumberMap(value, np.where(np.isfinite(value), error, np.inf))

    @property
    def sigma(self) -> SigmaMap | None:
        """sigma at every site with its standard error."""
        found = self.number("sigma")
        return None if found is None else SigmaMap(*found)

    @property
    def normals(self) -> NormalMap | None:
        """The normal of every site with its standard error."""
        if "tilt_x" not in self.names:
            return None
        at = [self.names.index(name) for name in MAPS["normal"]]
        offset = np.einsum("sk,ski->si", np.nan_to_num(self.value[:, at]), self.axes)
        # The tangents and the mean normal are a right-handed frame.
        mean = np.cross(self.axes[:, 0], self.axes[:, 1])
        normal = (mean + offset) / np.linalg.norm(mean + offset, axis=1, keepdims=True)
        variance = self.covariance[:, at, at].mean(axis=1)
        seen = np.isfinite(variance)
        normal = np.where(seen[:, None], normal, np.nan)
        return NormalMap(offset, normal, np.sqrt(variance))


def tangents_of(
    normals: Float[np.ndarray, "sample 3"], site: Int[np.ndarray, "sample"], count: int
) -> Float[np.ndarray, "site 2 3"]:
    """Choose two tangents of every site, by the mean normal of its observations."""
    sums = np.stack(
        [np.bincount(site, normals[:, axis], minlength=count) for axis in range(3)], axis=-1
    )
    unseen = ~np.any(sums, axis=1)
    sums[unseen] = [0.0, 0.0, 1.0]
    return np.asarray(_tangents(jnp.asarray(sums)))


@stored(jax.jit, effort="least")
def _tangents(normals: Float[Array, "site 3"]) -> Float[Array, "site 2 3"]:
    """Choose two tangents, of normals of any length."""
    return jnp.swapaxes(world_from_local(_unit(normals))[:, :, :2], 1, 2)


def with_normals(
    model_of: ModelOf, normals: NormalMap, site: Int[np.ndarray, "observation"]
) -> ModelOf:
    """Tilt the normals of models of observations that show the given sites."""

    def tilted(index: Int[np.ndarray, "kept"]) -> Tiltable:
        model = model_of(index)
        assert isinstance(model, Tiltable)
        return with_normals_of(model, normals.tilted(model.samples.normals, site[index]))

    return tilted


def _tilted(
    normals: Float[Array, "sample 3"], offset: Float[Array, "sample 3"]
) -> Float[Array, "sample 3"]:
    along = jnp.sum(normals * offset, axis=1, keepdims=True)
    return _unit((1 - along) * normals + offset)


def _unit(vectors: Float[Array, "*any 3"]) -> Float[Array, "*any 3"]:
    return vectors / jnp.linalg.norm(vectors, axis=-1, keepdims=True)
