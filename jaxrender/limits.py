"""How much a file may ask for, in one place: readers ask here before they take memory.

A header can claim any size, and a few lines of YAML can stand for millions of values.  Each limit
is far above what real files hold.  Whoever trusts a larger file sets the environment variable that
the error names, or calls ``allow``.

``PIXELS``          of a picture of up to four channels; more channels count in fours
``FACES``           of a mesh, its repeated parts counted as often as they stand in it; vertices too
``REPEATED``        of a mesh file with more faces or vertices than bytes, which repeats its parts
``MESH_BYTES``      of a mesh file
``NUMBERS``         of one array in a NetCDF file
``PACKING``         how many times larger the numbers may be than the file that packs them
``TEXT_BYTES``      of a table or a list in a text file
``DOCUMENT_BYTES``  of a JSON document
``CONFIG_BYTES``    of a YAML file, which is read slowly
``STORAGE_BYTES``   of a YAML file of OpenCV
``DEPTH``           of brackets within brackets, or of sections within sections
``CONFIG_VALUES``   of a YAML file, each alias counted with all that it stands for
"""

import os

from jaxrender.errors import InputError


class Limit:
    """The most of something; its environment variable is read each time."""

    def __init__(self, variable: str, most: int, unit: str):
        self.variable, self.unit = variable, unit
        self._most = most

    @property
    def most(self) -> int:
        """The largest number that is allowed.

        Raises ``InputError`` where the environment variable is no whole number.
        """
        said = os.environ.get(self.variable)
        if said is None:
            return self._most
        if not (said.isascii() and said.isdecimal() and len(said) < 19 and int(said)):
            raise InputError(f"{self.variable} is {said!r}; wanted a whole number from 1")
        return int(said)

    def allow(self, most: int) -> None:
        """Set the limit of this process, where its environment variable is not set.

        Raises ``ValueError`` for a number below 1.
        """
        if most < 1:
            raise ValueError(f"{self.variable}: {most}; give a number from 1")
        self._most = most

    def check(self, place: str, found: int, remedy: str = "mend the file") -> None:
        """Raise ``InputError`` if there is too much at a place."""
        if found > self.most:
            raise InputError(
                f"{place}: {_counted(found)} {self.unit}, and at most {self.most:,} are read: "
                f"{remedy}, or set {self.variable} to allow more"
            )


def _counted(found: int) -> str:
    return f"{found:,}" if found < 10**18 else "over 10^18"


PIXELS = Limit("JAXRENDER_MAX_PIXELS", 2**29, "pixels")
FACES = Limit("JAXRENDER_MAX_FACES", 2**27, "faces or vertices")
REPEATED = Limit("JAXRENDER_MAX_REPEATED_FACES", 2**21, "faces or vertices of repeated parts")
MESH_BYTES = Limit("JAXRENDER_MAX_MESH_BYTES", 2**32, "bytes")
NUMBERS = Limit("JAXRENDER_MAX_NUMBERS", 2**31, "numbers")
PACKING = Limit("JAXRENDER_MAX_PACKING", 2**12, "times the size of its file")
TEXT_BYTES = Limit("JAXRENDER_MAX_TEXT_BYTES", 2**27, "bytes")
DOCUMENT_BYTES = Limit("JAXRENDER_MAX_DOCUMENT_BYTES", 2**24, "bytes")
CONFIG_BYTES = Limit("JAXRENDER_MAX_CONFIG_BYTES", 2**17, "bytes")
STORAGE_BYTES = Limit("JAXRENDER_MAX_STORAGE_BYTES", 2**21, "bytes")
DEPTH = Limit("JAXRENDER_MAX_DEPTH", 64, "levels of brackets or sections within each other")
CONFIG_VALUES = Limit("JAXRENDER_MAX_CONFIG_VALUES", 2**13, "values")

# What is smaller than this may be packed however much: it does no harm.
_HARMLESS = 2**27


def check_packing(place: str, numbers: int, stored: int, packed: int) -> None:
    """Raise ``InputError`` for a file far too small for what it claims.

    ``numbers`` are read as 8 bytes each and are ``stored`` bytes as the format has them, which
    takes ``packed`` bytes of the file.
    """
    if 8 * numbers > _HARMLESS:
        times = stored // max(packed, 1)
        PACKING.check(f"{place}: {numbers:,} numbers are claimed", times, "fetch the file again")
