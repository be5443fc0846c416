"""Numbers of every camera model, as calibrations have them."""

from jaxrender.geometry import LENS_MODELS, Lens, Pinhole, metashape_lens, opencv_lens

FISHEYE = [-0.03, 0.004, -0.001, 1e-4]
NUMBERS: dict[str, list[float]] = {
    "SIMPLE_RADIAL": [-0.1],
    "RADIAL": [-0.1, 0.02],
    "OPENCV": [-0.1, 0.02, 1e-3, -2e-3],
    "FULL_OPENCV": [-0.1, 0.02, 1e-3, -2e-3, 0.01, 0.05, -0.02, 0.003],
    "FOV": [0.9],
    "SIMPLE_DIVISION": [-0.1],
    "DIVISION": [0.15],
    "SIMPLE_FISHEYE": [],
    "FISHEYE": [],
    "SIMPLE_RADIAL_FISHEYE": FISHEYE[:1],
    "RADIAL_FISHEYE": FISHEYE[:2],
    "OPENCV_FISHEYE": FISHEYE,
    "THIN_PRISM_FISHEYE": [*FISHEYE[:2], 1e-3, -2e-3, *FISHEYE[2:], 1e-3, -5e-4],
    "EUCM": [0.6, 1.1],
    "EQUIRECTANGULAR": [],
    "RAD_TAN_THIN_PRISM_FISHEYE": [*FISHEYE, 1e-5, -1e-5, 1e-3, -2e-3, 1e-3, -5e-4, 7e-4, 3e-4],
}
PRISM = [-0.1, 0.02, 1e-3, -2e-3, 0.01, 0.05, -0.02, 0.003, 1e-3, -5e-4, 7e-4, 3e-4]


def lenses() -> dict[str, Lens]:
    """Make a lens of every kind."""
    made = {name: LENS_MODELS[name].lens(numbers) for name, numbers in NUMBERS.items()}
    made["prism"] = opencv_lens(PRISM)
    made["metashape"] = metashape_lens([-0.1, 0.02, -0.003, 5e-4], (1e-3, -2e-3), 0.004)
    return {name: lens for name, lens in made.items() if lens is not None}


def parameters(name: str) -> list[float]:
    """List all numbers of a model of COLMAP."""
    if name == "EQUIRECTANGULAR":
        return [64.0, 48.0]
    lengths = [100.0] if LENS_MODELS[name].parameters[0] == "f" else [100.0, 120.0]
    return [*lengths, 31.0, 23.5, *NUMBERS[name]]


def camera(lens: Lens | None, pose, size=(64, 48)) -> Pinhole:
    """Make a camera whose corners are far from the axis."""
    return Pinhole(*size, pose, fl_x=60.0, fl_y=66.0, cx=31.0, cy=23.5, lens=lens)
