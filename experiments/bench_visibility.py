"""Which of 1024 directions each of 10,000 places on a sculpture sees, beside Mitsuba and trimesh.

    python experiments/bench_visibility.py [--places 10000] [--directions 1024] [--runs 7]

The task: origins and directions in, the mask of all pairs out, both NumPy; only the half above each
horizon is traced.  Ours twice, with Embree's packets (where Numba is installed) and with its single
rays; Mitsuba 3 (``llvm_ad_rgb``: Embree's packets of rays, all processors; its rays
are put together on its own side) with those rays picked out, and with the others masked off;
trimesh's wrapper of embreex (one thread).  The first call, then warm: medians of runs in turn; wall
time, and processor time of all threads, which other work on the machine disturbs less.  Transfer
vectors to degree 8 from the same number of directions are timed along.  Peers that are not
installed are left out.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable
from unittest import mock

import jax
import numpy as np

from jaxrender.geometry import Mesh, SurfacePlaces, fibonacci_sphere, packets, sculpture, visible
from jaxrender.reflection import Quadrature, transfer_vectors

# What is demanded: times Mitsuba's time.
MITSUBA = 1.2
# Origins stand off the surface by this part of the diagonal, here as in the library.
OFFSET = 1e-4


def take_turns(calls: dict[str, Callable], runs: int) -> dict[str, tuple[float, float]]:
    """Return median warm seconds of each call: on the wall's clock, and of the processors."""
    times = {name: [] for name in calls}
    for _ in range(runs):
        for name, call in calls.items():
            wall, processor = time.perf_counter(), time.process_time()
            call()
            times[name].append((time.perf_counter() - wall, time.process_time() - processor))
    return {
        name: (statistics.median(w for w, _ in taken), statistics.median(p for _, p in taken))
        for name, taken in times.items()
    }


def mitsuba_calls(mesh: Mesh, origins, normals, directions) -> dict[str, Callable]:
    """Prepare Mitsuba's scene and arrays; return its two ways of doing the task."""
    try:
        import drjit as dr
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")
    except (ImportError, AttributeError) as missing:
        print(f"without Mitsuba: {missing}")
        return {}
    shape = mi.Mesh("shape", len(mesh.vertices), len(mesh.faces))
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = mesh.vertices.astype(np.float32).ravel()
    parameters["faces"] = mesh.faces.astype(np.uint32).ravel()
    parameters.update()
    scene = mi.load_dict({"type": "scene", "shape": shape})
    from_place, upwards, towards = (
        kind(array.T.astype(np.float32))
        for kind, array in zip(
            (mi.Point3f, mi.Vector3f, mi.Vector3f), (origins, normals, directions)
        )
    )
    per_place, count = len(directions), len(origins) * len(directions)

    def pairs(index):
        place, direction = index // per_place, index % per_place
        return place, dr.gather(mi.Vector3f, towards, direction)

    def above_horizon():
        place, direction = pairs(dr.arange(mi.UInt32, count))
        above = dr.dot(direction, dr.gather(mi.Vector3f, upwards, place)) > 0
        return above, place, direction

    def picked():
        above, _, _ = above_horizon()
        dr.eval(above)
        index = dr.compress(above)
        place, direction = pairs(index)
        free = ~scene.ray_test(mi.Ray3f(dr.gather(mi.Point3f, from_place, place), direction))
        seen = dr.zeros(mi.Bool, count)
        dr.scatter(seen, free, index)
        return np.array(seen).reshape(-1, per_place)

    def masked():
        above, place, direction = above_horizon()
        rays = mi.Ray3f(dr.gather(mi.Point3f, from_place, place), direction)
        return np.array(above & ~scene.ray_test(rays, active=above)).reshape(-1, per_place)

    return {"Mitsuba 3, rays picked": picked, "Mitsuba 3, rays masked": masked}


def trimesh_call(mesh: Mesh, origins, normals, directions) -> Callable:
    """Prepare trimesh's wrapper of embreex, which traces the mesh as it is given."""
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    tracer = RayMeshIntersector(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))

    def traced():
        seen = normals @ directions.T > 0
        for first in range(0, len(origins), 1000):
            part = seen[first : first + 1000]
            place, direction = np.nonzero(part)
            hits = tracer.intersects_any(origins[first + place], directions[direction])
            part[part] = ~hits
        return seen

    return traced


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--places", type=int, default=10_000)
    parser.add_argument("--directions", type=int, default=1024)
    parser.add_argument("--runs", type=int, default=7)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    mesh = sculpture(5)
    vertices = SurfacePlaces.of_vertices(mesh)
    places = SurfacePlaces(*(rows[: options.places] for rows in vertices))
    normals = places.geometric_normals
    directions = fibonacci_sphere(options.directions)
    origins = places.points + OFFSET * mesh.diagonal() * normals
    arrays = origins, normals, directions
    calls = mitsuba_calls(mesh, *arrays)
    calls["jaxrender, visible"] = lambda: visible(mesh, places, directions)
    with mock.patch.object(packets, "available", return_value=False):
        alone = sculpture(5)
        seen = visible(alone, places, directions)  # which decides how this mesh is traced
    calls["jaxrender, single rays"] = lambda: visible(alone, places, directions)
    calls["trimesh's wrapper"] = trimesh_call(mesh, *arrays)
    print(f"packets of rays: {'yes' if packets.available() else 'no'}")
    for name, call in calls.items():
        start = time.perf_counter()
        differ = np.mean(call() != seen)
        first = time.perf_counter() - start
        print(f"{name}: {differ:.1e} of the pairs differ, first call {first:.2f} s")
    quadrature = Quadrature(options.directions)
    shading = mesh.normals[: options.places]
    calls["transfer vectors, degree 8"] = lambda: transfer_vectors(
        mesh, places, shading, 8, quadrature
    )
    timed = take_turns(calls, options.runs)
    rays = np.count_nonzero(normals @ directions.T > 0)
    base = next(iter(timed))
    print(f"\n{len(origins)} places x {len(directions)} directions, {len(mesh.faces)} faces,")
    print(f"{rays} rays above the horizons, {np.mean(seen):.1%} of all pairs visible,")
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; ratios to {base}")
    print(
        f"\n{'':30s}{'wall s':>9s}{'ratio':>7s}{'processor s':>13s}{'ratio':>7s}{'M rays/s':>10s}"
    )
    for name, (wall, processor) in timed.items():
        ratios = wall / timed[base][0], processor / timed[base][1]
        speed = f"{rays / wall / 1e6:10.1f}" if "transfer" not in name else ""
        print(f"{name:30s}{wall:9.3f}{ratios[0]:7.2f}{processor:13.3f}{ratios[1]:7.2f}{speed}")
    print(f"demanded of visible: {MITSUBA} times Mitsuba")


if __name__ == "__main__":
    main()
