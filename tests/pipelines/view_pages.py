"""A material, a light and shapes whose pages the tests look at; made without a fit."""

import json
import re

import numpy as np

from jaxrender.brdf import material_named
from jaxrender.geometry import Mesh, Sphere
from jaxrender.inverse import KnownLight
from jaxrender.lighting import DirectionalSources, Environment
from jaxrender.pipelines.view.layout import Facts, values_of
from jaxrender.pipelines.view.light import page_light
from jaxrender.pipelines.view.page import html_of
from jaxrender.pipelines.view.shown import Shown, shown_as

BRDF = {"model": "ggx", "kd": [0.2, 0.12, 0.06], "ks": 0.1, "sigma": 0.2, "mu": 1.5}
MATERIALS = {
    "microfacet": {"kd": [0.2] * 3, "ks": 0.1, "sigma": 0.12, "mu": 1.8},
    "ggx": {"kd": [0.2] * 3, "ks": 0.1, "sigma": 0.05, "mu": 1.5},
    "ward": {"kd": [0.2] * 3, "ks": 0.1, "roughness": 0.1},
    "phong": {"kd": [0.2] * 3, "ks": 0.1, "exponent": 50.0},
    "oren-nayar": {"kd": [0.2] * 3, "sigma": 0.3},
    "lambertian": {"kd": [0.2] * 3},
}
SUMMARY = {
    "brdf": BRDF,
    "outcome": "converged",
    "meaning": "made by hand",
    "interval90": {"kd": [[0.19, 0.21], [0.11, 0.13], [0.05, 0.07]], "ks": [0.09, 0.11]},
}


def light(rows: int = 16) -> KnownLight:
    """A sky with a bright window, and two sources."""
    random = np.random.default_rng(1)
    radiance = 0.2 + 0.1 * random.uniform(size=(rows, 2 * rows, 3))
    radiance[rows // 4 : rows // 2, 3:9] += [3.0, 2.5, 2.0]
    sources = DirectionalSources(
        np.array([[0.3, -0.5, 0.8], [-1.0, 0.2, 0.1]]), np.array([[1.0, 1.0, 0.9], [0.4, 0.5, 0.6]])
    )
    return KnownLight(Environment(radiance), sources)


def shown(shape=None, brdf=BRDF) -> Shown:
    """What a page shows, of the unit ball unless a shape is given."""
    material = material_named(brdf["model"], brdf)
    width = float(material.width)
    return shown_as(material, width, page_light(light(), width), shape or Sphere())


def egg() -> Mesh:
    """A convex mesh."""
    return Mesh.ellipsoid(np.array([1.0, 0.8, 0.6]), 4)


def page(what: Shown, title: str = "ball") -> str:
    """The page of it."""
    return html_of(values_of(what, Facts(title, "0" * 64, SUMMARY, False, None)))


def scene_of(text: str) -> dict:
    """The data in a page."""
    found = re.search(r'<script type="application/json" id="scene">(.*?)</script>', text, re.S)
    assert found
    return json.loads(found[1])
