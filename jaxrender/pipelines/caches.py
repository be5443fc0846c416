"""Where photographs that were rendered from a recipe are kept between runs."""

import os
from pathlib import Path

from jaxrender.pipelines.config import RecipeConfig
from jaxrender.pipelines.output import fingerprint
from jaxrender.pipelines.scene import input_files
from jaxrender.pipelines.synth import written_files


def capture_folder(recipe: RecipeConfig, recipe_path: Path) -> Path:
    """Name the folder of a recipe's photographs: its content decides, not its path.

    Below ``XDG_CACHE_HOME`` or ``~/.cache``; whatever is there may be deleted at any time.
    """
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    base = base if base.is_absolute() else Path.home() / ".cache"
    digest = fingerprint(recipe, input_files(recipe), purpose="synth")
    return base / "jaxrender" / "captures" / f"{recipe_path.stem}-{digest[:16]}"


def is_whole(recipe: RecipeConfig, folder: Path) -> bool:
    """Whether a folder of photographs still holds all that was written into it."""
    return all((folder / name).is_file() for name in written_files(recipe))
