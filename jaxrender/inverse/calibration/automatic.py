"""What is freed: some nuisances by name, or (``auto``) whatever the diagnosis names.

``auto`` frees one after the other, until the diagnosis names none or none that can be freed.
"""

import dataclasses
from collections.abc import Callable
from typing import Generic, TypeVar

from jaxrender.inverse.calibration.account import Calibration
from jaxrender.inverse.diagnosis import CLIPPED, Diagnosis
from jaxrender.inverse.misfit import Misfit
from jaxrender.inverse.nuisances import NUISANCES

# So many times at most something is freed that the diagnosis names.
_MOST_FREED = 3
# Causes whose odds are within e^5 of the best one's may be the right one.
_AS_WELL = 10.0
# What is freed is to do this part of what the diagnosis foretold.
_AS_FORETOLD = 0.5

End = TypeVar("End")


@dataclasses.dataclass(frozen=True)
class Examined(Generic[End]):
    """Where a fit has ended, what it leaves, what would explain it, and what was freed for it."""

    end: End
    misfit: Misfit | None = None
    diagnosis: tuple[Diagnosis, ...] = ()
    calibration: Calibration | None = None
    refused: tuple[str, ...] = ()

    @property
    def freed(self) -> tuple[str, ...]:
        """What has been freed so far."""
        return () if self.calibration is None else self.calibration.free

    @property
    def named(self) -> tuple[str, ...]:
        """The nuisance that explains the rest best, and those that do so as well.

        None is tried where values are clipped: that no nuisance is to take up.
        """
        if any(one.cause == CLIPPED for one in self.diagnosis):
            return ()
        left = [
            one
            for one in self.diagnosis
            if one.cause in NUISANCES and one.cause not in self.refused
        ]
        least = left[0].bic - _AS_WELL if left else 0.0
        return tuple(one.cause for one in left if one.bic >= least)

    @property
    def unsettled(self) -> bool:
        """Whether something was freed, and something else is still named."""
        return self.calibration is not None and bool(self.named)

    @property
    def unsettled_sentence(self) -> str:
        """Say so."""
        return (
            f"free: auto has freed {', '.join(self.freed)} one after the other, and the diagnosis "
            "still names something that could be freed"
        )

    def and_then(self, further: "Examined[End]") -> "Examined[End]":
        """Go on with what was freed, if that did what the diagnosis foretold; else refuse it.

        What is wrong in truth does more than its first order says; what looks alike does less.
        Where something else explains more, it is to do more than that would.
        """
        best = self.diagnosis[0]
        demanded = (_AS_FORETOLD if best.cause in self.named else 1) * best.explains
        if self._absorbed_by(further) >= demanded:
            return dataclasses.replace(further, refused=self.refused)
        return dataclasses.replace(self, refused=(*self.refused, *self.named))

    def _absorbed_by(self, further: "Examined[End]") -> float:
        """Say which part of what this leaves the other takes away: by a robust loss or by squares.

        A robust loss hardly counts gross residuals.  The diagnosis foretells squares.
        """
        assert further.calibration is not None
        robust = further.calibration.absorbed
        if self.misfit is None or further.misfit is None or not self.misfit.rms > 0:
            return robust
        return max(robust, 1 - (further.misfit.rms / self.misfit.rms) ** 2)


def free_what_is_named(
    examined: Examined[End], freed: Callable[[Examined[End], tuple[str, ...]], Examined[End]]
) -> Examined[End]:
    """Free what the diagnosis names, as often as that pays, by ``freed``."""
    for _ in range(_MOST_FREED):
        if not examined.named:
            break
        further = freed(examined, (*examined.freed, *examined.named))
        examined = examined.and_then(further)
    return examined


def check_free(free: tuple[str, ...] | str) -> tuple[str, ...]:
    """Refuse what is no nuisance; each counts once."""
    if free == "auto":
        return ()
    for name in (free,) if isinstance(free, str) else free:
        if name not in NUISANCES:
            raise ValueError(f"{name!r} cannot be freed; choose of {', '.join(NUISANCES)}, or auto")
    if isinstance(free, str):
        raise ValueError(f"free={free!r}: give a tuple of names, or auto")
    return tuple(dict.fromkeys(free))
