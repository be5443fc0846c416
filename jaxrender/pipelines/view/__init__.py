"""The page of a result: an object to turn and to light in a browser, without a network.

``material_table`` ``light`` ``surface``
    what the shaders are given: lobes as a table, point masses, triangles
``texture``
    the maps of a texture, and maps in false colours
``packing``
    arrays as text, and directions in 32 bits
``sliders`` ``pictures``
    numbers with their bands; photographs beside predictions
``shown`` ``layout`` ``page`` ``view``
    what is shown, seen and rendered; laid out; the templates filled with all of it, under a strict
    content policy; the command
``viewer`` ``widget``
    the object alone as a widget of a notebook, by the same scripts
``shaders`` ``scripts``
    the page's own GLSL and JavaScript

The viewer is distant, so that what a convex object sends to him depends on its normal alone (T
2.12).  The page sums the light at the normals of a disc, the reflection map, and looks the pixels
up in it; single sources are evaluated at every pixel.
"""

from jaxrender.pipelines.view.view import view_result

__all__ = ["view_result"]
