"""The paths and names of photographs, as files of cameras state them.

Paths inside a file come from whoever wrote it: they must stay below the file's own folder (or the
folder of pictures that the user names) unless the user allows more.
"""

from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import Any, NamedTuple

from jaxrender.errors import InputError
from jaxrender.io.raw import RAW_SUFFIXES

# What a path may leave out, in the order of preference: linear formats first.
_PICTURES = (".exr", ".hdr", ".pfm", ".png", ".jpg", ".jpeg", ".tga", ".tiff", ".tif")
IMAGE_SUFFIXES = (*_PICTURES, *RAW_SUFFIXES)


class Looking(NamedTuple):
    """Where the paths of a capture lead.

    ``require_images`` False: the cameras alone are wanted, the pictures need not exist.
    ``original``: poses are wanted as they were before a program moved all of them.
    """

    folder: Path
    allow_outside: bool = False
    require_images: bool = True
    original: bool = False

    def resolve(
        self, place: str, key: str, value: Any, suffixes: tuple[str, ...] = IMAGE_SUFFIXES
    ) -> Path:
        """Find the file that a file names, adding a suffix where it has none.

        Raises InputError for what names no file, is not there, or leads outside.
        """
        if not isinstance(value, str) or not value:
            raise InputError(f"{place}: `{key}` is {value!r}; wanted the path of a picture")
        try:
            return self._found(place, key, self.folder / value, suffixes)
        except InputError:
            raise
        except (OSError, ValueError):
            # A zero byte, half a surrogate pair, or more letters than a name may have.
            raise InputError(
                f"{place}: `{key}` is {value!r}; no file can be named so: mend the path"
            ) from None

    def _found(self, place: str, key: str, wanted: Path, suffixes: tuple[str, ...]) -> Path:
        # Before anything is looked at: even whether a file exists is told only below the folder.
        self._check_inside(place, key, wanted)
        candidates = [wanted]
        if wanted.suffix.lower() not in suffixes:
            candidates += [wanted.with_name(wanted.name + suffix) for suffix in suffixes]
        for candidate in candidates:
            if candidate.is_file():
                self._check_inside(place, key, candidate)
                return candidate
        if self.require_images:
            tried = f", nor with one of {', '.join(suffixes)}" if len(candidates) > 1 else ""
            raise InputError(
                f"{place}: `{key}`: {wanted} does not exist{tried}; mend the path, or name the "
                "folder that it starts from as `images`"
            )
        return wanted

    def _check_inside(self, place: str, key: str, path: Path) -> None:
        if not self.allow_outside and not _below(path, self.folder):
            raise InputError(
                f"{place}: `{key}` leads outside {self.folder}; move the file, name its folder as "
                "`images`, or allow paths outside (allow_outside)"
            )


def _below(path: Path, folder: Path) -> bool:
    """Whether a path, its symbolic links followed, stays inside a folder."""
    return path.resolve().is_relative_to(folder.resolve())


def frame_names(path: Path, values: Sequence[str], key: str) -> list[str]:
    """Name each frame; refuse those with the path of another.

    A frame is named by its file without folder and suffix; where two would share that name, by the
    whole path with ``_`` between folders; where that does not help, by number and file.
    """
    stems: dict[PurePath, int] = {}
    for i, value in enumerate(values):
        stem = Path(value)
        if stem.suffix.lower() in IMAGE_SUFFIXES:
            stem = stem.with_suffix("")
        if stem in stems:
            raise InputError(
                f"{path}: frame {i} ({value}) repeats the {key} of frame {stems[stem]}"
            )
        stems[stem] = i
    short = [stem.name for stem in stems]
    whole = ["_".join(stem.relative_to(stem.anchor).parts) for stem in stems]
    numbered = [f"{i}_{name}" for i, name in enumerate(short)]
    return next(names for names in (short, whole, numbered) if len(set(names)) == len(names))
