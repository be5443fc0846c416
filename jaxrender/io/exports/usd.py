"""USD, through its own library (extra ``usd``): mesh, UsdPreviewSurface, lights and cameras.

The axes are the world's: the stage's up axis is Z.  Its ``metersPerUnit`` is 1: one unit of the
capture counts as one metre, since nobody says how long it is.  A dome's texture follows OpenEXR's
latitude-longitude images, with +Z in the middle and +X left of it; its transform takes these to our
x and y.  Distant sources are normalised, so that their intensity is the irradiance.

Dielectrics take the specular workflow, whose colour is the reflectance head-on; metals the other.
"""

from pathlib import Path
from typing import Any

import numpy as np

from jaxrender.brdf import head_on_reflectance
from jaxrender.errors import InputError
from jaxrender.geometry import Camera, Mesh, Orthographic, Pinhole
from jaxrender.io.atomic import replacing
from jaxrender.io.exports.contents import Contents, Part, lamp_pose, mesh_of, plain_name
from jaxrender.io.exports.gltf import ENVIRONMENT, GltfTextures, facing_panorama, srgb
from jaxrender.io.exports.gltf_material import GltfMaterial
from jaxrender.io.images import write_image
from jaxrender.shapes import Float

SCENE = "scene.usdc"
# Rows: where x, y and z of a dome's own axes are in the world.
_WORLD_FROM_DOME = np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
_FOCAL_LENGTH = 50.0
# Apertures and focal lengths count in tenths of a unit.
_TENTHS = 10.0
# Sources are this wide, degrees: nearly a direction.
_WIDTH = 0.05
_NAMES = ("base_color", "specular_color", "roughness", "metallic")


def usd_losses(contents: Contents, material: GltfMaterial) -> tuple[str, ...]:
    """Say what UsdPreviewSurface and USD's cameras cannot hold."""
    lost, cameras = [], [one.camera for one in contents.cameras]
    if any(isinstance(one, Pinhole) and one.lens is not None for one in cameras):
        lost.append("the distortion of lenses: USD's cameras are undistorted")
    if not material.isotropic:
        lost.append("the direction of brushed surfaces: UsdPreviewSurface has one roughness")
    if float(material.specular) != 1:
        lost.append("that an interface reflects less than all light at grazing")
    if contents.maps is not None and contents.maps.offset is not None:
        lost.append("the normals of single texels: the shape's own are kept")
    return tuple(lost)


def usd_library() -> Any:
    """Import USD; ``InputError`` says how to install it."""
    try:
        import pxr.Usd  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise InputError(
            "--to usd: needs the package usd-core: pip install 'jaxrender[usd]'"
        ) from None
    import pxr  # pyright: ignore[reportMissingImports]

    return pxr


def write_usd(
    contents: Contents,
    folder: Path,
    material: GltfMaterial,
    textures: GltfTextures | None = None,
) -> tuple[Part, ...]:
    """Write ``scene.usdc`` and the pictures that it names.

    Raises ``ValueError`` for contents without a shape, ``InputError`` where the library is missing.
    """
    if contents.shape is None:
        raise ValueError("a scene of USD needs a shape")
    usd_library()
    writer = _Writer(folder)
    writer.object(contents, material, textures)
    writer.lights(contents)
    writer.cameras(contents)
    with replacing(folder / SCENE) as aside:
        writer.stage.GetRootLayer().Export(str(aside), args={"format": "usdc"})
    about = "mesh, UsdPreviewSurface, lights and cameras; z is up, one unit counts as one metre"
    return (Part(SCENE, about), *writer.parts)


class _Writer:
    """A stage in memory, and the files that it names."""

    def __init__(self, folder: Path):
        from pxr import Usd, UsdGeom  # pyright: ignore[reportMissingImports]

        self.folder = folder
        self.parts: list[Part] = []
        self.stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)
        root = UsdGeom.Xform.Define(self.stage, "/scene")
        self.stage.SetDefaultPrim(root.GetPrim())

    def object(
        self, contents: Contents, material: GltfMaterial, textures: GltfTextures | None
    ) -> None:
        """Write the mesh, and bind the material."""
        from pxr import UsdShade  # pyright: ignore[reportMissingImports]

        assert contents.shape is not None
        mesh = mesh_of(contents.shape, textured=textures is not None)
        shape = self._mesh(mesh)
        name = plain_name(contents.name)
        found = UsdShade.Material.Define(self.stage, f"/scene/materials/m_{name}")
        self.stage.DefinePrim("/scene/materials", "Scope")
        shader = self._shader(found, "surface", "UsdPreviewSurface")
        head_on = float(head_on_reflectance(material.ior)) * float(material.specular)
        is_metal = float(material.metallic) == 1
        inputs: dict[str, Any] = {
            "diffuseColor": np.asarray(material.base_color, float),
            "roughness": float(material.roughness),
            "clearcoat": float(material.clearcoat),
            "clearcoatRoughness": float(material.clearcoat_roughness),
            "useSpecularWorkflow": 0 if is_metal else 1,
        }
        if is_metal:
            inputs["metallic"], inputs["ior"] = 1.0, float(material.ior)
        else:
            inputs["specularColor"] = np.minimum(head_on * np.asarray(material.specular_color), 1)
        for key, value in inputs.items():
            self._input(shader, key, value)
        if textures is not None:
            self._textures(found, shader, textures, head_on)
        found.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        UsdShade.MaterialBindingAPI.Apply(shape.GetPrim()).Bind(found)

    def _mesh(self, mesh: Mesh) -> Any:
        from pxr import Sdf, UsdGeom, Vt  # pyright: ignore[reportMissingImports]

        def rows(values: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(values, np.float32)

        shape = UsdGeom.Mesh.Define(self.stage, "/scene/object")
        shape.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(rows(mesh.vertices)))
        corners = np.ascontiguousarray(mesh.faces.ravel(), np.int32)
        shape.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(corners))
        shape.CreateFaceVertexCountsAttr(Vt.IntArray([3] * len(mesh.faces)))
        shape.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(rows(mesh.normals)))
        shape.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        shape.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        shape.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(rows(mesh.bounds())))
        if mesh.texture_coordinates is not None:
            coordinates = UsdGeom.PrimvarsAPI(shape).CreatePrimvar(
                "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
            )
            flat = rows(mesh.texture_coordinates.reshape(-1, 2))
            coordinates.Set(Vt.Vec2fArray.FromNumpy(flat))
        return shape

    def _shader(self, material: Any, name: str, kind: str) -> Any:
        from pxr import UsdShade  # pyright: ignore[reportMissingImports]

        shader = UsdShade.Shader.Define(self.stage, material.GetPath().AppendChild(name))
        shader.CreateIdAttr(kind)
        return shader

    def _input(self, shader: Any, name: str, value: Any) -> Any:
        from pxr import Gf, Sdf  # pyright: ignore[reportMissingImports]

        types = Sdf.ValueTypeNames
        if isinstance(value, np.ndarray):
            return shader.CreateInput(name, types.Color3f).Set(Gf.Vec3f(*value.tolist()))
        kind = types.Int if isinstance(value, int) else types.Float
        return shader.CreateInput(name, kind).Set(value)

    def _textures(self, material: Any, surface: Any, maps: GltfTextures, head_on: float) -> None:
        """Write the maps as PNG, and put them in the place of the numbers."""
        from pxr import Gf, Sdf  # pyright: ignore[reportMissingImports]

        types = Sdf.ValueTypeNames
        places = self._shader(material, "coordinates", "UsdPrimvarReader_float2")
        places.CreateInput("varname", types.String).Set("st")
        pairs = zip(_NAMES, ("diffuseColor", "specularColor", "roughness", "metallic"))
        for name, target in pairs:
            values = getattr(maps, name)
            if values is None:
                continue
            is_colour = values.ndim == 3
            file = f"{name}.png"
            codes = srgb(values) if is_colour else np.repeat(values[..., None], 3, axis=-1)
            write_image(self.folder / file, np.clip(codes, 0, 1))
            space = "sRGB" if is_colour else "raw"
            self.parts.append(Part(file, f"{target} of the texture, {space}; row 0 at v = 1"))
            reader = self._shader(material, name, "UsdUVTexture")
            reader.CreateInput("file", types.Asset).Set(Sdf.AssetPath(f"./{file}"))
            reader.CreateInput("sourceColorSpace", types.Token).Set(space)
            for side in ("wrapS", "wrapT"):
                reader.CreateInput(side, types.Token).Set("repeat")
            if target == "specularColor":
                scale = Gf.Vec4f(head_on, head_on, head_on, 1)
                reader.CreateInput("scale", types.Float4).Set(scale)
            reader.CreateInput("st", types.Float2).ConnectToSource(
                places.CreateOutput("result", types.Float2)
            )
            output = ("rgb", types.Float3) if is_colour else ("r", types.Float)
            wanted = surface.GetInput(target)
            wanted.ConnectToSource(reader.CreateOutput(*output))

    def lights(self, contents: Contents) -> None:
        """Write the dome with its texture, and the sources."""
        from pxr import Sdf, UsdLux  # pyright: ignore[reportMissingImports]

        if contents.environment is not None:
            write_image(self.folder / ENVIRONMENT, facing_panorama(contents.environment))
            about = "radiance around the object for the dome light, linear RGB, latitude-longitude"
            self.parts.append(Part(ENVIRONMENT, about))
            dome = UsdLux.DomeLight.Define(self.stage, "/scene/environment")
            dome.CreateTextureFileAttr(Sdf.AssetPath(f"./{ENVIRONMENT}"))
            dome.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
            self._placed(dome, _WORLD_FROM_DOME)
        nodes = (np.asarray(part, float) for part in contents.sources.nodes())
        for number, (direction, irradiance) in enumerate(zip(*nodes)):
            if np.any(irradiance > 0):
                source = UsdLux.DistantLight.Define(self.stage, f"/scene/source_{number}")
                source.CreateAngleAttr(_WIDTH)
                self._emits(source, irradiance)
                self._placed(source, lamp_pose(direction).T)
        if contents.points is None:
            return
        points = contents.points
        pairs = zip(*(np.asarray(p, float) for p in (points.positions, points.intensity)))
        for number, (place, intensity) in enumerate(pairs):
            point = UsdLux.SphereLight.Define(self.stage, f"/scene/point_{number}")
            point.CreateTreatAsPointAttr(True)
            # A sphere of radiance L sends L times the area of its disc, a quarter of its own.
            self._emits(point, 4 * intensity)
            pose = np.eye(4)
            pose[3, :3] = place
            self._placed(point, pose)

    def _emits(self, light: Any, values: Float[np.ndarray, "3"]) -> None:
        from pxr import Gf  # pyright: ignore[reportMissingImports]

        strength = float(np.max(values))
        light.CreateIntensityAttr(strength)
        light.CreateNormalizeAttr(True)
        light.CreateColorAttr(Gf.Vec3f(*np.clip(values / strength, 0, 1).tolist()))

    def _placed(self, prim: Any, rows: Float[np.ndarray, "4 4"]) -> None:
        from pxr import Gf, UsdGeom  # pyright: ignore[reportMissingImports]

        matrix = Gf.Matrix4d(*np.asarray(rows, float).ravel().tolist())
        UsdGeom.Xformable(prim).AddTransformOp().Set(matrix)

    def cameras(self, contents: Contents) -> None:
        """Write the cameras; their axes are ours."""
        from pxr import UsdGeom  # pyright: ignore[reportMissingImports]

        for number, frame in enumerate(contents.cameras):
            name = f"/scene/camera_{number}_{plain_name(frame.name)}"
            found = UsdGeom.Camera.Define(self.stage, name)
            camera: Camera = frame.camera
            pose = np.eye(4)
            pose[:3] = camera.world_from_camera[:3]
            self._placed(found, pose.T)
            if isinstance(camera, Pinhole):
                across, down = _FOCAL_LENGTH / camera.fl_x, _FOCAL_LENGTH / camera.fl_y
            else:
                assert isinstance(camera, Orthographic)
                found.CreateProjectionAttr(UsdGeom.Tokens.orthographic)
                across = down = _TENTHS * camera.scale
            found.CreateFocalLengthAttr(_FOCAL_LENGTH)
            found.CreateHorizontalApertureAttr(camera.width * across)
            found.CreateVerticalApertureAttr(camera.height * down)
            found.CreateHorizontalApertureOffsetAttr((camera.width / 2 - camera.cx) * across)
            found.CreateVerticalApertureOffsetAttr((camera.cy - camera.height / 2) * down)
