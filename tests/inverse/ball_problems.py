"""A ball under smooth light and one lamp, seen by six small cameras: for tests of what is wrong."""

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from jaxrender.brdf import Microfacet
from jaxrender.geometry import Pinhole, Sphere, SurfacePlaces, SurfaceSamples, look_at, observe
from jaxrender.inverse import KnownLight, Observations
from jaxrender.lighting import DirectionalSources, HarmonicLight
from jaxrender.reflection import integral_columns, radiance

SIZE, VIEWS, DISTANCE = 24, 6, 5.0
# Masked, so that nothing jumps where texels set behind the horizon: differences mean something.
BRDF = Microfacet(np.array([0.12, 0.17, 0.21]), np.full(3, 0.1), 0.25, 1.5, masking="smith")
LAMP = np.array([[0.48, 0.6, 0.64]])
ENERGY = np.array([[2.0, 1.8, 1.6]])

STEP = 1e-4


def smooth_light():
    """Make coefficients of smooth light, bright enough to be positive."""
    rng = np.random.default_rng(5)
    light = 0.25 * rng.normal(size=(16, 3))
    light[0] = 4.0
    return light


LIGHT = smooth_light()
ENVIRONMENT = HarmonicLight(LIGHT).to_environment(48)


def cameras(turn=0.0, axis=None):
    found = []
    for number in range(VIEWS):
        azimuth = 2 * np.pi * number / VIEWS
        height = (0.2, 0.6)[number % 2]
        towards = np.array([np.cos(azimuth), np.sin(azimuth), height])
        pose = look_at(
            DISTANCE * towards / np.linalg.norm(towards), np.zeros(3), np.array([0.0, 0, 1])
        )
        if axis is not None and number == 0:
            pose[:3, :3] = Rotation.from_rotvec(turn * np.asarray(axis)).as_matrix() @ pose[:3, :3]
        found.append(Pinhole(SIZE, SIZE, pose, fl_x=2.2 * SIZE))
    return found


def seen(every=None, shape=None):
    """List what cameras see of a ball, at those pixels that the clean ones see well."""
    clean = [observe(camera, Sphere()) for camera in cameras()]
    views = clean
    if every is not None or shape is not None:
        views = [observe(camera, shape or Sphere()) for camera in every or cameras()]
    usable = [view.exit_cosines > 0.4 for view in clean]

    def gathered(name):
        return np.concatenate([getattr(v, name)[u] for v, u in zip(views, usable)])

    samples = SurfaceSamples(gathered("normals"), gathered("outgoing"))
    places = SurfacePlaces(gathered("points"), gathered("geometric_normals"))
    frame = np.repeat(np.arange(VIEWS), [np.count_nonzero(u) for u in usable])
    pixel = np.concatenate([np.argwhere(u) for u in usable])
    eyes = np.stack([camera.position for camera in cameras()])
    blank = np.zeros((len(frame), 3))
    return Observations(samples, blank, frame, places, pixel=pixel, eyes=eyes)


def photographed(observations, light=None, lamp=LAMP, energy=ENERGY, brdf=BRDF):
    """Integrate over an environment, and over one lamp."""
    samples = SurfaceSamples(*(jnp.asarray(part) for part in observations.samples))
    nodes = (light or ENVIRONMENT).nodes(), DirectionalSources(lamp, energy).nodes()
    return sum(np.asarray(radiance(brdf, integral_columns(brdf, samples, part))) for part in nodes)


CLEAN = seen()
PHOTOGRAPHS = photographed(CLEAN)
KNOWN = KnownLight(ENVIRONMENT, DirectionalSources(LAMP, ENERGY))
