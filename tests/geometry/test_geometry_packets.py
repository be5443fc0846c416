"""Shadow rays in packets.

Pinned down: packets of sixteen and of eight answer as testing every triangle does, be the last one
full or not; nothing asked, nothing blocked; rows in any order of memory; two meshes at once; where
Numba is missing or broken, packets are not available, and only a broken one is worth a word.
"""

import platform
import sys

import numpy as np
import pytest
import trimesh

from jaxrender.geometry import Mesh, fibonacci_sphere, packets

pytest.importorskip("numba")
if not packets.available():
    # Where the tests are meant to run it must be.
    assert (sys.platform, platform.machine()) != ("linux", "x86_64")
    pytest.skip("no packets on this machine", allow_module_level=True)


def torus(radius):
    body = trimesh.creation.torus(radius, 0.1, major_sections=20, minor_sections=12)
    return Mesh(body.vertices, body.faces)


RING = torus(0.3)


def scene_of(mesh):
    return packets.PacketScene(mesh.vertices, mesh.faces)


def pairs(places, seed):
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-0.45, 0.45, (places, 3)) * [1, 1, 0.3]
    return origins, fibonacci_sphere(37), rng.random((places, 37)) < 0.7


def by_brute_force(mesh, origins, directions, asked):
    expected = np.zeros_like(asked)
    place, direction = np.nonzero(asked)
    expected[asked] = mesh.occluded_brute_force(origins[place], directions[direction])
    return expected


@pytest.mark.parametrize("width", packets.PACKET_QUERIES)
@pytest.mark.parametrize("places", [1, 2, 40])
def test_packets_answer_as_every_triangle_tested(width, places):
    scene = scene_of(RING)
    scene._width = width
    origins, directions, asked = pairs(places, seed=places)
    expected = by_brute_force(RING, origins, directions, asked)
    assert 0 < expected.sum() < asked.sum()
    np.testing.assert_array_equal(scene.occluded_pairs(origins, directions, asked), expected)


def test_the_order_in_memory_does_not_matter():
    origins, directions, asked = pairs(12, seed=5)
    expected = by_brute_force(RING, origins, directions, asked)
    found = scene_of(RING).occluded_pairs(
        np.asfortranarray(origins), np.asfortranarray(directions), np.asfortranarray(asked)
    )
    np.testing.assert_array_equal(found, expected)


def test_nothing_asked_nothing_blocked():
    origins, directions, asked = pairs(3, seed=6)
    scene = scene_of(RING)
    assert not scene.occluded_pairs(origins, directions, np.zeros_like(asked)).any()
    nowhere = np.zeros((0, 37), bool)
    assert scene.occluded_pairs(np.zeros((0, 3)), directions, nowhere).shape == (0, 37)
    assert scene.occluded_pairs(origins, np.zeros((0, 3)), asked[:, :0]).shape == (3, 0)


def test_two_meshes_are_two_scenes():
    origins, directions, asked = pairs(20, seed=7)
    wide = torus(0.39)
    both = scene_of(RING), scene_of(wide)
    found = [scene.occluded_pairs(origins, directions, asked) for scene in both]
    for mesh, blocked in zip((RING, wide), found):
        np.testing.assert_array_equal(blocked, by_brute_force(mesh, origins, directions, asked))
    assert (found[0] != found[1]).any()


@pytest.fixture
def found_out_anew():
    packets._embree.cache_clear()
    yield
    packets._embree.cache_clear()


def test_without_numba_there_are_no_packets(monkeypatch, caplog, found_out_anew):
    monkeypatch.setitem(sys.modules, "numba", None)
    assert not packets.available()
    assert not caplog.records
    with pytest.raises(RuntimeError, match="cannot be traced in packets here"):
        scene_of(RING)


def test_a_broken_numba_is_named(monkeypatch, caplog, tmp_path, found_out_anew):
    (tmp_path / "numba.py").write_text("raise ImportError('wants another NumPy')")
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    assert not packets.available()
    assert "one by one: wants another NumPy" in caplog.text


def test_another_embreex_has_no_packets(monkeypatch, found_out_anew):
    monkeypatch.setattr(packets.metadata, "files", lambda name: [])
    assert not packets.available()
