"""What the page of a result carries: arrays, light, shape and material.

- Its data are the arrays that it was made from, to the rounding of their kinds.
- The material's table, interpolated and summed over the light as the shader does it, is the exact
  integral to 2 of 255.
"""

import itertools
import json

import numpy as np
import pytest
from view_pages import MATERIALS, egg, light, page, scene_of, shown

from jaxrender.brdf import AnisotropicWard, material_named
from jaxrender.errors import InputError
from jaxrender.geometry import Mesh
from jaxrender.imaging.display import exposed, exposure_for
from jaxrender.lighting import LightNodes
from jaxrender.pipelines.view.light import gathered, page_light
from jaxrender.pipelines.view.material_table import interpolated, material_table
from jaxrender.pipelines.view.packing import from_octahedral, octahedral, packed, unpacked
from jaxrender.pipelines.view.shown import rendered, seen_from
from jaxrender.pipelines.view.surface import surface_document

# 16 bits of a direction folded onto a square; 11 bits of a half float.
DIRECTION, HALF = 1e-4, 2.0**-11


@pytest.fixture(scope="module")
def ball():
    what = shown()
    return what, page(what)


def test_arrays_come_back():
    for kind in ("uint8", "int16", "uint32", "float16", "float32"):
        array = np.arange(12).reshape(3, 4).astype(kind)
        again = unpacked(json.loads(json.dumps(packed(array))))
        assert again.dtype == array.dtype
        np.testing.assert_array_equal(again, array)
    with pytest.raises(ValueError, match="float64"):
        packed(np.zeros(3))


def test_directions_come_back():
    directions = np.random.default_rng(0).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = np.concatenate([directions, np.eye(3), -np.eye(3)])
    np.testing.assert_allclose(from_octahedral(octahedral(directions)), directions, atol=DIRECTION)


def test_the_light_of_a_page_is_the_light(ball):
    what, text = ball
    stored = scene_of(text)["lights"]["result"]
    for name in ("fine", "cells", "sources"):
        own: LightNodes = getattr(what.light, name)
        directions = from_octahedral(unpacked(stored[name]["directions"]))
        np.testing.assert_allclose(directions, own.directions, atol=DIRECTION)
        found = unpacked(stored[name]["irradiance"]).astype(float) * stored[name]["scale"]
        np.testing.assert_allclose(found, own.irradiance, rtol=HALF, atol=1e-6)
    np.testing.assert_array_equal(unpacked(stored["first"]), what.light.first)


def test_a_light_keeps_its_energy_and_its_sources():
    known = light()
    found = page_light(known, 0.2)
    assert known.environment is not None
    energy = [
        np.asarray(part.nodes().irradiance).sum(axis=0)
        for part in (known.environment, known.directional)
    ]
    np.testing.assert_allclose(np.sum(found.nodes.irradiance, axis=0), sum(energy), rtol=1e-12)
    np.testing.assert_allclose(np.sum(found.cells.irradiance, axis=0), energy[0], rtol=1e-12)
    np.testing.assert_allclose(np.sum(found.sources.irradiance, axis=0), energy[1], rtol=1e-12)
    # Y_00 is 1 / sqrt(4 pi).
    mean = sum(energy) / np.sqrt(4 * np.pi)
    np.testing.assert_allclose(found.coefficients[0], mean, rtol=1e-6)


def test_nodes_lie_in_their_cells():
    random = np.random.default_rng(3)
    directions = random.normal(size=(900, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    fine, cells, first = gathered(LightNodes(directions, random.uniform(size=(900, 3))))
    assert (first[0], first[-1]) == (0, 900)
    for k, (start, end) in enumerate(itertools.pairwise(first)):
        own = np.asarray(fine.directions)[start:end]
        # The shader takes this for granted.
        assert (own @ np.asarray(cells.directions)[k] > np.cos(0.3)).all()
        total = np.asarray(fine.irradiance)[start:end].sum(axis=0)
        np.testing.assert_allclose(np.asarray(cells.irradiance)[k], total)


def test_a_mesh_comes_back():
    mesh = egg()
    stored = surface_document(mesh)
    positions = unpacked(stored["positions"]) / 65535 * stored["size"] + stored["lower"]
    faces = unpacked(stored["faces"])
    assert faces.dtype == np.uint16
    np.testing.assert_allclose(positions[faces], mesh.vertices[mesh.faces], atol=2e-5)
    normals = from_octahedral(unpacked(stored["normals"]))
    np.testing.assert_allclose(normals[faces], mesh.normals[mesh.faces], atol=DIRECTION)
    assert stored["radius"] == pytest.approx(1.0, abs=1e-3)


def test_a_page_of_20_000_triangles_is_small():
    assert len(page(shown(Mesh.ellipsoid(np.array([1.0, 0.8, 0.6]), 5)))) < 6e6


# ---------------------------------------------------------------- the material


@pytest.mark.parametrize("model", MATERIALS)
def test_a_table_is_its_material(model):
    material = material_named(model, MATERIALS[model])
    assert material_table(material, float(material.width)).error < 0.01


def test_an_anisotropic_material_is_refused():
    brushed = AnisotropicWard(np.full(3, 0.2), np.full(3, 0.1), 0.1, 0.3)
    with pytest.raises(InputError, match="turns about its normal"):
        material_table(brushed, 0.1)


def test_the_shaders_sum_is_the_exact_integral(ball):
    """What ``reflected`` in table.glsl does, for every node and every pixel."""
    what, _ = ball
    view = seen_from(what, 0.7, 0.3, 24)
    exact = rendered(what, view)
    normals, outgoing = view.normals[view.hit], view.outgoing[view.hit]
    directions, irradiance = (np.asarray(part, float) for part in what.light.nodes)
    table = what.table
    incoming = normals @ directions.T
    exit_cosine = np.einsum("pi,pi->p", normals, outgoing)[:, None]
    difference = np.sqrt((1 + outgoing @ directions.T) / 2)
    half = np.minimum((incoming + exit_cosine) / (2 * difference), 1)
    sines = np.sqrt(np.maximum((1 - half**2) * (1 - difference**2), 1e-14))
    turned = np.clip((incoming - difference * half) / sines, -1, 1)
    lit = incoming > 0
    values = np.zeros((*incoming.shape, 4))
    values[lit] = interpolated(
        table.logarithms[table.fitted],
        float(table.widths[table.fitted]),
        np.arccos(half[lit]),
        difference[lit],
        turned[lit],
    )
    factor = np.broadcast_to(exit_cosine, incoming.shape) * 4 if table.weighted else 1 / incoming
    lobe = values[..., :3] / factor[..., None]
    base = (values[..., 3] * incoming)[..., None]
    columns = table.base * base + table.lobe * lobe
    found = np.zeros_like(exact)
    found[view.hit] = np.einsum("pnc,nc->pc", np.where(lit[..., None], columns, 0), irradiance)
    exposure = exposure_for(exact[view.hit])
    off = exposed(found, exposure).astype(int) - exposed(exact, exposure)
    assert np.abs(off).max() <= 2
