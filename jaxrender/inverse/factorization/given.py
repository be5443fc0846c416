"""What is known of a material, as a factorization has it; its own units where all is known."""

import numpy as np

from jaxrender.inverse.factorization.recover import Factorization
from jaxrender.inverse.factorization.state import Known
from jaxrender.inverse.uncertainty import Uncertain
from jaxrender.inverse.unknowns import MicrofacetUnknowns
from jaxrender.lighting import DirectionalSources
from jaxrender.shapes import Float


def known_of(unknowns: MicrofacetUnknowns, channels: int = 3, *, matt: bool = False) -> Known:
    """Say what of the material is known; only ratios of kd and ks mean anything without the light.

    ``matt``: it has one lobe alone, and so a share that is known.
    """
    share = None
    given = reflectances_of(unknowns, channels)
    if given is not None:
        kd, ks = given
        share = tuple((ks / (kd + ks)).tolist())
    elif matt:
        # One lobe alone, which is called kd: a base or, of oren-nayar, the lobe of the search.
        share = (0.0 if unknowns.ks.fixed is not None else 1.0,) * channels
    return Known(share, unknowns.sigma, unknowns.mu)


def reflectances_of(
    unknowns: MicrofacetUnknowns, channels: int = 3
) -> tuple[Float[np.ndarray, "channel"], Float[np.ndarray, "channel"]] | None:
    """Take kd and ks where both are known; else None."""
    if unknowns.kd.fixed is None or unknowns.ks.fixed is None:
        return None
    kd, ks = (
        np.broadcast_to(np.asarray(unknown.fixed, float), (channels,))
        for unknown in (unknowns.kd, unknowns.ks)
    )
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
