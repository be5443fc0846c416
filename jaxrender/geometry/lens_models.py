"""Lenses by the names and in the numbers of the programs that calibrate them.

``LENS_MODELS`` has the camera models of COLMAP, whose OPENCV, FULL_OPENCV and OPENCV_FISHEYE are
those of OpenCV, too.  ``opencv_lens`` takes OpenCV's list of coefficients, ``metashape_lens`` the
frame camera of Metashape.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from jaxrender.geometry.distortions import (
    Distortion,
    Division,
    FieldOfView,
    RadialTangential,
    Skew,
)
from jaxrender.geometry.lenses import (
    EnhancedUnifiedLens,
    EquirectangularLens,
    FisheyeLens,
    Lens,
    PerspectiveLens,
)

# How many coefficients OpenCV gives, and which ones they are in its order.
_OPENCV = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty")
_COUNTS = (0, 4, 5, 8, 12, 14)


class LensModel(NamedTuple):
    """A camera model: its numbers in the order of its files, and the lens that they make.

    ``parameters`` begin with the focal length or lengths and the principal point, in pixels, or
    are the width and the height of a panorama.
    ``lens`` takes the numbers after these; None is a lens without distortion.
    """

    parameters: tuple[str, ...]
    lens: Callable[[Sequence[float]], Lens | None]

    @property
    def intrinsics(self) -> int:
        """How many numbers come before those of the lens."""
        return self.parameters.index("cy") + 1 if "cy" in self.parameters else len(self.parameters)

    def pinhole(self, numbers: Sequence[float]) -> dict[str, float]:
        """Name the focal lengths (the second where it is another) and the principal point."""
        named = dict(zip(self.parameters, numbers))
        if "w" in named:
            width, height = named["w"], named["h"]
            lengths = {"fl_x": width / (2 * math.pi), "fl_y": height / math.pi}
            return lengths | {"cx": width / 2, "cy": height / 2}
        centre = {"cx": named["cx"], "cy": named["cy"]}
        if "f" in named:
            return {"fl_x": named["f"]} | centre
        return {"fl_x": named["fx"], "fl_y": named["fy"]} | centre


def perspective(*distortions: Distortion) -> Lens | None:
    """Make a perspective lens; None without distortions that distort."""
    kept = tuple(one for one in distortions if not _is_idle(one))
    return PerspectiveLens(kept) if kept else None


def fisheye(*distortions: Distortion) -> Lens:
    """Make a fisheye of those distortions that distort."""
    return FisheyeLens(tuple(one for one in distortions if not _is_idle(one)))


def opencv_lens(coefficients: Sequence[float]) -> Lens | None:
    """Make the lens of OpenCV's 0, 4, 5, 8, 12 or 14 distortion coefficients.

    Raises ``ValueError`` for another number of them, and for a tilted sensor.
    """
    if len(coefficients) not in _COUNTS:
        raise ValueError(f"{len(coefficients)} distortion coefficients: OpenCV has 4, 5, 8 or 12")
    named = dict.fromkeys(_OPENCV, 0.0) | dict(zip(_OPENCV, map(float, coefficients)))
    if named["tx"] or named["ty"]:
        raise ValueError("a tilted sensor (tau_x, tau_y): undistort the photographs first")
    return perspective(
        RadialTangential(
            tuple(named[name] for name in ("k1", "k2", "k3")),
            tuple(named[name] for name in ("k4", "k5", "k6")),
            (named["p1"], named["p2"]),
            tuple(named[name] for name in ("s1", "s2", "s3", "s4")),
        )
    )


def metashape_lens(
    radial: Sequence[float],
    tangential: Sequence[float],
    skew: float = 0.0,
    *,
    is_fisheye: bool = False,
) -> Lens | None:
    """Make the lens of Metashape's frame or fisheye camera.

    ``radial`` are k1 .. k4, ``tangential`` p1 and p2, ``skew`` is b2 over the length f + b1.  Its
    p1 is OpenCV's p2, and its p2 OpenCV's p1.
    """
    p1, p2 = tangential
    parts = RadialTangential(tuple(radial), (), (p2, p1)), Skew(skew)
    return fisheye(*parts) if is_fisheye else perspective(*parts)


def _thin_prism_fisheye(n: Sequence[float]) -> Lens:
    k1, k2, p1, p2, k3, k4, sx1, sy1 = n
    return fisheye(RadialTangential((k1, k2, k3, k4), (), (p1, p2), (sx1, 0.0, sy1, 0.0)))


def _rad_tan_thin_prism_fisheye(n: Sequence[float]) -> Lens:
    p0, p1 = n[6:8]
    after = RadialTangential((), (), (p1, p0), tuple(n[8:]))
    return fisheye(RadialTangential(tuple(n[:6])), after)


def _is_idle(distortion: Distortion) -> bool:
    if isinstance(distortion, RadialTangential):
        parts = (distortion.numerator, distortion.denominator, distortion.tangential)
        return not any(any(part) for part in (*parts, distortion.prism))
    if isinstance(distortion, Skew):
        return distortion.skew == 0
    return isinstance(distortion, Division) and distortion.k == 0


def _model(parameters: str, lens: Callable[[Sequence[float]], Lens | None]) -> LensModel:
    return LensModel(tuple(parameters.split()), lens)


def _fov(n: Sequence[float]) -> Lens | None:
    # No angle of view is no distortion.
    return perspective(FieldOfView(n[0])) if n[0] else None


LENS_MODELS: dict[str, LensModel] = {
    "SIMPLE_PINHOLE": _model("f cx cy", lambda n: None),
    "PINHOLE": _model("fx fy cx cy", lambda n: None),
    "SIMPLE_RADIAL": _model("f cx cy k", lambda n: perspective(RadialTangential(tuple(n)))),
    "RADIAL": _model("f cx cy k1 k2", lambda n: perspective(RadialTangential(tuple(n)))),
    "OPENCV": _model("fx fy cx cy k1 k2 p1 p2", opencv_lens),
    "FULL_OPENCV": _model("fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6", opencv_lens),
    "FOV": _model("fx fy cx cy omega", _fov),
    "SIMPLE_DIVISION": _model("f cx cy k", lambda n: perspective(Division(n[0]))),
    "DIVISION": _model("fx fy cx cy k", lambda n: perspective(Division(n[0]))),
    "SIMPLE_FISHEYE": _model("f cx cy", lambda n: fisheye()),
    "FISHEYE": _model("fx fy cx cy", lambda n: fisheye()),
    "SIMPLE_RADIAL_FISHEYE": _model("f cx cy k", lambda n: fisheye(RadialTangential(tuple(n)))),
    "RADIAL_FISHEYE": _model("f cx cy k1 k2", lambda n: fisheye(RadialTangential(tuple(n)))),
    "OPENCV_FISHEYE": _model(
        "fx fy cx cy k1 k2 k3 k4", lambda n: fisheye(RadialTangential(tuple(n)))
    ),
    "THIN_PRISM_FISHEYE": _model("fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1", _thin_prism_fisheye),
    "RAD_TAN_THIN_PRISM_FISHEYE": _model(
        "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3", _rad_tan_thin_prism_fisheye
    ),
    "EUCM": _model("fx fy cx cy alpha beta", lambda n: EnhancedUnifiedLens(*n)),
    "EQUIRECTANGULAR": _model("w h", lambda n: EquirectangularLens()),
}
