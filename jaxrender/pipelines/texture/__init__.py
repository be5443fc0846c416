"""Task ``texture``: K_d and K_s of every texel or vertex (T 6.13, 6.14).

``sites``
    which texel or vertex each pixel shows, and which material each of them belongs to
``surface``
    what is known of every site and of the lobe, whatever the light
``known_light`` ``unknown_light``
    the two ways to it; under unknown light up to what photographs cannot tell (T 6.1.1)
``summary`` ``files``
    the result as data, and as maps
``recovery``
    all of it as a run's recovery
"""

from jaxrender.pipelines.texture.recovery import TextureRecovery, recover_surface

__all__ = ["TextureRecovery", "recover_surface"]
