"""Ways to spoil a light, and what is said of each."""

import numpy as np
from small_captures import edit_json, write_json
from spoilt_captures import nothing, removed, write_any


def environment(shape, value=1.0, name="e.exr"):
    return lambda folder: write_any(folder / name, np.full((*shape, 3), value))


LIT_BY = "lighting={environment: {path: cap/e.exr}}"
CASES = {
    "aspect": (
        environment((8, 8)),
        [LIT_BY],
        r"e\.exr: the panorama is 8 x 8 \(width x height\); the convention 'z-up' wants 2:1",
    ),
    "broken environment": (
        environment((8, 16), np.nan),
        [LIT_BY],
        r"e\.exr: channel R, pixel \(row 0, column 0\): the value is nan; .* mend the picture$",
    ),
    "dark environment": (
        environment((8, 16), 0.0),
        [LIT_BY],
        r"^lighting \(.*e\.exr\): the light is zero: give an environment or sources",
    ),
    "dark source": (
        nothing,
        ["lighting={directional: [{direction: [0, 0, 1], irradiance: 0}]}"],
        r"^lighting: the light is zero: give an environment or sources with radiance$",
    ),
    "missing environment": (nothing, [LIT_BY], r"cap/e\.exr: no such image file; mend the path$"),
    "missing lights": (removed("lights.json"), [], r"lights\.json: no such file; mend the path$"),
    "too few lights": (
        lambda folder: edit_json(folder / "lights.json", lambda lights: lights.pop()),
        [],
        r"lights\.json: lights for 2 photographs, but the capture has 3; one entry each$",
    ),
    "lights of others": (
        lambda folder: write_json(folder / "lights.json", {"0": [], "1": [], "7": []}),
        [],
        r"lights\.json: no photograph is named '7'; the photographs are 0, 1, 2$",
    ),
    "no light in any photograph": (
        lambda folder: write_json(folder / "lights.json", [[], [], []]),
        [],
        r"^lighting \(.*lights\.json\): the light is zero",
    ),
}
