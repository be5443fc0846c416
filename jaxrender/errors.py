"""The one exception for input that its author can mend."""

_LONGEST_LINE, _MOST_LINES = 2000, 50


class InputError(ValueError):
    """Bad input: its message names the file, the place, the value and the remedy.

    Raised at the boundaries (files, configs, command line) and nowhere else; the command line
    prints it and exits with code 2.  Misuse of the Python API raises plain ``ValueError``.  What a
    file brings into the message is escaped where a terminal would obey it, and shortened.
    """

    def __init__(self, message: str):
        lines = [_printable(line) for line in message.split("\n")]
        if len(lines) > _MOST_LINES:
            left = len(lines) - _MOST_LINES + 1
            lines[_MOST_LINES - 1 :] = [f"... and {left:,} more lines; mend these first"]
        super().__init__("\n".join(lines))


def _printable(line: str) -> str:
    if len(line) > _LONGEST_LINE:
        half = _LONGEST_LINE // 2 - 3
        line = f"{line[:half]} ... {line[-half:]}"
    if line.isprintable():
        return line
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)
