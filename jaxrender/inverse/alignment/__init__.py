"""Where an object of known shape lies, by its silhouettes alone.

``rims`` finds the points of a mesh that make its outline, and how far they are from a mask's;
``pose_search`` finds scale, turn and shift of a mesh, with their errors; ``spheres`` finds centre
and radius of a ball.
"""

from jaxrender.inverse.alignment.pose_search import Alignment, align
from jaxrender.inverse.alignment.spheres import FoundSphere, sphere_of_silhouettes

__all__ = ["Alignment", "FoundSphere", "align", "sphere_of_silhouettes"]
