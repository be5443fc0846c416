"""Light as spherical harmonics: JSON, a C header, and GLSL that evaluates it.

The harmonics are real and orthonormal over the sphere, in the world's axes (z up), and carry no
Condon-Shortley sign: Y_11 = +0.488603 x, and Y_{l,-m} holds sin(m phi) (T 4.5).  Coefficients are
L_lm = int L Y_lm dw of the radiance, flat at l (l + 1) + m, one for each of red, green and blue.
Irradiance has A_l L_lm with A = pi, 2 pi / 3, pi / 4 (T 4.6 to 4.11).  Each file says so itself.
"""

import json
from pathlib import Path

import numpy as np

from jaxrender.io.atomic import replacing
from jaxrender.io.exports.contents import Part
from jaxrender.shapes import AnyArray, Float

_SIGNS = (
    "real, orthonormal over the sphere, no Condon-Shortley sign: Y_00 = 0.282095, "
    "Y_1-1 = 0.488603 y, Y_10 = 0.488603 z, Y_11 = 0.488603 x; Y_l,-m holds sin(m phi)"
)
_ORDER = "coefficient l (l + 1) + m, m from -l to l; each is red, green, blue"
_SCALE = "L_lm = integral of radiance times Y_lm over the sphere; linear RGB, primaries of sRGB"
_AXES = "z up, azimuth phi from +x towards +y, polar angle from +z"
_LAMBERTIAN = [np.pi, 2 * np.pi / 3, np.pi / 4]
# The polynomials of the nine harmonics to degree 2, as GLSL.
_BASIS = (
    "0.28209479",
    "0.48860251 * n.y",
    "0.48860251 * n.z",
    "0.48860251 * n.x",
    "1.09254843 * n.x * n.y",
    "1.09254843 * n.y * n.z",
    "0.31539157 * (3.0 * n.z * n.z - 1.0)",
    "1.09254843 * n.x * n.z",
    "0.54627422 * (n.x * n.x - n.y * n.y)",
)


def write_harmonics(
    coefficients: Float[AnyArray, "coefficient 3"], folder: Path
) -> tuple[Part, ...]:
    """Write the three files.  Raises ``ValueError`` for fewer than nine coefficients."""
    rows = np.asarray(coefficients, float)
    if len(rows) < len(_BASIS):
        raise ValueError(f"{len(rows)} coefficients: give nine, those of degree 2, or more")
    band_limit = int(np.sqrt(len(rows))) - 1
    files = {
        "light.json": _json(rows, band_limit),
        "light.h": _header(rows, band_limit),
        "light.glsl": _shader(rows[: len(_BASIS)]),
    }
    for name, text in files.items():
        with replacing(folder / name) as aside:
            aside.write_text(text, encoding="utf-8")
    return (
        Part("light.json", f"coefficients to degree {band_limit}, and what they mean"),
        Part("light.h", "the same as a constant array of C"),
        Part(
            "light.glsl", "functions `radiance(n)` and `irradiance(n)` to degree 2, n in world axes"
        ),
    )


def _json(rows: np.ndarray, band_limit: int) -> str:
    document = {
        "band_limit": band_limit,
        "harmonics": _SIGNS,
        "order": _ORDER,
        "scale": _SCALE,
        "axes": _AXES,
        "irradiance": "multiply degrees 0, 1, 2 by pi, 2 pi / 3, pi / 4; the rest is small",
        "coefficients": rows.tolist(),
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def _header(rows: np.ndarray, band_limit: int) -> str:
    lines = [
        "/* Light as spherical harmonics, written by jaxrender.",
        *(f" * {said}." for said in (_SIGNS, _ORDER, _SCALE, _AXES)),
        " */",
        "#ifndef JAXRENDER_LIGHT_H",
        "#define JAXRENDER_LIGHT_H",
        f"#define JAXRENDER_LIGHT_BAND_LIMIT {band_limit}",
        f"static const float jaxrender_light[{len(rows)}][3] = {{",
        *(f"    {{{', '.join(f'{x:.9g}f' if _dotted(x) else f'{x:.9g}.0f' for x in row)}}},"
          for row in rows),
        "};",
        "#endif",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _shader(rows: np.ndarray) -> str:
    degrees = [0, 1, 1, 1, 2, 2, 2, 2, 2]
    lines = ["// Light as spherical harmonics, written by jaxrender."]
    lines += [f"// {said}." for said in (_SIGNS, _SCALE, _AXES)]
    for name, scales, about in (
        ("radiance", [1.0, 1.0, 1.0], "radiance from direction n, to degree 2"),
        ("irradiance", _LAMBERTIAN, "irradiance on a surface with normal n (T 4.11, degree 2)"),
    ):
        lines += [f"// {about}; n is a unit vector.", f"vec3 {name}(vec3 n) {{", "    return"]
        terms = [
            f"        vec3({', '.join(_literal(scales[degree] * x) for x in row)}) * ({basis})"
            for row, degree, basis in zip(rows, degrees, _BASIS)
        ]
        lines += [" +\n".join(terms) + ";", "}"]
    return "\n".join(lines) + "\n"


def _literal(value: float) -> str:
    text = f"{value:.9g}"
    return text if _dotted(value) else f"{text}.0"


def _dotted(value: float) -> bool:
    """Whether nine digits of a number have a point or an exponent, as literals of C must."""
    return any(mark in f"{value:.9g}" for mark in ".e")
