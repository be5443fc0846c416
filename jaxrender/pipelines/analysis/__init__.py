"""What a run's photographs will tell, from its config alone: before any is taken.

``prospect``
    cameras, shape and light of a config, without its photographs
``supposed``
    the material and the noise that the forecast is made for
``forecast``
    the forecasts of all that could be recovered, and suggestions of a further view or lamp
``tables`` ``figure``
    the same for a terminal, and as a picture
"""

from jaxrender.pipelines.analysis.forecast import ConfigAnalysis, Options, analyze_config

__all__ = ["ConfigAnalysis", "Options", "analyze_config"]
