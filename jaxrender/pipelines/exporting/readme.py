"""The README.txt of an export: what each file is, and what was lost."""

import textwrap
from collections.abc import Sequence
from typing import NamedTuple

from jaxrender.io.exports import Contents, Part

README = "README.txt"
_WIDTH = 88
_COMMON = (
    "Axes: the world's, x, y, z with z up, unless a file says otherwise. Lengths are in the units "
    "of the capture. Radiance and irradiance are in the units of the photographs, in linear RGB "
    "with the primaries of sRGB; a BRDF is in 1/sr. Roughness of facets is theirs, not its square, "
    "where nothing else is said."
)


class Section(NamedTuple):
    """What one format gave: its files (paths from the README), losses and remarks."""

    name: str
    about: str
    parts: Sequence[Part]
    losses: Sequence[str]
    remarks: Sequence[str]


def readme_text(
    contents: Contents,
    sections: Sequence[Section],
    left_out: Sequence[str],
) -> str:
    """Lay the README out."""
    title = f"Export of the result {_plain(contents.name)} by jaxrender"
    lines = [title, "=" * len(title), "", *textwrap.wrap(_COMMON, _WIDTH)]
    for section in sections:
        head = f"{section.name}: {section.about}"
        lines += ["", head, "-" * len(head)]
        for part in section.parts:
            lines += _item(part.file, part.about)
        lines += ["", "Lost:"] if section.losses else ["", "Lost: nothing that the result holds."]
        for loss in section.losses:
            lines += _bullet(loss)
        for remark in section.remarks:
            lines += _bullet(remark)
    if left_out:
        lines += ["", "Left out", "--------"]
        for sentence in left_out:
            lines += _bullet(sentence)
    return "\n".join(lines) + "\n"


def _item(name: str, about: str) -> list[str]:
    return textwrap.wrap(
        f"{name}: {about}", _WIDTH, initial_indent="  ", subsequent_indent="      "
    )


def _bullet(sentence: str) -> list[str]:
    return textwrap.wrap(_plain(sentence), _WIDTH, initial_indent="- ", subsequent_indent="  ")


def _plain(text: str) -> str:
    """Escape what a terminal would obey."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
