"""What is known of a material, as a factorization wants it, and the light in its units."""

from collections.abc import Callable

import numpy as np

from jaxrender.brdf import Parametric
from jaxrender.inverse.factorization.gauges import amplitudes_of
from jaxrender.inverse.factorization.recover import Factorization
from jaxrender.inverse.factorization.state import Known
from jaxrender.inverse.intervals import Uncertain
from jaxrender.inverse.stated import Unknown
from jaxrender.inverse.unknowns import Unknowns
from jaxrender.lighting import DirectionalSources
from jaxrender.shapes import AnyArray, Float


def known_of(
    unknowns: Unknowns, lobe: Parametric, channels: int = 3, *, diffuse: bool = False
) -> Known:
    """Turn the unknowns of a material into those of a factorization.

    Without the light, kd and ks count by their ratio alone.  The numbers of ``lobe`` become the
    width and the index that they stand for.  A ``diffuse`` material has one lobe alone, so that its
    share is known.

    Raises ``ValueError`` for a prior, which no factorization asks for.
    """
    for name in unknowns.with_prior:
        raise ValueError(f"{name} has a prior; priors count under known light: give it bounds")
    share = None
    given = reflectances_of(unknowns, channels)
    if given is not None:
        kd, ks = given
        share = tuple((ks / (kd + ks)).tolist())
    elif diffuse:
        # One lobe alone: a base, or that of the search.
        share = (float(lobe.amplitude_names[0] not in lobe.bases),) * channels
    sigma = _through(unknowns[lobe.shape.name], lobe.shape.width_of)
    has_index = lobe.index.name in unknowns
    mu = _through(unknowns[lobe.index.name], lobe.index.index_of) if has_index else None
    return Known(share, sigma, mu)


def _through(unknown: Unknown, function: Callable[[float], float]) -> Unknown:
    """Carry bounds, value and start over to another number, which may fall as this one rises."""
    if unknown.fixed is not None:
        return Unknown(fixed=tuple(float(function(value)) for value in unknown.fixed))
    low, high = sorted(float(function(bound)) for bound in (unknown.lower, unknown.upper))
    return Unknown(
        None, low, high, None if unknown.start is None else float(function(unknown.start))
    )


def reflectances_of(
    unknowns: Unknowns, channels: int = 3
) -> tuple[Float[np.ndarray, "channel"], Float[np.ndarray, "channel"]] | None:
    """Take kd and ks where both are known, kd 0 where there is no base; else None."""
    if unknowns.free_amplitudes:
        return None
    kd, ks = np.zeros(channels), np.zeros(channels)
    for at, unknown in enumerate(unknowns.amplitudes):
        into = ks if at in unknowns.shaped else kd
        into += np.asarray(unknown.fixed, float)
    return kd, ks


def in_units_of(
    found: Factorization, kd: Float[np.ndarray, "channel"], ks: Float[np.ndarray, "channel"]
) -> Factorization:
    """Divide the light by the reflectance that the material is known to have."""
    total, scene = kd + ks, found.scene
    energies = np.asarray(scene.sources.irradiance) / total[None, :]
    sources = DirectionalSources(scene.sources.directions, energies)
    scene = scene._replace(
        slow=scene.slow / total,
        sources=sources,
        covariance=scene.covariance / total[:, None, None] ** 2,
        clusters=tuple(
            one._replace(
                irradiance=one.irradiance / total, irradiance_error=one.irradiance_error / total
            )
            for one in scene.clusters
        ),
    )
    known = amplitudes_of(found.brdf, kd, ks)
    exact = found.parameters.if_exact
    parameters = _of_known(found.parameters, known)
    if exact is not None:
        parameters = parameters._replace(if_exact=_of_known(exact, known))
    return found._replace(
        brdf=found.brdf.with_amplitudes(*known.values()), scene=scene, parameters=parameters
    )


def _of_known(parameters: Uncertain, known: dict[str, Float[AnyArray, "channel"]]) -> Uncertain:
    """Put amplitudes in that are known, without errors."""
    value, low, high, error = (p._replace(amplitudes=known) for p in parameters[:4])
    error = error._replace(amplitudes={name: 0 * amount for name, amount in known.items()})
    return Uncertain(value, low, high, error, origins=parameters.origins)
