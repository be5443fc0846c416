"""Rows of what renders: samples, views and cameras, by either model."""

import numpy as np

from jaxrender import reflection
from jaxrender.brdf import Microfacet
from jaxrender.geometry import Orthographic, Sphere, observe
from jaxrender.lighting import DirectionalSources, LightNodes
from jaxrender.reflection import DualForward, ExactForward

from ..page import Above, Row, Unit
from .surface import (
    AT,
    EDGES,
    LIGHT,
    MATERIAL,
    MU,
    NARROW,
    SIGMA,
    SLOW,
    SOURCES,
    UP,
    dual,
    glossy,
    unlit,
)

POSE = np.array([[1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, 1, 5], [0, 0, 0, 1.0]])
CAMERA, BALL = Orthographic(3, 3, POSE, scale=0.4), Sphere(np.zeros(3), 1.0)
VIEW = observe(CAMERA, BALL)
HIT_NORMALS = np.where(VIEW.hit[..., None], VIEW.normals, UP)
SEEN = {"normals": Unit(HIT_NORMALS)}


def _view(normals):
    outgoing = VIEW.outgoing.astype(normals.dtype)
    return VIEW._replace(normals=normals, outgoing=outgoing)


def _rendered(function):
    """An image by material, normals and the nodes of a light."""

    def call(kd, ks, sigma, mu, normals, directions, irradiance):
        model = ExactForward(LightNodes(directions, irradiance))
        return function(Microfacet(kd, ks, sigma, mu), _view(normals), model)

    return call


def _images(brdf, view, model):
    return tuple(reflection.render_views(brdf, [view, view], model))


def _from_camera(picture):
    """An image of the ball by material and sources."""

    def call(kd, ks, sigma, mu, irradiance):
        # Its own geometry is in double precision, and so is the image; a view may be in single.
        parts = (part.astype(np.float64) for part in (kd, ks, sigma, mu, irradiance))
        kd, ks, sigma, mu, energy = parts
        image = picture(Microfacet(kd, ks, sigma, mu), energy)
        return image.astype(irradiance.dtype)

    return call


def _by_nodes(brdf, energy):
    return reflection.render(brdf, CAMERA, BALL, ExactForward(LightNodes(SOURCES, energy)))


def _by_a_light(brdf, energy):
    return reflection.render_lit(brdf, DirectionalSources(SOURCES, energy), BALL, CAMERA)


ROWS = [
    Row(
        "render_samples",
        lambda samples, kd, ks, sigma, mu, slow, **light: reflection.render_samples(
            Microfacet(kd, ks, sigma, mu), samples, DualForward(dual(slow, **light), "gaussian")
        ),
        {**AT, **MATERIAL, **SLOW, **LIGHT},
        {"head-on at the poles": EDGES["head-on at the poles"], "sigma .01": NARROW},
    ),
    Row(
        "DualForward.columns",
        lambda samples, sigma, slow: DualForward(dual(slow, *unlit(sigma)), "gaussian").columns(
            glossy(sigma), samples
        ),
        {**AT, **SIGMA, **SLOW},
    ),
    Row(
        "ExactForward.columns",
        lambda samples, sigma, directions, irradiance: ExactForward(
            LightNodes(directions, irradiance)
        ).columns(glossy(sigma), samples),
        {**AT, **SIGMA, **LIGHT},
    ),
    *(
        Row(name, _rendered(function), {**MATERIAL, **SEEN, **LIGHT})
        for name, function in (
            ("render_view", reflection.render_view),
            ("render_views", _images),
            ("sensitivities", reflection.sensitivities),
        )
    ),
    Row("render", _from_camera(_by_nodes), {**MATERIAL, "irradiance": LIGHT["irradiance"]}),
    Row("render_lit", _from_camera(_by_a_light), {**MATERIAL, "irradiance": LIGHT["irradiance"]}),
    Row(
        "render_widths",
        lambda samples, widths, ks, mu, directions, irradiance: reflection.render_widths(
            Microfacet(ks, ks, widths[0], mu),
            widths,
            samples,
            ExactForward(LightNodes(directions, irradiance)),
        ),
        {**AT, "widths": Above(np.array([0.1, 0.4])), "ks": MATERIAL["ks"], **MU, **LIGHT},
    ),
]
