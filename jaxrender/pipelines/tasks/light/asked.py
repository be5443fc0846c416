"""The settings of a recovery under unknown light, from a config."""

from jaxrender.catalogue import MODELS
from jaxrender.inverse import Factorization, FactorSettings, Known, factorization
from jaxrender.inverse.comparison import Asked
from jaxrender.pipelines.config import RunConfig
from jaxrender.pipelines.scene import lobe_of, settings_of, unknowns_of


def factor_settings(config: RunConfig) -> FactorSettings:
    """Translate how the light is to be found."""
    return FactorSettings(
        _stated(config),
        config.solve.most_sources,
        refine=config.solve.refine == "exact",
        noise=settings_of(config).noise,
        loss="huber" if config.solve.loss == "auto" else config.solve.loss,
        diagnose=config.solve.diagnose,
        free=config.solve.free,
    )


def band_limit(config: RunConfig) -> int:
    """Choose the degree of the slow light, where the rounds begin."""
    stated = _stated(config)
    return factorization.FIRST_DEGREE if stated is None else stated


def _stated(config: RunConfig) -> int | None:
    return None if config.solve.band_limit == "auto" else config.solve.band_limit


def asked_models(config: RunConfig) -> tuple[Asked, ...]:
    """List every model of the config, each with what is known of its parameters."""
    models = []
    for model in config.brdf.models:
        own = config.model_copy(update={"brdf": config.brdf.as_model(model)})
        models.append(Asked(model, lobe_of(own.brdf), known_of(own)))
    return tuple(models)


def known_of(config: RunConfig) -> Known:
    """Say what of the material is known."""
    diffuse = not MODELS[config.brdf.model].has_specular
    return factorization.known_of(unknowns_of(config, 1), lobe_of(config.brdf), diffuse=diffuse)


def in_given_units(config: RunConfig, found: Factorization) -> Factorization:
    """Divide the light by the reflectance that the material is known to have."""
    given = factorization.reflectances_of(unknowns_of(config, 1))
    assert given is not None
    return factorization.in_units_of(found, *given)
