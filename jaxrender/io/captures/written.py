"""Cameras and exposures, written as ``read_capture`` reads them."""

import json
from pathlib import Path
from typing import Any

from jaxrender.geometry.cameras import Camera, Orthographic, Pinhole
from jaxrender.io.captures.capture import Capture
from jaxrender.io.captures.lens_keys import keys_of


def write_capture(path: Path, capture: Capture) -> None:
    """Write cameras and exposures as ``read_capture`` reads them.

    Pictures keep the paths that they have in the folder of ``capture.source``.
    """
    folder = capture.source.parent
    frames = []
    for frame in capture.frames:
        entry: dict[str, Any] = {"file_path": _relative(frame.image_path, folder)}
        if frame.mask_path is not None:
            entry["mask_path"] = _relative(frame.mask_path, folder)
        if frame.exposure is not None:
            entry["exposure"] = float(frame.exposure)
        frames.append(entry | _keys(frame.camera))
    path.write_text(json.dumps({"frames": frames}, indent=1) + "\n", encoding="utf-8")


def _keys(camera: Camera) -> dict[str, Any]:
    """State a camera: its size, its intrinsics, its lens and its pose."""
    entry: dict[str, Any] = {"w": camera.width, "h": camera.height}
    if isinstance(camera, Orthographic):
        entry |= {"camera_model": "orthographic", "ortho_scale": camera.scale}
        entry |= {"cx": camera.cx, "cy": camera.cy}
    else:
        assert isinstance(camera, Pinhole)
        entry |= {name: getattr(camera, name) for name in ("fl_x", "fl_y", "cx", "cy")}
        entry |= keys_of(camera.lens)
    return entry | {"transform_matrix": camera.world_from_camera.tolist()}


def _relative(path: Path, folder: Path) -> str:
    """Say where a file is from a folder, or where it is at all."""
    try:
        return path.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return str(path.resolve())
