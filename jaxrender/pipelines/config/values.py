"""The kinds of value that a config may hold: numbers, vectors, colours, paths.

Each kind is an annotated type that carries, beside its check, the words that tell a person what is
accepted (``Accepts``); :mod:`.wording` puts them into the error messages.  Whole numbers may be
written ``1e4``; a quoted number is not a number; NaN and infinity are refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Strict,
    Tag,
)


@dataclass(frozen=True)
class Accepts:
    """What a kind of value accepts, in words that can follow 'accepted:'."""

    text: str


class Section(BaseModel):
    """A section of a config: immutable, and unknown keys are errors."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        use_attribute_docstrings=True,
        validate_default=False,
    )


def _whole(value: Any) -> Any:
    """Let 1e4 pass as the whole number that it is."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _spread(value: Any) -> Any:
    """One number for all three channels."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return (value, value, value) if is_number else value


def _not_zero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if not math.hypot(*vector) > 0:
        raise ValueError(
            "found [0, 0, 0], which has no direction; accepted: three numbers, not all 0"
        )
    return vector


_FINITE = Field(allow_inf_nan=False)

Number = Annotated[float, Strict(), _FINITE, Accepts("a number")]
NonNegative = Annotated[float, Strict(), _FINITE, Field(ge=0), Accepts("a number of at least 0")]
Positive = Annotated[float, Strict(), _FINITE, Field(gt=0), Accepts("a number above 0")]
Fraction = Annotated[float, Strict(), Field(ge=0, le=1), Accepts("a number from 0 to 1")]
OpenFraction = Annotated[
    float, Strict(), Field(gt=0, lt=1), Accepts("a number between 0 and 1, both excluded")
]
FieldOfView = Annotated[
    float, Strict(), Field(gt=0, lt=180), Accepts("an angle in degrees between 0 and 180")
]
LobeWidth = Annotated[
    float, Strict(), Field(gt=0, le=180), Accepts("an angle in degrees above 0 and up to 180")
]
Elevation = Annotated[
    float, Strict(), Field(ge=-90, le=90), Accepts("an angle in degrees from -90 to 90")
]
WholeNumber = Annotated[
    int, Strict(), Field(ge=0), BeforeValidator(_whole), Accepts("a whole number of at least 0")
]
Count = Annotated[
    int, Strict(), Field(ge=1), BeforeValidator(_whole), Accepts("a whole number of at least 1")
]
Switch = Annotated[bool, Strict(), Accepts("true or false")]
ConfigPath = Annotated[Path, Accepts("a path")]

Vector = Annotated[tuple[Number, Number, Number], Accepts("three numbers")]
Direction = Annotated[
    tuple[Number, Number, Number],
    AfterValidator(_not_zero),
    Accepts("three numbers, not all 0"),
]
PositiveVector = Annotated[tuple[Positive, Positive, Positive], Accepts("three numbers above 0")]
SignedRgb = Annotated[
    tuple[Number, Number, Number],
    BeforeValidator(_spread, json_schema_input_type=Number | tuple[Number, Number, Number]),
    Accepts("a number, or three of them (red, green, blue)"),
]
Rgb = Annotated[
    tuple[NonNegative, NonNegative, NonNegative],
    BeforeValidator(
        _spread, json_schema_input_type=NonNegative | tuple[NonNegative, NonNegative, NonNegative]
    ),
    Accepts("a number of at least 0, or three of them (red, green, blue)"),
]


def auto_or_several(kind: Any) -> Any:
    """Make the type of a key that is the word auto, or a list of what it names."""

    def shape(value: Any) -> str:
        return "<named>" if isinstance(value, list | tuple) else "<word>"

    return Annotated[
        Annotated[Literal["auto"], Tag("<word>")] | Annotated[tuple[kind, ...], Tag("<named>")],
        Discriminator(shape),
    ]
