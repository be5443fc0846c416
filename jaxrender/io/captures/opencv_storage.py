"""Files of OpenCV's ``FileStorage``, YAML or XML, as plain numbers, texts, lists and arrays.

A matrix becomes an array.  YAML without aliases is read, since OpenCV writes none.
"""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from jaxrender.errors import InputError
from jaxrender.io.jsonfiles import read_text
from jaxrender.io.xmlfiles import Element, read_xml
from jaxrender.limits import DEPTH, STORAGE_BYTES
from jaxrender.shapes import Float

# The second has `sizes` in the place of rows and columns.
_MATRICES = ("opencv-matrix", "opencv-nd-matrix")
_NESTING = re.compile(r"[\[\]{}]|(?:[-?] ){2,}")
# What stands in quotes, or between spaces.
_WORD = re.compile(r'"([^"]*)"|(\S+)')


def read_storage(path: Path) -> dict[str, Any]:
    """Read the named values of a file; raises InputError with its line."""
    if path.suffix.lower() == ".xml":
        return {child.tag: _of_element(path, child) for child in read_xml(path)}
    text = read_text(path, STORAGE_BYTES)
    _refuse_deep(path, text)
    lines = text.split("\n")
    # `%YAML:1.0` is OpenCV's own spelling, which YAML does not know; newer ones say 1.2.
    if lines[0].startswith("%YAML"):
        lines[0] = ""
    try:
        root = YAML(typ="safe", pure=True).compose("\n".join(lines))
    except (YAMLError, RecursionError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        line = 1 if mark is None else mark.line + 1
        raise InputError(
            f"{path}:{line}: {getattr(error, 'problem', None) or 'no YAML'}; mend the file"
        ) from None
    if not isinstance(root, MappingNode):
        raise InputError(f"{path}:1: wanted named values, as OpenCV's FileStorage writes them")
    return _of_node(path, root, set(), 0)


def _refuse_deep(path: Path, text: str) -> None:
    """Refuse many brackets or dashes within each other, which a parser takes long to go through."""
    depth = 0
    for found in _NESTING.finditer(text):
        word = found.group()
        # An indicator of a list in a list: as many as stand in a row.
        own = len(word) // 2
        depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(word, 0)
        DEPTH.check(str(path), max(depth, own), "take brackets out")


def _of_node(path: Path, node: Node, seen: set[int], depth: int) -> Any:
    place = f"{path}:{node.start_mark.line + 1}"
    DEPTH.check(place, depth, "take brackets out")
    if id(node) in seen:
        raise InputError(f"{place}: an alias (*); write its value in its place")
    if isinstance(node, ScalarNode):
        # What stands in quotes is a text, whatever it looks like.
        return node.value if node.style in ("'", '"') else _scalar(node.value)
    seen.add(id(node))
    if isinstance(node, SequenceNode):
        return [_of_node(path, one, seen, depth + 1) for one in node.value]
    found = {str(key.value): _of_node(path, value, seen, depth + 1) for key, value in node.value}
    return _matrix(place, found) if str(node.tag).endswith(_MATRICES) else found


def _of_element(path: Path, element: Element) -> Any:
    place = f"{path}: <{element.tag}>"
    if element.get("type_id") in _MATRICES:
        found: dict[str, Any] = {child.tag: _scalar(child.text or "") for child in element}
        for key in ("data", "sizes"):
            found[key] = [_scalar(word) for word in (element.findtext(key) or "").split()]
        return _matrix(place, found)
    if all(child.tag == "_" for child in element) and len(element):
        return [_of_element(path, child) for child in element]
    if len(element):
        return {child.tag: _of_element(path, child) for child in element}
    text = (element.text or "").strip()
    texts = [one or other for one, other in _WORD.findall(text)]
    if '"' in text:
        return texts if len(texts) > 1 else texts[0]
    return [_scalar(word) for word in texts] if len(texts) > 1 else _scalar(text)


def _scalar(text: str) -> float | str:
    """Read a number; all else is a text."""
    try:
        return float(text)
    except ValueError:
        return text.strip()


def _matrix(place: str, keys: dict[str, Any]) -> Float[np.ndarray, "row column"]:
    rows, columns, data = (keys.get(key) for key in ("rows", "cols", "data"))
    sizes = keys.get("sizes")
    if isinstance(sizes, list) and len(sizes) in (1, 2):
        rows, columns = sizes[0], sizes[1] if len(sizes) == 2 else 1.0
    good = isinstance(data, list) and all(isinstance(one, float) for one in data)
    if not (isinstance(rows, float) and isinstance(columns, float) and good):
        raise InputError(f"{place}: a matrix wants rows, cols and data of numbers")
    assert isinstance(data, list)
    if rows < 1 or columns < 1 or rows * columns != len(data):
        raise InputError(f"{place}: a matrix of {rows:g} x {columns:g} with {len(data)} numbers")
    if not all(map(math.isfinite, data)):
        raise InputError(f"{place}: a matrix with numbers that are not finite")
    return np.array(data).reshape(int(rows), int(columns))
