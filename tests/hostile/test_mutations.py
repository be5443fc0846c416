"""Every format is damaged a few tens of times, always in the same way.

Each damaged file is read, or refused by ``InputError`` in words that name it, can be printed and
are short; no warning and no ignored error shows.  ``experiments/fuzz_readers.py`` tries thousands,
with limits of memory and time.
"""

import time

import pytest

from . import READ, REFUSED, SUBJECTS, judged, mutated

# Large files take longer, and are damaged in one way only.
COUNTS = {"merl": 3, "utia": 10}
# Longer than any machine takes, where a hang would have no end.
SECONDS = 60.0


@pytest.mark.parametrize("name", SUBJECTS)
def test_damaged_files_are_read_or_refused(tmp_path, name):
    subject = SUBJECTS[name]
    path = tmp_path / subject.name
    subject.make(path)
    whole = path.read_bytes()
    assert judged(subject.read, path) == READ
    found = {}
    for seed in range(COUNTS.get(name, 40)):
        path.write_bytes(mutated(whole, subject.kind, [seed]))
        start = time.monotonic()
        found[seed] = judged(subject.read, path)
        assert time.monotonic() - start < SECONDS, f"seed {seed}"
    assert set(found.values()) <= {READ, REFUSED}, found
    assert REFUSED in found.values()
