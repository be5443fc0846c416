"""Textures for other programs: what is lost of them, and who writes them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from jaxrender.brdf import Exchanged, Microfacet, Mixture
from jaxrender.geometry import Mesh
from jaxrender.io.exports import (
    Atlas,
    BlenderMaterial,
    Contents,
    GltfMaterial,
    MaterialMaps,
    MetallicMaps,
    blend_losses,
    gltf_losses,
    mitsuba_losses,
    own_textured,
    principled,
    spread_over_faces,
    table_widths,
    usd_losses,
    with_normals,
    write_blend,
    write_gltf,
    write_mitsuba,
    write_usd,
)
from jaxrender.io.rgl import read_rgl
from jaxrender.pipelines.exporting.differences import difference
from jaxrender.pipelines.exporting.nearest_gltf import (
    Reading,
    TexturedGltf,
    as_gltf,
    nearest_textured,
)
from jaxrender.pipelines.exporting.prepared import LACKED, Prepared, Written

USD_DETAILS = (
    "UsdPreviewSurface leaves to renderers how the base loses what the interface reflects: "
    "pictures differ between them"
)
BLENDER_DETAILS = (
    "nodes have the distribution GGX, without what facets hand on to one another; "
    "light is followed to its first reflection, as here: raise Light Paths > Max Bounces for more"
)
_STEPS = "steps finer than a 256th of a texture's range"
UNSEEN = "places that no photograph shows are black"
_OF_METAL = (
    "metal is a plugin of Mitsuba's own, by its definition; the dielectric is tables, and a place "
    "lies between two widths of them"
)


def in_texels(contents: Contents, prepare: Callable[[Contents], Prepared]) -> Prepared:
    """Prepare a texture of vertices as one of texels, and say what that changes.

    Raises ``InputError`` for a mesh of too many pieces.
    """
    maps = contents.maps
    assert isinstance(contents.shape, Mesh)
    assert maps is not None
    atlas = Atlas.of(contents.shape)
    color, named = (maps.kd, "K_d") if isinstance(maps, MaterialMaps) else (maps.base_color, "base")
    rows, columns = atlas.vertex.shape
    loss = (
        f"that sites are vertices: the mesh gets {atlas.charts} charts in {columns} x {rows} "
        f"texels, {atlas.density:.2g} to an edge, which changes {named} by "
        f"{100 * atlas.apart(np.maximum(color, 0)):.2g} % in the mean"
    )
    asked = prepare(contents._replace(shape=atlas.mesh, maps=atlas.baked_maps(maps)))
    return asked._replace(losses=(loss, *asked.losses))


def textured_gltf(
    contents: Contents, maps: MaterialMaps | MetallicMaps, *, binary: bool
) -> Prepared:
    """Prepare a texture of texels: its own numbers, or those of the nearest material."""
    found = nearest_textured(maps)
    losses = (*gltf_losses(contents), _STEPS, *_lost(found, maps, contents))
    if maps.offset is not None:
        losses += ("the normals of single texels: the shape's own are kept",)
    colours = "base colour" if found.mean is None else "base colour and specular colour"
    numbers = "roughness linear in green" + (", metalness in blue" if found.mean is None else "")

    def write(folder: Path) -> Written:
        parts = write_gltf(contents, folder, found.material, found.textures, binary=binary)
        return Written(parts, (f"textures: {colours} in sRGB, {numbers}", UNSEEN))

    return Prepared(losses, write)


def textured_usd(contents: Contents, maps: MaterialMaps | MetallicMaps) -> Prepared:
    """Prepare a texture of texels for USD: its numbers are glTF's."""
    found = nearest_textured(maps)

    def write(folder: Path) -> Written:
        parts = write_usd(contents, folder, found.material, found.textures)
        return Written(parts, (USD_DETAILS, UNSEEN))

    losses = (*usd_losses(contents, found.material), _STEPS, *_lost(found, maps, contents))
    return Prepared(losses, write)


def textured_blend(contents: Contents, maps: MaterialMaps | MetallicMaps) -> Prepared:
    """Prepare a texture of texels for Blender: its own shaders, or what it makes of the nearest."""
    assert contents.shape is not None
    surface = own_textured(maps) if isinstance(maps, MaterialMaps) else None
    losses: tuple[str, ...] = ()
    if surface is None:
        found = nearest_textured(maps, BlenderMaterial)
        surface = principled(found.material, found.textures)
        losses = _lost(found, maps, contents, BlenderMaterial)
    if isinstance(maps, MaterialMaps) and maps.offset is not None:
        surface = with_normals(surface, maps, contents.shape)
        losses += (_below_the_horizon(maps),)

    def write(folder: Path) -> Written:
        return Written(write_blend(contents, folder, surface), (BLENDER_DETAILS, UNSEEN))

    return Prepared((*blend_losses(contents), *losses), write)


def _lost(
    found: TexturedGltf,
    maps: MaterialMaps | MetallicMaps,
    contents: Contents,
    reading: Reading = as_gltf,
) -> tuple[str, ...]:
    """Say what textures of glTF's material lose, as a program takes them."""
    lost: tuple[str, ...] = ()
    if found.mean is not None:
        apart = difference(maps.mean, reading(found.mean), contents).sentence
        lost = (f"{LACKED}; for the mean texel the nearest that it has is {apart} away",)
    elif reading is not as_gltf:
        assert isinstance(maps, MetallicMaps)
        mean = maps.mean
        color = np.minimum(np.asarray(mean.base_color), 1)
        own = GltfMaterial(color, float(mean.metallic), float(mean.roughness), float(mean.ior))
        apart = difference(maps.mean, reading(own), contents).sentence
        lost = (f"{LACKED}; of the mean texel's numbers it makes one {apart} away",)
    if found.too_bright:
        lost += (f"{100 * found.too_bright:.2g} % of the texels are brighter than white",)
    return lost


def textured_mitsuba(contents: Contents, maps: MaterialMaps) -> Prepared:
    """Prepare a texture as bitmaps, or as colours of vertices, over tables of the lobe."""
    losses = mitsuba_losses(contents)
    below = [float(np.mean(part < 0)) for part in (maps.kd, maps.coloured_ks)]
    if any(below):
        losses += (f"negative values: they are 0 ({100 * max(below):.2g} % of one map)",)
    if maps.offset is not None and not maps.of_vertices:
        losses += (_below_the_horizon(maps),)
    if maps.of_vertices:
        assert isinstance(contents.shape, Mesh)
        spread = spread_over_faces(maps, contents.shape)
        losses += (
            "that a place has the material of the nearest vertex: Mitsuba goes evenly from vertex "
            f"to vertex, which changes K_d by {100 * spread:.3g} % in the mean",
        )

    def write(folder: Path) -> Written:
        parts = write_mitsuba(contents, folder)
        tables = [part.file for part in parts if part.file.endswith(".bsdf")]
        return Written(parts, (*_accuracy(contents, maps, folder, tables), UNSEEN))

    return Prepared(losses, write)


def metallic_mitsuba(contents: Contents) -> Prepared:
    """Prepare maps of metal: its own plugin by metalness, over tables of the dielectric."""

    def write(folder: Path) -> Written:
        parts = write_mitsuba(contents, folder)
        return Written(parts, (_OF_METAL, UNSEEN))

    return Prepared(mitsuba_losses(contents), write)


def _below_the_horizon(maps: MaterialMaps) -> str:
    """Say what other programs leave out under a tilted normal."""
    assert maps.offset is not None
    # A normal and the shape's own, t apart, share (1 + cos t) / 2 of the light that is even.
    slope = np.linalg.norm(np.nan_to_num(maps.offset[maps.seen]), axis=-1)
    unseen = float(np.mean(1 - 1 / np.sqrt(1 + slope**2))) / 2
    return (
        "light from below the shape's own horizon that a tilted normal would still see: "
        f"{100 * unseen:.3g} % of an even light"
    )


def _accuracy(
    contents: Contents, maps: MaterialMaps, folder: Path, tables: list[str]
) -> tuple[str, ...]:
    """Say how exact the first table is, which is the narrowest, and lobes between two tables."""
    if not tables:
        return ()
    mean = maps.mean
    assert isinstance(mean, Microfacet)
    bare = mean.with_amplitudes(np.zeros(3), np.ones(3))
    widths = np.array([float(mean.sigma)])
    if maps.sigma is not None:
        widths = table_widths(maps.sigma[maps.seen])
    own = bare.with_roughness(float(widths[0]), mean.mu)
    table = Exchanged(read_rgl(folder / tables[0]).brdf)
    straight = np.array([[0.0, 0.0, 1.0]])
    # A table is so many times as bright as its lobe, and may have the colour of one hue.
    brightness = np.asarray(table.evaluate(straight, straight) / own.evaluate(straight, straight))
    coloured = own.with_amplitudes(np.zeros(3), brightness[0])
    apart = difference(coloured, table, contents).sentence
    said = (f"the table {tables[0]} differs from its lobe by {apart}",)
    is_between = maps.sigma is not None and not np.all(np.isin(maps.sigma[maps.seen], widths))
    if is_between and len(widths) > 1:
        ends = [bare.with_roughness(float(width), mean.mu) for width in widths[:2]]
        # Both ends alike: the worst place between them.
        between = float(np.mean(widths[:2] ** -2.0) ** -0.5)
        mixed = Mixture(tuple(ends), np.full((2, 3), 0.5))
        apart = difference(
            bare.with_roughness(between, mean.mu), mixed, Contents(contents.name)
        ).sentence
        said += (f"half-way between the sigmas of two tables a lobe is off by {apart}",)
    return said
