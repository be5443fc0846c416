"""The latitude-longitude image as a quadrature rule on the sphere.

Row i lies at polar angle (i + 1/2) pi / H from +Z (row 0 at the top), column j at azimuth
(j + 1/2) 2 pi / W.  The polar angles are the nodes of Fejer's first rule, whose weights integrate
polynomials in cos t up to degree H - 1 exactly; together with W equal azimuths the image therefore
determines every function up to ``band_limit`` exactly.
"""

import equinox as eqx
import numpy as np

from jaxrender.shapes import Float


class LatLongGrid(eqx.Module):
    """Sampling of the sphere by ``height`` rows and ``width`` columns; hashable, all static.

    Raises ValueError if a side is below 1.
    """

    height: int = eqx.field(static=True)
    width: int = eqx.field(static=True)

    def __check_init__(self):
        if self.height < 1 or self.width < 1:
            raise ValueError(
                f"a grid of {self.height} rows and {self.width} columns; give 1 or more of each"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return (self.height, self.width)

    @property
    def band_limit(self) -> int:
        """Highest degree whose analysis from this grid is exact: products reach twice as far."""
        return (min(self.height, self.width) - 1) // 2

    def polar_angles(self) -> Float[np.ndarray, " row"]:
        """Angle from +Z of each row, radians."""
        return (np.arange(self.height) + 0.5) * np.pi / self.height

    def azimuths(self) -> Float[np.ndarray, " column"]:
        """Angle from +X towards +Y of each column, radians."""
        return (np.arange(self.width) + 0.5) * 2.0 * np.pi / self.width

    def directions(self) -> Float[np.ndarray, "row column 3"]:
        """Unit vectors (sin t cos p, sin t sin p, cos t) of the texel centres."""
        polar, azimuth = self.polar_angles()[:, None], self.azimuths()[None, :]
        x, y = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth)
        return np.stack([x, y, np.broadcast_to(np.cos(polar), x.shape)], axis=-1)

    def row_weights(self) -> Float[np.ndarray, " row"]:
        """Solid angle of one texel of each row: Fejer's weights times 2 pi / W, steradians.

        w_i = (2 / H) (1 - 2 sum_{k=1}^{H/2} cos(2 k t_i) / (4 k^2 - 1)); the w_i sum to 2.
        """
        # The sum over k is a cosine transform; at these sizes a matrix product is as quick.
        k = np.arange(1, self.height // 2 + 1)
        waves = np.cos(2.0 * np.multiply.outer(self.polar_angles(), k))
        fejer = (2.0 / self.height) * (1.0 - 2.0 * waves @ (1.0 / (4.0 * k**2 - 1.0)))
        return fejer * 2.0 * np.pi / self.width

    def weights(self) -> Float[np.ndarray, "row column"]:
        """Solid angle of every texel; sums to 4 pi."""
        return np.repeat(self.row_weights()[:, None], self.width, axis=1)
