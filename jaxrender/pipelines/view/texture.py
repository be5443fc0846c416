"""Maps of a texture as a page holds them: numbers of 8 bits, relative to the mean of all texels.

The page's sliders are those of the mean texel, so that they change all texels alike.  Colours are
kept in sRGB, which has fine steps where it is dark; widths evenly in their logarithm.  Errors are
kept coarser: they are shown, and nothing is made of them.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import UInt8

from jaxrender.brdf import Microfacet
from jaxrender.errors import InputError
from jaxrender.imaging.display import codes as whole
from jaxrender.imaging.response import SRGB
from jaxrender.io.exports import MaterialMaps
from jaxrender.io.netcdf import opened
from jaxrender.pipelines.result import ARRAYS, ARRAYS_FORMAT, FinishedRun
from jaxrender.pipelines.view.packing import packed
from jaxrender.shapes import Float

# The most rows or columns of a map, and of a map of errors.
MOST_TEXELS, _MOST_OF_ERRORS = 512, 256
# Widths of neighbouring reflection maps, and the most of these.
_STEP, _MOST_LAYERS = 1.35, 6
# A code of an overlay that stands for a texel which nobody saw.
UNKNOWN = 255
_PERCENTILE, _TINY = 98, 1e-12


class Overlay(NamedTuple):
    """A map in false colours: what it shows, and the numbers at the ends of the scale."""

    id: str
    label: str
    low: float
    high: float
    unit: str
    codes: UInt8[np.ndarray, "row column"]

    @property
    def scale(self) -> tuple[str, str]:
        """The ends of the scale in words."""
        return f"{self.low:.3g}{self.unit}", f"{self.high:.3g}{self.unit}"


class PageTexture(NamedTuple):
    """The maps of a page; ``ratios`` are the widths of its reflection maps over the mean's."""

    maps: MaterialMaps
    ratios: Float[np.ndarray, "layer"]
    overlays: tuple[Overlay, ...]

    @property
    def choices(self) -> dict[str, str]:
        """What can be shown in the place of the object, by its name in the scripts."""
        plain = {"picture": "the object in the light", "kd": "its colour, π K_d"}
        plain["ks"] = "its highlights, K_s"
        if self.maps.offset is not None:
            plain["normals"] = "its normals"
        return plain | {one.id: one.label for one in self.overlays}

    def document(self) -> dict[str, Any]:
        """Lay it out as text."""
        maps, (kd, ks) = self.maps, self.maps.mean.amplitudes
        found: dict[str, Any] = {
            "kd": _colours(maps.kd / np.maximum(np.asarray(kd, float), _TINY)),
            "ks": _colours(maps.coloured_ks / np.maximum(np.asarray(ks, float), _TINY)),
            "overlays": [one._asdict() | {"codes": packed(one.codes)} for one in self.overlays],
        }
        if maps.sigma is not None:
            assert isinstance(maps.mean, Microfacet)
            share = np.zeros(maps.sigma.shape)
            if len(self.ratios) > 1:
                log = np.log(np.maximum(maps.sigma, _TINY) / float(maps.mean.sigma))
                low, high = np.log(self.ratios[[0, -1]])
                share = np.clip((log - low) / (high - low), 0, 1)
            found["sigma"] = packed(np.rint(255 * share).astype(np.uint8))
        if maps.offset is not None:
            most = max(float(np.abs(maps.offset).max()), _TINY)
            codes = np.rint(128 + 127 * maps.offset / most).astype(np.uint8)
            found["offset"] = {"codes": packed(codes), "scale": most}
        return found


def page_texture(run: FinishedRun, maps: MaterialMaps) -> PageTexture:
    """Make the maps of a page.  Raises ``InputError`` for a texture of vertices, which has none."""
    if maps.of_vertices:
        raise InputError(
            f"{run.folder}: the texture is one of vertices, and a page shows one of texels: give "
            "the mesh texture coordinates and fit again, or use jaxrender render"
        )
    rows, columns = maps.kd.shape[:2]
    ratios = np.ones(1)
    if maps.sigma is not None:
        assert isinstance(maps.mean, Microfacet)
        ends = np.percentile(maps.sigma[maps.seen], [0, 100]) / float(maps.mean.sigma)
        layers = 1 + int(np.ceil(np.log(ends[1] / ends[0]) / np.log(_STEP)))
        ratios = ends[:1]
        if layers > 1:
            ratios = np.geomspace(ends[0], ends[1], min(layers, _MOST_LAYERS))
    overlays = _overlays(run, maps)
    step = -(-max(rows, columns) // MOST_TEXELS)
    if step > 1:
        maps = maps._replace(**{
            name: _coarser(np.nan_to_num(values), step)
            for name in ("kd", "ks", "sigma", "offset")
            if (values := getattr(maps, name)) is not None
        })  # fmt: skip
    if maps.offset is not None:
        maps = maps._replace(offset=np.nan_to_num(maps.offset))
    return PageTexture(maps, ratios, overlays)


def _overlays(run: FinishedRun, maps: MaterialMaps) -> tuple[Overlay, ...]:
    """Read the errors of what was found; none are there in results without them."""
    found = []
    with opened(run.folder / ARRAYS, ARRAYS_FORMAT) as file:
        group = file.group("texture")
        errors = {
            name: group.array(f"{name}_error")
            for name in ("kd", "ks", "sigma", "normal")
            if f"{name}_error" in group
        }
    if maps.sigma is not None:
        sigma = np.where(maps.seen, maps.sigma, np.nan)
        found.append(_overlay("sigma", "Roughness sigma", "", sigma))
    if "kd" in errors:
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = 100 * np.max(errors["kd"] / maps.kd, axis=-1)
        found.append(_overlay("kd-error", "Standard deviation of K_d", " %", relative))
    if "ks" in errors:
        ks = errors["ks"].reshape(*maps.kd.shape[:2], -1).max(axis=-1)
        found.append(_overlay("ks-error", "Standard deviation of K_s", "", ks))
    if "sigma" in errors:
        found.append(_overlay("sigma-error", "Standard deviation of sigma", "", errors["sigma"]))
    if "normal" in errors:
        degrees = np.degrees(errors["normal"])
        found.append(_overlay("normal-error", "Standard deviation of normals", "°", degrees))
    return tuple(found)


def _overlay(id: str, label: str, unit: str, values: Float[np.ndarray, "row column"]) -> Overlay:
    """Code a map from the least to nearly the largest number; unseen texels have a code apart."""
    step = -(-max(values.shape) // (MOST_TEXELS if id == "sigma" else _MOST_OF_ERRORS))
    values = np.where(np.isfinite(values), values, np.nan)
    if step > 1:
        known = np.isfinite(values)
        share = _coarser(known.astype(float), step)
        sums = _coarser(np.where(known, values, 0.0), step)
        values = np.where(share > 0, sums / np.maximum(share, _TINY), np.nan)
    known = np.isfinite(values)
    low, high = (0.0, 0.0) if not known.any() else np.percentile(values[known], [0, _PERCENTILE])
    low = float(low) if id == "sigma" else 0.0
    share = np.clip((np.nan_to_num(values) - low) / max(float(high) - low, _TINY), 0, 1)
    codes = np.where(known, np.rint((UNKNOWN - 1) * share), UNKNOWN).astype(np.uint8)
    return Overlay(id, label, low, float(high), unit, codes)


def _colours(ratios: Float[np.ndarray, "row column channel"]) -> dict[str, Any]:
    scale = max(float(ratios.max()), _TINY)
    codes = whole(SRGB().encode(np.clip(ratios / scale, 0, 1)))
    return {"codes": packed(codes), "scale": scale, "channels": int(ratios.shape[-1])}


def _coarser(values: np.ndarray, step: int) -> np.ndarray:
    """Average blocks of texels; at the far border the last ones are repeated."""
    more = [(0, -size % step) for size in values.shape[:2]]
    padded = np.pad(values, [*more, *[(0, 0)] * (values.ndim - 2)], mode="edge")
    rows, columns = (size // step for size in padded.shape[:2])
    return padded.reshape(rows, step, columns, step, *values.shape[2:]).mean(axis=(1, 3))
