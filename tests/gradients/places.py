"""Numbers that rows share: random ones from stated seeds, and directions at the edges."""

import numpy as np

POLES = {"+Z": np.array([0.0, 0.0, 1.0]), "-Z": np.array([0.0, 0.0, -1.0])}


def normal(*shape: int, seed: int = 0) -> np.ndarray:
    """Normal numbers."""
    return np.random.default_rng(seed).normal(size=shape)


def complex_normal(*shape: int, seed: int = 0) -> np.ndarray:
    """Complex normal numbers."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def unit(count: int, seed: int = 0) -> np.ndarray:
    """Random unit vectors."""
    vectors = normal(count, 3, seed=100 + seed)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def repeated(vector: np.ndarray, count: int = 2) -> np.ndarray:
    """One vector several times."""
    return np.tile(np.asarray(vector, float), (count, 1))
