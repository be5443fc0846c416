"""Caches between runs: photographs rendered from a recipe, and arrays that are slow to make.

They lie in the user's cache folder (``cache_place``), and may be deleted at any time.
"""

import hashlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from jaxrender.io.atomic import replacing
from jaxrender.pipelines.cache_place import user_cache
from jaxrender.pipelines.config import RecipeConfig
from jaxrender.pipelines.output import fingerprint
from jaxrender.pipelines.scene import input_files
from jaxrender.pipelines.synth import purpose_of, written_files


def capture_folder(recipe: RecipeConfig, recipe_path: Path) -> Path:
    """Name the folder of a recipe's photographs: its content decides, not its path."""
    digest = fingerprint(recipe, input_files(recipe), purpose=purpose_of(recipe))
    return _base() / "captures" / f"{recipe_path.stem}-{digest[:16]}"


def is_whole(recipe: RecipeConfig, folder: Path) -> bool:
    """Say whether a folder of photographs still holds all its files."""
    return all((folder / name).is_file() for name in written_files(recipe))


def remembered(
    kind: str, key: Sequence[np.ndarray | str], make: Callable[[], np.ndarray]
) -> np.ndarray:
    """Look up an array by the content that it depends on, or make it and keep it.

    The array is made anew where the cache is damaged or cannot be written.
    """
    digest = hashlib.sha256()
    for part in key:
        array = np.ascontiguousarray(part)
        digest.update(f"{array.dtype.str} {array.shape};".encode())
        digest.update(array.tobytes())
    path = _base() / kind / f"{digest.hexdigest()[:32]}.npy"
    try:
        return np.load(path, allow_pickle=False)
    except (OSError, ValueError):
        made = make()
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        # No other run reads half of it.
        with replacing(path) as aside:
            np.save(aside, made)
    return made


def _base() -> Path:
    return user_cache() / "jaxrender"
