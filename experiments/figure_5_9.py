"""T figure 5.9: reflection maps beside Cabral's twelve, blended between the viewers.

    python experiments/figure_5_9.py [--probe FILE.hdr] [--convention cross] [--out F.png]

Cabral's maps stand at the vertices of an icosahedron and are blended linearly on its faces; here
they are summed from the same global map.  Above, a microfacet lobe with sharp near-grazing
reflections: T 5.34 with sigma = .1 times Fresnel's ratio at the exit angle, which rises from 1 to
25 (mu = 1.5).  Below, Kajiya and Kay's fibres, s = 32, about the tangent, which runs uphill.  The
correct image is the integral over every texel of the light by the BRDF itself.

Two of the viewers stand over the middle of a face of the icosahedron, farthest from its maps; the
first of them is drawn.  Prints what (F, P) miss of each BRDF and the relative rms of both methods
over the sphere's pixels for growing P.  The thesis has no number: "Cabral's approximation can lead
to large errors, while our approach still gives accurate results".  Demanded: the SHRM nearer at
every viewer from P = 3 on.  Differences are of the pictures as displayed, shown as they are and
multiplied by the factor that stands above them.
"""

import argparse
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from figure_5_1 import Frames, integrated, light_from, mapped, relative_rms, seen
from figure_5_8 import Comparison, as_shown, draw, print_table
from shrm_materials import Material, fibres

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Sphere
from jaxrender.lighting import Environment, LightNodes
from jaxrender.reflection.shrm import IcosahedralMaps
from jaxrender.spectra import central_spectrum_of, missing_energy

BAND_LIMIT, ORDERS, DEMANDED_FROM = 30, (1, 2, 3, 5, 8, 10), 3
SIGMA, MU, SPECULAR = 0.1, 1.5, np.array([0.3, 0.3, 0.3])
SIZE = 80
# Azimuth and elevation in degrees: over two faces, and anywhere.
VIEWS = ((-90, 20.905), (-20.905, 0), (-60, 15), (100, -20))
DRAWN_ORDER = 8


def materials() -> dict[str, Material]:
    """To the largest P; smaller ones are cut from it."""
    limits = BAND_LIMIT, ORDERS[-1]
    facets = Microfacet(np.zeros(3), SPECULAR, SIGMA, MU)
    spectrum = central_spectrum_of(facets, limits, weighted=True)
    return {
        "grazing microfacet": Material(spectrum, facets, divided=False),
        "Kajiya-Kay": fibres(limits),
    }


def approximated(material: Material, light: Environment, order: int, views: list[Frames]) -> list:
    """Both pictures of every viewer: by the SHRM and by Cabral's maps."""
    _, shrm = mapped(light, material.spectrum.cut((BAND_LIMIT, order)))
    twelve = IcosahedralMaps.of(shrm)
    return [
        tuple(
            as_shown(material, one.at(frames.centres, frames.samples.outgoing), frames)
            for one in (shrm, twelve)
        )
        for frames in views
    ]


def compared(name: str, material: Material, light: Environment) -> tuple[Comparison, bool]:
    """Print the errors for growing P; return the comparison that is drawn, and the verdict."""
    sphere = Sphere(np.zeros(3), 1.0)
    views = [seen(sphere, view, material.about_tangent, SIZE) for view in VIEWS]
    nodes = LightNodes(*(jnp.asarray(a, jnp.float32) for a in light.nodes()))
    exact = [np.asarray(integrated(material, frames, nodes)) for frames in views]
    missed = missing_energy(material.spectrum)[-1]
    print(f"\n{name}: relative rms, per cent, SHRM | Cabral; viewers 1, 2 over faces")
    print(f"{'P':>3s}{'missed':>9s}" + "".join(f"{f'viewer {k + 1}':>17s}" for k in range(4)))
    nearer, drawn = True, ()
    for order in ORDERS:
        pictures = approximated(material, light, order, views)
        errors = [[100 * relative_rms(i, e) for i in both] for both, e in zip(pictures, exact)]
        columns = "".join(f"{ours:8.1f} |{theirs:7.1f}" for ours, theirs in errors)
        print(f"{order:3d}{100 * missed[order]:7.1f} %{columns}")
        if order >= DEMANDED_FROM:
            nearer = nearer and all(ours < theirs for ours, theirs in errors)
        if order == DRAWN_ORDER:
            drawn = pictures[0]
    return Comparison(name, views[0], exact[0], drawn), nearer


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--probe", type=Path)
    parser.add_argument("--convention", default="cross")
    parser.add_argument("--out", type=Path, default=Path("experiments/out/figure_5_9.png"))
    arguments = parser.parse_args()
    light = light_from(arguments.probe, arguments.convention)
    found = [compared(name, material, light) for name, material in materials().items()]
    names = f"SHRM, P = {DRAWN_ORDER}", "Cabral's twelve maps"
    print_table([comparison for comparison, _ in found], names)
    verdict = "met" if all(nearer for _, nearer in found) else "NOT met"
    print(f"published: Cabral large errors, SHRM accurate; SHRM nearer from P = 3: {verdict}")
    title = "T fig. 5.9: near-grazing reflections and fibres"
    draw([comparison for comparison, _ in found], names, title, arguments.out)


if __name__ == "__main__":
    main()
