"""Numbers in a text that are told apart by blanks or commas alone, each with its line."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.errors import InputError
from jaxrender.limits import DOCUMENT_BYTES
from jaxrender.shapes import Float


class NumberedLine(NamedTuple):
    """A line of a file, and its number from 1."""

    number: int
    text: str


class NumberedWords:
    """Words of some lines of a file, taken as numbers one after the other."""

    def __init__(self, path: Path, lines: list[NumberedLine]):
        self.path = path
        self.words = [
            (number, word) for number, text in lines for word in text.replace(",", " ").split()
        ]
        self.next = 0

    def take(self, count: int, what: str) -> Float[np.ndarray, "number"]:
        """Take so many numbers; InputError if fewer are left, or a word is no finite number."""
        left = len(self.words) - self.next
        if count > left:
            raise InputError(
                f"{self.path}: {left} numbers left where {count} are wanted for {what}; the file "
                "is cut short, or a count is wrong"
            )
        found = np.array([self._value(k, what) for k in range(self.next, self.next + count)])
        self.next += count
        return found

    def count(self, what: str, least: int) -> int:
        """Take a whole number from ``least`` on."""
        place = self.place()
        value = self.take(1, what)[0]
        if value != int(value) or value < least:
            raise InputError(f"{place}: {value:g} for {what}; wanted a count from {least} on")
        return int(value)

    def place(self) -> str:
        """Say where the next number stands."""
        known = self.words[min(self.next, len(self.words) - 1)][0] if self.words else "end"
        return f"{self.path}:{known}"

    def finish(self) -> None:
        """Raise InputError if any number is left."""
        left = len(self.words) - self.next
        if left:
            raise InputError(f"{self.place()}: {left} numbers too many; a count is wrong")

    def _value(self, index: int, what: str) -> float:
        number, word = self.words[index]
        try:
            value = float(word)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise InputError(f"{self.path}:{number}: found {word!r} for {what}; wanted a number")
        return value


def read_maker_lines(path: Path) -> list[NumberedLine]:
    """Read the lines of a text in UTF-8, or else in Latin-1, in which makers write their names.

    Raises InputError for a file that is missing, binary, or larger than any of luminaires.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend the path")
    DOCUMENT_BYTES.check(str(path), path.stat().st_size, "give a file of one luminaire")
    content = path.read_bytes()
    if b"\0" in content:
        raise InputError(f"{path}: a binary file (byte {content.index(0)} is 0); wanted a text")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    # Old files end in DOS's end-of-file sign.
    lines = text.rstrip("\x1a\r\n ").splitlines()
    return [NumberedLine(number, line) for number, line in enumerate(lines, start=1)]
