"""How far causes move a texture: that goes into its errors.

Causes are tested on some of the sites.  Every site's K_d and K_s are taken to move by the part that
those of the tested ones do.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.texture.site_sums import by_channel
from jaxrender.inverse.texture.texture import Texture
from jaxrender.shapes import Float, Int

# What is darker than this part of the typical site says nothing of relative errors.
_DARK = 0.1
# The part of the sites that is within one standard deviation.
_MOST = 0.68


class Reach(NamedTuple):
    """Standard deviations: of K_d and K_s by channel, relative to them, and of the lobe's numbers.

    ``kd`` and ``ks`` are for each channel; of a K_s without channels there is one.
    """

    kd: Float[np.ndarray, "channel"]
    ks: Float[np.ndarray, "channel_or_one"]
    numbers: dict[str, float]

    @classmethod
    def of(
        cls,
        texture: Texture,
        sites: Int[np.ndarray, "tested"],
        names: tuple[str, ...],
        shifts: Float[np.ndarray, "number cause"],
    ) -> "Reach":
        """Sum up shifts, a column each: of the tested sites' K_d and K_s, then of the numbers.

        Shifts may go on with those of something else.
        """
        channels = texture.kd.shape[1]
        of_ks = np.asarray(by_channel(texture.ks))
        kd, ks, squares = np.zeros(channels), np.zeros(of_ks.shape[1]), dict.fromkeys(names, 0.0)
        glossy = len(shifts) > len(sites) * channels
        # Where the photographs do not tell K_s, its prior holds both, and the columns know of none.
        told = ~texture.ks_marked[sites] | (not glossy)
        for shift in shifts.T:
            of_kd, rest = np.split(shift, [len(sites) * channels])
            kd += _part(of_kd.reshape(-1, channels)[told], texture.kd[sites[told]]) ** 2
            if glossy:
                shifted, numbers = np.split(rest, [of_ks[sites].size])
                shifted = shifted.reshape(len(sites), -1)
                ks += _part(shifted[told], of_ks[sites[told]]) ** 2
                for name, number in zip(names, numbers):
                    squares[name] += float(number) ** 2
        return cls(np.sqrt(kd), np.sqrt(ks), {n: float(np.sqrt(s)) for n, s in squares.items()})

    def texture(self, texture: Texture, *, both: bool = False) -> Texture:
        """Widen the errors of all sites; ``both`` those of a model that is exact as well."""
        by_kd = self.kd * texture.kd
        by_ks = (self.ks * np.asarray(by_channel(texture.ks))).reshape(texture.ks.shape)
        wider = texture._replace(
            kd_error=np.hypot(texture.kd_error, by_kd), ks_error=np.hypot(texture.ks_error, by_ks)
        )
        if both:
            wider = wider._replace(
                kd_exact_error=np.hypot(texture.kd_exact_error, by_kd),
                ks_exact_error=np.hypot(texture.ks_exact_error, by_ks),
            )
        return wider.marked()

    def of_number(self, name: str) -> float:
        """Look up a number of the lobe; 0 where it is fixed."""
        return self.numbers.get(name, 0.0)


def _part(
    shift: Float[np.ndarray, "site channel"], value: Float[np.ndarray, "site channel"]
) -> Float[np.ndarray, "channel"]:
    """Compare shifts with values: more than most sites move, of those that are not dark.

    A few sites may move beyond all measure, where one pixel a photograph does not tell K_s.
    """
    lit = value > _DARK * np.median(value, axis=0) if len(value) else value > 0
    parts = [np.abs(by[at] / of[at]) for by, of, at in zip(shift.T, value.T, lit.T)]
    return np.array([np.quantile(part, _MOST) if len(part) else 0.0 for part in parts])
