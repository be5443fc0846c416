"""What glTF's material reflects of a known light, tabulated over the roughness.

Of each observation three integrals tell all: those of (1 - P) / pi, (1 - P) S and P S (see
``brdf/metallic_roughness.py``).  The first knows no roughness, and the others are smooth in its
logarithm: cubic splines through a few values of each.  Base colour, share of metal and index enter
by arithmetic alone, so that a search of every site costs no further integral.

The sharper the lobe, the finer the cells by which the light is summed up.
"""

from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import CubicSpline

from jaxrender.brdf import MetallicRoughness, head_on_reflectance
from jaxrender.brdf.metallic_roughness import mixed
from jaxrender.geometry import Shape
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import Columns, ExactModel, Numbers, Rows
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import nodes_seen
from jaxrender.lighting import LightNodes
from jaxrender.programs import stored
from jaxrender.reflection import FrameNodes
from jaxrender.shapes import AnyArray, Float, Int, in_precision

# Steps of the table in the logarithm of the roughness: a highlight is right to 1e-3 of its peak.
_STEP = 0.15
# Cells are so narrow in widths of the lobe, and no wider than so many radians.
_CELL_PER_WIDTH, _WIDEST_CELL = 1 / 2, 0.1
# Observations at once; and pairs of these with cells of the light, for the sharpest lobe.
_CHUNK, _PAIRS = 2**12, 2**30
# The finest partition has so many rows of cells, of which a sphere has this times their square.
_ROWS, _CELLS_PER_ROW = (64, 128), np.pi / 2
# The sharpest lobe that is looked for is about as wide as the finest cell.
_SHARPEST_WIDTH = 0.8


class MetallicTable(eqx.Module):
    """The three integrals of each observation: one, and the others over log roughness.

    ``values`` and ``slopes`` are those of a spline at its nodes, by steps of the table, of
    (1 - P) S and P S.
    """

    diffuse: Float[AnyArray, "sample channel"]
    values: Float[AnyArray, "sample node part channel"]
    slopes: Float[AnyArray, "sample node part channel"]
    first: float = eqx.field(static=True)
    step: float = eqx.field(static=True)

    def columns(self, numbers: Numbers) -> Columns:
        """Look up what the base colour colours, and what it does not."""
        diffuse = jnp.asarray(self.diffuse)
        count, nodes = self.values.shape[:2]
        logs = jnp.broadcast_to(jnp.log(numbers["roughness"]), (count,))
        place = jnp.clip((logs - self.first) / self.step, 0, nodes - 1)
        low = jnp.clip(jnp.floor(jax.lax.stop_gradient(place)), 0, nodes - 2)
        before, t = low.astype(int), (place - low)[:, None, None]
        rows = jnp.arange(count)
        v0, v1, s0, s1 = (
            jnp.asarray(part)[rows, at]
            for part in (self.values, self.slopes)
            for at in (before, before + 1)
        )
        u = 1 - t
        found = u * u * ((1 + 2 * t) * v0 + t * s0) + t * t * ((1 + 2 * u) * v1 - u * s1)
        metallic = jnp.broadcast_to(numbers["metallic"], (count,))[:, None]
        parts = mixed(metallic, numbers["ior"], diffuse, found[:, 0], found[:, 1])
        return Columns(*parts, shaped=(0, 1))

    def take(self, index: Rows) -> "MetallicTable":
        """Keep the samples of the given indices."""
        diffuse, values, slopes = (
            np.asarray(part)[index] for part in (self.diffuse, self.values, self.slopes)
        )
        return MetallicTable(diffuse, values, slopes, self.first, self.step)


def finest_cell(light: KnownLight, observations: int) -> float:
    """Tell how narrow (radians) the cells are that so many observations can afford.

    0 where all light comes from single directions, which are no cells.
    """
    if not light.images:
        return 0.0
    affordable = np.sqrt(_PAIRS / max(observations, 1) / _CELLS_PER_ROW)
    rows = np.clip(2 ** np.floor(np.log2(affordable)), *_ROWS)
    return float(np.pi / min(rows, max(image.grid.shape[0] for image in light.images)))


def sharpest_told(cell: float) -> float:
    """Tell the roughness of the sharpest lobe that cells of light can tell."""
    return float(np.sqrt(_SHARPEST_WIDTH * cell))


def tabulated(
    variant: MetallicRoughness,
    light: KnownLight,
    observations: Observations,
    span: tuple[float, float],
    finest: float,
    shape: Shape | None = None,
) -> MetallicTable:
    """Integrate for all observations, at roughnesses over a ``span``.

    The light is summed up by cells of half the width of a lobe, and of ``finest`` radians at least.
    A concave ``shape`` casts shadows.
    """
    low, high = np.log(span)
    nodes = max(int(np.ceil((high - low) / _STEP)), 3) + 1
    logs = np.linspace(low, high, nodes)
    channels = np.asarray(observations.radiance).shape[1]
    diffuse = np.zeros((observations.count, channels))
    values = np.zeros((observations.count, nodes, 2, channels))
    index = float(np.asarray(variant.ior))
    for rows, kept, model in _chunks(variant, light, observations, _WIDEST_CELL / 2, shape):
        base, _ = _reflected(model, *map(np.asarray, (1.0, 0.0, index)))
        diffuse[rows] = np.asarray(base)[:kept] / (1 - head_on_reflectance(index))
    for node, rough in enumerate(np.exp(logs)):
        cell = min(max(_CELL_PER_WIDTH * rough**2, finest), _WIDEST_CELL)
        for rows, kept, model in _chunks(variant, light, observations, cell, shape):
            parts = _reflected(model, *map(np.asarray, (float(rough), 1.0, index)))
            for place, part in enumerate(parts):
                values[rows, node, place] = np.asarray(part)[:kept]
    step = (high - low) / (nodes - 1)
    by_node = CubicSpline(np.arange(nodes), np.eye(nodes))(np.arange(nodes), 1)
    slopes = np.einsum("mn,snpc->smpc", by_node, values)
    return MetallicTable(diffuse, values, slopes, float(low), float(step))


def _chunks(
    variant: MetallicRoughness,
    light: KnownLight,
    observations: Observations,
    cell: float,
    shape: Shape | None,
) -> "Iterator[tuple[slice, int, ExactModel]]":
    """Model some observations at a time by the integral; the last are repeated to fill up."""
    every = tuple(_filled(part) for part in exact_nodes(light, observations, cell, 1.0))
    for first in range(0, observations.count, _CHUNK):
        kept = min(_CHUNK, observations.count - first)
        length = _CHUNK if observations.count > _CHUNK else _power_of_two(kept)
        index = np.minimum(np.arange(first, first + length), observations.count - 1)
        own = observations.take(index)
        nodes = tuple(_of_rows(part, index) for part in every)
        seen = nodes_seen(shape, own, nodes)
        yield slice(first, first + kept), kept, ExactModel(variant, own.samples, nodes, seen)


def _of_rows(
    part: LightNodes | FrameNodes, index: Int[np.ndarray, "row"]
) -> LightNodes | FrameNodes:
    if not isinstance(part, FrameNodes):
        return part
    return part._replace(frame_of_sample=np.asarray(part.frame_of_sample)[index])


def _filled(part: LightNodes | FrameNodes) -> LightNodes | FrameNodes:
    """Add dark nodes, so that lights of about as many nodes have one program."""
    if isinstance(part, FrameNodes):
        return part
    more = _power_of_two(len(part.directions)) - len(part.directions)
    directions = np.concatenate([part.directions, np.tile([0.0, 0.0, 1.0], (more, 1))])
    dark = np.zeros((more, np.shape(part.irradiance)[1]))
    return LightNodes(directions, np.concatenate([part.irradiance, dark]))


def _power_of_two(count: int) -> int:
    """Round up to a power of two, or half-way to the next."""
    power = 1 << max(count - 1, 0).bit_length()
    return 3 * power // 4 if count <= 3 * power // 4 else power


@stored(effort="less")
def _reflected(
    model: ExactModel,
    roughness: Float[AnyArray, ""],
    metallic: Float[AnyArray, ""],
    index: Float[AnyArray, ""],
) -> tuple[Float[AnyArray, "sample channel"], ...]:
    given = {"roughness": roughness, "metallic": metallic, "ior": index}
    numbers = {name: jnp.asarray(value) for name, value in given.items()}
    # Sums of many terms, all positive: single precision loses nothing that the noise would not.
    single = in_precision(np.float32, (model, numbers))
    return single[0].columns(single[1]).parts
