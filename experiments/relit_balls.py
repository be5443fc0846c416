"""How balls of measured materials are seen, lit, fitted and relit."""

from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scenes
from scenes import unit

from jaxrender.brdf import Bank, Parametric, lobe_named
from jaxrender.geometry import SurfaceSamples, fibonacci_sphere
from jaxrender.inverse import (
    BRDFFit,
    FitSettings,
    KnownLight,
    Observations,
    Stated,
    fit_brdf,
    unknowns_of,
)
from jaxrender.inverse.light_nodes import exact_nodes
from jaxrender.inverse.models import ExactModel
from jaxrender.io import read_environment
from jaxrender.lighting import DirectionalSources, Environment

NOISE, LOWEST_COSINE, VIEWS, PIXELS, SIDE = 0.005, 0.15, 12, 400, 64
ROWS, ENERGY = 32, 3.0
# What is found of a renderer's material besides what always is.
FREED = {
    "openpbr": ("specular_ior", "coat_weight", "coat_roughness", "fuzz_weight"),
    "principled": ("sheen", "clearcoat", "specular"),
}


class Relit(NamedTuple):
    """How well a picture under another light was foretold."""

    rms: float
    median: float
    stated: float


def ball(views: np.ndarray, count: int, seed: int) -> tuple[SurfaceSamples, np.ndarray]:
    """Draw pixels of a ball, alike over its picture, from every view."""
    rng = np.random.default_rng(seed)
    normals = []
    for view in views:
        across = unit(np.cross(view, [0.3, 0.5, 0.8]))
        radius = np.sqrt(rng.uniform(0, 1 - LOWEST_COSINE**2, (count, 1)))
        angle = rng.uniform(0, 2 * np.pi, (count, 1))
        aside = np.cos(angle) * across + np.sin(angle) * np.cross(view, across)
        normals.append(radius * aside + np.sqrt(1 - radius**2) * view)
    frame = np.repeat(np.arange(len(views)), count)
    return SurfaceSamples(np.concatenate(normals), views[frame]), frame


def pictures(count: int) -> tuple[SurfaceSamples, np.ndarray]:
    """List all pixels of so many pictures from one side."""
    across = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    x, y = (axis.ravel() for axis in np.meshgrid(across, across))
    there = x**2 + y**2 < 1 - LOWEST_COSINE**2
    normals = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=1)[there]
    frame = np.repeat(np.arange(count), len(normals))
    every = np.tile(normals, (count, 1))
    return SurfaceSamples(every, np.tile([0.0, 0.0, 1.0], (len(every), 1))), frame


def columns(material: Parametric, samples: SurfaceSamples, frame: np.ndarray, light: KnownLight):
    """Integrate every lobe."""
    nodes = exact_nodes(light, frame, float(material.width))
    model = ExactModel(material, samples, nodes)
    numbers = {name: jnp.asarray(value) for name, value in material.numbers.items()}
    return np.stack([np.asarray(part) for part in model.columns(numbers)], axis=1)


def relit(fit: BRDFFit, truth: np.ndarray, found: np.ndarray) -> Relit:
    """Hold a picture by what a fit has found against the true one; ``found`` are its columns."""
    material = found_by(fit)
    predicted = np.einsum("skc,kc->sc", found, np.asarray(material.amplitudes))
    labels = fit.parameters.value.labels
    covariance = np.asarray(fit.parameters.covariance)
    variance = np.zeros_like(predicted)
    for channel in range(predicted.shape[1]):
        own = [f"{name}[{channel}]" for name in material.amplitude_names]
        kept = [place for place, label in enumerate(own) if label in labels]
        rows = [labels.index(own[place]) for place in kept]
        moves = found[:, kept, channel]
        variance[:, channel] = np.sum((moves @ covariance[np.ix_(rows, rows)]) * moves, axis=1)
    return compared(predicted, np.sqrt(np.maximum(variance, 1e-30)), truth)


def compared(predicted: np.ndarray, stated: np.ndarray, truth: np.ndarray) -> Relit:
    """Hold a predicted picture against the true one."""
    off = predicted - truth
    size = np.linalg.norm(truth, axis=1)
    lit = size > 1e-3 * size.max()
    return Relit(
        100 * np.sqrt(np.sum(off**2) / np.sum(truth**2)),
        100 * float(np.median(np.linalg.norm(off, axis=1)[lit] / size[lit])),
        float(np.median((np.abs(off) / stated)[lit])),
    )


def found_by(fit: BRDFFit) -> Parametric:
    """Take the material; of a bank with the lobes that are black, whose program is there."""
    if not isinstance(fit.brdf, Bank):
        return fit.brdf
    bank = Bank.black()
    found = dict(zip(fit.brdf.amplitude_names, np.asarray(fit.brdf.amplitudes)))
    return bank.with_amplitudes(*(found.get(name, np.zeros(3)) for name in bank.amplitude_names))


def lobe(name: str) -> Parametric:
    return Bank.black() if name == "bank" else lobe_named(name)


def fitted(name: str, observations: Observations, light: KnownLight) -> BRDFFit:
    variant = lobe(name)
    freed = dict.fromkeys(FREED.get(name, ()), Stated())
    unknowns = unknowns_of(variant, freed, ks_per_channel=True)
    return fit_brdf(observations, light, unknowns, variant, FitSettings(diagnose=False))


def probes(files: list[Path], convention: str) -> list[Environment]:
    """Read probes, or make rooms of windows up, of like energy."""
    if files:
        found = [read_environment(file, convention, height=ROWS) for file in files]
    else:
        found = [scenes.probe(kind, 1, ROWS) for kind in ("interior", "sky")]
    energies = [np.asarray(one.nodes().irradiance).sum(axis=0).mean() for one in found]
    return [
        Environment(np.asarray(one.radiance) * ENERGY / energy)
        for one, energy in zip(found, energies)
    ]


def around(count: int) -> np.ndarray:
    """Spread directions over the sphere."""
    return np.asarray(fibonacci_sphere(count))


def lamp(direction: list[float], energy: float) -> DirectionalSources:
    return DirectionalSources(unit(np.array([direction])), np.full((1, 3), energy))
