"""How a fit ended: numerical outcomes are results, not exceptions."""

import enum


class Outcome(enum.Enum):
    """The five ways in which a fit ends; ``sentence`` says it to a person."""

    CONVERGED = "converged"
    MISFIT = "misfit"
    NOT_CONVERGED = "not_converged"
    AT_BOUND = "at_bound"
    NOT_IDENTIFIABLE = "not_identifiable"

    @property
    def sentence(self) -> str:
        """What the outcome means."""
        return _SENTENCES[self]


_SENTENCES = {
    Outcome.CONVERGED: "the fit converged and every free parameter is identifiable",
    Outcome.MISFIT: "the photographs hold more than the model and noise: see what would explain it",
    Outcome.NOT_CONVERGED: "the solver stopped before it converged: do not use these values",
    Outcome.AT_BOUND: "a parameter ended at a bound: widen it, or fix the parameter",
    Outcome.NOT_IDENTIFIABLE: "the photographs do not determine every free parameter",
}
