"""Numbers as a reader wants them: few digits, units, and words where there is no number."""

import math
from typing import Any

MISSING = "–"


def numbers(value: Any) -> list[float]:
    """List a scalar, a list, or what stands for neither ("none", null) as numbers."""
    if isinstance(value, list | tuple):
        return [number for item in value for number in numbers(item)]
    return [float(value)] if is_number(value) else []


def is_number(value: Any) -> bool:
    """Say whether there is a finite number to show."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def shown(value: Any, digits: int = 4) -> str:
    """Write a number with so many significant digits."""
    if not is_number(value):
        return MISSING
    if value == 0:
        return "0"
    mantissa, _, exponent = f"{value:#.{digits}g}".rstrip(".").partition("e")
    power = f"\u202f×\u202f{power_of_ten(int(exponent))}" if exponent else ""
    return mantissa.rstrip(".").replace("-", "−") + power


def power_of_ten(exponent: int) -> str:
    """Write a power of ten in plain characters."""
    return "10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def percent(value: Any, digits: int = 2, sign: bool = False) -> str:
    """Write a fraction as a percentage, never in exponents."""
    if not is_number(value):
        return MISSING
    hundredfold = 100 * value
    size = abs(hundredfold)
    if 0 < size < 0.001:
        return "under 0.001\u00a0%"
    places = 0 if size >= 10 ** (digits - 1) else digits - 1 - math.floor(math.log10(size or 1))
    return f"{hundredfold:{'+' if sign else ''}.{min(places, 4)}f}\u00a0%".replace("-", "−")


def seconds(value: Any) -> str:
    """Write a duration; what is under a millisecond is said to be."""
    if not is_number(value):
        return MISSING
    return "under 1 ms" if value < 1e-3 else f"{value:.3g} s" if value < 100 else f"{value:.0f} s"


def counted(value: Any) -> str:
    """Write a count with thin spaces between thousands."""
    return f"{int(value):,}".replace(",", "\u202f") if is_number(value) else MISSING
