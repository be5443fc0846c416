"""The division: materials and lights from photographs, with error bars.

``outcomes``
    how a fit ended, in words
``solvers`` ``blas``
    the only place that knows the optimisation libraries; BLAS kept to one thread
``stated`` ``unknowns`` ``parameters``
    what is stated of a number: its value, bounds, a prior; which numbers are free, and how they
    enter; the same in a material's own units
``observations``
    usable pixels as measurements, and how a subset of them is drawn
``priors`` ``elimination`` ``search`` ``descent``
    what is known beforehand, laid out for a search; variable projection: the linear unknowns solved
    for inside each step; the search for the others; a descent with halved steps
``models``
    the exact integral behind the same interface as the dual model's table
``passes`` ``weights``
    one pass of a fit: least squares, noise and robust weights in turn; noise as weights
``intervals`` ``uncertainty`` ``conditioning`` ``account`` ``reasons`` ``variants``
    values with their intervals; the covariance behind them; what rests on grazing angles; what is
    identifiable and why not, in words; what rests on the model
``misfit`` ``clusters`` ``saturation`` ``diagnosis`` ``examination``
    noise apart from misfit, by neighbouring pixels; error bars that know of misfit; values that
    were clipped; what would explain it; all of that for one fit
``nuisances`` ``calibration`` ``rays`` ``near_light``
    what may be a little wrong with a capture, as numbers; found together with the material; rays of
    moved cameras; sources that have a place
``photographs`` ``stored_values`` ``unknown_material`` ``scene`` ``estimate`` ``own_words``
    photographs into observations; what their stored values mean; a material to be found; a scene
    and its fit; what was found of it, shown and saved; a material by the numbers of its own model
``any_estimate``
    what estimates of a material, a texture and a spectrum have in common
``known_light`` ``prepared_light``
    what lights photographs, and its point masses for the integral; it split for the dual model
``brdf`` ``material_task`` ``frequency_fit`` ``coarse_fit`` ``bank_choice``
    the whole recovery of a BRDF under known light (T 6.4.2); what it works on; how it begins, in
    the frequency view and without; which lobes of a bank the photographs ask for
``comparison`` ``interreflection``
    several models judged by held-out samples; light that a concave object sends itself (T 6.6)
``lighting``
    the light from a known material: its coefficients, or a map of directions (T 6.4.3)
``factorization``
    light and material both unknown (T 6.4.4)
``light_field``
    the same in closed form, from all coefficients of a reflected light field (T 2.68)
``brdf_spectrum`` ``brdf_table``
    a BRDF as coefficients; as a table, from photographs under one moving source
``nearest_models`` ``nearest_search`` ``curves``
    the models nearest to a table, a tree or measurements, with what they miss; curves that several
    numbers describe together, with bands
``completion``
    a whole BRDF from few values, by what other materials have in common; where to measure next
``texture``
    reflectance site by site, under known and unknown light
``shadowing`` ``transfer_field``
    what a concave object hides from itself; transfer vectors anywhere on it
``forecast`` ``next_best`` ``candidate_views``
    what photographs will tell, before they are taken, and which one more would tell most
"""

from jaxrender.inverse.any_estimate import AnyEstimate
from jaxrender.inverse.brdf import BRDFFit, fit_brdf
from jaxrender.inverse.estimate import Estimate
from jaxrender.inverse.factorization import Factorization, FactorSettings, Known, factorize
from jaxrender.inverse.known_light import KnownLight
from jaxrender.inverse.lighting import (
    DualSettings,
    LightOperator,
    LightSettings,
    RecoveredDual,
    RecoveredLight,
    recover_coefficients,
    recover_dual,
)
from jaxrender.inverse.nearest_models import Candidate, best_models
from jaxrender.inverse.observations import Observations
from jaxrender.inverse.outcomes import Outcome
from jaxrender.inverse.passes import FitSettings
from jaxrender.inverse.photographs import LoadedCapture, Reading, load_capture
from jaxrender.inverse.scene import Scene, fit
from jaxrender.inverse.stated import Prior, Stated, Unknown
from jaxrender.inverse.unknown_material import UnknownMaterial, unknown
from jaxrender.inverse.unknowns import Unknowns, unknowns_of

__all__ = [
    "AnyEstimate",
    "BRDFFit",
    "Candidate",
    "DualSettings",
    "Estimate",
    "FactorSettings",
    "Factorization",
    "FitSettings",
    "Known",
    "KnownLight",
    "LightOperator",
    "LightSettings",
    "LoadedCapture",
    "Observations",
    "Outcome",
    "Reading",
    "RecoveredDual",
    "RecoveredLight",
    "Scene",
    "Prior",
    "Stated",
    "Unknown",
    "Unknowns",
    "UnknownMaterial",
    "best_models",
    "factorize",
    "fit",
    "fit_brdf",
    "load_capture",
    "recover_coefficients",
    "recover_dual",
    "unknown",
    "unknowns_of",
]
