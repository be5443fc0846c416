"""``jaxrender view``: a finished result as one page to turn and to light."""

import re
from pathlib import Path

from jaxrender.brdf import Parametric
from jaxrender.errors import InputError
from jaxrender.geometry import Mesh
from jaxrender.io.atomic import replacing
from jaxrender.io.exports import Atlas
from jaxrender.pipelines.exporting.contents import contents_of
from jaxrender.pipelines.output import fingerprint
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.render import light_of_run
from jaxrender.pipelines.result import RESULT, FinishedRun, read_run
from jaxrender.pipelines.scene import input_files, shape_of
from jaxrender.pipelines.subject import CorrectedSubject, UniformSubject
from jaxrender.pipelines.tasks import task_named
from jaxrender.pipelines.tasks.texture.metallic import MetallicSubject
from jaxrender.pipelines.tasks.texture.subject import TexturedSubject
from jaxrender.pipelines.view.layout import Facts, values_of
from jaxrender.pipelines.view.light import page_light
from jaxrender.pipelines.view.page import html_of
from jaxrender.pipelines.view.pictures import gallery_of
from jaxrender.pipelines.view.shown import Shown, shown_as
from jaxrender.pipelines.view.surface import refuse_large
from jaxrender.pipelines.view.texture import MOST_TEXELS, page_texture

PAGE = "view.html"
_MARK = re.compile(r'<meta name="jaxrender-view" content="([0-9a-f]{64})">')
# What a page that is ours holds within so many of its first characters.
_HEAD = 4096


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
    if isinstance(subject, TexturedSubject | MetallicSubject):
        maps, atlas = contents_of(run).contents.maps, None
        assert maps is not None
        if maps.of_vertices:
            assert isinstance(shape, Mesh)
            refuse_large(shape)
            with progress.stage("lay out"):
                atlas = Atlas.of(shape, MOST_TEXELS)
            shape = atlas.mesh
            rows, columns = atlas.vertex.shape
            progress.note(
                f"the texture is one of vertices; the page has it in {columns} x {rows} texels, "
                f"{atlas.density:.2g} to an edge"
            )
        texture, brdf = page_texture(run, maps, atlas), maps.mean
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
    if isinstance(subject, TexturedSubject | MetallicSubject):
        assert isinstance(brdf, Parametric)
        shown = shown_as(brdf, float(brdf.width), found, shape, texture, subject)
    else:
        shown = shown_as(brdf, width, found, shape)
    off = 100 * shown.table.error
    progress.note(f"the table of the material is off by {off:.2g} % in the mean")
    return shown


def _page(run: FinishedRun, digest: str, progress: Progress) -> str:
    shown = shown_of(run, progress)
    gallery = gallery_of(run, progress)
    title = run.folder.resolve().name
    facts = Facts(title, digest, run.summary, not run.config.knows_light, gallery)
    return html_of(values_of(shown, facts))
