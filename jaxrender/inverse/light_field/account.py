"""What a factorization determines, in words: degrees, the ties between them, and their errors."""

import numpy as np

from jaxrender.shapes import Bool, Float, Int

# Light of a degree is said to be uncertain above this relative error.
_POORLY = 0.25
# A fit this much worse than its noise (chi-squared for one degree of freedom) is no factorization.
_CONTRADICTED = 3.0


def sentences(
    component: Int[np.ndarray, "degree"],
    light_known: Bool[np.ndarray, "degree"],
    brdf_known: Bool[np.ndarray, "degree outgoing_degree order"],
    relative_error: Float[np.ndarray, "degree"],
    chi_squared: float,
) -> tuple[str, ...]:
    """Say what is determined; ``component`` and the masks are those of a ``FactoredField``."""
    # Degrees that the light lacks: those of no component.
    dark = np.flatnonzero((component < 0) & light_known)
    unseen = np.flatnonzero((component < 0) & ~light_known)
    tied = np.flatnonzero(component == 0)
    said = [
        f"light and BRDF of {named(tied)} are determined, in the gauge L_00 = 1 / Lambda_0"
        if len(tied)
        else "degree 0 is dark: nothing fixes the gauge"
    ]
    own = [np.flatnonzero(component == which) for which in range(1, int(component.max()) + 1)]
    single = np.array([members[0] for members in own if len(members) == 1], int)
    groups = [f"{named(members)} together have" for members in own if len(members) > 1]
    if len(single):
        groups.append(f"{named(single)} " + ("has" if len(single) == 1 else "each have"))
    said += [
        f"{group} an unknown factor: light times f and BRDF over f give the same field (T 3.26), "
        "for no BRDF coefficient ties them to other degrees"
        for group in groups
    ]
    if len(dark):
        count = int(np.count_nonzero(brdf_known[dark]))
        said.append(
            f"the light has nothing at {named(dark)}: of the BRDF there, only the {count} "
            "coefficients that reciprocity knows from other degrees"
        )
    if len(unseen):
        said.append(
            f"nothing is known of {named(unseen)}: the field vanishes there, because the light "
            "does, or the BRDF, or both"
        )
    weak = np.flatnonzero((component == 0) & (relative_error > _POORLY))
    if len(weak):
        said.append(f"the light of {named(weak)} is uncertain by more than {_POORLY:.0%}")
    if chi_squared > _CONTRADICTED:
        said.append(
            f"chi-squared is {chi_squared:.3g} for one degree of freedom: no reciprocal BRDF "
            "explains this field; are the coefficients about the normal, and times cos t_o?"
        )
    return tuple(said)


def named(degrees: Int[np.ndarray, "some"]) -> str:
    """List degrees as runs: ``degrees 0 to 4, 6``."""
    values = [int(d) for d in degrees]
    runs: list[list[int]] = []
    for value in values:
        if runs and value == runs[-1][-1] + 1:
            runs[-1].append(value)
        else:
            runs.append([value])
    texts = [str(r[0]) if len(r) == 1 else f"{r[0]} to {r[-1]}" for r in runs]
    return ("degree " if len(values) == 1 else "degrees ") + ", ".join(texts)
