"""Single precision beside double, and slow light beside the integral: where digits might be lost.

    python experiments/precision.py [--quick]

The first table computes everything twice, from the same directions in single and in double
precision, and prints the largest difference over the largest value.  BRDFs, transfers by degree,
the dual model and reflection maps; sigma from .01 to 1.5, exit cosines from .02 to 1.

The second reflects slow light, whose coefficients fall off with the degree, with all azimuthal
orders of the lobe, and by the integral (``polar_columns``): on 256 nodes in the cosine, and more
where the lobe is narrower than .2.

Exits with 1 where a demand is missed.
"""

import argparse
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import BRDF, PARAMETRIC, Microfacet, lobe_named
from jaxrender.geometry import Components, SurfaceSamples
from jaxrender.harmonics import LatLongGrid, coefficient_count, degrees, legendre, real_basis
from jaxrender.lighting import DirectionalSources
from jaxrender.reflection import (
    DualLight,
    dual_columns,
    global_shrm,
    local_shrm,
    polar_columns,
    reflect_slow_light,
)
from jaxrender.reflection.shrm import specular_spectrum
from jaxrender.spectra import azimuthal_transfer_of_samples, exit_cosine_transfer

PRECISION, INTEGRAL = 1e-5, 1e-4
WIDTHS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 1.5)
# 51 nodes in a width: with 13 the integral of a lobe of sigma .05 is itself off by 1 %.
_NODES_PER_WIDTH = 51.2
EXIT_COSINES = np.array([0.02, 0.05, 0.15, 0.3, 0.6, 0.9, 1.0])
SLOW_WIDTHS, SLOW_DEGREES = (0.05, 0.1, 0.2, 0.4, 0.8, 1.0), (32, 64, 96, 128)
FACETS = (("gaussian", "none"), ("gaussian", "smith"), ("beckmann", "smith"), ("ggx", "smith"))


def materials(sigma: float) -> dict[str, BRDF]:
    """Make every model that has this width, in double precision."""
    made: dict[str, BRDF] = {}
    one = np.ones(1)
    for facets, masking in FACETS:
        # Facets of the other distributions are no rougher than 1.
        if sigma <= 1 or facets == "gaussian":
            name = f"microfacet {facets}, {masking}"
            made[name] = Microfacet(one, one, sigma, 1.5, "exit", masking, facets)
    for name in PARAMETRIC:
        try:
            plain = lobe_named(name, 1)
            made[name] = plain.with_roughness(sigma, plain.mu).with_amplitudes(one, one)
        except ValueError:  # a width that this model does not have
            continue
    return made


def single(tree):
    """The same in single precision."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), tree)


def double(tree):
    """What the single precision numbers are, in double precision."""
    return jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf), jnp.float64), tree)


def difference(call, *arguments) -> float:
    """The largest difference of a call in both precisions, over the largest value."""
    rounded = single(arguments)
    few, many = call(*rounded), call(*double(rounded))
    if few.dtype != jnp.float32:
        raise TypeError(f"single precision came back as {few.dtype}")
    few, many = np.asarray(few, float), np.asarray(many)
    return float(np.abs(few - many).max() / np.abs(many).max())


def directions(sigma: float, cosine: float, count: int, rng) -> tuple[np.ndarray, np.ndarray]:
    """Pairs about the mirror direction, some widths away, of this exit cosine; +Z is the normal."""
    outgoing = np.array([np.sqrt(1 - cosine**2), 0, cosine])
    spread = sigma * rng.uniform(0, 3, (count, 1)) * rng.standard_normal((count, 3))
    incoming = outgoing * [-1, -1, 1] + spread
    incoming /= np.linalg.norm(incoming, axis=1, keepdims=True)
    incoming[incoming[:, 2] < 1e-3] = outgoing * [-1, -1, 1]
    return incoming, np.broadcast_to(outgoing, incoming.shape)


def random_samples(count: int, rng) -> SurfaceSamples:
    """Samples of all normals with exit cosines from .02 to 1."""
    normals, across = rng.standard_normal((2, count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    across = np.cross(normals, across)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    cosines = np.linspace(0.02, 1, count)[:, None]
    return SurfaceSamples(normals, cosines * normals + np.sqrt(1 - cosines**2) * across)


def slow_coefficients(band_limit: int, rng) -> np.ndarray:
    fall = (1 + degrees(band_limit)[:, None]) ** 1.5
    return rng.standard_normal((coefficient_count(band_limit), 1)) / fall


@eqx.filter_jit
def value(brdf: BRDF, incoming, outgoing):
    """The lobe times the cosine, without the diffuse part."""
    return brdf.transfer(Components.of(incoming), Components.of(outgoing))[1]


def sixty_degrees(brdf, cosines):
    return exit_cosine_transfer(brdf, cosines, 60)


@eqx.filter_jit
def mapped(brdf, light, samples, limits=(20, 3)):
    """A reflection map and what is looked up in it."""
    spectrum = specular_spectrum(brdf, limits)
    maps = global_shrm(local_shrm(light, spectrum, LatLongGrid(96, 192)))
    return maps.at(samples.reflected, samples.outgoing)


def precision_of(sigma: float, rng) -> dict[str, float]:
    """The differences of everything that has this width."""
    found: dict[str, float] = {}
    for name, brdf in materials(sigma).items():
        worst = 0.0
        for cosine in EXIT_COSINES:
            pairs = directions(sigma, cosine, 2000, rng)
            worst = max(worst, difference(value, brdf, *pairs))
        found[name] = worst
    for facets, masking in FACETS:
        name = f"microfacet {facets}, {masking}"
        if name in found:
            brdf = materials(sigma)[name]
            found[f"transfer of {name}"] = max(
                difference(lambda b, c: exit_cosine_transfer(b, c, 60), brdf, np.array([cosine]))
                for cosine in EXIT_COSINES
            )
    thesis = materials(sigma)["microfacet gaussian, none"]
    samples = random_samples(200, rng)
    found["orders of the transfer"] = difference(
        lambda b, c: azimuthal_transfer_of_samples(b, c, 20, 6), thesis, samples.exit_cosines
    )
    axes = rng.standard_normal((8, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    # Sources near mirror directions, so that narrow lobes are seen.
    near = np.asarray(samples.reflected)[:40] + 0.5 * sigma * rng.standard_normal((40, 3))
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    sources = DirectionalSources(np.concatenate([axes, near]), np.ones((48, 1)))
    light = DualLight(slow_coefficients(20, rng), sources)
    found["dual model"] = difference(dual_columns, thesis, samples, light)
    found["reflection map"] = difference(mapped, thesis, slow_coefficients(20, rng), samples)
    return found


def slow_light_error(sigma: float, band_limit: int, nodes: int, rng) -> float:
    """Slow light against the integral, over the largest value: sources cut at the band limit."""
    nodes = max(nodes, round(_NODES_PER_WIDTH / sigma))
    axes = rng.standard_normal((3, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    degree = np.arange(band_limit + 1)
    falling = (2 * degree + 1) / (4 * np.pi) / (1 + degree) ** 1.5
    basis = np.asarray(real_basis(axes, band_limit))
    wave = 4 * np.pi / (2 * degree + 1) * falling
    coefficients = wave[degrees(band_limit)][:, None] * basis.sum(0)[:, None]

    def radiance_of(towards):
        return sum(legendre(towards @ axis, band_limit) @ falling for axis in axes)[:, None]

    brdf = Microfacet(np.ones(1), np.ones(1), sigma, 1.5)
    samples = random_samples(12, rng)
    reflected = np.asarray(reflect_slow_light(brdf, samples, coefficients))
    exact = np.asarray(polar_columns(brdf, samples, radiance_of, nodes))[:, 1]
    return float(np.abs(reflected - exact).max() / np.abs(exact).max())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer widths, degrees and samples")
    quick = parser.parse_args().quick
    jax.config.update("jax_enable_x64", True)
    rng = np.random.default_rng(0)
    widths = (0.01, 0.2, 1.5) if quick else WIDTHS
    tables = {sigma: precision_of(sigma, rng) for sigma in widths}
    print("single precision: largest difference over the largest value, by sigma")
    print(f"{'':42s}" + "".join(f"{sigma:9g}" for sigma in widths))
    for name in tables[widths[0]]:
        row = (tables[sigma].get(name) for sigma in widths)
        print(f"{name:42s}" + "".join(f"{'-' if x is None else format(x, '.1e'):>9s}" for x in row))
    worst = max(max(table.values()) for table in tables.values())
    print(f"worst {worst:.1e}, demanded {PRECISION:g}")

    slow_widths, limits = ((0.4,), (64,)) if quick else (SLOW_WIDTHS, SLOW_DEGREES)
    print("slow light against the integral: largest difference over the largest value")
    print(f"{'F':>4s}" + "".join(f"{sigma:9g}" for sigma in slow_widths))
    off, nodes = 0.0, 128 if quick else 256
    for limit in limits:
        row = [slow_light_error(sigma, limit, nodes, rng) for sigma in slow_widths]
        off = max(off, *row)
        print(f"{limit:4d}" + "".join(f"{x:9.1e}" for x in row), flush=True)
    print(f"worst {off:.1e}, demanded {INTEGRAL:g}")
    sys.exit(worst > PRECISION or off > INTEGRAL)


if __name__ == "__main__":
    main()
