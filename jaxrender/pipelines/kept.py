"""What is kept when a person stops a command: the sentences that Ctrl-C ends with."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def keeping(say: Callable[[], str]) -> Iterator[None]:
    """Add to an interrupt inside the block what is kept; the command line prints it."""
    try:
        yield
    except KeyboardInterrupt as stop:
        stop.add_note(say())
        raise


def kept_after(stop: KeyboardInterrupt) -> str:
    """Say what an interrupt left, in one line."""
    notes = getattr(stop, "__notes__", [])
    return "; ".join(notes) if notes else "nothing was written; an earlier result is as it was"
