"""Tasks whose light is unknown: ``factorize`` (with the material) and ``lighting`` (alone).

``asked``
    the settings of the recovery, from a config
``recovery``
    the task itself, and its predicted photographs
``result`` ``images``
    the result as data; the light as images
"""

from jaxrender.pipelines.tasks.light.images import light_images
from jaxrender.pipelines.tasks.light.recovery import TASK, LightRecovery, recover_light

__all__ = ["TASK", "LightRecovery", "light_images", "recover_light"]
