"""A probe prefiltered: nine coefficients for diffuse surfaces, a reflection map for each lobe.

The map of a lobe shows it head-on.  On request a spherical harmonic reflection map (T 5) goes with
it, whose texels depend on the viewer.  Python makes one from any light and any isotropic BRDF::

    spectrum = central_spectrum_of(brdf, (24, 4), weighted=True)  # jaxrender.spectra
    shrm = global_shrm(local_shrm(light, spectrum, LatLongGrid(240, 480)))  # jaxrender.reflection
    picture = shrm.at(samples.reflected, samples.outgoing)  # or shrm.dynamic_map(viewer)
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxrender.errors import InputError
from jaxrender.harmonics import (
    WINDOWS,
    LatLongGrid,
    analyse,
    apply_transfer,
    degrees,
    evaluate,
    orders,
    ringing,
    window_named,
)
from jaxrender.io import read_environment, write_image
from jaxrender.io.jsonfiles import read_json
from jaxrender.lighting import Environment
from jaxrender.lighting.layouts import Cross, panorama_named
from jaxrender.pipelines.lobe_orders import OrdersGoal
from jaxrender.pipelines.lobes import Lobe, significant_degree
from jaxrender.pipelines.output import FolderState, fingerprint_of, prepare, result_folder
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.reflection_maps import (
    LightSpectrum,
    check_lobes,
    reflection_map,
)
from jaxrender.pipelines.shrm_files import read_about, write_shrm
from jaxrender.pipelines.shrm_layout import ReflectionMap, ShrmAbout
from jaxrender.pipelines.source_lobes import files_of_lobes, lobe_named
from jaxrender.reflection import irradiance_matrix, reflection_maps
from jaxrender.shapes import Float

DEFAULT_LOBES = (
    "lambertian",
    *(f"microfacet:sigma={sigma}" for sigma in (0.05, 0.1, 0.2, 0.4)),
)
NO_WINDOW = "none"
_QUADRATIC = 2
# Texels of a map and of a cube's face per degree of the lobe, and the least of either.
_ROWS_PER_DEGREE = 4
_LEAST_ROWS = 32
_POINTS_AT_ONCE = 1 << 14


class Prefiltered(NamedTuple):
    """The written folder, and the coefficients in it."""

    folder: Path
    coefficients: Float[np.ndarray, "9 channel"]
    reflection: tuple[str, ...] = ()
    """A sentence for each spherical harmonic reflection map: what it keeps and what it loses."""


def prefilter(
    probe: Path,
    out: Path,
    convention: str = "z-up",
    axes: str = "probe",
    brdfs: Sequence[str] = DEFAULT_LOBES,
    force: bool = False,
    progress: Progress | None = None,
    shrm: OrdersGoal | None = None,
    window: str = NO_WINDOW,
) -> Prefiltered:
    """Write ``irradiance.json``, a map for each lobe (lat-long and cube) and a contact sheet.

    ``shrm`` asks for a spherical harmonic reflection map of each lobe, and states its degrees.
    ``window`` removes the ringing of truncated lobes.  Raises ``InputError`` for an unusable probe,
    and for unknown lobes and windows.
    """
    progress = progress or SilentProgress()
    if window not in (NO_WINDOW, *WINDOWS):
        raise InputError(f"--window {window}: choose one of {', '.join((NO_WINDOW, *WINDOWS))}")
    lobes = [lobe_named(specification) for specification in dict.fromkeys(brdfs)]
    for sentence in dict.fromkeys(said for lobe in lobes for said in lobe.said):
        progress.note(sentence)
    asked = [] if shrm is None else [shrm]
    if shrm is not None:
        shrm.check()
        check_lobes(lobes)
    settings = json.dumps(
        [convention, axes, [lobe.specification for lobe in lobes], window, *asked]
    )
    try:
        digest = fingerprint_of("prefilter", settings, [probe, *files_of_lobes(lobes)])
        if prepare(out, digest, force) is FolderState.FINISHED:
            progress.note(f"{out}: prefiltered before; reused (--force: anew)")
            document = read_json(out / "irradiance.json")
            found = [_said(lobe, read_about(_shrm_path(out, lobe))) for lobe in lobes if asked]
            return Prefiltered(out, np.array(document["coefficients"]), tuple(found))
        with progress.stage("read"):
            light = read_environment(probe, convention, axes=axes)
            if shrm is not None:
                shrm.check(light.grid.band_limit)
    except ValueError as error:
        raise InputError(str(error)) from None
    with progress.stage("filter"):
        grid, radiance = light.grid, np.asarray(light.radiance)
        if grid.band_limit < _QUADRATIC:
            raise InputError(
                f"{probe}: {radiance.shape[1]} x {radiance.shape[0]} texels carry degree "
                f"{grid.band_limit}, and irradiance needs degree 2; give a probe of 6 or more rows"
            )
        coefficients = np.asarray(analyse(grid, radiance, _QUADRATIC))
        transfers = [_transfer_of(light, lobe, window, progress) for lobe in lobes]
        maps = [_maps_of(light, transfer) for transfer in transfers]
        about = ShrmAbout(probe.name, "", axes=axes, convention=convention)
        try:
            reflection = [] if shrm is None else _reflection(light, lobes, shrm, about, window)
        except InputError:
            raise
        except ValueError as error:
            raise InputError(f"{probe}: {error}") from None
    with progress.stage("write"), result_folder(out, digest, force) as folder:
        document = irradiance_document(coefficients, convention, axes, probe.name)
        text = json.dumps(document, indent=2)
        (folder / "irradiance.json").write_text(text + "\n", encoding="utf-8")
        for lobe, (latlong, cube) in zip(lobes, maps):
            write_image(folder / f"{lobe.file_name}.exr", latlong)
            write_image(folder / f"{lobe.file_name}_cube.exr", cube)
        from jaxrender.pipelines.contact_sheet import write_contact_sheet

        pictures = {"the probe": radiance}
        pictures |= {lobe.specification: latlong for lobe, (latlong, _) in zip(lobes, maps)}
        write_contact_sheet(folder / "contact_sheet.png", pictures, f"{probe.name}, {axes} axes")
        for lobe, found in zip(lobes, reflection):
            _write_reflection(folder, lobe, found)
    said = [_said(lobe, found.about) for lobe, found in zip(lobes, reflection)]
    return Prefiltered(out, coefficients, tuple(said))


def irradiance_document(
    coefficients: Float[np.ndarray, "9 channel"], convention: str, axes: str, source: str
) -> dict:
    """Arrange the nine coefficients and the matrices of T 4.15 for ``irradiance.json``."""
    matrices = np.asarray(irradiance_matrix(coefficients))
    order = [f"{n}{m}" for n, m in zip(degrees(_QUADRATIC), orders(_QUADRATIC))]
    return {
        "source": source,
        "convention": convention,
        "axes": axes,
        "units": "radiance; N' M N is irradiance, times albedo / pi the radiance reflected",
        "order": order,
        "coefficients": coefficients.tolist(),
        "matrix": matrices.tolist(),
    }


def _transfer_of(
    light: Environment, lobe: Lobe, window: str, progress: Progress
) -> Float[np.ndarray, "degree channel"]:
    """Truncate a lobe where it or the probe ends, and apply the window.

    Channels share the window that their mean asks for.
    """
    most = light.grid.band_limit
    transfer = lobe.transfers(most)
    # A lobe sharper than the probe passes all degrees of the probe.
    significant = max(significant_degree(channel) for channel in transfer.T)
    transfer = transfer[: min(max(significant, 1), most) + 1]
    if window == NO_WINDOW:
        return transfer
    mean = transfer.mean(axis=1)
    weights = np.asarray(window_named(window, mean))
    after = transfer * weights[:, None]
    before, now = (100 * ringing(values) for values in (mean, mean * weights))
    progress.note(
        f"{lobe.specification}: degree {len(transfer) - 1}, lowest value {before:.2g} % of the "
        f"peak; through the window {window} {now:.2g} %"
    )
    return after


def _maps_of(
    light: Environment, transfer: Float[np.ndarray, "degree channel"]
) -> tuple[np.ndarray, np.ndarray]:
    """Filter the light by one lobe: as a latitude-longitude image and as the cross of a cube."""
    grid, radiance = light.grid, np.asarray(light.radiance)
    band_limit = len(transfer) - 1
    transfer = np.broadcast_to(transfer, (len(transfer), radiance.shape[2]))
    rows = min(grid.height, max(_LEAST_ROWS, _ROWS_PER_DEGREE * band_limit))
    latlong = reflection_maps(radiance, transfer[None], LatLongGrid(rows, 2 * rows))[0]
    filtered = apply_transfer(analyse(grid, radiance, band_limit), jnp.asarray(transfer))
    layout, height = Cross(), 4 * (rows // 2)
    directions = layout.directions(height)
    cube = np.zeros((*directions.shape[:2], radiance.shape[2]))
    covered = layout.covers(height)
    wanted = directions[covered]
    values = [
        np.asarray(evaluate(filtered, jnp.asarray(wanted[first : first + _POINTS_AT_ONCE])))
        for first in range(0, len(wanted), _POINTS_AT_ONCE)
    ]
    cube[covered] = np.concatenate(values)
    return np.asarray(latlong), cube


def _reflection(
    light: Environment, lobes: Sequence[Lobe], goal: OrdersGoal, about: ShrmAbout, window: str
) -> list[ReflectionMap]:
    spectrum, named = LightSpectrum.of(light), None if window == NO_WINDOW else window
    return [reflection_map(spectrum, lobe, goal, about, named) for lobe in lobes]


def _write_reflection(folder: Path, lobe: Lobe, found: ReflectionMap) -> None:
    """Write a map, and pictures of a sphere that is shaded by it."""
    from jaxrender.pipelines.sphere_views import write_sphere_views

    shrm, about = found
    write_shrm(_shrm_path(folder, lobe), shrm, about)
    own_from_world = panorama_named(about.convention).world_from_own.T
    up = (own_from_world if about.axes == "probe" else np.eye(3))[:, 2]
    title = f"{about.source}, {lobe.specification}: F {shrm.band_limit}, P {shrm.order}"
    is_diffuse = about.central_direction == "normal"
    path = _shrm_path(folder, lobe).with_suffix(".png")
    write_sphere_views(path, shrm, title, about_normal=is_diffuse, up=up)


def _shrm_path(folder: Path, lobe: Lobe) -> Path:
    return folder / f"{lobe.file_name}_shrm.nc"


def _said(lobe: Lobe, about: ShrmAbout) -> str:
    return f"{_shrm_path(Path(), lobe)}: {about.comment}"
