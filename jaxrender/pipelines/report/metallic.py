"""The page of recovered maps of glTF's material."""

import numpy as np

from jaxrender.imaging.display import as_rgb
from jaxrender.pipelines.report.contents import Page, Pictures, Shown
from jaxrender.pipelines.report.display import data_uri
from jaxrender.pipelines.report.photographs import gallery
from jaxrender.pipelines.report.texture import (
    Map,
    TextureContents,
    coloured,
    enlarged,
    graded_map,
)
from jaxrender.pipelines.report.wording import percent, shown
from jaxrender.shapes import Float

_NUMBERS = {"roughness": "roughness", "metallic": "metalness"}
_COLOUR = "base colour in sRGB, one exposure for all channels"
_ERROR = "relative standard error of the base colour, largest of the channels"


def metallic_page(contents: TextureContents) -> Page:
    """Lay out the page."""
    result = contents.result
    brdf = {name: value for name, value in result["brdf"].items() if name in _shared(contents)}
    maps = _maps(contents.maps)
    sections = {"maps": maps, "texture": result["texture"]}
    table = contents._replace(result={**result, "brdf": brdf})
    return Page("metallic.html.j2", table, sections, _first(contents, maps))


def _shared(contents: TextureContents) -> tuple[str, ...]:
    """Name what the table shows: the model, and what is no map."""
    texture = contents.result["texture"]
    return tuple(n for n in contents.result["brdf"] if f"{n}_marked" not in texture)


def _maps(maps: dict[str, Float[np.ndarray, "row column channel"]] | None) -> tuple[Map, ...]:
    if maps is None:
        return ()
    found = [Map(coloured(maps["base_color"]), _COLOUR)]
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.max(maps["base_color_error"] / maps["base_color"], axis=-1, keepdims=True)
    uri, top = graded_map(np.where(np.isfinite(relative), relative, np.nan))
    found.append(Map(uri, f"{_ERROR}; dark 0, yellow {percent(top)}"))
    for name, words in _NUMBERS.items():
        if name in maps:
            for key, said in ((name, words), (f"{name}_error", f"standard error of {words}")):
                uri, top = graded_map(maps[key])
                found.append(Map(uri, f"{said}; dark 0, yellow {shown(top, 3)}"))
    for name, words in {"base_color": "the base colour", **_NUMBERS}.items():
        if f"{name}_marked" in maps:
            found.append(Map(_white(maps[f"{name}_marked"]), f"white: {words} is unreliable"))
    found.append(Map(_white(maps["unseen"]), "white: no photograph shows it"))
    return tuple(found)


def _white(marks: Float[np.ndarray, "row column _"]) -> str:
    return data_uri(enlarged(np.rint(255 * as_rgb(marks)).astype(np.uint8)))


def _first(contents: TextureContents, maps: tuple[Map, ...]) -> Pictures:
    """Choose maps for the first page; vertices have none, and the prediction stands in."""
    named = {caption: Shown(picture, f"{caption}.") for picture, caption in maps}
    if _COLOUR not in named:
        predicted = gallery(contents.frames[:1]).frames
        picture = predicted[0].predicted if predicted else None
        return Pictures(Shown(picture or "", "The prediction of the first photograph."))
    error = next(one for caption, one in named.items() if caption.startswith(_ERROR))
    return Pictures(named[_COLOUR], error, named["white: the base colour is unreliable"])
