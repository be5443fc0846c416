"""Textures of T 6.2 as plugins of Mitsuba 3: bitmaps, or colours of vertices, over tables.

Mitsuba has no lobe of T 6.2, so its shape is a table for ``measured``, and bitmaps say how much of
it each place has.  With lobes S_k of brightness c,

    rho(x) = (1 - sum w_k) kd'(x) + sum w_k(x) c S_k,  w_k = ks_k / c,  kd' = kd / (1 - sum w_k):

``blendbsdf`` in ``blendbsdf``, exact but for the tables.  A coloured K_s whose hue changes has a
table for each channel.  Where sigma varies there are tables of several widths, and a place lies
between two of them, linearly in 1 / sigma^2, in which the peak of a lobe is linear.  Normals are
a ``normalmap``.

Texels are looked up as in our renderings: the nearest one.  Values at vertices go evenly from one
to the next, where ours are those of the nearest.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import Microfacet, Parametric, RglSize, tabulate_rgl
from jaxrender.geometry import Mesh, Shape
from jaxrender.io.exports.contents import MaterialMaps, MetallicMaps, Part, mesh_of
from jaxrender.io.exports.texel_frames import in_frames, texel_frames
from jaxrender.io.images import write_image
from jaxrender.io.meshes import write_mesh
from jaxrender.io.rgl import write_rgl
from jaxrender.shapes import Float

# Widths of neighbouring tables are at most so far apart, and there are at most so many.
_STEP, _MOST_WIDTHS = 1.25, 12
# The most that all lobes have of a place's weights.
_MOST_SHARE = 0.5
# Colours that differ less than this have one hue.
_SAME_HUE = 1e-6
# Places a side of a face at which values of vertices are compared.
_STEPS = 12
# Of several tables each is coarser.
_ONE, _OF_SEVERAL = RglSize(), RglSize(samples=72)


class MappedLobe(NamedTuple):
    """A lobe, and how much of it each site has."""

    lobe: Parametric
    amount: Float[np.ndarray, "*site"]


class TexturedPlugin(NamedTuple):
    """The plugin as a dictionary, the columns of the mesh that it reads, and the files written."""

    plugin: dict[str, Any]
    columns: dict[str, Float[np.ndarray, "vertex"]]
    parts: tuple[Part, ...]


def mapped_lobes(maps: MaterialMaps) -> tuple[MappedLobe, ...]:
    """Take the lobes of a texture apart: amounts times lobes are K_s S, but for widths between."""
    mean = maps.mean
    assert isinstance(mean, Microfacet)
    ks = np.maximum(maps.coloured_ks, 0)
    if not ks.any():
        return ()
    found = []
    for tint, amount in _hues(ks):
        bare = mean.with_amplitudes(np.zeros(3), tint)
        if maps.sigma is None:
            found.append(MappedLobe(bare, amount))
            continue
        widths = table_widths(maps.sigma[maps.seen])
        for width, share in zip(widths, np.moveaxis(shares(maps.sigma, widths), -1, 0)):
            if np.any(share * amount):
                lobe = bare.with_roughness(float(width), mean.mu)
                found.append(MappedLobe(lobe, share * amount))
    return tuple(found)


def table_widths(sigma: Float[np.ndarray, "site"]) -> Float[np.ndarray, "width"]:
    """Choose the widths that have a table: those that there are, if few, or geometric steps."""
    own = np.unique(sigma)
    if len(own) <= _MOST_WIDTHS:
        return own
    steps = int(np.ceil(np.log(own[-1] / own[0]) / np.log(_STEP)))
    return np.geomspace(own[0], own[-1], min(steps + 1, _MOST_WIDTHS))


def shares(
    sigma: Float[np.ndarray, "*site"], widths: Float[np.ndarray, "width"]
) -> Float[np.ndarray, "*site width"]:
    """Share each site among the two nearest widths, linearly in 1 / sigma^2."""
    if len(widths) == 1:
        return np.ones((*sigma.shape, 1))
    place = 1 / np.clip(sigma, widths[0], widths[-1]) ** 2
    nodes = 1 / widths**2
    return np.stack(
        [np.interp(place, nodes[::-1], row[::-1]) for row in np.eye(len(widths))], axis=-1
    )


def textured_plugin(maps: MaterialMaps, shape: Shape, folder: Path) -> TexturedPlugin:
    """Write the bitmaps and tables of a texture, and the plugin that joins them."""
    lobes = mapped_lobes(maps)
    total = sum((one.amount for one in lobes), np.zeros(maps.kd.shape[:-1]))
    brightness = float(total.max()) / _MOST_SHARE or 1.0
    store = Store(folder, {}, [])
    left = 1 - total / brightness
    reflectance = store.texture("reflectance", np.pi * np.maximum(maps.kd, 0) / left[..., None])
    found = store.over({"type": "diffuse", "reflectance": reflectance}, lobes, brightness)
    if maps.offset is not None and not maps.of_vertices:
        normals = in_frames(maps.offset, texel_frames(shape, maps.kd.shape[:2]))
        picture = store.texture("normal", (1 + normals) / 2)
        # As ours, where a normal alone says how bright a place is.
        plain = {"use_shadowing_function": False, "flip_invalid_normals": False}
        found = {"type": "normalmap", **plain, "normalmap": picture, "bsdf_0": found}
    return TexturedPlugin(found, store.columns, tuple(store.parts))


def write_textured_mesh(
    path: Path,
    shape: Shape,
    maps: MaterialMaps | MetallicMaps,
    columns: dict[str, Float[np.ndarray, "vertex"]],
) -> None:
    """Write a mesh with Mitsuba's texture coordinates, v downwards, or with values at vertices."""
    mesh = mesh_of(shape)
    if maps.of_vertices:
        normals = mesh.normals
        if maps.offset is not None:
            normals = _tilted(normals, np.nan_to_num(maps.offset))
        write_mesh(path, Mesh(mesh.vertices, mesh.faces, normals), columns)
        return
    assert mesh.texture_coordinates is not None
    corners = np.column_stack([mesh.faces.ravel(), mesh.texture_coordinates.reshape(-1, 2)])
    written, index = np.unique(corners, axis=0, return_inverse=True)
    vertex = written[:, 0].astype(int)
    split = Mesh(mesh.vertices[vertex], index.reshape(-1, 3), mesh.normals[vertex])
    write_mesh(path, split, {"s": written[:, 1], "t": 1 - written[:, 2]})


def spread_over_faces(maps: MaterialMaps, mesh: Mesh) -> float:
    """How far K_d goes from that of the nearest vertex where it goes evenly instead.

    The mean over the surface of the absolute difference, over the mean.
    """
    assert maps.of_vertices
    steps = (np.arange(_STEPS) + 0.5) / _STEPS
    u, v = (one.ravel() for one in np.meshgrid(steps, steps))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    weights = np.stack([1 - u - v, u, v], axis=-1)
    corners = np.maximum(maps.kd, 0)[mesh.faces]
    evenly = np.einsum("pk,fkc->fpc", weights, corners)
    nearest = corners[:, np.argmax(weights, axis=1)]
    first, second = (
        mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)
    )
    area = np.linalg.norm(np.cross(first, second), axis=1)
    apart = np.abs(evenly - nearest).mean(axis=(1, 2))
    return float(np.sum(area * apart) / np.sum(area * nearest.mean(axis=(1, 2))))


def _tilted(
    normals: Float[np.ndarray, "vertex 3"], offset: Float[np.ndarray, "vertex 3"]
) -> Float[np.ndarray, "vertex 3"]:
    tilted = normals + offset - np.sum(normals * offset, axis=1, keepdims=True) * normals
    return tilted / np.maximum(np.linalg.norm(tilted, axis=1, keepdims=True), 1e-20)


def _hues(
    ks: Float[np.ndarray, "*site channel"],
) -> list[tuple[Float[np.ndarray, "3"], Float[np.ndarray, "*site"]]]:
    """Take K_s apart: one colour times amounts where there is one hue, else channel by channel."""
    if ks.shape[-1] == 1:
        return [(np.ones(3), ks[..., 0])]
    sums = ks.sum(axis=-1)
    hue = ks.reshape(-1, 3).sum(axis=0) / sums.sum()
    if np.allclose(ks, sums[..., None] * hue, rtol=0, atol=_SAME_HUE * float(ks.max())):
        return [(hue, sums)]
    return [(axis, ks[..., k]) for k, axis in enumerate(np.eye(3)) if ks[..., k].any()]


class Store(NamedTuple):
    """Where textures and tables go: a folder, columns of a mesh, and what was written."""

    folder: Path
    columns: dict[str, Float[np.ndarray, "vertex"]]
    parts: list[Part]

    def texture(self, name: str, values: Float[np.ndarray, "*site channel"]) -> dict[str, Any]:
        """Keep values as a bitmap, or at vertices, and refer to them."""
        if values.ndim == 2:
            self.columns.update({f"{name}_{k}": column for k, column in enumerate(values.T)})
            return {"type": "mesh_attribute", "name": f"vertex_{name}"}
        file = f"{name}.exr"
        write_image(self.folder / file, values)
        self.parts.append(Part(file, f"{_ABOUT[name.partition('_')[0]]}; row 0 at v = 1"))
        return {"type": "bitmap", "filename": file, "raw": True, "filter_type": "nearest"}

    def over(
        self, inner: dict[str, Any], lobes: tuple[MappedLobe, ...], brightness: float
    ) -> dict[str, Any]:
        """Put tables of lobes, so many times as bright, over a plugin that gets what they leave."""
        left = 1 - sum((one.amount for one in lobes), np.zeros(())) / brightness
        # From the innermost to the outermost: a weight is of what those outside have left.
        for number, (lobe, amount) in enumerate(lobes):
            left = left + amount / brightness
            weight = amount / brightness / left
            inner = {
                "type": "blendbsdf",
                "weight": self.texture(f"weight_{number}", weight[..., None]),
                "bsdf_0": inner,
                "bsdf_1": self.table(f"lobe_{number}.bsdf", lobe, brightness, len(lobes) > 1),
            }
        return inner

    def table(self, file: str, lobe: Parametric, brightness: float, coarse: bool) -> dict[str, Any]:
        """Write a lobe as a table."""
        bright = lobe.with_amplitudes(*(brightness * np.asarray(lobe.amplitudes)))
        tables = tabulate_rgl(bright, "outgoing", _OF_SEVERAL if coarse else _ONE)
        write_rgl(self.folder / file, tables, "exported by jaxrender")
        about = f"the lobe of width {float(lobe.width):.4g}, {brightness:.4g} times as bright as 1"
        self.parts.append(Part(file, f"{about}, as a table for Mitsuba's plugin `measured`"))
        return {"type": "measured", "filename": file}


_ABOUT = {
    "reflectance": "pi K_d over what the lobes leave, linear RGB",
    "base": "the base colour, linear RGB",
    "roughness": "the roughness",
    "metal": "how much of a place is metal",
    "weight": "how much a place has of the lobe of the same number, of what those after it leave",
    "normal": "normals relative to the tangent of u, (1 + n) / 2",
}
