"""What Blender says of a scene, and the pictures that Cycles makes of it, in another process."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from jaxrender.errors import InputError
from jaxrender.io import read_image
from jaxrender.io.exports import blender_command, run_in_blender

SCRIPT = Path(__file__).with_name("blender_child.py")


def need_blender() -> None:
    """Skip where there is no Blender."""
    try:
        blender_command()
    except InputError as error:
        pytest.skip(str(error))


def scene_of(path: Path) -> dict[str, Any]:
    """Ask Blender what a scene holds."""
    out = path.with_name(f"{path.name}.json")
    run_in_blender(SCRIPT, (path, out, "{}"))
    return json.loads(out.read_text())


class Picture(NamedTuple):
    """A picture, and where the object covers whole pixels."""

    pixels: np.ndarray
    whole: np.ndarray


def cycles_picture(path: Path, samples: int, seed: int = 0, **options: Any) -> Picture:
    """Have Cycles render a scene.  Options: size, camera (a name), light (an EXR, for a GLB)."""
    out = path.with_name(f"{path.name}.{seed}.exr")
    told = json.dumps(options | {"samples": samples, "seed": seed})
    run_in_blender(SCRIPT, (path, out, told))
    found = read_image(out)
    assert found.alpha is not None
    return Picture(found.pixels, found.alpha > 0.999)


def apart(first: np.ndarray, second: np.ndarray, where: np.ndarray) -> float:
    """The mean absolute difference over the mean of the second."""
    return float(np.abs(first - second)[where].mean() / second[where].mean())
