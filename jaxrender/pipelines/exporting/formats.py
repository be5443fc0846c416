"""Every format by its name: what it needs, what it loses of the contents, and who writes it."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, AnisotropicGGX, Exchanged, IsotropicMean, OpenPBR, tabulate_rgl
from jaxrender.errors import InputError
from jaxrender.io.exports import (
    BlenderMaterial,
    Brushed,
    Contents,
    GltfMaterial,
    MaterialMaps,
    MetallicMaps,
    Part,
    SeparatelyMasked,
    blend_losses,
    blender_command,
    environment_losses,
    gltf_losses,
    materialx_library,
    mitsuba_losses,
    openpbr_losses,
    own_surface,
    principled,
    principled_losses,
    usd_library,
    usd_losses,
    write_blend,
    write_environment_pictures,
    write_gltf,
    write_harmonics,
    write_materialx,
    write_mitsuba,
    write_usd,
)
from jaxrender.io.exports.materialx import MERIDIAN
from jaxrender.io.exports.mitsuba_materials import TABLE
from jaxrender.io.merl import MerlTable, write_merl
from jaxrender.io.rgl import read_rgl, write_rgl
from jaxrender.lighting import Light, LightSum
from jaxrender.pipelines.exporting.differences import difference
from jaxrender.pipelines.exporting.nearest_gltf import (
    Reading,
    as_gltf,
    described,
    nearest_brushed,
    nearest_gltf,
    own_gltf,
)
from jaxrender.pipelines.exporting.prepared import LACKED, Prepared, Written
from jaxrender.pipelines.exporting.textures import (
    BLENDER_DETAILS,
    USD_DETAILS,
    in_texels,
    metallic_mitsuba,
    textured_blend,
    textured_gltf,
    textured_mitsuba,
    textured_usd,
)
from jaxrender.spectra import light_coefficients

ALL = "all"
MATERIAL, _SHAPE, _LIGHT = "single material", "shape", "light"
_ENVIRONMENT, _MERL = "environment", "material.binary"
# The largest degree of exported harmonics.
_DEGREE = 10
_MAPPED = "material or texture"
_TURNING = "how the surface differs with its turning"


class ExportFormat(NamedTuple):
    """A format: a line on it, what the contents must have, and what prepares it.

    ``at_vertices`` are textures that it takes at vertices; others are laid out in texels for it.
    """

    about: str
    needs: tuple[str, ...]
    prepare: Callable[[Contents], Prepared]
    at_vertices: tuple[type, ...] = ()

    def prepared(self, contents: Contents) -> Prepared:
        """Prepare contents that lack nothing; raises ``InputError`` as formats do."""
        maps = contents.maps
        is_taken = maps is None or not maps.of_vertices or isinstance(maps, self.at_vertices)
        if is_taken or _MAPPED not in self.needs:
            return self.prepare(contents)
        return in_texels(contents, self.prepare)


def format_named(name: str) -> ExportFormat:
    """Look a format up; ``InputError`` lists those that there are."""
    if name not in FORMATS:
        raise InputError(f"--to {name}: no such format; known are {', '.join((*FORMATS, ALL))}")
    return FORMATS[name]


def missing_of(contents: Contents, kind: ExportFormat) -> tuple[str, ...]:
    """Name what a format needs and the contents lack."""
    has = {
        MATERIAL: contents.material is not None,
        _MAPPED: contents.material is not None or contents.maps is not None,
        _SHAPE: contents.shape is not None,
        _LIGHT: contents.is_lit,
        _ENVIRONMENT: contents.environment is not None,
    }
    return tuple(need for need in kind.needs if not has[need])


def _isotropic(brdf: BRDF) -> BRDF:
    return brdf if brdf.isotropic else IsotropicMean(brdf)


def _mitsuba(contents: Contents) -> Prepared:
    if isinstance(contents.maps, MetallicMaps):
        return metallic_mitsuba(contents)
    if contents.maps is not None:
        return textured_mitsuba(contents, contents.maps)
    assert contents.material is not None
    if isinstance(contents.material, AnisotropicGGX):
        return _brushed_mitsuba(contents, contents.material)
    material = _isotropic(contents.material)

    def write(folder: Path) -> Written:
        parts = write_mitsuba(contents._replace(material=material), folder)
        if not (folder / TABLE).exists():
            return Written(parts, ("the material is a plugin of Mitsuba's own, by its definition",))
        return Written(parts, (_of_table(folder, material, contents, "outgoing"),))

    return Prepared(mitsuba_losses(contents), write)


def _brushed_mitsuba(contents: Contents, material: AnisotropicGGX) -> Prepared:
    """Prepare a brushed surface: only the masking differs."""
    apart = difference(material, SeparatelyMasked(material), contents).sentence
    loss = f"that facets hide light in and out together: Mitsuba hides them apart, {apart} away"
    remark = "the tangents are the texture coordinates of object.ply, face by face"
    return Prepared(
        (*mitsuba_losses(contents), loss),
        lambda folder: Written(write_mitsuba(contents, folder), (remark,)),
    )


def _rgl(contents: Contents) -> Prepared:
    assert contents.material is not None
    material = _isotropic(contents.material)
    losses = () if contents.material.isotropic else (_TURNING,)

    def write(folder: Path) -> Written:
        write_rgl(folder / TABLE, tabulate_rgl(material), "exported by jaxrender")
        about = "BRDF times cosine in RGL's format, by the direction of the light; linear RGB"
        return Written((Part(TABLE, about),), (_of_table(folder, material, contents, "incoming"),))

    return Prepared(losses, write)


class _Chosen(NamedTuple):
    """glTF's material that is written, what is lost with it, and a remark."""

    material: GltfMaterial
    losses: tuple[str, ...]
    remark: str


def _chosen(contents: Contents, reading: Reading = as_gltf) -> _Chosen:
    """Choose glTF's own material, or the nearest one with what it misses.

    ``reading`` is what a program makes of glTF's numbers.
    """
    assert contents.material is not None
    own = own_gltf(contents.material)
    if own is not None:
        remark = "the material is glTF's own, by its definition"
        if reading is as_gltf:
            return _Chosen(own, (), remark)
        apart = difference(contents.material, reading(own), contents).sentence
        return _Chosen(own, (f"{LACKED}; of the same numbers it makes one {apart} away",), remark)
    target, brushed = contents.material, Brushed.of(contents.material)
    if brushed is None:
        target = _isotropic(target)
        near = nearest_gltf(target, reading=reading)
    else:
        assert isinstance(target, AnisotropicGGX | OpenPBR)
        near = nearest_brushed(target, brushed, reading)
    apart = difference(target, reading(near), contents).sentence
    losses = (f"{LACKED}; the nearest that it has is {apart} away",)
    if brushed is None and not contents.material.isotropic:
        losses += (_TURNING,)
    return _Chosen(near, losses, f"the nearest material of glTF has {described(near)}")


def _gltf(contents: Contents, *, binary: bool) -> Prepared:
    """Prepare a scene; a texture's numbers are those of the nearest material, texel by texel."""
    if contents.maps is not None:
        return textured_gltf(contents, contents.maps, binary=binary)
    found = _chosen(contents)

    def write(folder: Path) -> Written:
        parts = write_gltf(contents, folder, found.material, binary=binary)
        return Written(parts, (found.remark,))

    return Prepared((*gltf_losses(contents), *found.losses), write)


def _materialx(contents: Contents) -> Prepared:
    materialx_library()
    material = contents.material
    if isinstance(material, OpenPBR):
        losses, remark = openpbr_losses(material), "the numbers are OpenPBR's own"
    else:
        material, losses, remark = _chosen(contents)
        if not material.isotropic:
            losses += (MERIDIAN,)
    return Prepared(
        losses,
        lambda folder: Written(write_materialx(material, contents.name, folder), (remark,)),
    )


def _usd(contents: Contents) -> Prepared:
    usd_library()
    if contents.maps is not None:
        return textured_usd(contents, contents.maps)
    found = _chosen(contents)

    def write(folder: Path) -> Written:
        parts = write_usd(contents, folder, found.material)
        return Written(parts, (found.remark, USD_DETAILS))

    return Prepared((*usd_losses(contents, found.material), *found.losses), write)


def _blend(contents: Contents) -> Prepared:
    blender_command()
    if contents.maps is not None:
        return textured_blend(contents, contents.maps)
    assert contents.material is not None
    surface, losses = own_surface(contents.material), ()
    remark = "the material is a sum of Blender's own shaders, by its definition"
    if surface is None:
        found = _chosen(contents, BlenderMaterial)
        surface, remark = principled(found.material), found.remark
        losses = (*principled_losses(found.material), *found.losses)

    def write(folder: Path) -> Written:
        parts = write_blend(contents, folder, surface)
        return Written(parts, (remark, BLENDER_DETAILS))

    return Prepared((*blend_losses(contents), *losses), write)


def _merl(contents: Contents) -> Prepared:
    assert contents.material is not None
    material = _isotropic(contents.material)
    losses = () if contents.material.isotropic else (_TURNING,)
    if not contents.material.reciprocal:
        losses += (
            "that the material is not reciprocal: one value serves a pair of directions and its "
            "exchange",
        )

    def write(folder: Path) -> Written:
        table = MerlTable.of(material)
        write_merl(folder / _MERL, table)
        apart = difference(material, table.brdf(), contents).sentence
        about = "BRDF over theta_h, theta_d and phi_d as the MERL database has it; linear RGB"
        return Written((Part(_MERL, about),), (f"the table differs from the material by {apart}",))

    return Prepared(losses, write)


def _environment(contents: Contents) -> Prepared:
    return Prepared(
        environment_losses(contents),
        lambda folder: Written(write_environment_pictures(contents, folder)),
    )


def _harmonics(contents: Contents) -> Prepared:
    """Prepare all of the light, sources too, to the degree that its image determines."""
    parts: list[Light] = [contents.all_distant]
    degree = _DEGREE
    if contents.environment is not None:
        parts.append(contents.environment)
        degree = min(degree, contents.environment.grid.band_limit)
    coefficients = light_coefficients(LightSum(tuple(parts)), max(degree, 2))
    remark = f"harmonics are the light to degree {max(degree, 2)}, and no finer"
    losses = ()
    if contents.points is not None:
        losses = ("the places of near sources: they are as the middle of the object sees them",)
    return Prepared(
        losses, lambda folder: Written(write_harmonics(np.asarray(coefficients), folder), (remark,))
    )


def _of_table(folder: Path, material: BRDF, contents: Contents, first: str) -> str:
    """Say how exact the table of a material is, from the file itself."""
    table: BRDF = read_rgl(folder / TABLE).brdf
    if first == "outgoing":
        table = Exchanged(table)
    found = difference(material, table, contents)
    return f"the table {TABLE} differs from the recovered material by {found.sentence}"


FORMATS: dict[str, ExportFormat] = {
    "gltf": ExportFormat(
        "a scene of glTF 2.0 as text", (_MAPPED, _SHAPE), partial(_gltf, binary=False)
    ),
    "glb": ExportFormat(
        "a scene of glTF 2.0 in one binary file", (_MAPPED, _SHAPE), partial(_gltf, binary=True)
    ),
    "mitsuba": ExportFormat(
        "a scene of Mitsuba 3, as XML and as a dictionary",
        (_MAPPED, _SHAPE, _LIGHT),
        _mitsuba,
        (MaterialMaps,),
    ),
    "materialx": ExportFormat(
        "the material as MaterialX, by OpenPBR or glTF's shading model", (MATERIAL,), _materialx
    ),
    "usd": ExportFormat(
        "a stage of USD with UsdPreviewSurface, lights and cameras", (_MAPPED, _SHAPE), _usd
    ),
    "blend": ExportFormat(
        "a scene of Blender with Principled BSDF, lights and cameras", (_MAPPED, _SHAPE), _blend
    ),
    "merl": ExportFormat(
        "the material as a file of the MERL database (.binary)", (MATERIAL,), _merl
    ),
    "environment": ExportFormat(
        "the light around the object as EXR, Radiance HDR, KTX 2 and six faces of a cube",
        (_ENVIRONMENT,),
        _environment,
    ),
    "harmonics": ExportFormat(
        "the light as spherical harmonics: JSON, C header, GLSL", (_LIGHT,), _harmonics
    ),
    "rgl": ExportFormat("the material as a table in RGL's format (.bsdf)", (MATERIAL,), _rgl),
}

# What a material by itself can be written as.
OF_MATERIALS = tuple(
    n for n, kind in FORMATS.items() if kind.needs[0] not in (_LIGHT, _ENVIRONMENT)
)
