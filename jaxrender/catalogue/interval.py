"""Where a number may lie."""

from typing import NamedTuple


class Interval(NamedTuple):
    """Where a number lies, written as in ``(0, 1]``: a round bracket leaves the end out."""

    text: str

    @property
    def low(self) -> float:
        """The lower end."""
        return float(self.text[1:-1].split(",")[0])

    @property
    def high(self) -> float:
        """The upper end, which may be infinite."""
        return float(self.text[1:-1].split(",")[1])

    def holds(self, value: float) -> bool:
        """Whether a number lies inside."""
        above = value > self.low if self.text[0] == "(" else value >= self.low
        return above and (value < self.high if self.text[-1] == ")" else value <= self.high)

    @property
    def words(self) -> str:
        """The same in words that can follow "a number"."""
        lower = f"above {self.low:g}" if self.text[0] == "(" else f"at least {self.low:g}"
        if self.high == float("inf"):
            return lower
        return f"{lower} and {'below' if self.text[-1] == ')' else 'at most'} {self.high:g}"
