"""What is known of every site: K_d and K_s, their errors, and what is not to be trusted.

K_d is marked where its standard error is large, or where the site's observations contradict each
other.  K_s is marked where the prior says more than the photographs.
"""

from typing import NamedTuple

import numpy as np

from jaxrender.inverse.models import Columns
from jaxrender.inverse.texture.site_sums import by_channel
from jaxrender.shapes import Bool, Float, Int

# K_d is marked where its standard error exceeds this part of it ...
_TRUSTED_ERROR = 0.05
# ... (of what is dark, this part of the typical K_d counts as well) ...
_DARK = 0.1
# ... or where the residuals are this many times what the noise makes them.
TRUSTED_MISFIT = 3.0


class Texture(NamedTuple):
    """The material of every site with its standard errors; NaN and infinite where unseen.

    ``misfit`` is the root mean square of a site's residuals in units of the noise; ``kd_marked``
    says where K_d is not to be trusted, ``ks_marked`` where K_s is the prior's more than its own.
    Errors know of misfit; ``kd_exact_error`` and ``ks_exact_error`` are those of a model that is
    exact.  ``relative_rms`` is sqrt(sum r^2 / sum B^2) over all observations.  K_s has channels
    where it has a colour; ``ks_colour_marked`` then says where that is the prior's more than its
    own.
    """

    kd: Float[np.ndarray, "site channel"]
    ks: Float[np.ndarray, "site *channel"]
    kd_error: Float[np.ndarray, "site channel"]
    ks_error: Float[np.ndarray, "site *channel"]
    misfit: Float[np.ndarray, "site"]
    seen: Int[np.ndarray, "site"]
    kd_marked: Bool[np.ndarray, "site"]
    ks_marked: Bool[np.ndarray, "site"]
    kd_exact_error: Float[np.ndarray, "site channel"]
    ks_exact_error: Float[np.ndarray, "site *channel"]
    relative_rms: float
    ks_colour_marked: Bool[np.ndarray, "site"] | None = None

    def if_exact(self) -> "Texture":
        """Take the model to be exact."""
        return self._replace(kd_error=self.kd_exact_error, ks_error=self.ks_exact_error)

    def marked(self) -> "Texture":
        """Mark K_d where its error is large, or where observations contradict each other."""
        large = ~(self.relative_error <= _TRUSTED_ERROR)
        return self._replace(kd_marked=large | ~(self.misfit <= TRUSTED_MISFIT))

    @property
    def coloured(self) -> bool:
        """Whether K_s has a colour."""
        return self.ks.ndim == 2

    @property
    def relative_error(self) -> Float[np.ndarray, "site"]:
        """The largest standard error of a site's K_d beside its value: how bad it may be."""
        seen = np.isfinite(self.kd_error).all(axis=1)
        if not seen.any():
            return np.full(len(self.kd), np.inf)
        typical = np.median(self.kd[seen], axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            relative = np.max(self.kd_error / (self.kd + _DARK * typical), axis=1)
        return np.where(seen, relative, np.inf)

    def radiance(
        self, columns: Columns, site: Int[np.ndarray, "sample"]
    ) -> Float[np.ndarray, "sample channel"]:
        """Evaluate B = K_d(x) D + K_s(x) S of samples that show the given sites (T 6.13).

        A site that is unknown, or -1, is black.
        """
        kd, ks = (np.nan_to_num(values) for values in (self.kd, self.ks))
        found = kd[site] * columns.diffuse + by_channel(ks[site]) * columns.specular
        return np.where((site >= 0)[:, None], found, 0)

    def with_sites(self, chosen: Bool[np.ndarray, "site"], other: "Texture") -> "Texture":
        """Replace the chosen sites by those of another texture."""
        changed: dict = {"relative_rms": max(self.relative_rms, other.relative_rms)}
        for name, own, others in zip(self._fields, self, other):
            if name in changed or own is None or others is None:
                continue
            mask = chosen[:, None] if np.ndim(own) == 2 else chosen
            changed[name] = np.where(mask, others, own)
        return self._replace(**changed)
