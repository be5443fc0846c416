"""The pixels that take part in a fit."""

from __future__ import annotations

from jaxrender.pipelines.config.values import Count, OpenFraction, Section, WholeNumber


class SamplesConfig(Section):
    """The number of pixels, and the most grazing view among them."""

    min_cosine: OpenFraction = 0.15
    """Smallest cosine between normal and view direction."""
    count: Count = 12000
    """Number of pixels drawn from all photographs of a capture together."""
    seed: WholeNumber = 0
    """Seed of the draw."""
