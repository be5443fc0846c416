"""An examination of the installation: what works, what is missing, and what to do about it.

Each check tries the thing itself: a ray is traced, a picture written and read, an equation solved.
Nothing heavy is imported above the checks, so that a broken library is a finding and no traceback.
Which libraries belong to it, and to which extra, is read from the package's own metadata.
"""

from __future__ import annotations

import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, NamedTuple

from jaxrender import __version__

_NAME = "jaxrender"

_ANEW = "install jaxrender once more in a new environment, as its README says"

State = Literal["good", "remark", "bad"]


class Finding(NamedTuple):
    """What one check found: ``bad`` means that commands will fail; ``remedy`` may be empty."""

    name: str
    state: State
    text: str
    remedy: str = ""


class Extra(NamedTuple):
    """One extra of the package: what is there, what is missing, and how to install it."""

    name: str
    there: tuple[str, ...]
    missing: tuple[str, ...]
    install: str


class Examination(NamedTuple):
    """All findings about one installation."""

    version: str
    python: str
    platform: str
    findings: tuple[Finding, ...]
    extras: tuple[Extra, ...]

    @property
    def is_well(self) -> bool:
        """Whether all that is essential works."""
        return all(finding.state != "bad" for finding in self.findings)

    def as_json(self) -> dict[str, Any]:
        """Give the same as plain values."""
        return {
            "version": self.version,
            "python": self.python,
            "platform": self.platform,
            "well": self.is_well,
            "checks": [finding._asdict() for finding in self.findings],
            "extras": [extra._asdict() | {"complete": not extra.missing} for extra in self.extras],
        }


def examine(set_up: Callable[[], None], cache: Path | None) -> Examination:
    """Try everything that commands need.

    ``set_up`` prepares JAX as commands do; ``cache`` is the folder that they then keep programs in.
    """
    here = f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors"
    findings = [
        _tried("libraries", _libraries),
        _tried("devices", lambda: _devices(set_up)),
        _tried("precision", _precision),
        _tried("cache", lambda: _cache(cache)),
        _tried("rays", _rays),
        _tried("pictures", _pictures),
        _tried("solvers", _solvers),
        _tried("blender", _blender),
    ]
    return Examination(__version__, platform.python_version(), here, tuple(findings), extras())


def extras() -> tuple[Extra, ...]:
    """List the package's extras with what is there of each; none where it has no metadata."""
    try:
        named = metadata.metadata(_NAME).get_all("Provides-Extra") or []
    except metadata.PackageNotFoundError:
        return ()
    return tuple(_extra(name) for name in named)


def _extra(name: str) -> Extra:
    wanted = list(_wanted(name))
    there = tuple(f"{one.name} {one.version}" for one in wanted if one.fits)
    missing = [one for one in wanted if not one.fits]
    return Extra(name, there, tuple(one.trouble for one in missing), _install(missing))


class _Wanted(NamedTuple):
    """One library that is wanted, as ``name>=1.2``, and the version that is there."""

    name: str
    wanted: str
    version: str | None
    fits: bool

    @property
    def trouble(self) -> str:
        """What is wrong with it."""
        found = "not installed" if self.version is None else f"has {self.version}"
        return f"{self.wanted} ({found})"


def _install(missing: list[_Wanted]) -> str:
    """The command that installs what is missing, by the libraries' own names."""
    if not missing:
        return ""
    return "pip install --upgrade " + " ".join(f'"{one.wanted}"' for one in missing)


def _wanted(extra: str = "") -> Iterator[_Wanted]:
    """List the libraries of an extra, or of the package itself."""
    from packaging.requirements import Requirement

    for line in metadata.requires(_NAME) or []:
        one = Requirement(line)
        always = one.marker is None or one.marker.evaluate({"extra": ""})
        belongs = one.marker is not None and one.marker.evaluate({"extra": extra})
        # What holds without an extra belongs to the package itself.
        if not (belongs and not always if extra else always):
            continue
        wanted = f"{one.name}{one.specifier}"
        try:
            version = metadata.version(one.name)
        except metadata.PackageNotFoundError:
            yield _Wanted(one.name, wanted, None, False)
            continue
        fits = one.specifier.contains(version, prereleases=True)
        yield _Wanted(one.name, wanted, version, fits)


def _tried(name: str, check: Callable[[], Finding]) -> Finding:
    """Do a check; whatever it raises is what it found."""
    try:
        return check()
    except Exception as error:
        said = " ".join(str(error).split())[:300]
        return Finding(name, "bad", f"{type(error).__name__}: {said}", _ANEW)


def _libraries() -> Finding:
    try:
        found = list(_wanted())
    except metadata.PackageNotFoundError:
        return Finding(
            "libraries",
            "remark",
            "the package is not installed, so that its list of libraries is unknown",
            "pip install -e . in its folder",
        )
    wrong = [one for one in found if not one.fits]
    if wrong:
        text = f"missing or too old: {', '.join(one.trouble for one in wrong)}"
        return Finding("libraries", "bad", text, _install(wrong))
    shown = [f"{one.name} {one.version}" for one in found if one.name in ("jax", "numpy")]
    return Finding("libraries", "good", f"all {len(found)} there; {', '.join(shown)}")


def _devices(set_up: Callable[[], None]) -> Finding:
    set_up()
    import jax

    kinds: dict[str, int] = {}
    for device in jax.devices():
        kinds[device.device_kind] = kinds.get(device.device_kind, 0) + 1
    listed = ", ".join(f"{count} x {kind}" for kind, count in kinds.items())
    return Finding("devices", "good", f"{jax.default_backend()}: {listed}")


def _precision() -> Finding:
    import jax.numpy as jnp

    number = jnp.asarray(1.0)
    if float(number + 1e-12) == 1.0:
        return Finding(
            "precision",
            "bad",
            f"{number.dtype}: results lose digits",
            "unset JAX_ENABLE_X64, or set it to 1",
        )
    return Finding("precision", "good", f"{number.dtype}")


def _cache(folder: Path | None) -> Finding:
    """Say what is kept; without a cache commands work, but start later."""
    from jaxrender.pipelines.cache_place import contents

    if folder is None:
        return Finding(
            "cache",
            "remark",
            "none: every command compiles anew",
            "set JAX_COMPILATION_CACHE_DIR to a folder that you alone may write to",
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
    except OSError as error:
        return Finding(
            "cache",
            "remark",
            f"{folder}: cannot be written: {error.strerror}; every command compiles anew",
            f"make {folder} writable, or set JAX_COMPILATION_CACHE_DIR to another folder",
        )
    files, size = contents(folder)
    text = f"{folder}: {_bytes(size)} in {files:,} files, writable"
    # A program is looked up by the package's source: what is older than that is never found again.
    changed = max(path.stat().st_mtime for path in Path(__file__).parents[1].rglob("*.py"))
    stale = contents(folder / "programs", before=min(changed, time.time()))
    if stale.files:
        return Finding(
            "cache",
            "remark",
            f"{text}; {_bytes(stale.size)} left by another version",
            f"delete {folder} if you need the space: it is made anew",
        )
    return Finding("cache", "good", text)


def _bytes(size: int) -> str:
    return f"{size / 1e6:,.1f} MB" if size < 1e9 else f"{size / 1e9:,.1f} GB"


def _rays() -> Finding:
    """Trace one ray against a triangle whose point is known."""
    import numpy as np

    from jaxrender.geometry import Mesh

    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    triangle = Mesh(corners, np.array([[0, 1, 2]]))
    hits = triangle.first_hits(np.array([[0.25, 0.25, 2.0]]), np.array([[0.0, 0.0, -1.0]]))
    point = np.asarray(hits.points)[0]
    if not (bool(hits.hit[0]) and np.allclose(point, [0.25, 0.25, 0.0])):
        remedy = "pip install --force-reinstall embreex"
        return Finding("rays", "bad", f"a ray that hits a triangle ended at {point}", remedy)
    return Finding("rays", "good", f"Embree (embreex {metadata.version('embreex')}) traces")


def _pictures() -> Finding:
    """Write an EXR into a temporary folder, and read it back."""
    import numpy as np

    from jaxrender.io import read_image, write_image

    # Each of these is a number of single precision, which EXR holds exactly.
    pixels = np.arange(24.0).reshape(2, 4, 3) * 4096 + 0.125
    with tempfile.TemporaryDirectory(prefix="jaxrender-") as folder:
        path = Path(folder) / "test.exr"
        write_image(path, pixels)
        found = read_image(path).pixels
    if not np.array_equal(found, pixels):
        remedy = "pip install --force-reinstall OpenImageIO"
        return Finding("pictures", "bad", "an EXR came back with other values", remedy)
    version = metadata.version("OpenImageIO")
    return Finding("pictures", "good", f"OpenImageIO {version} writes and reads EXR")


def _solvers() -> Finding:
    """Solve two small problems of known answers."""
    import jax.numpy as jnp
    import numpy as np

    from jaxrender.inverse import solvers

    wanted = jnp.asarray([0.5, -0.25])
    found = solvers.least_squares(lambda x, goal: jnp.exp(x) - jnp.exp(goal), 0 * wanted, wanted)
    free = np.allclose(found.point, wanted, atol=1e-6)
    ends = jnp.zeros(2), jnp.ones(2)
    boxed = solvers.solve_in_box(jnp.eye(2), jnp.asarray([2.0, 0.5]), *ends)
    if not (free and np.allclose(boxed, [1.0, 0.5], atol=1e-9)):
        answers = f"{np.asarray(found.point)} and {np.asarray(boxed)}"
        remedy = "pip install --force-reinstall optimistix lineax jaxopt"
        return Finding("solvers", "bad", f"two small problems gave {answers}", remedy)
    named = ", ".join(f"{name} {metadata.version(name)}" for name in ("optimistix", "jaxopt"))
    return Finding("solvers", "good", f"{named} find known answers")


def _blender() -> Finding:
    """Say what would run Blender's scripts; only one format needs it."""
    from jaxrender.errors import InputError
    from jaxrender.io.exports import blender_command

    try:
        command = blender_command()
    except InputError as error:
        text, _, remedy = str(error).partition(": ")
        return Finding("blender", "remark", f"{text}; only export --to blend needs it", remedy)
    return Finding("blender", "good", f"{command[0]} runs it for export --to blend")


_MARKS: dict[State, str] = {"good": "ok", "remark": "note", "bad": "FAIL"}


def text_of(found: Examination) -> str:
    """Write an examination as lines for people."""
    lines = [f"jaxrender {found.version}, Python {found.python}, {found.platform}"]
    for finding in found.findings:
        lines.append(f"{_MARKS[finding.state]:5s} {finding.name:10s} {finding.text}")
        if finding.remedy:
            lines.append(f"{'':17s}-> {finding.remedy}")
    if found.extras:
        lines.append("extras")
    for extra in found.extras:
        mark = "there" if not extra.missing else "-"
        held = ", ".join(extra.there + extra.missing)
        lines.append(f"{mark:5s} {extra.name:10s} {held}")
        if extra.missing:
            lines.append(f"{'':17s}-> {extra.install}")
    failed = [finding.name for finding in found.findings if finding.state == "bad"]
    lines.append(
        "everything that commands need works"
        if found.is_well
        else f"broken: {', '.join(failed)}; the arrows say what to do"
    )
    return "\n".join(lines)
