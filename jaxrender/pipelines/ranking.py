"""The compared models, the best first: as data for ``result.json``, and as a sentence."""

from typing import Any

from jaxrender.inverse.comparison import Comparison, Score
from jaxrender.inverse.own_words import OwnWords


def ranking_of(comparison: Comparison, one_ks: bool = False) -> dict[str, Any]:
    """List the models that were compared, the best first; ``one_ks`` as in ``OwnWords``."""

    def one(score: Score) -> dict[str, Any]:
        words = OwnWords(score.name, score.fit.brdf, one_ks)
        parameters = score.fit.parameters.summed(score.fit.brdf.sums)
        return {
            "model": score.name,
            "outcome": score.fit.outcome.value,
            "brdf": words.material(parameters.value),
            "standard_error": words.values(parameters.standard_error),
            "chi_squared": score.chi_squared,
            "relative_rms": score.relative_rms,
            "behind": score.behind,
            "behind_error": score.behind_error,
            "told_apart": score.told_apart,
        }

    return {
        "held_out": comparison.held_out,
        "ranking": [one(score) for score in comparison.scores],
    }


def sentence_of(comparison: Comparison) -> str:
    """Name the best model, and those that explain the held-out samples as well."""
    best, *others = comparison.scores
    as_good = [score.name for score in others if not score.told_apart]
    sentence = f"{best.name} explains {comparison.held_out} held-out samples best"
    return f"{sentence}; {', '.join(as_good)} as well" if as_good else sentence
