"""To which degree a task follows slow light, and how far that pays.

The rounds follow slow light to a low degree, and sources carry what is finer.  A room of wide
windows has no sources: their edges have all degrees, and a view that grazes passes more of them
than the lobe does at normal exitance.  So where the photographs hold more than the model, slow
light is followed farther.  Akaike's criterion says whether more degrees predict other photographs
better, or only follow the noise.
"""

import numpy as np

from jaxrender.brdf import Glossy, Parametric
from jaxrender.geometry import Shape, visible_along
from jaxrender.harmonics import coefficient_count
from jaxrender.inverse.factorization.integral_response import IntegralResponse, response_of_convex
from jaxrender.inverse.factorization.response import MirrorResponse
from jaxrender.inverse.factorization.rounds import at_standstill, relit
from jaxrender.inverse.factorization.sight import Sight
from jaxrender.inverse.factorization.sources import add_sources
from jaxrender.inverse.factorization.state import FactorSettings, Known, State, Task, measured
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.shadowing import places_of, with_transfer

# Degrees to which slow light is followed: at first, where sources are told from it, and at most.
FIRST_DEGREE, _LAST_DEGREE = 10, 28
# A lobe of width sigma passes exp(-(sigma l)^2) at normal exitance: e^-16 at this product.  A view
# that grazes sees it two or three times as narrow across.
_SIGMA_TIMES_DEGREE = 4.0
# Sources that are looked for at once beside finer light.
_SOURCES = 16
# So many samples for each coefficient leave the light well determined.
SAMPLES_PER_COEFFICIENT = 4


def task_of(
    observations: Observations,
    variant: Parametric,
    settings: FactorSettings,
    known: Known,
    hiding: Shape | None,
    degree: int | None = None,
) -> Task:
    """Make the task of photographs; ``hiding`` is the shape where it shadows itself.

    Slow light is followed to ``degree``, or where nothing is said to that of the settings.  Raises
    ``ValueError`` for too few samples.
    """
    stated = FIRST_DEGREE if settings.band_limit is None else settings.band_limit
    band_limit = stated if degree is None else degree
    _check_enough(observations.count, band_limit)
    return with_samples(observations, variant, settings, known, hiding, band_limit)


def with_samples(
    observations: Observations,
    variant: Parametric,
    settings: FactorSettings,
    known: Known,
    hiding: Shape | None,
    band_limit: int,
) -> Task:
    """Make a task of other samples, few or many; the rest is that of ``task_of``."""
    if hiding is not None and isinstance(variant, Glossy):
        observations = with_transfer(observations, hiding, band_limit)
    samples, sources = observations.samples, settings.most_sources
    response = response_of_convex(variant, samples, band_limit, sources)
    if hiding is None:
        return Task(observations, response, None, known, settings)
    places = places_of(observations)
    sight = Sight(hiding, places)
    if isinstance(response, MirrorResponse):
        transfer = np.asarray(observations.transfer)[:, : coefficient_count(band_limit)]
        reflected = visible_along(hiding, places, np.asarray(samples.reflected, np.float64))
        response = response.shadowed(transfer, reflected)
    else:
        assert isinstance(response, IntegralResponse)
        response = response.shadowed(sight.hidden())
    return Task(observations, response, sight, known, settings)


def followed_farther(
    task: Task, state: State, hiding: Shape | None, excess: float = 1.0
) -> tuple[Task, State] | None:
    """Follow slow light to the degree that the lobe may show, where that pays; else None.

    ``excess`` is how many times the variance of noise the samples' weights stand for.

    It pays where other photographs of the same would be predicted better then.  A degree that was
    stated stays.  So does that of a material without a frequency view: its integrals are made for
    low degrees.
    """
    if task.settings.band_limit is not None or not isinstance(task.response, MirrorResponse):
        return None
    enough = int(np.sqrt(task.observations.count / SAMPLES_PER_COEFFICIENT)) - 1
    shown = int(np.ceil(_SIGMA_TIMES_DEGREE / np.exp(float(state.guess.sigma))))
    degree = min(shown, _LAST_DEGREE, enough)
    if degree <= task.band_limit:
        return None
    variant, known = task.response.variant, task.known
    finer = task_of(task.observations, variant, task.settings, known, hiding, degree)
    there = relit(finer, state)
    if _criterion(finer, there, excess) >= _criterion(task, state, excess):
        return None
    # Slow light has now what most sources stood for: those that still pay are found anew.
    bare = at_standstill(finer, there._replace(active=np.zeros_like(state.active)))
    return finer, add_sources(finer, bare, _SOURCES)


def _criterion(task: Task, state: State, excess: float) -> float:
    """Compute Akaike's criterion: chi-squared, and twice the number of coefficients that it took.

    What is expected of the light holds a coefficient in part, so that it counts in part.
    """
    assert state.joint is not None
    solved, penalty = state.joint.solved, np.asarray(measured(task, state).penalty)
    held = float(np.sum(penalty * np.asarray(solved.light) ** 2))
    inverse = np.linalg.inv(np.asarray(solved.normal))
    free = 1 - penalty.T * np.einsum("crp,crp->cp", inverse, inverse)
    return excess * (2 * float(solved.cost) - held) + 2 * float(free.sum())


def _check_enough(samples: int, band_limit: int) -> None:
    unknowns = coefficient_count(band_limit)
    if samples < SAMPLES_PER_COEFFICIENT * unknowns:
        raise ValueError(
            f"{samples} samples for light of {unknowns} coefficients: use more photographs or "
            "samples, or a lower band_limit"
        )
