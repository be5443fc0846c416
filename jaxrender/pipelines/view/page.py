"""The page: one HTML file with its data, its shaders and its scripts, and no other address.

Its content policy allows the page's own script and style, by their digests, and pictures within the
page.  Nothing is fetched.  A widget shows the object by the same scripts, shaders and markup.
"""

import base64
import hashlib
import json
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

_PACKAGE = "jaxrender.pipelines.view"
# What draws the object wherever it stands, and what else a page and a widget have.
_SHARED = (
    "arrays.js", "material.js", "textures.js", "renderer.js", "viewer.js", "controls.js",
    "opening.js",
)  # fmt: skip
_OF_PAGE = ("photographs.js", "explorer.js", "start.js")
_OF_WIDGET = ("widget.js",)
SHADERS = {
    "table": "table.glsl",
    "square": "square.vert.glsl",
    "map": "map.frag.glsl",
    "mesh": "mesh.vert.glsl",
    "sphere": "sphere.vert.glsl",
    "object": "object.frag.glsl",
}


def html_of(values: dict[str, Any]) -> str:
    """Fill the page's template; every string from outside is escaped."""
    style = _text("page.css")
    script = script_text()
    own = {
        "style": Markup(style),
        "script": Markup(script),
        "style_digest": _digest(style),
        "script_digest": _digest(script),
        "shaders": {name: Markup(text) for name, text in _shaders().items()},
    }
    return _filled("page.html.j2", own | values)


def markup_of(values: dict[str, Any]) -> str:
    """Fill the part of the page that shows the object, for a widget."""
    return _filled("object.html.j2", values)


def script_text() -> str:
    """Put the page's scripts together, closed off from the page's own names."""
    return f'(() => {{\n"use strict";\n{_joined(*_SHARED, *_OF_PAGE)}\n}})();\n'


def module_text() -> str:
    """Put a widget's scripts together, with its shaders and its style, as one module."""
    own = {"SHADERS": _shaders(), "STYLE": _text("page.css")}
    constants = "".join(f"const {name} = {json.dumps(value)};\n" for name, value in own.items())
    return constants + _joined(*_SHARED, *_OF_WIDGET)


def _filled(template: str, values: dict[str, Any]) -> str:
    templates = Environment(
        loader=PackageLoader(_PACKAGE, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return templates.get_template(template).render(values)


def _shaders() -> dict[str, str]:
    return {name: _text(f"shaders/{file}") for name, file in SHADERS.items()}


def _joined(*scripts: str) -> str:
    return "\n".join(_text(f"scripts/{name}") for name in scripts)


def _text(name: str) -> str:
    text = resources.files(_PACKAGE).joinpath(name).read_text(encoding="utf-8")
    assert "</" not in text, f"{name} would end the element that it stands in"
    return text


def _digest(text: str) -> str:
    """Digest what stands between two tags, as a content policy names it."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")
