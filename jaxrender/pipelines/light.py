"""Tasks whose light is unknown: ``factorize`` (with the material) and ``lighting`` (alone)."""

from pathlib import Path
from typing import Any

import h5netcdf
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy
from jaxrender.geometry import Shape, SurfaceSamples, SurfaceView
from jaxrender.harmonics import LatLongGrid, band_limit_of, degrees, orders, synthesise
from jaxrender.inverse import Factorization, FactorSettings, Known, Observations, factorize
from jaxrender.inverse.comparison import Asked, Comparison, compare_factorizations, divided
from jaxrender.inverse.factorization import RecoveredScene, Round, predict
from jaxrender.inverse.uncertainty import Uncertain, in_own_units
from jaxrender.io import write_environment
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.pipelines.clock import Clock
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.deviation import write_covariance
from jaxrender.pipelines.own_words import OwnWords
from jaxrender.pipelines.photographs import Photograph
from jaxrender.pipelines.progress import Progress
from jaxrender.pipelines.recovery import Recovery
from jaxrender.pipelines.result import finite, pixels_of, ranking_of, sentence_of, write_variable
from jaxrender.pipelines.scene import fault_of, lobe_of, settings_of, unknowns_of
from jaxrender.pipelines.shadows import TransferField
from jaxrender.reflection import (
    DualForward,
    DualLight,
    ForwardModel,
    ShadowedDual,
    ShadowedModel,
    render_views,
)
from jaxrender.shapes import Float

# Slow light of so high a degree tells lamps from each other; the lamps carry what is finer.
_BAND_LIMIT = 10
# Rows of the recovered light's image: its texels are smaller than any lobe that showed it.
_ROWS = 128
_GAUGES = {
    "per-channel": "kd + ks = 1 in each channel; light scaled to match",
    "dielectric": "one ks for all channels, mean of kd + ks = 1; light scaled to match",
    "metal": "light of one mean radiance in all channels, mean of kd + ks = 1",
    "given": "given by the material",
}


class LightRecovery(Recovery):
    """A recovered light with its material, known beforehand or recovered along with it."""

    def __init__(
        self,
        asked: tuple[str, str, str],
        found: Factorization,
        observations: Observations,
        seen: tuple[list[Photograph], Shape],
        comparison: Comparison | None = None,
    ):
        """``asked`` are the task, the model's name and the gauge; perhaps it was compared."""
        self.task, self.model, self.gauge = asked
        self.found, self.observations = found, observations
        self.photographs, self.shape = seen
        self.comparison = comparison

    @property
    def light(self) -> DualLight:
        """The recovered light as the dual model sees it."""
        scene = self.found.scene
        return DualLight(jnp.asarray(scene.slow), scene.sources)

    def result(self) -> dict[str, Any]:
        """Build the summary of ``result.json``."""
        return _result(self)

    def predict(self) -> list[Float[np.ndarray, "row column channel"]]:
        """Render every photograph with the recovered light and material."""
        views = [photograph.view for photograph in self.photographs]
        if isinstance(self.found.brdf, Glossy):
            images = render_views(self.found.brdf, views, self._forward())
        else:
            images = [self._integrated(view) for view in views]
        # A sum of few degrees may dip below zero where the light is dark.
        return [np.maximum(image, 0) for image in images]

    def write(self, folder: Path) -> None:
        """Write the light as images, whole and without its lamps, and all arrays as NetCDF."""
        whole, slow = light_images(self.found.scene)
        write_environment(folder / "lighting.exr", Environment(whole))
        write_environment(folder / "lighting_slow.exr", Environment(slow))
        with h5netcdf.File(folder / "result.nc", "w") as file:
            _write_light(file, self.found.scene)
            _write_samples(file, self.observations, self.found)
            write_covariance(file, self.found.parameters)

    def contents(self, title: str, result: dict[str, Any], frames: tuple) -> Any:
        """Gather what the report shows."""
        from jaxrender.pipelines.report import LightContents

        images = light_images(self.found.scene)
        return LightContents(title, result, self.found, images, frames)

    def _integrated(self, view: SurfaceView) -> Float[np.ndarray, "row column channel"]:
        samples = SurfaceSamples(view.normals[view.hit], view.outgoing[view.hit])
        count, channels = len(samples.normals), self.found.scene.slow.shape[1]
        unseen = Observations(samples, np.zeros((count, channels)), np.zeros(count, int))
        image = np.zeros((*view.hit.shape, channels))
        image[view.hit] = predict(self.found, unseen)
        return image

    def _forward(self) -> ForwardModel | ShadowedModel:
        if self.shape.is_convex():
            return DualForward(self.light)
        pixels = sum(int(np.count_nonzero(p.view.hit)) for p in self.photographs)
        field = TransferField.of(self.shape, self.light.band_limit, pixels)
        return ShadowedDual(self.shape, self.light, field.at)


def recover_light(
    config: RunConfig,
    observations: Observations,
    seen: tuple[list[Photograph], Shape],
    clock: Clock,
    progress: Progress,
) -> LightRecovery:
    """Recover the light, and the material where that is not known."""
    photographs, shape = seen
    if observations.transfer is None and not shape.is_convex():
        with clock.stage("shadows"):
            field = TransferField.of(shape, _band_limit(config), observations.count)
            assert observations.places is not None
            normals = np.asarray(observations.samples.normals)
            transfer = field.at(observations.places, normals)
            observations = observations._replace(transfer=transfer)
    known, model, comparison = config.task == "lighting", config.brdf.model, None
    how = {
        "gauge": "per-channel" if known else config.brdf.gauge,
        "shape": shape,
        "stage": clock.stage,
        "watch": lambda round_: progress.note(_sentence(round_)),
    }
    settings = factor_settings(config)
    if config.brdf.compare:
        with fault_of("brdf.compare"):
            held_out, seed = config.solve.held_out, config.samples.seed
            models = _asked(config)
            comparison = compare_factorizations(
                observations, models, settings, held_out, seed, **how
            )
        found, model = comparison.best.fit, comparison.best.name
        assert isinstance(found, Factorization)
        # What it was fitted to, and predicts.
        observations, _ = divided(observations, held_out, seed)
        progress.note(sentence_of(comparison))
    else:
        with fault_of(str(config.capture.transforms)):
            lobe = lobe_of(config.brdf)
            found = factorize(observations, lobe, settings, _known(config), **how)
    gauge = "given" if known else config.brdf.gauge
    if known:
        found = _in_given_units(config, found)
    asked = config.task, model, gauge
    return LightRecovery(asked, found, observations, (photographs, shape), comparison)


def _asked(config: RunConfig) -> tuple[Asked, ...]:
    """List every model that the config names, each with what is said of its own parameters."""
    models = []
    for model in config.brdf.models:
        own = config.model_copy(update={"brdf": config.brdf.as_model(model)})
        models.append(Asked(model, lobe_of(own.brdf), _known(own)))
    return tuple(models)


def factor_settings(config: RunConfig) -> FactorSettings:
    """Translate how the light is to be found."""
    return FactorSettings(
        _band_limit(config),
        config.solve.most_sources,
        refine=config.solve.refine == "exact",
        noise=settings_of(config).noise,
        loss="huber" if config.solve.loss == "auto" else config.solve.loss,
    )


def _result(recovery: LightRecovery) -> dict[str, Any]:
    """Build the summary of ``result.json``."""
    found = recovery.found
    words = OwnWords(recovery.model, found.brdf)
    parameters = in_own_units(found.parameters, found.brdf)
    result = {
        "task": recovery.task,
        "outcome": found.outcome.value,
        "meaning": found.outcome.sentence,
        "reasons": list(found.reasons),
        "brdf": {
            "model": recovery.model,
            **words.material(parameters.value),
            **words.choices(),
        },
        "interval90": words.intervals(parameters.lower, parameters.upper),
        "standard_error": words.values(parameters.standard_error),
        "identifiable": found.identifiable,
        "residual": {
            "relative_rms": found.relative_rms,
            "samples": recovery.observations.count,
        },
        "noise": {"relative": found.noise.relative, "floor": found.noise.floor},
        "lighting": _lighting(recovery),
        "path": [
            {
                "sources": one.sources,
                "ks_share": one.share.tolist(),
                "sigma": one.sigma,
                found.brdf.index.name: found.brdf.index.of_index(one.mu),
                "relative_rms": one.relative_rms,
            }
            for one in found.rounds
        ],
        "pixels": pixels_of(recovery.photographs),
    }
    if recovery.comparison is not None:
        result["comparison"] = ranking_of(recovery.comparison)
    return finite(result)


def _write_light(file: h5netcdf.File, scene: RecoveredScene) -> None:
    light = file.create_group("light")
    count, channels = scene.slow.shape
    lamps = scene.sources.directions.shape[0]
    light.dimensions = {
        "coefficient": count,
        "channel": channels,
        "source": max(lamps, 1),
        "component": 3,
    }
    band_limit = band_limit_of(count)
    write_variable(light, "degree", ("coefficient",), degrees(band_limit))
    write_variable(light, "order", ("coefficient",), orders(band_limit))
    for name in ("slow", "slow_error", "total"):
        write_variable(light, name, ("coefficient", "channel"), getattr(scene, name))
    if lamps:
        write_variable(light, "direction", ("source", "component"), scene.sources.directions)
        write_variable(light, "irradiance", ("source", "channel"), scene.sources.irradiance)
        write_variable(light, "irradiance_error", ("source", "channel"), scene.energy_error)
        write_variable(light, "direction_error", ("source",), scene.direction_error)


def _write_samples(file: h5netcdf.File, observations: Observations, found: Factorization) -> None:
    samples, channels = file.create_group("samples"), observations.radiance.shape[1]
    samples.dimensions = {"sample": observations.count, "channel": channels, "component": 3}
    each = ("sample", "component")
    write_variable(samples, "normal", each, observations.samples.normals)
    write_variable(samples, "outgoing", each, observations.samples.outgoing)
    write_variable(samples, "radiance", ("sample", "channel"), observations.radiance)
    write_variable(samples, "predicted", ("sample", "channel"), found.predicted)
    write_variable(samples, "frame", ("sample",), observations.frame)


def light_images(
    scene: RecoveredScene,
) -> tuple[Float[np.ndarray, "row column channel"], Float[np.ndarray, "row column channel"]]:
    """Draw the whole light, each lamp as one texel of its energy, and its slow part alone.

    Where a sum of few degrees falls below zero the light is black.
    """
    grid = LatLongGrid(_ROWS, 2 * _ROWS)
    slow = np.maximum(np.asarray(synthesise(grid, jnp.asarray(scene.slow))), 0)
    whole = slow.copy()
    rows, columns = texels_of(scene.sources, grid)
    energy = np.maximum(np.asarray(scene.sources.irradiance), 0)
    np.add.at(whole, (rows, columns), energy / grid.weights()[rows, columns, None])
    return whole, slow


def texels_of(sources: DirectionalSources, grid: LatLongGrid) -> tuple[np.ndarray, np.ndarray]:
    """Find the texel that holds each source."""
    x, y, z = np.asarray(sources.directions, float).T
    height, width = grid.shape
    rows = np.clip(np.arccos(np.clip(z, -1, 1)) / np.pi * height, 0, height - 1).astype(int)
    columns = ((np.arctan2(y, x) / (2 * np.pi)) % 1 * width).astype(int) % width
    return rows, columns


def _band_limit(config: RunConfig) -> int:
    return _BAND_LIMIT if config.solve.band_limit == "auto" else config.solve.band_limit


def _known(config: RunConfig) -> Known:
    """What of the material is fixed; only ratios of kd and ks mean anything without the light."""
    brdf, unknowns = config.brdf, unknowns_of(config, 1)
    sigma, mu = (
        None if unknown is None or unknown.fixed is None else float(unknown.fixed[0])
        for unknown in (unknowns.sigma, unknowns.mu)
    )
    share = None
    if brdf.kd.fixed is not None and brdf.ks.fixed is not None:
        kd, ks = _reflectances(config)
        share = tuple((ks / (kd + ks)).tolist())
    return Known(share, sigma, mu)


def _reflectances(config: RunConfig) -> tuple[np.ndarray, np.ndarray]:
    brdf = config.brdf
    kd, ks = (np.broadcast_to(np.asarray(p.fixed, float), (3,)) for p in (brdf.kd, brdf.ks))
    return kd, ks


def _in_given_units(config: RunConfig, found: Factorization) -> Factorization:
    """Divide the light by the reflectance that the material is known to have."""
    kd, ks = _reflectances(config)
    total, scene = kd + ks, found.scene
    energies = np.asarray(scene.sources.irradiance) / total[None, :]
    sources = DirectionalSources(scene.sources.directions, energies)
    scene = scene._replace(
        slow=scene.slow / total,
        slow_error=scene.slow_error / total,
        sources=sources,
        energy_error=scene.energy_error / total,
        total=scene.total / total,
    )
    value, low, high, error = (p._replace(kd=kd, ks=ks) for p in found.parameters[:4])
    parameters = Uncertain(value, low, high, error)
    zero = parameters.standard_error._replace(kd=0 * kd, ks=0 * ks)
    return found._replace(
        brdf=found.brdf.with_amplitudes(kd, ks),
        scene=scene,
        parameters=parameters._replace(standard_error=zero),
    )


def _lighting(recovery: LightRecovery) -> dict[str, Any]:
    scene = recovery.found.scene
    return {
        "gauge": _GAUGES[recovery.gauge],
        "band_limit": band_limit_of(scene.slow.shape[0]),
        "coefficients": scene.slow.tolist(),
        "coefficients_error": scene.slow_error.tolist(),
        "coefficients_total": scene.total.tolist(),
        "environment": "lighting.exr",
        "directional": [
            {
                "direction": np.asarray(direction).tolist(),
                "irradiance": np.asarray(energy).tolist(),
                "irradiance_error": error.tolist(),
                "direction_error_degrees": float(np.degrees(step)),
            }
            for direction, energy, error, step in zip(
                scene.sources.directions,
                scene.sources.irradiance,
                scene.energy_error,
                scene.direction_error,
            )
        ],
    }


def _sentence(round_: Round) -> str:
    return (
        f"{round_.sources} sources: {100 * round_.relative_rms:.2f} % unexplained, "
        f"sigma {round_.sigma:.4f}"
    )
