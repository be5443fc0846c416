"""Stanford-ORB's layout for Blender: photographs with masks, and a panorama of each of the test.

``data/blender_HDR/SCENE`` (or ``blender_LDR``) has ``transforms_test.json`` and
``transforms_train.json`` with the keys of ``transforms``, and masks in ``test_mask`` and
``train_mask``.  ``data/ground_truth/SCENE`` has ``mesh_blender/mesh.obj`` and, for each photograph
of the test, ``env_map/NAME.exr``.  Such a panorama is in the frame of its camera: the middle is
straight ahead, +x is to the right and +y up.
"""

from pathlib import Path

import numpy as np

from jaxrender.io.captures.capture import Capture, Frame
from jaxrender.io.captures.contents import Contents, StatedEnvironment, StatedLight
from jaxrender.io.captures.paths import IMAGE_SUFFIXES, Looking
from jaxrender.io.captures.transforms import read_transforms

LOOKED_FOR = "transforms_test.json and test_mask/, or the same of train"
_PARTS = ("test", "train")
# The left edge of ``y-up`` is straight ahead, that of Stanford-ORB straight behind.
_TURN = np.diag([-1.0, 1.0, -1.0])


def find_stanford_orb(folder: Path) -> list[Path]:
    """List the parts of a scene; that of the test, whose light is known, comes first."""
    named = [(folder / f"transforms_{part}.json", folder / f"{part}_mask") for part in _PARTS]
    return [path for path, masks in named if path.is_file() and masks.is_dir()]


def read_stanford_orb(path: Path, looking: Looking) -> Contents:
    """Read one part of a scene; raises InputError as ``read_transforms`` does."""
    contents = read_transforms(path, looking)
    folder = path.parent
    masks = folder / f"{path.stem.removeprefix('transforms_')}_mask"
    frames = tuple(_masked(frame, masks) for frame in contents.capture.frames)
    truth = folder.parent.parent / "ground_truth" / folder.name
    mesh = truth / "mesh_blender" / "mesh.obj"
    panoramas = [_panorama(truth / "env_map", frame) for frame in frames]
    kept = [frame for frame, one in zip(frames, panoramas) if one is not None]
    environments = tuple(one for one in panoramas if one is not None)
    found = [f"masks of {sum(frame.mask_path is not None for frame in frames)} photographs"]
    assumed: list[str] = []
    if environments:
        found.append("a panorama of each photograph, in the frame of its camera")
        assumed.append(
            "photographs and panoramas have one scale; where they have not, say "
            "lighting.free_scale: true"
        )
        assumed.append(
            "panoramas are as the light at the object was; where a probe stood elsewhere, say "
            "solve.free: [exposure, environment]"
        )
        frames = tuple(kept)
    if len(kept) < len(panoramas):
        found.append(
            f"{len(panoramas) - len(kept)} photographs without a panorama: their light is unknown"
            + (", and they are left out" if kept else "")
        )
    return contents._replace(
        capture=Capture(frames, path),
        files=(path, *(one.path for one in environments)),
        mesh=mesh if mesh.is_file() else None,
        light=StatedLight(environments=environments or None),
        found=(*contents.found, *found),
        assumed=(*contents.assumed, *assumed),
    )


def _masked(frame: Frame, masks: Path) -> Frame:
    """Add the mask of a photograph, which has its name."""
    if frame.mask_path is not None:
        return frame
    named = [masks / f"{frame.image_path.stem}{suffix}" for suffix in IMAGE_SUFFIXES]
    return frame._replace(mask_path=next((path for path in named if path.is_file()), None))


def _panorama(folder: Path, frame: Frame) -> StatedEnvironment | None:
    """State a photograph's panorama, turned from the frame of its camera to the world."""
    path = folder / f"{frame.image_path.stem}.exr"
    if not path.is_file():
        return None
    world_from_camera = np.asarray(frame.camera.world_from_camera, float)[:3, :3]
    return StatedEnvironment(path, "y-up", turn=world_from_camera @ _TURN)
