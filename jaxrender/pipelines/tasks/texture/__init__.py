"""Task ``texture``: K_d and K_s of every texel or vertex (T 6.13, 6.14).

``asked``
    what a config asks for: sites, regions and settings
``recovery``
    the call, and all of it as a run's recovery
``summary`` ``arrays``
    the result as data, and as arrays
``metallic``
    all of it for maps of glTF's material
"""

from jaxrender.pipelines.tasks.texture.recovery import TASK, TextureRecovery, recover_texture

__all__ = ["TASK", "TextureRecovery", "recover_texture"]
