"""Maps of a texture as a page holds them: numbers of 8 bits, relative to the mean of all texels.

The page's sliders are those of the mean texel, so that they change all texels alike.  Colours are
kept in sRGB, which has fine steps where it is dark; widths evenly in their logarithm.  Errors are
kept coarser: they are shown, and nothing is made of them.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import UInt8

from jaxrender.brdf import Microfacet
from jaxrender.imaging.display import codes as whole
from jaxrender.imaging.response import SRGB
from jaxrender.io.exports import Atlas, MaterialMaps, MetallicMaps
from jaxrender.io.netcdf import opened
from jaxrender.pipelines.result import ARRAYS, ARRAYS_FORMAT, FinishedRun
from jaxrender.pipelines.view.packing import packed
from jaxrender.shapes import Bool, Float

# The most rows or columns of a map, and of a map of errors.
MOST_TEXELS, _MOST_OF_ERRORS = 512, 256
# Widths of neighbouring reflection maps, and the most of these.
_STEP, _MOST_LAYERS = 1.35, 6
# A code of an overlay that stands for a texel which nobody saw.
UNKNOWN = 255
_ERRORS = ("kd", "ks", "sigma", "normal", "base_color", "metallic", "roughness")
_PERCENTILE, _TINY = 98, 1e-12
# Overlays that are kept as fine as the maps, from their least number.
_FINE = ("sigma", "roughness", "metallic")


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


class PageMaps(NamedTuple):
    """What every texel has: an amount of the base, one of the lobes, perhaps a width and a normal.

    ``means`` are the amounts and the width of all seen texels.
    """

    means: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], float]
    base: Float[np.ndarray, "row column 3"]
    lobe: Float[np.ndarray, "row column channel"]
    width: Float[np.ndarray, "row column"] | None
    offset: Float[np.ndarray, "row column 3"] | None
    seen: Bool[np.ndarray, "row column"]

    @classmethod
    def of(cls, maps: MaterialMaps | MetallicMaps) -> "PageMaps":
        """Take the maps of K_d and K_s, or of a base colour and metalness."""
        if isinstance(maps, MetallicMaps):
            width = float(maps.mean.width)
            metal = np.full(3, float(maps.mean.metallic))
            means = np.asarray(maps.mean.base_color, float), metal, width
            share = maps.metallic[..., None]
            return cls(means, maps.base_color, share, maps.roughness**2, None, maps.seen)
        assert isinstance(maps.mean, Microfacet)
        kd, ks = np.asarray(maps.mean.amplitudes, float)
        means = kd, ks, float(maps.mean.width)
        return cls(means, maps.kd, maps.coloured_ks, maps.sigma, maps.offset, maps.seen)

    def coarser(self, step: int) -> "PageMaps":
        """Average blocks of so many texels a side."""
        return self._replace(**{
            name: _coarser(np.nan_to_num(values), step)
            for name in ("base", "lobe", "width", "offset")
            if (values := getattr(self, name)) is not None
        })  # fmt: skip


class PageTexture(NamedTuple):
    """The maps of a page; ``ratios`` are the widths of its reflection maps over the mean's."""

    maps: PageMaps
    ratios: Float[np.ndarray, "layer"]
    overlays: tuple[Overlay, ...]
    metal: bool = False

    @property
    def choices(self) -> dict[str, str]:
        """What can be shown in the place of the object, by its name in the scripts."""
        plain = {"picture": "the object in the light", "kd": "its colour, π K_d"}
        if self.metal:
            plain["kd"] = "its base colour"
        else:
            plain["ks"] = "its highlights, K_s"
        if self.maps.offset is not None:
            plain["normals"] = "its normals"
        return plain | {one.id: one.label for one in self.overlays}

    def document(self) -> dict[str, Any]:
        """Lay it out as text."""
        maps, (base, lobe, width) = self.maps, self.maps.means
        found: dict[str, Any] = {
            "kd": _colours(maps.base / np.maximum(base, _TINY)),
            "ks": _colours(maps.lobe / np.maximum(lobe[: maps.lobe.shape[-1]], _TINY)),
            "overlays": [one._asdict() | {"codes": packed(one.codes)} for one in self.overlays],
        }
        if maps.width is not None:
            share = np.zeros(maps.width.shape)
            if len(self.ratios) > 1:
                log = np.log(np.maximum(maps.width, _TINY) / width)
                low, high = np.log(self.ratios[[0, -1]])
                share = np.clip((log - low) / (high - low), 0, 1)
            found["sigma"] = packed(np.rint(255 * share).astype(np.uint8))
        if maps.offset is not None:
            most = max(float(np.abs(maps.offset).max()), _TINY)
            codes = np.rint(128 + 127 * maps.offset / most).astype(np.uint8)
            found["offset"] = {"codes": packed(codes), "scale": most}
        return found


def page_texture(
    run: FinishedRun, found: MaterialMaps | MetallicMaps, atlas: Atlas | None = None
) -> PageTexture:
    """Make the maps of a page; an ``atlas`` lays those of vertices out in texels."""
    stated = _stated(run)
    if atlas is not None:
        found = atlas.baked_maps(found)
        stated = {name: atlas.baked(values) for name, values in stated.items()}
    maps = PageMaps.of(found)
    ratios = np.ones(1)
    if maps.width is not None:
        ends = np.percentile(maps.width[maps.seen], [0, 100]) / maps.means[2]
        layers = 1 + int(np.ceil(np.log(ends[1] / ends[0]) / np.log(_STEP)))
        ratios = ends[:1]
        if layers > 1:
            ratios = np.geomspace(ends[0], ends[1], min(layers, _MOST_LAYERS))
    metal = isinstance(found, MetallicMaps)
    overlays = _metal_overlays(stated, found) if metal else _overlays(stated, found)
    step = -(-max(maps.base.shape[:2]) // MOST_TEXELS)
    if step > 1:
        maps = maps.coarser(step)
    if maps.offset is not None:
        maps = maps._replace(offset=np.nan_to_num(maps.offset))
    return PageTexture(maps, ratios, overlays, metal)


def _stated(run: FinishedRun) -> dict[str, Float[np.ndarray, "*site_channel"]]:
    """Read the errors of what was found; none are there in results without them."""
    with opened(run.folder / ARRAYS, ARRAYS_FORMAT) as file:
        group = file.group("texture")
        return {name: group.array(f"{name}_error") for name in _ERRORS if f"{name}_error" in group}


def _relative(
    errors: Float[np.ndarray, "row column channel"], values: Float[np.ndarray, "row column channel"]
) -> Float[np.ndarray, "row column"]:
    """The largest error of a colour relative to its channel, in per cent."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return 100 * np.max(errors / values, axis=-1)


def _metal_overlays(
    errors: dict[str, Float[np.ndarray, "row column *channel"]], maps: MetallicMaps
) -> tuple[Overlay, ...]:
    """Show metalness and roughness, and how well all is known."""
    found = [
        _overlay(name, label, "", np.where(maps.seen, values, np.nan))
        for name, label, values in (
            ("metallic", "Metalness", maps.metallic),
            ("roughness", "Roughness", maps.roughness),
        )
    ]
    if "base_color" in errors:
        relative = _relative(errors["base_color"], maps.base_color)
        found.append(_overlay("color-error", "Standard deviation of the colour", " %", relative))
    for name, label in (("metallic", "metalness"), ("roughness", "roughness")):
        if name in errors:
            label = f"Standard deviation of {label}"
            found.append(_overlay(f"{name}-error", label, "", errors[name]))
    return tuple(found)


def _overlays(
    errors: dict[str, Float[np.ndarray, "row column *channel"]], maps: MaterialMaps
) -> tuple[Overlay, ...]:
    """Show sigma, and how well all is known."""
    found = []
    if maps.sigma is not None:
        sigma = np.where(maps.seen, maps.sigma, np.nan)
        found.append(_overlay("sigma", "Roughness sigma", "", sigma))
    if "kd" in errors:
        relative = _relative(errors["kd"], maps.kd)
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
    step = -(-max(values.shape) // (MOST_TEXELS if id in _FINE else _MOST_OF_ERRORS))
    values = np.where(np.isfinite(values), values, np.nan)
    if step > 1:
        known = np.isfinite(values)
        share = _coarser(known.astype(float), step)
        sums = _coarser(np.where(known, values, 0.0), step)
        values = np.where(share > 0, sums / np.maximum(share, _TINY), np.nan)
    known = np.isfinite(values)
    low, high = (0.0, 0.0) if not known.any() else np.percentile(values[known], [0, _PERCENTILE])
    low = float(low) if id in _FINE else 0.0
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
