"""A newcomer's path: a folder of photographs in Nerfstudio's layout, four commands, a report.

    python experiments/first_hour.py [--out FOLDER] [--probe soft\\ boxes] [--views 12] [--size 192]

Mitsuba 3 photographs an object of conductor and diffuse under a probe.  The pictures are those of a
camera: sRGB, 8 bit, behind a lens with distortion.  Cameras stand in a ``transforms.json`` as
Nerfstudio writes it, turned by its ``applied_transform``; the mesh lies in the frame before that.
Nothing is said of the light.  Then the commands of the README run in a process each, and their
times are printed with what was recovered beside the truth.
"""

import argparse
import json
from pathlib import Path

import mitsuba_scenes
import numpy as np
import scenes
from commands import run
from PIL import Image
from scipy import ndimage

from jaxrender.geometry import Mesh, Pinhole, look_at
from jaxrender.geometry.sculpture import sculpture
from jaxrender.imaging import SRGB
from jaxrender.io import write_mesh

# Radial and tangential distortion: ten pixels at the corners of a picture of a thousand.
K1, K2, P1, P2 = -0.08, 0.02, 0.0006, -0.0004
# The pinhole's picture is this much wider, so that the lens bends nothing in from beyond it.
WIDER, FINER = 1.15, 2
# What Nerfstudio's importer of COLMAP does to the world: z up becomes its own z up by a swap.
APPLIED = np.array([[0.0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]])
# The brightest thousandth is beyond white, as in most photographs.
WHITE_PERCENTILE = 99.9


def cameras(mesh: Mesh, views: int, size: int) -> list[Pinhole]:
    """Two rings about the object, as one walks around it."""
    lower, upper = mesh.bounds()
    centre, radius = (lower + upper) / 2, mesh.diagonal() / 2
    focal = size / 2 / np.tan(np.radians(mitsuba_scenes.ANGLE) / 2)
    found = []
    for number in range(views):
        azimuth, height = 2 * np.pi * (number + 0.25) / views, (0.15, 0.6)[number % 2]
        towards = np.array([np.cos(azimuth), np.sin(azimuth), height])
        position = centre + mitsuba_scenes.DISTANCE * radius * towards / np.linalg.norm(towards)
        pose = look_at(position, centre, np.array([0.0, 0.0, 1.0]))
        found.append(Pinhole(size, size, pose, fl_x=float(focal)))
    return found


def photograph(mi, scene, camera: Pinhole, spp: int, seed: int) -> np.ndarray:
    """Render a pinhole's picture, and look through the lens at it; alpha is the last channel."""
    side = round(FINER * WIDER * camera.width)
    sensor = mitsuba_scenes.sensor_of(mi, camera)
    half = np.tan(np.radians(sensor["fov"]) / 2) * side / (FINER * camera.width)
    sensor["fov"] = float(2 * np.degrees(np.arctan(half)))
    sensor["film"] |= {"width": side, "height": side, "pixel_format": "rgba"}
    integrator = mi.load_dict({"type": "direct", "hide_emitters": True})
    fine = mi.render(scene, sensor=mi.load_dict(sensor), integrator=integrator, spp=spp, seed=seed)
    fine = np.asarray(fine, float)
    inside = (np.arange(FINER * camera.width) + 0.5) / FINER - camera.width / 2
    x, y = np.meshgrid(inside / camera.fl_x, inside / camera.fl_x)
    x, y = undistorted(x, y)
    places = [FINER * camera.fl_x * axis + side / 2 - 0.5 for axis in (y, x)]
    bent = [ndimage.map_coordinates(c, places, order=1) for c in np.moveaxis(fine, -1, 0)]
    return (
        np.stack(bent, -1).reshape(camera.height, FINER, camera.width, FINER, 4).mean(axis=(1, 3))
    )


def undistorted(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Invert OpenCV's polynomial by fixed-point steps."""
    u, v = x.copy(), y.copy()
    for _ in range(50):
        square = u**2 + v**2
        radial = 1 + K1 * square + K2 * square**2
        across = 2 * P1 * u * v + P2 * (square + 2 * u**2)
        along = P1 * (square + 2 * v**2) + 2 * P2 * u * v
        u, v = (x - across) / radial, (y - along) / radial
    return u, v


def write_folder(folder: Path, probe: str, views: int, size: int, spp: int) -> None:
    """Write mesh, pictures and ``transforms.json``."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    (folder / "images").mkdir(parents=True)
    mesh = sculpture(5, 3)
    write_mesh(folder / "mesh.ply", mesh)
    light = scenes.probe(probe, 1)
    shape = {
        "type": "ply",
        "filename": str(folder / "mesh.ply"),
        "bsdf": mitsuba_scenes.blend("ggx"),
    }
    parts = {"light": mitsuba_scenes.envmap(mi, light), "object": shape}
    scene = mi.load_dict({"type": "scene", **parts})
    eyes = cameras(mesh, views, size)
    pictures = [photograph(mi, scene, eye, spp, number) for number, eye in enumerate(eyes)]
    seen = np.concatenate([one[one[..., 3] > 0.99][:, :3].ravel() for one in pictures])
    white = float(np.percentile(seen, WHITE_PERCENTILE))
    frames = []
    for number, (eye, picture) in enumerate(zip(eyes, pictures), 1):
        name = f"images/frame_{number:05d}.png"
        shown = SRGB().encode(np.clip(picture[..., :3] / white, 0, 1))
        codes = np.rint(255 * np.concatenate([shown, picture[..., 3:].clip(0, 1)], -1))
        Image.fromarray(codes.astype(np.uint8)).save(folder / name)
        pose = np.eye(4)
        pose[:3] = APPLIED @ eye.world_from_camera
        frames.append({"file_path": name, "transform_matrix": pose.tolist()})
    focal = eyes[0].fl_x
    intrinsics = {"camera_model": "OPENCV", "w": size, "h": size, "fl_x": focal, "fl_y": focal}
    intrinsics |= {"cx": size / 2, "cy": size / 2, "k1": K1, "k2": K2, "p1": P1, "p2": P2}
    document = {**intrinsics, "applied_transform": APPLIED.tolist(), "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(document, indent=1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("first_hour"))
    parser.add_argument("--probe", default="soft boxes", choices=sorted(scenes.PROBES))
    parser.add_argument("--views", type=int, default=12)
    parser.add_argument("--size", type=int, default=192)
    parser.add_argument("--spp", type=int, default=256)
    options = parser.parse_args()
    photos, capture, result = (options.out / name for name in ("photos", "capture", "result"))
    write_folder(photos, options.probe, options.views, options.size, options.spp)
    seconds = {
        "import": run("import", photos, "--mesh", photos / "mesh.ply", "--out", capture),
        "check": run("check", capture),
        "fit": run("fit", capture / "capture.yaml", f"output={result}"),
        "evaluate": run("evaluate", result),
    }
    print("  ".join(f"{name} {spent:.0f} s" for name, spent in seconds.items()))
    print(f"together {sum(seconds.values()):.0f} s")
    found, truth = json.loads((result / "result.json").read_text()), mitsuba_scenes.material("ggx")
    kd, ks = (np.asarray(part, float) for part in (truth.kd, truth.ks))
    print(f"{'':10} {'recovered':>10} {'90 % interval':>24} {'true':>8}")
    for channel in range(3):
        share = kd[channel] / (kd + ks)[channel]
        row(f"kd[{channel}]", *(found[key]["kd"][channel] for key in ("brdf", "interval90")), share)
    row("sigma", *(found[key]["sigma"] for key in ("brdf", "interval90")), truth.sigma)


def row(name: str, value: float, interval: list[float], true: float) -> None:
    low, high = interval
    print(f"{name:10} {value:10.4f} {low:12.4f} to {high:8.4f} {true:8.4f}")


if __name__ == "__main__":
    main()
