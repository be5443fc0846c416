"""What a config says of light and material, in the words of a recovery under unknown light."""

import numpy as np

from jaxrender.inverse import Factorization, FactorSettings, Known
from jaxrender.inverse.comparison import Asked
from jaxrender.inverse.uncertainty import Uncertain
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.config.brdf import MATT
from jaxrender.pipelines.scene import lobe_of, settings_of, unknowns_of

# Slow light of so high a degree tells lamps from each other; the lamps carry what is finer.
_BAND_LIMIT = 10


def factor_settings(config: RunConfig) -> FactorSettings:
    """Translate how the light is to be found."""
    return FactorSettings(
        band_limit(config),
        config.solve.most_sources,
        refine=config.solve.refine == "exact",
        noise=settings_of(config).noise,
        loss="huber" if config.solve.loss == "auto" else config.solve.loss,
    )


def band_limit(config: RunConfig) -> int:
    """Choose the degree of the slow light."""
    return _BAND_LIMIT if config.solve.band_limit == "auto" else config.solve.band_limit


def asked_models(config: RunConfig) -> tuple[Asked, ...]:
    """List every model that the config names, each with what is said of its own parameters."""
    models = []
    for model in config.brdf.models:
        own = config.model_copy(update={"brdf": config.brdf.as_model(model)})
        models.append(Asked(model, lobe_of(own.brdf), known_of(own)))
    return tuple(models)


def known_of(config: RunConfig) -> Known:
    """What of the material is known; only ratios of kd and ks mean anything without the light."""
    brdf, unknowns = config.brdf, unknowns_of(config, 1)
    share = None
    if unknowns.kd.fixed is not None and unknowns.ks.fixed is not None:
        kd, ks = _reflectances(config)
        share = tuple((ks / (kd + ks)).tolist())
    elif brdf.model in MATT:
        # One lobe alone, which is called kd: a base or, of oren-nayar, the lobe of the search.
        share = (0.0 if unknowns.ks.fixed is not None else 1.0,) * 3
    return Known(share, unknowns.sigma, unknowns.mu)


def in_given_units(config: RunConfig, found: Factorization) -> Factorization:
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


def _reflectances(config: RunConfig) -> tuple[np.ndarray, np.ndarray]:
    unknowns = unknowns_of(config, 1)
    kd, ks = (
        np.broadcast_to(np.asarray(unknown.fixed, float), (3,))
        for unknown in (unknowns.kd, unknowns.ks)
    )
    return kd, ks
