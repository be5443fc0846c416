"""Where things are and which way they face.

``directions``, ``frames`` and ``embeddings`` are device side (jit-able, differentiable): unit
vectors, angles, mirror and half-way directions, the rotations between a surface point's frame and
the world, and the hemisphere as a unit square (``disc_cells``: what directions fill of its cells).
The rest is host side in float64.  ``cameras`` turn pixels into rays; a ``Shape`` (``hits``) answers
where rays meet it, as an exact ``Sphere`` or as a triangle ``Mesh`` traced by Embree (``tracing``;
its twin is in ``triangles``, ``tessellation`` makes spheres); ``surface`` puts the two together:
``observe(camera, shape)`` gives the point, normal and exit direction behind every pixel, of which
``samples`` keeps what the forward model asks for.  ``visibility`` tells what the surface itself can
see: which light reaches a place on a concave shape.  ``sculpture`` makes such a shape,
``height_fields`` a patch of micro-geometry, which ``periodic`` repeats without end.
``footprints`` says how much of a texture a pixel covers, and ``unwrapping`` gives coordinates to a
mesh that has none.  ``lenses`` bend a camera's rays: they are
made of ``distortions``, and by the names of other programs in ``lens_models``.  ``camera_axes``
reads the poses of other programs, and ``placement`` puts a mesh somewhere else.
"""

from jaxrender.geometry.camera_axes import CAMERA_AXES, camera_from, pose_from, shrunk_camera
from jaxrender.geometry.cameras import Camera, Orthographic, Pinhole, Rays, look_at
from jaxrender.geometry.components import Components, Incoming, pair_in_frame
from jaxrender.geometry.directions import (
    SphericalAngles,
    angles_from_direction,
    direction_from_angles,
    dot,
    half_vectors,
    normalise,
    reflect,
    squared_acute_angle,
    squared_angle,
    squared_angle_of_versine,
)
from jaxrender.geometry.distortions import (
    Distortion,
    Division,
    FieldOfView,
    RadialTangential,
    Skew,
)
from jaxrender.geometry.embeddings import EMBEDDINGS, NUSSELT, POLAR, Embedding
from jaxrender.geometry.footprints import pixel_steps, size_in_texels, texture_steps
from jaxrender.geometry.frames import (
    meridian_frames,
    rotation,
    to_local,
    to_world,
    world_from_local,
)
from jaxrender.geometry.height_fields import Patch, gaussian_surface, height_field, sawtooth, velvet
from jaxrender.geometry.hits import Hits, Shape
from jaxrender.geometry.lens_models import (
    LENS_MODELS,
    LensModel,
    metashape_lens,
    opencv_lens,
)
from jaxrender.geometry.lenses import (
    EnhancedUnifiedLens,
    EquirectangularLens,
    FisheyeLens,
    Lens,
    PerspectiveLens,
)
from jaxrender.geometry.mesh import Mesh
from jaxrender.geometry.periodic import PeriodicSurface
from jaxrender.geometry.placement import Placement, axis_turns
from jaxrender.geometry.samples import SurfaceSamples
from jaxrender.geometry.sculpture import sculpture
from jaxrender.geometry.sphere import Sphere
from jaxrender.geometry.surface import SurfaceView, contours, observe
from jaxrender.geometry.visibility import (
    SurfacePlaces,
    fibonacci_sphere,
    random_rotations,
    visible,
    visible_along,
)

__all__ = [
    "CAMERA_AXES",
    "EMBEDDINGS",
    "LENS_MODELS",
    "NUSSELT",
    "POLAR",
    "Camera",
    "Components",
    "Incoming",
    "Distortion",
    "Division",
    "Embedding",
    "FieldOfView",
    "EnhancedUnifiedLens",
    "EquirectangularLens",
    "FisheyeLens",
    "Hits",
    "Lens",
    "LensModel",
    "Mesh",
    "Orthographic",
    "Patch",
    "PeriodicSurface",
    "PerspectiveLens",
    "Pinhole",
    "Placement",
    "RadialTangential",
    "Rays",
    "Shape",
    "Skew",
    "Sphere",
    "SphericalAngles",
    "SurfacePlaces",
    "SurfaceSamples",
    "SurfaceView",
    "angles_from_direction",
    "axis_turns",
    "camera_from",
    "contours",
    "direction_from_angles",
    "dot",
    "fibonacci_sphere",
    "gaussian_surface",
    "half_vectors",
    "height_field",
    "look_at",
    "metashape_lens",
    "normalise",
    "observe",
    "opencv_lens",
    "pair_in_frame",
    "pixel_steps",
    "pose_from",
    "random_rotations",
    "reflect",
    "meridian_frames",
    "rotation",
    "sawtooth",
    "sculpture",
    "shrunk_camera",
    "size_in_texels",
    "squared_acute_angle",
    "squared_angle_of_versine",
    "squared_angle",
    "texture_steps",
    "to_local",
    "to_world",
    "velvet",
    "visible",
    "visible_along",
    "world_from_local",
]
