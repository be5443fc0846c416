"""The page of a recovered texture: its maps, its marks, and the light if recovered."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from matplotlib import colormaps

from jaxrender.harmonics import LatLongGrid, synthesise
from jaxrender.imaging.display import as_rgb, exposed, exposure_for
from jaxrender.pipelines.report.contents import (
    FramePictures,
    Page,
    Pictures,
    Shown,
    is_lambertian,
)
from jaxrender.pipelines.report.display import (
    Picture,
    data_uri,
    shrunk,
    tone_key,
    tone_mapped,
    with_alpha,
)
from jaxrender.pipelines.report.photographs import gallery
from jaxrender.pipelines.report.wording import counted, percent, shown
from jaxrender.shapes import Float

_LONGEST_SIDE = 400
# Small maps are blown up to about this many pixels, so that browsers do not blur them.
_SMALLEST_SIDE = 256
_COLOURS, _ROWS = "viridis", 64
# The scale of a map of one number ends at this percentile of it.
_WITHIN_PERCENTILE = 98
_CAPTIONS = {
    "kd": "K_d in sRGB, one exposure for all channels",
    "ks": "K_s",
    "kd_error": "relative standard error of K_d, largest of the channels",
    "ks_error": "standard error of K_s",
    "sigma": "sigma",
    "sigma_error": "standard error of sigma",
    "normal": "normal: x, y and z from -1 to 1 as red, green and blue",
    "normal_error": "standard error of the normal, radians",
    "ks_colour_marked": "white: the colour of K_s is unreliable",
    "marks": "marks: red: K_d is unreliable; green: K_s is unreliable; blue or white: not seen",
    "sigma_marked": "white: sigma is unreliable",
    "normal_marked": "white: the normal is unreliable",
}


class Map(NamedTuple):
    """One map as a data URI, with what it shows."""

    picture: str
    caption: str


class TextureContents(NamedTuple):
    """All that the report of a recovered texture shows.

    ``maps`` are kd, ks, kd_error, ks_error (NaN where unknown) and marks, None where sites are
    vertices; ``light`` the coefficients of a light that was recovered as well.
    """

    title: str
    result: dict[str, Any]
    maps: dict[str, Float[np.ndarray, "row column channel"]] | None
    light: Float[np.ndarray, "coefficient channel"] | None
    frames: tuple[FramePictures, ...]

    @property
    def fit(self) -> None:
        """None: the result has all there is."""


def _lobes_alone(contents: TextureContents) -> TextureContents:
    """Drop kd and ks from the table; sigma and mu, too, where each region has its own."""
    brdf = contents.result["brdf"]
    kept = () if "regions" in contents.result else ("sigma", "mu")
    brdf = {name: value for name, value in brdf.items() if name in ("model", *kept)}
    return contents._replace(result={**contents.result, "brdf": brdf})


def texture_page(contents: TextureContents) -> Page:
    """Lay out the page."""
    result, maps = contents.result, _maps(contents)
    sections = {
        "maps": maps,
        "texture": result["texture"],
        "ambiguity": result.get("ambiguity"),
        "regions": [_region(region) for region in result.get("regions", ())],
        "light": _light(contents),
        "lambertian": is_lambertian(contents),
    }
    return Page("texture.html.j2", _lobes_alone(contents), sections, _first(contents, maps))


def _first(contents: TextureContents, maps: tuple[Map, ...]) -> Pictures:
    """Choose maps for the first page; vertices have none, and the prediction stands in."""
    by_caption = {caption: Shown(picture, f"{caption}.") for picture, caption in maps}

    def named(name: str) -> Shown | None:
        return next(
            (one for caption, one in by_caption.items() if caption.startswith(_CAPTIONS[name])),
            None,
        )

    recovered = named("kd")
    if recovered is None:
        predicted = gallery(contents.frames[:1]).frames
        picture = predicted[0].predicted if predicted else None
        recovered = Shown(picture or "", "The prediction of the first photograph.")
    return Pictures(recovered, named("kd_error"), named("marks"))


def _region(region: dict[str, Any]) -> dict[str, str]:
    found = {"name": region["name"], "sites": counted(region["sites"])}
    for name in ("sigma", "mu"):
        pair = region.get(f"{name}_interval90")
        span = "" if pair is None else f" ({shown(pair[0])} to {shown(pair[1])})"
        found[name] = shown(region.get(name)) + span
    return found


def _maps(contents: TextureContents) -> tuple[Map, ...]:
    if contents.maps is None:
        return ()
    maps = contents.maps
    found = [Map(coloured(maps["kd"]), _CAPTIONS["kd"])]
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.max(maps["kd_error"] / maps["kd"], axis=-1, keepdims=True)
    relative = np.where(np.isfinite(relative), relative, np.nan)
    graded = {"ks": maps["ks"], "kd_error": relative, "ks_error": maps["ks_error"]}
    names = ("kd_error",) if is_lambertian(contents) else ("ks", "kd_error", "ks_error")
    if maps["ks"].shape[-1] > 1:
        found.append(Map(coloured(maps["ks"]), f"{_CAPTIONS['ks']} in sRGB, with its colour"))
        graded["ks_error"] = np.max(maps["ks_error"], axis=-1, keepdims=True)
        names = names[1:]
    if "sigma" in maps:
        graded |= {name: maps[name] for name in ("sigma", "sigma_error")}
        names = (*names, "sigma", "sigma_error")
    if "normal" in maps:
        found.append(Map(_coded((1 + maps["normal"]) / 2), _CAPTIONS["normal"]))
        graded["normal_error"], names = maps["normal_error"], (*names, "normal_error")
    for name in names:
        uri, top = graded_map(graded[name])
        scale = percent(top) if name == "kd_error" else shown(top, 3)
        found.append(Map(uri, f"{_CAPTIONS[name]}; dark 0, yellow {scale}"))
    for name in ("marks", "sigma_marked", "normal_marked", "ks_colour_marked"):
        if name in maps:
            marks = np.rint(255 * as_rgb(maps[name])).astype(np.uint8)
            found.append(Map(data_uri(enlarged(marks)), _CAPTIONS[name]))
    return tuple(found)


def coloured(image: Picture) -> str:
    """Show linear colours, with one exposure for all channels; a data URI."""
    small = shrunk(np.nan_to_num(image), _LONGEST_SIDE)
    return _transparent(exposed(small, exposure_for(image)), image)


def _coded(image: Picture) -> str:
    """Show numbers from 0 to 1 as they are, as programs that read normal maps do."""
    known = np.isfinite(image).all(axis=-1, keepdims=True)
    small = shrunk(np.nan_to_num(image), _LONGEST_SIDE)
    share = np.maximum(shrunk(known.astype(float), _LONGEST_SIDE), 1e-6)
    return _transparent(np.rint(255 * np.clip(small / share, 0, 1)).astype(np.uint8), image)


def _transparent(codes: np.ndarray, image: Picture) -> str:
    """Enlarge a small picture, which is transparent where nothing is known."""
    known = np.asarray(np.isfinite(image).all(axis=-1))
    opacity = shrunk(known[..., None].astype(float), _LONGEST_SIDE)[..., 0]
    return data_uri(enlarged(with_alpha(codes, opacity)))


def graded_map(image: Float[np.ndarray, "row column 1"]) -> tuple[str, float]:
    """Show one number from dark 0 to yellow; a data URI, and what yellow stands for."""
    finite = image[np.isfinite(image)]
    top = float(np.percentile(finite, _WITHIN_PERCENTILE)) if finite.size else 1.0
    top = top if top > 0 else 1.0
    small = shrunk(np.nan_to_num(image), _LONGEST_SIDE)[..., 0]
    opacity = shrunk(np.where(np.isfinite(image), 1.0, 0.0), _LONGEST_SIDE)[..., 0]
    colours = colormaps[_COLOURS](np.clip(small / np.maximum(opacity, 1e-6) / top, 0, 1))
    codes = np.rint(255 * colours[..., :3]).astype(np.uint8)
    return data_uri(enlarged(with_alpha(codes, opacity))), top


def enlarged(codes: np.ndarray) -> np.ndarray:
    """Repeat the texels of a small map."""
    times = max(1, _SMALLEST_SIDE // max(codes.shape[:2]))
    return np.repeat(np.repeat(codes, times, axis=0), times, axis=1)


def _light(contents: TextureContents) -> str | None:
    if contents.light is None:
        return None
    image = synthesise(LatLongGrid(_ROWS, 2 * _ROWS), jnp.asarray(contents.light))
    radiance = np.maximum(np.asarray(image), 0)
    return data_uri(tone_mapped(radiance, tone_key(radiance)))
