"""The known shape of the object: a sphere, a mesh, or (in recipes) an ellipsoid or a sculpture."""

from __future__ import annotations

from pydantic import model_validator

from jaxrender.pipelines.config.values import (
    ConfigPath,
    Positive,
    PositiveVector,
    Section,
    Vector,
    WholeNumber,
)

# What belongs to a mesh file, and is no shape itself.
_OF_MESHES = ("scale", "rotation", "translation")


class SphereConfig(Section):
    """A sphere in world coordinates."""

    center: Vector = (0.0, 0.0, 0.0)
    """Centre in world units."""
    radius: Positive = 1.0
    """Radius in world units."""


class EllipsoidConfig(Section):
    """An ellipsoid about the origin with axes along x, y and z: a subdivided icosahedron."""

    radii: PositiveVector
    """Half axes along x, y and z."""
    subdivisions: WholeNumber = 5
    """How often each triangle of the icosahedron is split in four."""


class SculptureConfig(Section):
    """A smooth concave shape about the origin: a unit sphere with deep dents and bumps."""

    subdivisions: WholeNumber = 5
    """How often each triangle of the icosahedron is split in four."""
    seed: WholeNumber = 0
    """Seed of the places, depths and widths of dents and bumps."""


class GeometryConfig(Section):
    """The shape of the photographed object: exactly one of ``sphere`` and ``mesh``."""

    sphere: SphereConfig | None = None
    """A sphere: {center, radius}."""
    mesh: ConfigPath | None = None
    """A mesh file: .obj, .ply, .glb or .stl."""
    scale: Positive = 1.0
    """World units per unit of the mesh file."""
    rotation: Vector = (0.0, 0.0, 0.0)
    """How the mesh is turned after it is scaled: a rotation vector, whose direction is the axis and
    whose length is the angle in degrees."""
    translation: Vector = (0.0, 0.0, 0.0)
    """Where the origin of the mesh file comes to lie, in world units."""

    @model_validator(mode="after")
    def _one_shape(self) -> GeometryConfig:
        shapes = _shape_fields(self)
        given = [name for name in shapes if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) if given else "none"
            raise ValueError(f"found {found}; give exactly one of {', '.join(shapes)}")
        if self.mesh is None and self.scale != 1:
            raise ValueError(f"found scale {self.scale:g}; only a mesh has a scale, remove it")
        for name in ("rotation", "translation"):
            if self.mesh is None and any(getattr(self, name)):
                raise ValueError(f"found {name}; only a mesh has a {name}, remove it")
        return self


class RecipeGeometryConfig(GeometryConfig):
    """The shape of a recipe: one of ``sphere``, ``mesh``, ``ellipsoid`` and ``sculpture``."""

    ellipsoid: EllipsoidConfig | None = None
    """An ellipsoid: {radii, subdivisions}."""
    sculpture: SculptureConfig | None = None
    """A concave sculpture: {subdivisions, seed}."""


def _shape_fields(section: GeometryConfig) -> list[str]:
    return [name for name in type(section).model_fields if name not in _OF_MESHES]
