"""The material, shape, light and cameras of a finished run, for any format to write."""

from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender import brdf as brdfs
from jaxrender.brdf import BRDF
from jaxrender.errors import InputError
from jaxrender.geometry import Shape, Sphere
from jaxrender.harmonics import LatLongGrid
from jaxrender.inverse.brdf_spectrum import HarmonicBRDF
from jaxrender.io.captures import Frame
from jaxrender.io.exports import Contents, MaterialMaps, MetallicMaps, plain_name
from jaxrender.lighting import DirectionalSources, Environment, PointSources
from jaxrender.pipelines.brdf_sources import source_of
from jaxrender.pipelines.captures import captures_of, joined
from jaxrender.pipelines.render import light_of_run
from jaxrender.pipelines.render_brdf import Stage, frames_of
from jaxrender.pipelines.result import RESULT, FinishedRun
from jaxrender.pipelines.scene import shape_of
from jaxrender.pipelines.tasks import task_named
from jaxrender.pipelines.tasks.texture.metallic import MetallicSubject
from jaxrender.pipelines.tasks.texture.subject import TexturedSubject

_CHANNELS = 3
# The white light that a BRDF by itself is shown in.
_ROWS = 16


class Held(NamedTuple):
    """The contents of a run, and what every format loses of it."""

    contents: Contents
    losses: tuple[str, ...]


class Alone(NamedTuple):
    """A BRDF by itself, as a scene: on a ball of radius 1, in white light of radiance 1."""

    held: Held
    said: tuple[str, ...]


def contents_of_source(named: str) -> Alone:
    """Put a source of ``brdf_sources`` on a ball; ``InputError`` where it cannot be read."""
    source, grid = source_of(named), LatLongGrid(_ROWS, 2 * _ROWS)
    ball, white = Sphere(np.zeros(3), 1.0), Environment(np.ones((*grid.shape, _CHANNELS)))
    brdf = source.colours
    if isinstance(brdf, brdfs.Recoloured) and not np.ptp(brdf.weights):
        # A model of one channel has its numbers in all three.
        brdf = _spread(brdf)
    cameras = frames_of(Stage(Path(source.name)), ball)
    said = tuple(f"{source.name}: {sentence}" for sentence in source.said)
    shown = "shown on a ball of radius 1 in white light, which it does not bring itself"
    return Alone(
        Held(Contents(plain_name(source.name), brdf, ball, white, cameras=cameras), ()),
        (*said, shown),
    )


def _spread(brdf: brdfs.Recoloured) -> BRDF:
    """Repeat the amplitudes of a model of one channel; others stay as they are."""
    own = brdf.brdf
    if not isinstance(own, brdfs.Parametric):
        return brdf
    return own.with_amplitudes(*(np.repeat(np.asarray(one), _CHANNELS) for one in own.amplitudes))


def contents_of(run: FinishedRun) -> Held:
    """Gather what a run holds.

    Raises ``InputError`` for files that have gone, and for a summary that lacks what this version
    writes.
    """
    try:
        return _contents(run)
    except KeyError as error:
        made = run.summary.get("provenance")
        version = made.get("jaxrender") if isinstance(made, dict) else None
        raise InputError(
            f"{run.folder / RESULT}: no key {error}; it is of an older version "
            f"({version or 'unknown'}), or damaged: make the result anew with fit --force"
        ) from None


def _contents(run: FinishedRun) -> Held:
    geometry = run.config.capture.geometry
    shape: Shape | None = None if geometry is None else shape_of(geometry)
    losses: list[str] = []
    light = _light(run, shape, losses)
    cameras: tuple[Frame, ...] = joined(
        [one.capture for one in captures_of(run.config, require_images=False)]
    ).frames
    if run.summary.get("gains"):
        losses.append("the gains of single photographs: one exposure serves all cameras")
    maps = None
    if run.config.task == "texture" and shape is not None:
        maps = _maps(run, shape, losses)
    name = run.folder.resolve().name
    return Held(
        Contents(
            name,
            _material(run),
            shape,
            light.environment,
            light.sources,
            cameras,
            maps,
            light.points,
        ),
        tuple(losses),
    )


def _maps(run: FinishedRun, shape: Shape, losses: list[str]) -> MaterialMaps | MetallicMaps:
    """Read a texture of texels or vertices."""
    subject = task_named(run.config.task).subject(run, shape)
    if isinstance(subject, MetallicSubject):
        return _metallic_maps(subject)
    assert isinstance(subject, TexturedSubject)
    _refuse_other_channels(run, subject.kd.shape[1])
    if len(subject.lobes) > 1 and subject.sigma is None:
        losses.append("the index of each region: that of the sharpest serves all")
    sharpest, seen = subject.lobe, np.any(subject.kd > 0, axis=1)
    assert isinstance(sharpest, brdfs.Microfacet)
    mean = sharpest.with_amplitudes(
        subject.kd[seen].mean(axis=0), np.broadcast_to(subject.ks[seen].mean(axis=0), _CHANNELS)
    )
    sigma = subject.sigma
    if sigma is None and len(subject.lobes) > 1:
        widths = np.array([float(lobe.sigma) for lobe in subject.lobes])
        sigma = widths[np.maximum(subject.region, 0)]
    if sigma is not None:
        mean = mean.with_roughness(float(np.median(sigma[seen])), mean.mu)
    sites = _sites(subject, len(subject.kd))
    ks = subject.ks.reshape(*sites, -1)
    return MaterialMaps(
        mean,
        subject.kd.reshape(*sites, -1),
        ks[..., 0] if ks.shape[-1] == 1 else ks,
        None if sigma is None else sigma.reshape(sites),
        None if subject.normals is None else subject.normals.offset.reshape(*sites, 3),
    )


def _metallic_maps(subject: MetallicSubject) -> MetallicMaps:
    known = {
        name: np.nan_to_num(subject.numbers_of[name], nan=0.0) for name in ("roughness", "metallic")
    }
    seen = subject.seen
    means = {name: jnp.asarray(float(values[seen].mean())) for name, values in known.items()}
    mean = subject.variant.with_numbers(means)
    mean = mean.with_amplitudes(subject.color[seen].mean(axis=0), np.ones(_CHANNELS))
    sites = _sites(subject, len(seen))
    laid = {name: values.reshape(sites) for name, values in known.items()}
    return MetallicMaps(mean, subject.color.reshape(*sites, -1), **laid)


def _sites(subject: TexturedSubject | MetallicSubject, count: int) -> tuple[int, ...]:
    """Find the rows and columns of a texture, or how many vertices there are."""
    return subject.size if subject.size[0] * subject.size[1] == count else (count,)


def _material(run: FinishedRun) -> BRDF | None:
    if run.config.task == "texture":
        return None
    brdf = task_named(run.config.task).brdf(run)
    channels = len(brdf.coupling) if isinstance(brdf, HarmonicBRDF) else brdf.amplitudes.shape[1]
    _refuse_other_channels(run, channels)
    if isinstance(brdf, brdfs.Microfacet) and not np.any(brdf.ks):
        return brdfs.Lambertian(np.asarray(brdf.kd))
    return brdf


def _refuse_other_channels(run: FinishedRun, channels: int) -> None:
    if channels != _CHANNELS:
        raise InputError(
            f"{run.folder}: the material has {channels} channels; only RGB can be exported"
        )


class _Lit(NamedTuple):
    """An environment, sources that are far away, and those that have a place."""

    environment: Environment | None
    sources: DirectionalSources
    points: PointSources | None


def _light(run: FinishedRun, shape: Shape | None, losses: list[str]) -> _Lit:
    """Find the light that the photographs were rendered by, its scale applied."""
    light = light_of_run(run, shape).upright
    if light.varies:
        losses.append("the light of all photographs but the first: it differs between them")
    scale = float(run.summary.get("scale", 1.0))
    environment, sources, points = light.environment_of(0), light.far_of(0), light.points_of(0)
    if environment is not None:
        environment = Environment(scale * np.asarray(environment.radiance))
    if points is not None:
        points = PointSources(np.asarray(points.positions), scale * np.asarray(points.intensity))
    scaled = scale * np.asarray(sources.irradiance)
    return _Lit(environment, DirectionalSources(np.asarray(sources.directions), scaled), points)
