"""From spectra to colour: reflectance at wavelengths as linear red, green and blue of Rec. 709.

XYZ = int r(l) S(l) (x, y, z)(l) dl with the colour-matching functions of the CIE 1931 standard
observer in the multi-lobe fit of Wyman, Sloan and Shirley, Simple Analytic Approximations to the
CIE XYZ Color Matching Functions (JCGT 2013):

    sum_k a_k exp(-(s_k(l) (l - m_k))^2 / 2),    s_k one inverse width below m_k, another above.

Rec. 709's primaries and white give the matrix from XYZ to RGB; then each channel is divided by that
of a perfect white, so that reflectance 1 at all wavelengths is (1, 1, 1) under every illuminant.
Wavelengths in nanometres.  Host side, float64.
"""

import numpy as np

from jaxrender.shapes import Float, checked

# (a, m in nm, inverse widths in 1/nm below and above m) of each lobe.
_OBSERVER = (
    (
        (0.362, 442.0, 0.0624, 0.0374),
        (1.056, 599.8, 0.0264, 0.0323),
        (-0.065, 501.1, 0.0490, 0.0382),
    ),
    ((0.821, 568.8, 0.0213, 0.0247), (0.286, 530.9, 0.0613, 0.0322)),
    ((1.217, 437.0, 0.0845, 0.0278), (0.681, 459.0, 0.0385, 0.0725)),
)
# CIE standard illuminant D65, relative power from 380 to 780 nm in steps of 10.
# fmt: off
_D65 = (
    49.9755, 54.6482, 82.7549, 91.4860, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861,
    115.923, 108.811, 109.354, 107.802, 104.790, 107.689, 104.405, 104.046, 100.000, 96.3342,
    95.7880, 88.6856, 90.0062, 89.5991, 87.6987, 83.2886, 83.6992, 80.0268, 80.2146, 82.2778,
    78.2842, 69.7213, 71.6091, 74.3490, 61.6040, 69.8856, 75.0870, 63.5927, 46.4182, 66.8054,
    63.3828,
)
# fmt: on
ILLUMINANTS = ("d65", "equal-energy")

_NODES = np.linspace(380, 780, 401)
# Rec. 709: chromaticities x, y of red, green and blue, and of white.
_PRIMARIES = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))
_WHITE = (0.3127, 0.3290)


@checked
def colour_matching(
    wavelengths: Float[np.ndarray, "wavelength"],
) -> Float[np.ndarray, "wavelength 3"]:
    """Evaluate the observer's x, y and z at wavelengths in nm."""
    wavelengths = np.asarray(wavelengths, float)
    functions = []
    for lobes in _OBSERVER:
        parts = []
        for height, centre, below, above in lobes:
            scaled = (wavelengths - centre) * np.where(wavelengths < centre, below, above)
            parts.append(height * np.exp(-(scaled**2) / 2))
        functions.append(sum(parts))
    return np.stack(functions, axis=-1)


@checked
def rgb_weights(
    wavelengths: Float[np.ndarray, "wavelength"], illuminant: str = "d65"
) -> Float[np.ndarray, "wavelength 3"]:
    """Find the weights that turn reflectances into linear RGB; their sums are 1.

    Reflectance is linear between the wavelengths and constant beyond them.  Raises ``ValueError``
    for wavelengths that do not ascend, or lie wholly outside 380 to 780 nm, and an unlisted
    ``illuminant``.
    """
    wavelengths = np.asarray(wavelengths, float)
    if illuminant not in ILLUMINANTS:
        raise ValueError(f"illuminant={illuminant!r}: choose one of {', '.join(ILLUMINANTS)}")
    if wavelengths.size == 0 or not np.all(np.diff(wavelengths) > 0):
        raise ValueError(f"wavelengths={wavelengths}: give them ascending, in nanometres")
    if not (wavelengths[0] < _NODES[-1] and wavelengths[-1] > _NODES[0]):
        raise ValueError(
            f"wavelengths from {wavelengths[0]:g} to {wavelengths[-1]:g}: none is visible, "
            f"{_NODES[0]:g} to {_NODES[-1]:g}; give nanometres"
        )
    power = np.ones_like(_NODES)
    if illuminant == "d65":
        power = np.interp(_NODES, np.linspace(380, 780, len(_D65)), _D65)
    hats = np.stack([np.interp(_NODES, wavelengths, row) for row in np.eye(len(wavelengths))])
    weights = hats @ (power[:, None] * colour_matching(_NODES)) @ rgb_from_xyz().T
    return weights / weights.sum(axis=0)


@checked
def rgb_of_reflectance(
    wavelengths: Float[np.ndarray, "wavelength"],
    reflectance: Float[np.ndarray, "*batch wavelength"],
    illuminant: str = "d65",
    clip: bool = True,
) -> Float[np.ndarray, "*batch 3"]:
    """Turn reflectance at wavelengths in nm, or a BRDF in 1/sr, into linear Rec. 709 RGB.

    Colours more saturated than the primaries have negative channels: 0 unless ``clip`` is off.
    Raises ``ValueError`` for whatever ``rgb_weights`` refuses.
    """
    found = np.asarray(reflectance, float) @ rgb_weights(wavelengths, illuminant)
    return np.maximum(found, 0) if clip else found


def rgb_from_xyz() -> Float[np.ndarray, "3 3"]:
    """Derive the matrix of Rec. 709 from its primaries; XYZ of its white becomes (1, 1, 1)."""
    xyz = np.array([_xyz(*chromaticity) for chromaticity in _PRIMARIES]).T
    return np.linalg.inv(xyz * np.linalg.solve(xyz, _xyz(*_WHITE)))


def _xyz(x: float, y: float) -> Float[np.ndarray, "3"]:
    """Find XYZ of a chromaticity, Y = 1."""
    return np.array([x / y, 1.0, (1 - x - y) / y])
