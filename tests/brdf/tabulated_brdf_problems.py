"""A table of random numbers over two directions, for the tests of tables."""

import equinox as eqx
import numpy as np

from jaxrender.brdf import BRDF

ROUNDING = 1e-12
SIZE = (5, 6, 7, 4)
VALUES = np.random.default_rng(0).uniform(size=(*SIZE, 2))

evaluate = eqx.filter_jit(BRDF.evaluate)
