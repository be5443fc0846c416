"""Tasks whose light is unknown: ``factorize`` (with the material) and ``lighting`` (alone).

``asked``
    what a config says of light and material, in the words of the recovery
``recovery``
    the task itself, and its predicted photographs
``result`` ``images``
    what was found as data; the light as images
"""

from jaxrender.pipelines.light.images import light_images
from jaxrender.pipelines.light.recovery import LightRecovery, recover_light

__all__ = ["LightRecovery", "light_images", "recover_light"]
