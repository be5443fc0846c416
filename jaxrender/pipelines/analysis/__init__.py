"""The errors that a run's photographs will allow, predicted from its config alone.

``prospect``
    cameras, shape and light of a config, without its photographs
``supposed``
    the supposed material and noise
``forecast``
    the forecasts of each recovery, and suggestions of a further view or source
``tables`` ``figure``
    the forecasts as text, and as a picture
"""

from jaxrender.pipelines.analysis.forecast import ConfigAnalysis, Options, analyze_config

__all__ = ["ConfigAnalysis", "Options", "analyze_config"]
