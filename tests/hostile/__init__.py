"""Damaged and malicious files: every reader answers with one clear error, or reads them.

``subjects`` makes a small file of every format and names its reader, ``mutations`` damages files,
``judge`` says what came of reading one.  ``experiments/fuzz_readers.py`` tries thousands of them
for each format in limited processes; the tests try a few tens.
"""

from .judge import READ, REFUSED, judged
from .mutations import mutated
from .subjects import SUBJECTS, Subject

__all__ = ["READ", "REFUSED", "SUBJECTS", "Subject", "judged", "mutated"]
