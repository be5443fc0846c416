"""Photographs of a chrome ball, ray by ray: an oracle that cannot unwrap them."""

import numpy as np

from jaxrender.geometry import Pinhole, look_at

UP = np.array([0.0, 0.0, 1.0])
CENTRE, RADIUS = np.array([0.3, -0.2, 0.5]), 0.4


def cameras(count=3, distance=2.4, size=140, focal=330.0):
    """Cameras around the ball, the ball a little off the middle of each picture."""
    found = []
    for k in range(count):
        azimuth = 2 * np.pi * k / count + 0.4
        place = CENTRE + distance * np.array(
            [np.cos(azimuth) * 0.95, np.sin(azimuth) * 0.95, 0.31 - 0.3 * (k % 2)]
        )
        aim = CENTRE + 0.08 * np.array([np.sin(3.0 * k), np.cos(2.0 * k), 0.5])
        found.append(Pinhole(size, size, look_at(place, aim, UP), fl_x=focal))
    return found


def photographed(camera, radiance_of, supersampling=3, background=0.5):
    """Trace rays to the ball and once on from there, several for each pixel."""
    scale = supersampling
    fine = Pinhole(
        camera.width * scale,
        camera.height * scale,
        camera.world_from_camera,
        fl_x=camera.fl_x * scale,
        fl_y=camera.fl_y * scale,
        cx=camera.cx * scale,
        cy=camera.cy * scale,
    )
    origins, directions = fine.rays()
    offset = origins - CENTRE
    half = np.sum(offset * directions, axis=-1)
    inside = half**2 - np.sum(offset**2, axis=-1) + RADIUS**2
    hit = inside > 0
    way = -half - np.sqrt(np.where(hit, inside, 0))
    normals = (offset + way[..., None] * directions) / RADIUS
    normals = np.where(hit[..., None], normals, UP)
    along = np.sum(normals * directions, axis=-1, keepdims=True)
    mirrored = directions - 2 * along * normals
    seen = np.where(hit[..., None], radiance_of(mirrored), background)

    def mean(picture):
        shape = (camera.height, scale, camera.width, scale, *picture.shape[2:])
        return picture.reshape(shape).mean(axis=(1, 3))

    return mean(seen), mean(hit.astype(float))
