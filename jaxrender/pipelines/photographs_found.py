"""What the photographs of an imported capture tell by their headers: sizes, response, exposures."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

from jaxrender.errors import InputError
from jaxrender.io import Frame
from jaxrender.io.captures import Contents, PhotoHeader, read_photo_header
from jaxrender.io.images import image_size
from jaxrender.io.raw import RawHeader

# Below this many bits a picture is what a camera makes for a screen.
_LINEAR_BITS = 12


def examined(
    contents: Contents, advance: Callable[[float], None] = lambda fraction: None
) -> Contents:
    """Hold photographs against their cameras, and fill in what their headers tell.

    Raises ``InputError`` for a size that is not its camera's, and for pixels of whole numbers
    beside those of floating point.
    """
    frames = contents.capture.frames
    headers = []
    for number, frame in enumerate(frames):
        headers.append(read_photo_header(frame.image_path))
        _check_size(frame, headers[-1])
        advance((number + 1) / len(frames))
    contents = contents._replace(found=(_sizes(headers), *contents.found))
    return _with_response(_with_exposures(contents, headers), headers)


def _check_size(frame: Frame, header: PhotoHeader) -> None:
    wanted = (frame.camera.width, frame.camera.height)
    sizes = [(frame.image_path, (header.width, header.height))]
    if frame.mask_path is not None:
        sizes.append((frame.mask_path, image_size(frame.mask_path)))
    for path, size in sizes:
        if size != wanted:
            raise InputError(
                f"{path}: {size[0]} x {size[1]} pixels, its camera says {wanted[0]} x {wanted[1]}; "
                "give the photographs that the cameras were found from (--images FOLDER)"
            )


def _sizes(headers: list[PhotoHeader]) -> str:
    counts = Counter((header.width, header.height) for header in headers)
    several = ", ".join(f"{n} of {w} x {h}" for (w, h), n in counts.most_common())
    return f"{len(headers)} photographs: {several} pixels"


def _with_exposures(contents: Contents, headers: list[PhotoHeader]) -> Contents:
    """Keep the exposures that are given, or else take those of EXIF."""
    frames = contents.capture.frames
    given = sum(frame.exposure is not None for frame in frames)
    if given == len(frames):
        return contents._replace(found=(*contents.found, "an exposure of each photograph"))
    if given:
        without = next(frame.name for frame in frames if frame.exposure is None)
        said = f"exposures of {given} photographs; those without, such as {without}, count as 1"
        return contents._replace(assumed=(*contents.assumed, said))
    exposures = [header.exposure for header in headers]
    if None in exposures:
        said = "no exposures are stated: all photographs count as exposed alike"
        return contents._replace(assumed=(*contents.assumed, said))
    first = exposures[0]
    relative = [exposure / first for exposure in exposures if exposure and first]
    if all(math.isclose(exposure, 1, rel_tol=1e-6) for exposure in relative):
        said = "by their EXIF all photographs are exposed alike"
        return contents._replace(found=(*contents.found, said))
    own = tuple(frame._replace(exposure=e) for frame, e in zip(frames, relative))
    said = "exposures from EXIF (seconds, ISO, f-number), relative to the first photograph"
    capture = contents.capture._replace(frames=own)
    return contents._replace(capture=capture, found=(*contents.found, said))


def _of_raw(contents: Contents, headers: list[PhotoHeader], raw: RawHeader) -> Contents:
    """Say how camera RAW is read."""
    if any(header.raw is None for header in headers):
        path = next(
            frame.image_path
            for frame, header in zip(contents.capture.frames, headers)
            if header.raw is None
        )
        raise InputError(f"{path}: no camera RAW, as others are; import photographs of one kind")
    red, _, blue = raw.camera_white
    said = (
        f"camera RAW: linear, the black level {raw.black_level:g} taken off, white at "
        f"{raw.white_level:g}; the colours are the camera's own, whose white balance would be "
        f"{red:.3g}, 1, {blue:.3g}"
    )
    return contents._replace(response="linear", curve=None, found=(*contents.found, said))


def _with_response(contents: Contents, headers: list[PhotoHeader]) -> Contents:
    """Say how pixels become radiance: what the format says, or what such files usually hold."""
    kinds = {header.is_integer for header in headers}
    if len(kinds) > 1:
        paths = [frame.image_path.name for frame in contents.capture.frames]
        names = [
            next(path for path, header in zip(paths, headers) if header.is_integer is kind)
            for kind in (True, False)
        ]
        raise InputError(
            f"{contents.capture.source}: {names[0]} holds whole numbers and {names[1]} floating "
            "point; import photographs of one kind"
        )
    raw = next((header.raw for header in headers if header.raw is not None), None)
    if raw is not None:
        return _of_raw(contents, headers, raw)
    if kinds == {False}:
        return contents._replace(response=None, curve=None)
    if contents.curve is not None:
        return contents
    if contents.response is not None:
        said = f"pixels are {contents.response}, as the format says"
        return contents._replace(found=(*contents.found, said))
    bits = min(header.bits for header in headers)
    response = "linear" if bits >= _LINEAR_BITS else "srgb"
    said = f"pixels of {bits} bits are taken to be {response} (capture.response)"
    return contents._replace(response=response, assumed=(*contents.assumed, said))
