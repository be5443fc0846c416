"""``jaxrender view``: a finished result as one page to turn and to light."""

import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxrender.brdf import BRDF, Parametric
from jaxrender.errors import InputError
from jaxrender.geometry import Orthographic, Shape, SurfaceView, look_at, observe
from jaxrender.imaging.display import exposed, exposure_for
from jaxrender.io.atomic import replacing
from jaxrender.io.exports import MaterialMaps
from jaxrender.lighting import LightNodes
from jaxrender.pipelines.exporting.contents import contents_of
from jaxrender.pipelines.output import fingerprint
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.render import light_of_run
from jaxrender.pipelines.report.display import data_uri, with_alpha
from jaxrender.pipelines.result import RESULT, FinishedRun, read_run
from jaxrender.pipelines.scene import input_files, shape_of
from jaxrender.pipelines.subject import CorrectedSubject, UniformSubject
from jaxrender.pipelines.tasks import task_named
from jaxrender.pipelines.tasks.texture.metallic import MetallicSubject
from jaxrender.pipelines.tasks.texture.subject import TexturedSubject
from jaxrender.pipelines.view.light import DEGREE, PageLight, page_light
from jaxrender.pipelines.view.material_table import (
    FLOOR,
    MIDDLE,
    NODES,
    MaterialTable,
    material_table,
)
from jaxrender.pipelines.view.packing import packed
from jaxrender.pipelines.view.page import html_of
from jaxrender.pipelines.view.pictures import Gallery, false_bar, false_colours, gallery_of
from jaxrender.pipelines.view.sliders import sliders_of
from jaxrender.pipelines.view.surface import surface_document
from jaxrender.pipelines.view.texture import PageTexture, page_texture
from jaxrender.reflection import ExactForward, render_view
from jaxrender.shapes import Float

PAGE = "view.html"
_MARK = re.compile(r'<meta name="jaxrender-view" content="([0-9a-f]{64})">')
# What a page that is ours holds within so many of its first characters.
_HEAD = 4096
# The picture reaches so far beyond the object, in its radii.
MARGIN = 1.08
# Half the side of the still picture is this many pixels.
_STILL = 96
# Where the page looks from at first, where no photograph says.
_AZIMUTH, _ELEVATION = math.radians(40), math.radians(20)


class Shown(NamedTuple):
    """What a page shows: the material, its table, its light and the surface."""

    brdf: BRDF
    table: MaterialTable
    light: PageLight
    shape: Shape
    center: Float[np.ndarray, "3"]
    radius: float
    texture: PageTexture | None = None
    subject: TexturedSubject | None = None


def view_result(
    result: Path, out: Path | None = None, force: bool = False, progress: Progress | None = None
) -> Path:
    """Write the page of a finished result; by default it is ``view.html`` in the result's folder.

    A page of the same result is reused.  Raises ``InputError`` for a folder without a result, for
    a result that no page can show, and for a file in the way.
    """
    progress = progress or SilentProgress()
    run = read_run(result)
    path = result / PAGE if out is None else out
    files = [*input_files(run.config), result / RESULT]
    digest = fingerprint(run.config, files, purpose="view")
    if _is_there(path, digest, force):
        progress.note(f"{path}: made before; reused (--force: anew)")
        return path
    with progress.stage("view"), replacing(path) as unfinished:
        unfinished.write_text(_page(run, digest, progress), encoding="utf-8")
    return path


def _is_there(path: Path, digest: str, force: bool) -> bool:
    """Whether the same page is there; ``InputError`` for what must not be replaced."""
    if not path.exists():
        return False
    if not path.is_file():
        raise InputError(f"{path}: a folder is in the way; give --out a file's name")
    with path.open(encoding="utf-8", errors="replace") as stream:
        found = _MARK.search(stream.read(_HEAD))
    if found is None:
        raise InputError(f"{path}: is no page of jaxrender view; give --out another name")
    if force:
        return False
    if found[1] != digest:
        raise InputError(
            f"{path}: is the page of another result (other config, input or version); choose "
            "another --out, or give --force to replace it"
        )
    return True


def shown_as(
    brdf: BRDF,
    width: float,
    light: PageLight,
    shape: Shape,
    texture: PageTexture | None = None,
    subject: TexturedSubject | None = None,
) -> Shown:
    """Tabulate a material, and find where the object lies; raises ``InputError`` as both do."""
    table = material_table(brdf, width)
    surface = surface_document(shape, texture is not None)
    center, radius = np.array(surface["center"], float), float(surface["radius"])
    return Shown(brdf, table, light, shape, center, radius, texture, subject)


def shown_of(run: FinishedRun, progress: Progress) -> Shown:
    """Prepare what a page shows; ``InputError`` for a result that no page can show."""
    config = run.config
    if config.capture.geometry is None:
        raise InputError(
            f"{run.folder / 'config.yaml'}: states no geometry, so there is nothing to show"
        )
    shape = shape_of(config.capture.geometry)
    task = task_named(config.task)
    try:
        subject = task.subject(run, shape)
        brdf = task.brdf(run) if isinstance(subject, CorrectedSubject) else subject.lobe
        light = light_of_run(run, shape)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        made = run.summary.get("provenance", {}).get("jaxrender", "an unknown version")
        raise InputError(
            f"{run.folder / RESULT}: does not state what this version reads ({error!r}); it was "
            f"made by jaxrender {made}: run fit again with --force"
        ) from error
    texture = None
    if isinstance(subject, TexturedSubject):
        maps = contents_of(run).contents.maps
        assert isinstance(maps, MaterialMaps)
        texture, brdf = page_texture(run, maps), maps.mean
    elif isinstance(subject, MetallicSubject):
        raise InputError(
            f"{run.folder}: a page shows textures of K_d and K_s, not of metalness; use jaxrender "
            "export --to glb, or jaxrender render"
        )
    elif not isinstance(subject, UniformSubject | CorrectedSubject) or brdf is None:
        raise InputError(
            f"{run.folder}: a result of task {config.task} has no single material, which a page "
            "shows; use jaxrender render"
        )
    if light.varies:
        progress.note("the light differs between photographs; the page shows that of the first")
    if light.near is not None:
        progress.note("point sources shine from infinity on the page, as the middle sees them")
    own = light.of_frame(0) if light.varies else light
    width = float(subject.width)
    scale = float(run.summary.get("scale", 1.0))
    found = page_light(own.far, width).scaled(scale)
    if isinstance(subject, TexturedSubject):
        assert isinstance(brdf, Parametric)
        shown = shown_as(brdf, float(brdf.width), found, shape, texture, subject)
    else:
        shown = shown_as(brdf, width, found, shape)
    off = 100 * shown.table.error
    progress.note(f"the table of the material is off by {off:.2g} % in the mean")
    return shown


def seen_from(shown: Shown, azimuth: float, elevation: float, size: int) -> SurfaceView:
    """Trace what the page's camera sees: a distant viewer, in radians, of so many pixels a side."""
    cosine = math.cos(elevation)
    towards = np.array(
        [cosine * math.cos(azimuth), cosine * math.sin(azimuth), math.sin(elevation)]
    )
    pose = look_at(
        shown.center + 4 * shown.radius * towards, shown.center, np.array([0.0, 0.0, 1.0])
    )
    scale = 2 * MARGIN * shown.radius / size
    return observe(Orthographic(size, size, pose, scale=scale), shown.shape)


def rendered(shown: Shown, view: SurfaceView) -> Float[np.ndarray, "row column 3"]:
    """Render what the page shows by the exact integral, as the page does: without shadows."""
    nodes = shown.light.nodes
    model = ExactForward(LightNodes(*(np.asarray(part) for part in nodes)))
    if shown.subject is not None:
        return shown.subject.image(view, model)
    return np.asarray(np.broadcast_to(render_view(shown.brdf, view, model), (*view.hit.shape, 3)))


class Facts(NamedTuple):
    """What a page says beside what it shows; ``digest`` tells which result it is of."""

    title: str
    digest: str
    summary: dict[str, Any]
    recovered: bool
    gallery: Gallery | None


def _page(run: FinishedRun, digest: str, progress: Progress) -> str:
    shown = shown_of(run, progress)
    gallery = gallery_of(run, progress)
    title = run.folder.resolve().name
    return page_of(shown, Facts(title, digest, run.summary, not run.config.knows_light, gallery))


def page_of(shown: Shown, facts: Facts) -> str:
    """Write the page: what is shown as data, and a still picture for browsers that cannot."""
    view = seen_from(shown, _AZIMUTH, _ELEVATION, 2 * _STILL)
    picture = rendered(shown, view)
    exposure = exposure_for(picture[view.hit])
    still = data_uri(with_alpha(exposed(picture, exposure), view.hit.astype(float)))
    sliders = sliders_of(shown.brdf, shown.table, facts.summary)
    gallery = facts.gallery
    scene: dict[str, Any] = {
        "surface": surface_document(shown.shape, shown.texture is not None),
        "material": _material_document(shown.table, shown.texture),
        "texture": None if shown.texture is None else shown.texture.document(),
        "false_colours": packed(false_colours()),
        "light": shown.light.document(),
        "sliders": [slider._asdict() for slider in sliders],
        "exposure": exposure,
        "view": [_AZIMUTH, _ELEVATION],
        "margin": MARGIN,
        "photographs": [] if gallery is None else list(gallery.frames),
    }
    said = {key: str(facts.summary.get(key, "")) for key in ("outcome", "meaning")}
    own = {
        "title": facts.title,
        "digest": facts.digest,
        "scene": scene,
        "still": still,
        "sliders": sliders,
        "gallery": gallery,
        "recovered": facts.recovered,
        "texture": shown.texture,
        "false_bar": false_bar(),
        "model": str(facts.summary.get("brdf", {}).get("model", "")),
        "is_convex": shown.shape.is_convex(),
        "error": shown.table.error,
        "harmonics": [(d, m) for d in range(DEGREE + 1) for m in range(-d, d + 1)],
    }
    return html_of(own | said)


def _material_document(table: MaterialTable, texture: PageTexture | None) -> dict[str, Any]:
    """Lay the table out as text: of a lobe without a colour one channel is enough."""
    values = table.logarithms
    grey = bool(np.all(values[..., :3] == values[..., :1]))
    kept = values[..., [0, 3]] if grey else values
    return {
        "logarithms": packed(kept.astype(np.float16)),
        "parts": kept.shape[-1],
        "nodes": list(NODES),
        "middle": MIDDLE,
        "floor": FLOOR,
        "widths": table.widths.tolist(),
        "fitted": table.fitted,
        "ratios": [1.0] if texture is None else texture.ratios.tolist(),
        "weighted": table.weighted,
        "base": table.base.tolist(),
        "lobe": table.lobe.tolist(),
    }
