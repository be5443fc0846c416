"""The page: one HTML file with its data, its shaders and its scripts, and no other address.

Its content policy allows the page's own script and style, by their digests, and pictures within the
page.  Nothing is fetched.
"""

import base64
import hashlib
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

_PACKAGE = "jaxrender.pipelines.view"
_SCRIPTS = (
    "arrays.js", "material.js", "textures.js", "renderer.js", "viewer.js", "controls.js",
    "photographs.js", "explorer.js", "start.js",
)  # fmt: skip
SHADERS = {
    "table": "table.glsl",
    "square": "square.vert.glsl",
    "map": "map.frag.glsl",
    "mesh": "mesh.vert.glsl",
    "sphere": "sphere.vert.glsl",
    "object": "object.frag.glsl",
}


def html_of(values: dict[str, Any]) -> str:
    """Fill the template; every string from outside is escaped."""
    templates = Environment(
        loader=PackageLoader(_PACKAGE, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    style = _text("page.css")
    script = script_text()
    own = {
        "style": Markup(style),
        "script": Markup(script),
        "style_digest": _digest(style),
        "script_digest": _digest(script),
        "shaders": {name: Markup(_text(f"shaders/{file}")) for name, file in SHADERS.items()},
    }
    return templates.get_template("page.html.j2").render(own | values)


def script_text() -> str:
    """Put the scripts together, closed off from the page's own names."""
    parts = "\n".join(_text(f"scripts/{name}") for name in _SCRIPTS)
    return f'(() => {{\n"use strict";\n{parts}\n}})();\n'


def _text(name: str) -> str:
    text = resources.files(_PACKAGE).joinpath(name).read_text(encoding="utf-8")
    assert "</" not in text, f"{name} would end the element that it stands in"
    return text


def _digest(text: str) -> str:
    """Digest what stands between two tags, as a content policy names it."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")
