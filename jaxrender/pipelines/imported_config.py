"""The config of an imported capture, in words and keys."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path

from jaxrender.io.captures import (
    Contents,
    StatedEnvironment,
    StatedLight,
    StatedPoint,
    StatedSource,
)

_WIDTH = 96


def config_text(
    name: str, contents: Contents, *, parts: tuple[str, ...], images: Path | None, outside: bool
) -> str:
    """Write the config that fits a capture, with all that was found and assumed.

    ``name`` is that of the format, ``parts`` the files of cameras: one, or one of each photograph.
    ``images`` is the folder that the paths of photographs start from.
    """
    light = contents.light
    lines = _comment(f"Imported from {contents.capture.source} (format: {name}).")
    lines += _listed("Found", contents.found) + _listed("Assumed", contents.assumed)
    if not light.given:
        lines += _comment(
            "No light was found, so that light and material are both unknown. Where the light is "
            "known, say `task: brdf` and give `lighting`."
        )
    lines += [f"task: {_task(contents)}", "capture:"]
    reading = [f"images: {_text(images)}"] if images is not None else []
    reading += ["allow_outside: true"] if outside else []
    if contents.curve is not None:
        reading += ["response: {curve: response.txt}"]
    elif contents.response is not None:
        reading += [f"response: {contents.response}"]
    first = parts[0] if not light.environments else _text(Path(parts[0]))
    lines += [f"  transforms: {first}", *(f"  {one}" for one in reading)]
    lines += [f"  geometry: {_geometry(contents)}"]
    own = light.environments or ()
    lines += _lighting(light if not own else light._replace(environment=own[0]))
    if len(parts) > 1:
        lines += ["captures:"]
    for part, panorama in list(zip(parts, own))[1:]:
        lines += [f"  - transforms: {_text(Path(part))}", *(f"    {one}" for one in reading)]
        lines += [f"    lighting: {{environment: {_panorama(panorama)}}}"]
    if contents.square is not None:
        lines += ["texture:", f"  size: {contents.capture.frames[0].camera.width}"]
    facets = "ggx, mu: none" if contents.head_on else "ggx"
    lines += [f"brdf: {{model: {facets}}}", f"output: runs/{_run_name(contents)}"]
    return "\n".join(lines) + "\n"


def _task(contents: Contents) -> str:
    """Choose what is found: a flat sample is photographed for its texture."""
    if contents.square is not None:
        return "texture"
    return "brdf" if contents.light.given else "factorize"


def _listed(title: str, sentences: tuple[str, ...]) -> list[str]:
    if not sentences:
        return []
    lines = [f"# {title}:"]
    for sentence in sentences:
        lines += _comment(sentence, "- ")
    return lines


def _comment(sentence: str, mark: str = "") -> list[str]:
    """Wrap a sentence; what a file brings into it cannot end the comment."""
    plain = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in sentence)
    wrapper = textwrap.TextWrapper(_WIDTH, f"# {mark}", f"# {' ' * len(mark)}")
    # A path stays in one piece, however long.
    wrapper.break_long_words = wrapper.break_on_hyphens = False
    return wrapper.wrap(plain)


def _text(path: Path) -> str:
    # A text of JSON is one of YAML.
    return json.dumps(str(path), ensure_ascii=False)


def _geometry(contents: Contents) -> str:
    if contents.mesh is not None:
        return f"{{mesh: {_text(contents.mesh)}}}"
    assert contents.sphere is not None
    center = ", ".join(repr(float(x)) for x in contents.sphere.center)
    return f"{{sphere: {{center: [{center}], radius: {float(contents.sphere.radius)!r}}}}}"


def _lighting(light: StatedLight) -> list[str]:
    if not light.given:
        return []
    lines = ["lighting:"]
    if light.environment is not None:
        lines += [f"  environment: {_panorama(light.environment)}"]
    for name, sources in (("directional", light.directional), ("point", light.point)):
        if sources:
            lines += [f"  {name}:"] + [f"    - {_source(one)}" for one in sources]
    if light.per_frame is not None:
        lines += ["  per_frame: lights.json"]
    return lines


def _panorama(panorama: StatedEnvironment) -> str:
    more = "" if panorama.scale == 1 else f", scale: {float(panorama.scale)!r}"
    more += ", mirrored: true" if panorama.mirrored else ""
    more += f", yaw: {float(panorama.yaw)!r}" if panorama.yaw else ""
    return f"{{path: {_text(panorama.path)}, convention: {panorama.convention}{more}}}"


def _source(source: StatedSource | StatedPoint) -> str:
    keys = source._asdict().items()
    return f"{{{', '.join(f'{key}: {[float(x) for x in value]}' for key, value in keys)}}}"


def _run_name(contents: Contents) -> str:
    """Name the run by the folder of the capture."""
    name = contents.capture.source.resolve().parent.name
    plain = "".join(c if c.isalnum() or c in "-_." else "_" for c in name).strip(".")
    return plain or "capture"
