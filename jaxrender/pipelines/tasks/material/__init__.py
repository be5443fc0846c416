"""Task ``brdf``: the material from photographs under known light.

``recovery``
    the task itself, and its predicted photographs
``result``
    the result as data, and as arrays
"""

from jaxrender.pipelines.tasks.material.recovery import TASK, MaterialRecovery, recover_material

__all__ = ["TASK", "MaterialRecovery", "recover_material"]
