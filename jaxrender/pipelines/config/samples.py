"""Which pixels of the photographs take part in a fit."""

from __future__ import annotations

from jaxrender.pipelines.config.values import Count, OpenFraction, Section, WholeNumber


class SamplesConfig(Section):
    """How many pixels are used, and how grazing they may be."""

    min_cosine: OpenFraction = 0.15
    """Smallest cosine between normal and view direction."""
    count: Count = 12000
    """Pixels drawn from all photographs together."""
    seed: WholeNumber = 0
    """Seed of the draw."""
