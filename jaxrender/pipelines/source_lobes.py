"""What ``--brdf`` names where a lobe has a spectrum: a model, or any source of ``brdf_sources``.

A material that is known by its values is one lobe of three channels about the reflected direction,
its diffuse part included.
"""

from pathlib import Path

import numpy as np

from jaxrender.brdf import Parametric, Recoloured
from jaxrender.pipelines.brdf_sources import files_of, names_file, source_of
from jaxrender.pipelines.lobes import Lobe, lobe_of


def lobe_named(specification: str) -> Lobe:
    """Read a lobe; a source that promises no isotropy is averaged over turns, and says so.

    Raises ``InputError`` as ``lobe_of`` and ``source_of`` do.
    """
    if not names_file(specification):
        return lobe_of(specification)
    path = Path(specification)
    source = source_of(specification).isotropic
    brdf = source.colours
    if isinstance(brdf, Parametric):
        # Taken whole, its base too.
        brdf = Recoloured(brdf, np.eye(brdf.amplitudes.shape[1]))
    said = tuple(f"{source.name}: {sentence}" for sentence in source.said)
    return Lobe(specification, path.name.replace(".", "_"), {}, brdf, said, whole=True)


def files_of_lobes(lobes: list[Lobe]) -> list[Path]:
    """List the files that lobes were read from."""
    return [path for lobe in lobes if lobe.whole for path in files_of(lobe.specification)]
