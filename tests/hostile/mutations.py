"""Damage to files, drawn at random: the same seed makes the same damage.

Bytes are flipped, overwritten, cut off, inserted, taken out and doubled; whole numbers and floats
of any width become huge, negative or NaN.  In texts, and in the text that opens a binary file,
words, numbers, lines and brackets are replaced, repeated and taken out.
"""

import json
import re
import struct

import numpy as np

_EXTREMES = (
    0,
    1,
    2,
    127,
    128,
    255,
    2**15,
    2**16 - 1,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63,
    2**64 - 1,
)
_FLOATS = (float("nan"), float("inf"), -float("inf"), -1.0, 0.0, 1e300, -1e300, 1e-320)
_NUMBERS = (
    "-1", "0", "1", "2", "255", "65536", "2147483648", "4294967295", "99999999999999999999",
    "1e999", "-1e308", "1e-320", "nan", "inf", "NaN", "Infinity", ".nan", ".inf", "0x7f",
    "1_000", "²", "١",
    "9" * 5000, "1" + "0" * 400, "1e", "--1", "", "null", "true", "[]", "{}", "''", "0.5", "~",
)  # fmt: skip
_WORDS = (
    "[" * 3000, "{" * 3000, '{"a":' * 3000, "- " * 3000, "a: " * 50, "&a [*a]", "*a",
    "!!python/x 1", "<<: *a", "\0", "\x1b[31m", "\r", "\t", '"', "'", "#", ":", ",", "]", "}",
    "\\ud800", "é", "%",
    "|", "x" * 10000, "../../../../etc/passwd", "/dev/zero", "..", "\u2028",
)  # fmt: skip
_BYTES = (b"\xff", b"\xfe\xff", b"\xc3", b"\xe9", b"\0", b"\xef\xbb\xbf")
_NUMBER = re.compile(r"-?\d+(\.\d+)?([eE][-+]?\d+)?")
# So many bytes at the start of a binary file may hold a header.
_HEAD = 512
# Texts that have grown by more bytes than this are damaged enough.
_GROWTH = 20_000


def mutated(content: bytes, kind: str, seed: list[int]) -> bytes:
    """Damage a file one to four times; ``kind`` is text, binary or glb."""
    rng = np.random.default_rng(seed)
    longest = len(content) + _GROWTH
    times = int(rng.choice([1, 1, 1, 2, 4]))
    for _ in range(times):
        if kind == "text" and len(content) > longest:
            break
        chance = rng.random()
        if kind == "text":
            content = _text(content, rng) if chance < 0.8 else _binary(content, rng)
        elif kind == "glb" and chance < 0.5:
            content = _glb(content, rng)
        elif chance < 0.3:
            # Where a header usually is.
            content = _binary(content[:_HEAD], rng) + content[_HEAD:]
        elif chance < 0.4:
            content = _text(content[:_HEAD], rng) + content[_HEAD:]
        else:
            content = _binary(content, rng)
    return content


def _binary(content: bytes, rng: np.random.Generator) -> bytes:
    if not content:
        return b"\0"
    data, at = bytearray(content), int(rng.integers(len(content)))
    width = int(rng.integers(1, 1 + min(64, len(data))))
    match int(rng.integers(8)):
        case 0:
            data[at] ^= 1 << int(rng.integers(8))
        case 1:
            data[at] = int(rng.choice([0, 1, 127, 128, 255]))
        case 2:
            del data[at:]
        case 3:
            data[at:at] = rng.bytes(width)
        case 4:
            del data[at : at + width]
        case 5:
            data[at:at] = data[at : at + width]
        case 6:
            form = str(rng.choice(list("BHIQ")))
            value = int(rng.choice(np.array(_EXTREMES, object))) % 256 ** struct.calcsize(form)
            _overwrite(data, at, struct.pack(str(rng.choice(["<", ">"])) + form, value))
        case _:
            form = str(rng.choice(["<f", "<d", ">f", ">d"]))
            value = np.float64(rng.choice(_FLOATS))
            if form[1] == "f":
                value = float(np.clip(value, -3e38, 3e38)) if np.isfinite(value) else float(value)
            _overwrite(data, at, struct.pack(form, value))
    return bytes(data)


def _overwrite(data: bytearray, at: int, value: bytes) -> None:
    # At a multiple of its width, where a field usually starts.
    at -= at % len(value)
    data[at : at + len(value)] = value


def _text(content: bytes, rng: np.random.Generator) -> bytes:
    text = content.decode("latin-1")
    match int(rng.integers(8)):
        case 0 | 1 | 2:
            found = list(_NUMBER.finditer(text))
            if found:
                one = found[int(rng.integers(len(found)))]
                text = text[: one.start()] + _drawn(_NUMBERS, rng) + text[one.end() :]
        case 3:
            at = int(rng.integers(len(text) + 1))
            text = text[:at] + _drawn(_WORDS, rng) + text[at:]
        case 4 | 5:
            text = _lines(text, rng)
        case 6:
            words = [one.span() for one in re.finditer(r"[^\s,:\[\]{}]+", text)]
            if words:
                start, end = words[int(rng.integers(len(words)))]
                text = text[:start] + _drawn(("", *_WORDS, *_NUMBERS), rng) + text[end:]
        case _:
            at = int(rng.integers(len(content) + 1))
            return content[:at] + _BYTES[int(rng.integers(len(_BYTES)))] + content[at:]
    return text.encode("latin-1", "ignore") if text.isascii() else _encoded(text)


def _encoded(text: str) -> bytes:
    """Letters that came as bytes go as bytes, all others in UTF-8."""
    return b"".join(c.encode("latin-1" if ord(c) < 256 else "utf-8", "replace") for c in text)


def _lines(text: str, rng: np.random.Generator) -> str:
    lines = text.splitlines(keepends=True)
    if not lines:
        return text
    i, j = (int(k) for k in rng.integers(len(lines), size=2))
    match int(rng.integers(5)):
        case 0:
            del lines[i]
        case 1:
            lines[i], lines[j] = lines[j], lines[i]
        case 2:
            lines.insert(j, lines[i])
        case 3:
            lines[i:i] = [lines[i]] * 300
        case _:
            lines[i] = " " * int(rng.integers(1, 9)) + lines[i]
    return "".join(lines)


def _drawn(choices: tuple[str, ...], rng: np.random.Generator) -> str:
    return choices[int(rng.integers(len(choices)))]


def _glb(content: bytes, rng: np.random.Generator) -> bytes:
    """Damage the JSON of a .glb, and put the lengths around it right."""
    try:
        length = struct.unpack_from("<I", content, 12)[0]
        document = json.loads(content[20 : 20 + length])
    except (ValueError, struct.error, RecursionError):
        return _binary(content, rng)
    text = json.dumps(document)
    damaged = _text(text.encode(), rng)
    damaged += b" " * (-len(damaged) % 4)
    rest = content[20 + length :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(damaged) + len(rest))
    return head + struct.pack("<I4s", len(damaged), b"JSON") + damaged + rest
