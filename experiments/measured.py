"""Measured materials: BRDFs as functions of two directions, and photographs of a ball of them."""

import zipfile
from collections.abc import Callable

import h5py
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.geometry import SurfaceSamples, meridian_frames
from jaxrender.inverse import KnownLight
from jaxrender.inverse.brdf_table.table import half_angle_coordinates
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.pipelines.brdf_sources import source_of

# Pairs of a sample and a direction that are worked on at once.
PAIRS = 200_000

# A BRDF in 1/sr by local directions to the light and to the camera.
Truth = Callable[[np.ndarray, np.ndarray], np.ndarray]


def network(archive: zipfile.ZipFile, name: str) -> Truth:
    """Read a network of six inputs, the half and the difference vector, fitted to MERL."""
    with archive.open(name) as opened, h5py.File(opened) as file:
        layers: dict[str, dict[str, np.ndarray]] = {}

        def visit(place: str, item: object) -> None:
            if isinstance(item, h5py.Dataset):
                layer, kind = place.split("/")[0], place.split("/")[-1].split(":")[0]
                layers.setdefault(layer, {})[kind] = np.asarray(item, float)

        file.visititems(visit)
    ordered = [layers[key] for key in sorted(layers)]

    def evaluate(incoming: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
        polar, difference, azimuth = np.moveaxis(half_angle_coordinates(incoming, outgoing), -1, 0)
        azimuth = np.abs(azimuth)
        sine = np.sin(difference)
        values = np.stack(
            [
                np.sin(polar),
                np.zeros_like(polar),
                np.cos(polar),
                sine * np.cos(azimuth),
                sine * np.sin(azimuth),
                np.cos(difference),
            ],
            axis=-1,
        )
        for number, layer in enumerate(ordered):
            values = values @ layer["kernel"] + layer["bias"]
            if number < len(ordered) - 1:
                values = np.maximum(values, 0)
        return np.maximum(np.expm1(values), 0)

    return evaluate


def table(path: str) -> Truth:
    """Read a measured table."""
    brdf = source_of(path).brdf
    evaluated = jax.jit(lambda incoming, outgoing: brdf.evaluate(incoming, outgoing))

    def evaluate(incoming: np.ndarray, outgoing: np.ndarray) -> np.ndarray:
        # As many each time: every number would be a program of its own.
        padded = np.tile([0.0, 0.0, 1.0], (PAIRS, 1))
        found = np.zeros((len(incoming), 3))
        for first in range(0, len(incoming), PAIRS):
            some = slice(first, first + PAIRS)
            pairs = [padded.copy(), padded.copy()]
            for pair, directions in zip(pairs, (incoming, outgoing)):
                pair[: len(directions[some])] = directions[some]
            found[some] = np.asarray(evaluated(*pairs))[: len(incoming[some])]
        return np.maximum(found, 0)

    return evaluate


def photographed(truth: Truth, samples: SurfaceSamples, frame: np.ndarray, light: KnownLight):
    """Add up what every node of the light sends to the camera."""
    frames = np.asarray(meridian_frames(jnp.asarray(samples.normals)))
    leaving = np.einsum("si,sij->sj", np.asarray(samples.outgoing), frames)
    found = np.zeros((len(frame), 3))
    for part in exact_nodes(light, frame, 0.05):
        directions, irradiance = (np.asarray(a, float) for a in part[:2])
        block = max(1, PAIRS // directions.shape[-2])
        for first in range(0, len(frame), block):
            some = slice(first, first + block)
            own = directions.ndim == 3
            towards = (
                directions[frame[some]]
                if own
                else np.broadcast_to(directions, (len(frame[some]), *directions.shape))
            )
            energy = irradiance[frame[some]] if own else irradiance[None]
            seen = np.einsum("sni,sij->snj", towards, frames[some])
            up = seen[..., 2] > 0
            out = np.broadcast_to(leaving[some, None], seen.shape)
            sent = np.zeros_like(seen)
            sent[up] = truth(seen[up], out[up]) * seen[up][:, 2:]
            found[some] += np.sum(sent * energy, axis=1)
    return found
