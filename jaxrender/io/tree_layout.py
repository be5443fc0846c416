"""How a coefficient tree is laid out in a file: names, limits, conventions.

Every convention is an attribute with a word for programs and a sentence for those who have the file
alone.
"""

import math
from typing import Any, NamedTuple

from jaxrender.brdf.half_difference_tree import LOG_SCALE
from jaxrender.geometry import EMBEDDINGS
from jaxrender.io.netcdf import Format
from jaxrender.wavelets import WAVELETS, CoefficientTree, Wavelet, daubechies

FORMAT = Format("jaxrender wavelet coefficient tree", 1, "jaxrender compress")

NODE_ARRAYS = ("child_mask", "value_mask")
BRDF_AXES = ("kappa_i", "lambda_i", "kappa_r", "lambda_r")
HALF_DIFFERENCE, HALF_DIFFERENCE_AXES = "half-difference", ("root_theta_h", "theta_d", "phi_d")
NO_EMBEDDING = "none"
CHANNEL_MEANING = {
    "rgb": "linear red, green, blue of Rec. 709",
    "wavelengths": "one for each of `wavelength`, in nm",
    "plain": "numbers without colour",
}
EMBEDDING_MEANING = {
    "nusselt": "direction (x, y, z): kappa = (x + 1) / 2, lambda = (y + 1) / 2; zero outside the "
    "disc",
    "polar": "kappa = polar angle / (pi / 2), lambda = azimuth / (2 pi)",
    HALF_DIFFERENCE: "h the half vector, d the difference of the directions: root_theta_h = "
    "sqrt(angle(h, n) / (pi / 2)), theta_d = angle(h, i) / (pi / 2), phi_d = azimuth of d about h "
    "from the plane of h and n, modulo pi, / pi, and closes upon itself",
    NO_EMBEDDING: "the axes are coordinates of their own",
}
TRANSFORM_MEANING = {
    "none": "f is the value",
    "cube-root": "f is the cube root of the value: take 0 for f below 0, then f^3",
    "log": f"f is log(1 + {LOG_SCALE:g} value): take 0 for f below 0, then "
    f"(e^f - 1) / {LOG_SCALE:g}",
}
_SENTENCES = {
    "tree": "node 0 is the root, at level 0; nodes stand level by level, each level's children of "
    "one node after those of the node before. Bit b of child_mask: there is a child at place "
    "2 m_a + (bit a of b) along axis a; bit nu of value_mask: there is a coefficient of selector "
    "nu, bit a of nu choosing wavelet (1) or scaling function (0) along axis a. `values` go "
    "node by node, nu ascending",
    "formula": "f(q) = root + sum over coefficients of value * product over axes of "
    "2^(l/2) gamma(2^l q_a - m_a), gamma = phi or psi of `wavelet`, l the level, each periodic of "
    "period 1 and of unit norm on [0, 1] if the wavelet is orthonormal",
    "samples": "sample j of n along an axis stands at j / n + offset",
    "negative": "what thresholding left may be negative: take 0 there, if f cannot be",
    "frame": "local: +Z the normal, both directions away from the surface; i incoming, r reflected",
}

# A level and a place have one 64-bit number; and what is read at most.
MOST_BITS = 62
MOST_NODES = 2**22
MOST_NUMBERS = 2**28
MOST_CHANNELS = 4096


class TreeAbout(NamedTuple):
    """What a tree was made from, and what it misses."""

    source: str
    embedding: str = "nusselt"
    axis_names: tuple[str, ...] = BRDF_AXES
    units: str = "1/sr"
    channels: str = "rgb"
    wavelengths: tuple[float, ...] = ()
    relative_rms: float = math.nan
    """Root mean square of what the tree misses over that of the table, channels together."""
    relative_rms_between: float = math.nan
    """The same at random pairs of directions, of the BRDF that the table was made from."""
    non_zero: int = 0
    """How many coefficients the table has; 0 where nobody counted."""
    comment: str = ""
    value_transform: str = "none"
    """What of a value the tree holds; files from before there was a choice hold the value."""


def fault_of(about: TreeAbout, tree: CoefficientTree) -> str | None:
    """Say what of a description does not go with a tree."""
    channels, known = tree.channels, (NO_EMBEDDING, *EMBEDDINGS, HALF_DIFFERENCE)
    if about.value_transform not in TRANSFORM_MEANING:
        listed = ", ".join(TRANSFORM_MEANING)
        return f"`value_transform` is {about.value_transform!r}; wanted one of {listed}"
    if about.embedding not in known:
        return f"`embedding` is {about.embedding!r}; wanted one of {', '.join(known)}"
    if about.channels not in CHANNEL_MEANING:
        return f"`channels` is {about.channels!r}; wanted one of {', '.join(CHANNEL_MEANING)}"
    if len(about.axis_names) != tree.axes:
        return f"{len(about.axis_names)} names of axes and {tree.axes} axes; give one for each"
    if about.channels == "rgb" and channels != 3:
        return f"{channels} channels called rgb; that has 3, so choose another word of `channels`"
    wanted = channels if about.channels == "wavelengths" else 0
    if len(about.wavelengths) != wanted:
        return f"{len(about.wavelengths)} wavelengths; wanted {wanted}, one a channel if so called"
    if any(not (math.isfinite(w) and w > 0) for w in about.wavelengths):
        return f"wavelengths {about.wavelengths}; wanted positive numbers, in nm"
    return None


def wavelet_of(name: str) -> Wavelet | None:
    """Find a wavelet by the name that files have for it."""
    family, _, number = name.rpartition("-")
    if name not in WAVELETS and family == "daubechies" and number in map(str, range(2, 11)):
        return daubechies(int(number))
    return WAVELETS.get(name)


def attributes(tree: CoefficientTree, about: TreeAbout) -> dict[str, Any]:
    """Arrange all that is not an array."""
    given = about._asdict() | {"axis_names": " ".join(about.axis_names)}
    given.pop("wavelengths")
    return {
        **given,
        "wavelet": tree.wavelet.name,
        "size": tree.size,
        "axes": tree.axes,
        "offset": tree.offset,
        "embedding_meaning": EMBEDDING_MEANING[about.embedding],
        "value_transform_meaning": TRANSFORM_MEANING[about.value_transform],
        "channels_meaning": CHANNEL_MEANING[about.channels],
        **{f"{name}_meaning": sentence for name, sentence in _SENTENCES.items()},
    }
