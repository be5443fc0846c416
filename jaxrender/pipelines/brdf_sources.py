"""The sources of a BRDF: a file of measurements, a model by name, or the result of a fit.

The suffix of a file, or its first bytes, decide who reads it.  Each reader says what it did.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxrender.brdf import (
    BRDF,
    IsotropicMean,
    Recoloured,
    ScatteredFit,
    WaveletBRDF,
    fit_isotropic_table,
)
from jaxrender.brdf.half_difference_tree import HalfDifferenceTree
from jaxrender.brdf.isotropic_mean import TURNS
from jaxrender.brdf.tables.measurements import Measurements
from jaxrender.brdf.tables.tabulated import TabulatedBRDF
from jaxrender.errors import InputError
from jaxrender.geometry import EMBEDDINGS
from jaxrender.imaging.colour import rgb_of_reflectance, rgb_weights
from jaxrender.inverse.brdf_spectrum import HarmonicBRDF
from jaxrender.io.alta import read_alta
from jaxrender.io.measured import ScatteredMeasurements, read_cornell
from jaxrender.io.merl import read_merl
from jaxrender.io.netcdf import opened
from jaxrender.io.rgl import read_rgl
from jaxrender.io.tables import FORMAT as TABLE
from jaxrender.io.tables import read_table
from jaxrender.io.tree_layout import BRDF_AXES, HALF_DIFFERENCE, HALF_DIFFERENCE_AXES
from jaxrender.io.tree_layout import FORMAT as TREE
from jaxrender.io.trees import read_tree
from jaxrender.io.utia import read_utia
from jaxrender.pipelines.lobes import model_of
from jaxrender.pipelines.result import ARRAYS, RESULT, read_run
from jaxrender.pipelines.tasks import task_named

_LOOKED_AT = 4096
_COLOURS = 3


class Source(NamedTuple):
    """A BRDF, its channels (as ``io.tree_layout`` names them), and what the reader says.

    ``rings``: negative values belong to a truncated series, not to holes among measurements.
    """

    name: str
    brdf: BRDF
    channels: str
    wavelengths: tuple[float, ...] = ()
    said: tuple[str, ...] = ()
    rings: bool = False
    measured: Measurements | None = None
    """Scattered measurements that the BRDF was fitted to."""

    @property
    def colours(self) -> BRDF:
        """The BRDF in linear RGB: one channel serves all three, and wavelengths are summed up.

        Raises ``InputError`` for channels that are no colours.
        """
        own = self.brdf.amplitudes.shape[1]
        if self.channels == "wavelengths":
            return _as_colours(self.name, self.brdf, self.wavelengths)
        if own not in (1, _COLOURS):
            raise InputError(f"{self.name}: {own} channels; give red, green and blue, or one")
        return self.brdf if own == _COLOURS else Recoloured(self.brdf, np.ones((1, _COLOURS)))

    @property
    def isotropic(self) -> "Source":
        """The source without a tangent: its mean over turns about the normal, which it says."""
        if self.brdf.isotropic:
            return self
        said = f"mean over {TURNS} turns about the normal and their mirror images"
        return self._replace(brdf=IsotropicMean(self.brdf), said=(*self.said, said))


def source_of(named: str, spectral: bool = False) -> Source:
    """Read a BRDF by its name: a file, a result folder, or a model such as ``phong:...``.

    ``spectral`` asks for all wavelengths of a file, instead of linear RGB.  Raises ``InputError``
    for an unreadable file, an unknown kind of file, and ``spectral`` without wavelengths.
    """
    path = Path(named)
    if path.is_dir():
        found = _result(path)
    elif names_file(named):
        found = _reader(path)(path, spectral)
    else:
        found = _model(named)
    if spectral and found.channels != "wavelengths":
        raise InputError(f"{named}: has no wavelengths; leave --spectral out")
    return found


def names_file(named: str | Path) -> bool:
    """Tell a file or a folder, there or not, from a model and its numbers."""
    path = Path(named)
    is_path = bool(path.suffix) or len(path.parts) > 1
    return path.exists() or (is_path and "=" not in str(named))


def names_result(named: str | Path) -> bool:
    """Tell the folder of a result, there or not, from a file and from a model."""
    path = Path(named)
    return path.is_dir() or (not path.exists() and names_file(path) and not path.suffix)


def files_of(named: str | Path) -> list[Path]:
    """List the files that a source is read from: one, those of a result, none of a model."""
    path = Path(named)
    if path.is_dir():
        return [path / name for name in (RESULT, ARRAYS) if (path / name).is_file()]
    return [path] if path.is_file() else []


def _as_colours(name: str, brdf: BRDF, wavelengths: Sequence[float]) -> BRDF:
    try:
        return Recoloured(brdf, rgb_weights(np.asarray(wavelengths, float)))
    except ValueError as error:
        raise InputError(f"{name}: {error}") from None


def _reader(path: Path) -> Callable[[Path, bool], Source]:
    if not path.is_file():
        raise InputError(f"{path}: no such file; mend the path")
    if path.suffix.lower() in READERS:
        return READERS[path.suffix.lower()]
    with path.open("rb") as stream:
        if b"#ALTA" in stream.read(_LOOKED_AT):
            return _alta
    raise InputError(
        f"{path}: unknown kind of file {path.suffix!r}; give one of {', '.join(READERS)}, a "
        "result folder, or a model such as microfacet:sigma=0.2"
    )


def measurements_of(named: str) -> Measurements | None:
    """Read the values of a file of scattered measurements as they are; None of any other source.

    Wavelengths become linear RGB.  Raises ``InputError`` for an unreadable file.
    """
    path = Path(named)
    if path.is_dir() or not path.is_file():
        return None
    reader = _reader(path)
    if reader is _cornell:
        return _measured_by_cornell(read_cornell(path), spectral=False)
    if reader is _alta:
        data = read_alta(path)
        return Measurements(data.incoming, data.outgoing, data.values)
    return None


def _measured_by_cornell(data: ScatteredMeasurements, spectral: bool) -> Measurements:
    values = np.where(data.values >= 0, data.values, np.nan)
    if not spectral:
        # A colour needs every wavelength.  A channel below zero, outside the gamut, becomes 0.
        values = rgb_of_reflectance(data.wavelengths, values)
    return Measurements(data.incoming, data.outgoing, values)


def _cornell(path: Path, spectral: bool) -> Source:
    data = read_cornell(path)
    measured = _measured_by_cornell(data, spectral)
    fit = _fitted(path, *measured)
    wavelengths = tuple(data.wavelengths.tolist()) if spectral else ()
    channels = "wavelengths" if spectral else "rgb"
    said = _said_of_fit(fit)
    return Source(path.name, fit.brdf, channels, wavelengths, said, measured=measured)


def _alta(path: Path, _: bool) -> Source:
    data = read_alta(path)
    fit = _fitted(path, data.incoming, data.outgoing, data.values)
    said = _said_of_fit(fit)
    if data.below_horizon:
        said += (f"{data.below_horizon} rows below the horizon left out",)
    measured = Measurements(data.incoming, data.outgoing, data.values)
    channels = _colours(data.values.shape[1])
    return Source(path.name, fit.brdf, channels, (), said, measured=measured)


def _fitted(
    path: Path, incoming: np.ndarray, outgoing: np.ndarray, values: np.ndarray
) -> ScatteredFit:
    try:
        return fit_isotropic_table(incoming, outgoing, values)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def _said_of_fit(fit: ScatteredFit) -> tuple[str, ...]:
    errors = " ".join(f"{100 * error:.3g}" for error in fit.relative_rms)
    return (
        f"fitted to {int(fit.used.max())} scattered measurements as an isotropic BRDF; error on "
        f"held-out measurements {errors} % rms",
        f"{int(fit.masked.sum())} negative or unknown values masked",
    )


def _merl(path: Path, _: bool) -> Source:
    table = read_merl(path)
    count = int(table.invalid.sum())
    said = f"{count} of {table.invalid.size} entries are not measured; filled from their neighbours"
    return Source(path.name, table.brdf(), "rgb", (), (said,))


def _utia(path: Path, _: bool) -> Source:
    table = read_utia(path)
    return Source(path.name, table.brdf(), "rgb", (), (f"{table.negative} negative values set 0",))


def _rgl(path: Path, spectral: bool) -> Source:
    material = read_rgl(path)
    said = (f"{material.negative} negative values set 0",)
    if material.wavelengths is None:
        return Source(path.name, material.brdf, "rgb", (), said)
    wavelengths = tuple(material.wavelengths.tolist())
    if not spectral:
        said = (*said, f"{len(wavelengths)} wavelengths as linear RGB")
        return Source(
            path.name, _as_colours(path.name, material.brdf, wavelengths), "rgb", (), said
        )
    return Source(path.name, material.brdf, "wavelengths", wavelengths, said)


def _netcdf(path: Path, _: bool) -> Source:
    with opened(path, TREE, TABLE) as file:
        is_tree = file.format == TREE
    return _tree(path) if is_tree else _table(path)


def _table(path: Path) -> Source:
    table = read_table(path)
    brdf = TabulatedBRDF(table.values, table.embedding)
    said = (
        f"table of {' x '.join(map(str, brdf.size))}, {table.embedding.name}",
        f"{table.masked} negative or unknown values set 0",
    )
    return Source(path.name, brdf, _colours(table.values.shape[-1]), (), said)


def _tree(path: Path) -> Source:
    tree, about = read_tree(path)
    if about.embedding == HALF_DIFFERENCE and about.axis_names == HALF_DIFFERENCE_AXES:
        brdf = HalfDifferenceTree.of(tree, about.value_transform)
    elif about.axis_names != BRDF_AXES or about.embedding not in EMBEDDINGS:
        raise InputError(f"{path}: a tree over {' '.join(about.axis_names)}; give one of a BRDF")
    elif about.value_transform != "none":
        raise InputError(
            f"{path}: {about.value_transform} of values over {about.embedding}; of trees over two "
            "directions only plain values are read: make it again with jaxrender compress"
        )
    else:
        brdf = WaveletBRDF(tree, EMBEDDINGS[about.embedding])
    said = (f"tree of {tree.count} coefficients, {100 * about.relative_rms:.3g} % rms off",)
    return Source(path.name, brdf, about.channels, about.wavelengths, said)


def _result(folder: Path) -> Source:
    run = read_run(folder)
    brdf = task_named(run.config.task).brdf(run)
    said = f"recovered by a fit, outcome {run.summary['outcome']}"
    if isinstance(brdf, HarmonicBRDF):
        return Source(folder.name, brdf, _colours(len(brdf.coupling)), (), (said,), rings=True)
    return Source(folder.name, brdf, _colours(brdf.amplitudes.shape[1]), (), (said,))


def _model(named: str) -> Source:
    brdf = model_of(named, option="").brdf
    if brdf is None:
        raise InputError(f"{named}: a mirror has no table; give a lobe such as microfacet:sigma=.1")
    return Source(named, brdf, _colours(brdf.amplitudes.shape[1]))


def _colours(channels: int) -> str:
    return "rgb" if channels == _COLOURS else "plain"


# One line for each kind of file.
READERS: dict[str, Callable[[Path, bool], Source]] = {
    ".binary": _merl,
    ".brdf": _cornell,
    ".alta": _alta,
    ".bin": _utia,
    ".bsdf": _rgl,
    ".nc": _netcdf,
}
