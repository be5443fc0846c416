"""One small capture, written as each program writes it: text by text, by none of our readers."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from jaxrender.geometry import Pinhole, look_at, metashape_lens, opencv_lens
from jaxrender.io import write_image

WIDTH, HEIGHT, COUNT = 24, 18, 3
FX, FY, CX, CY = 31.0, 33.0, 11.25, 9.5
K1, K2, P1, P2, K3 = -0.1, 0.02, 1e-3, -2e-3, 0.004
UP = np.array([0.0, 0, 1])
# Nerfstudio's change of axes, with a shift, and its scale.
APPLIED = np.array([[1.0, 0, 0, 0.25], [0, 0, 1, -0.5], [0, -1, 0, 0.125]])
APPLIED_SCALE = 0.375
FLIP = np.diag([1.0, -1, -1])


class Written(NamedTuple):
    """A format: how a folder of it is written, and whether it has a lens and square pixels."""

    write: Callable[[Path], None]
    lens: bool = True
    square: bool = False


def poses() -> list[np.ndarray]:
    """Camera to world, as ours are."""
    places = [(3.0, 1, 1.5), (-1, 3.2, 0.4), (0.5, -2.9, 2)]
    return [look_at(np.array(place), np.array([0.05, 0.1, -0.02]), UP) for place in places]


def cameras(form: Written) -> list[Pinhole]:
    """The cameras that every reader should find."""
    lens = opencv_lens([K1, K2, P1, P2, K3]) if form.lens else None
    fy = FX if form.square else FY
    return [
        Pinhole(WIDTH, HEIGHT, pose, fl_x=FX, fl_y=fy, cx=CX, cy=CY, lens=lens) for pose in poses()
    ]


def name(number: int) -> str:
    return f"view_{number}"


def pictures(folder: Path, suffix: str = ".exr") -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(COUNT):
        values = np.full((HEIGHT, WIDTH, 3), 0.25 + 0.1 * number)
        write_image(folder / f"{name(number)}{suffix}", values)


def world_to_camera() -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotation and shift from the world to a camera that looks along +z, y down."""
    turned = [(FLIP @ pose[:3, :3].T, pose[:3, 3]) for pose in poses()]
    return [(turn, -turn @ place) for turn, place in turned]


def _intrinsics() -> dict:
    return {"w": WIDTH, "h": HEIGHT, "fl_x": FX, "fl_y": FY, "cx": CX, "cy": CY}


def _lens() -> dict:
    return {"k1": K1, "k2": K2, "p1": P1, "p2": P2, "k3": K3}


def transforms(folder: Path) -> None:
    pictures(folder / "images")
    frames = [
        {"file_path": f"images/{name(i)}", "transform_matrix": pose.tolist()} | _lens()
        for i, pose in enumerate(poses())
    ]
    (folder / "transforms.json").write_text(json.dumps(_intrinsics() | {"frames": frames}))


def nerfstudio(folder: Path) -> None:
    pictures(folder / "images")
    applied = np.vstack([APPLIED, [0, 0, 0, 1]])
    frames = []
    for i, pose in enumerate(poses()):
        moved = applied @ pose
        moved[:3, 3] *= APPLIED_SCALE
        frames.append(
            {"file_path": f"./images/{name(i)}.exr", "transform_matrix": moved.tolist()}
            | _intrinsics()
            | _lens()
        )
    top = {
        "camera_model": "OPENCV",
        "applied_transform": APPLIED.tolist(),
        "applied_scale": APPLIED_SCALE,
        "ply_file_path": "sparse_pc.ply",
    }
    (folder / "transforms.json").write_text(json.dumps(top | {"frames": frames}))


# COLMAP's OPENCV has no k3; its FULL_OPENCV has.
COLMAP = (FX, FY, CX, CY, K1, K2, P1, P2, K3, 0.0, 0.0, 0.0)


def _quaternions() -> list[tuple[list[float], list[float]]]:
    return [
        (Rotation.from_matrix(turn).as_quat(scalar_first=True).tolist(), shift.tolist())
        for turn, shift in world_to_camera()
    ]


def colmap_text(folder: Path) -> None:
    pictures(folder / "images")
    place = folder / "sparse" / "0"
    place.mkdir(parents=True)
    numbers = " ".join(map(repr, COLMAP))
    (place / "cameras.txt").write_text(f"# Camera list\n7 FULL_OPENCV {WIDTH} {HEIGHT} {numbers}\n")
    lines = ["# Image list with two lines of data per image:"]
    # Not in the order of their names; one without points, whose line is empty.
    for i in (2, 0, 1):
        quaternion, shift = _quaternions()[i]
        words = " ".join(map(repr, [*quaternion, *shift]))
        lines += [f"{i + 5} {words} 7 {name(i)}.exr", "" if i else "1.5 2.5 -1 3.0 4.0 17"]
    (place / "images.txt").write_text("\n".join(lines) + "\n")


def colmap_binary(folder: Path) -> None:
    pictures(folder / "images")
    place = folder / "sparse" / "0"
    place.mkdir(parents=True)
    camera = struct.pack("<QIiQQ12d", 1, 7, 6, WIDTH, HEIGHT, *COLMAP)
    (place / "cameras.bin").write_bytes(camera)
    content = struct.pack("<Q", COUNT)
    for i in (2, 0, 1):
        quaternion, shift = _quaternions()[i]
        content += struct.pack("<I7dI", i + 5, *quaternion, *shift, 7)
        content += f"{name(i)}.exr".encode() + b"\0"
        content += struct.pack("<Q", i) + struct.pack("<ddq", 1.5, 2.5, -1) * i
    (place / "images.bin").write_bytes(content)


def _matrix(values: np.ndarray) -> str:
    rows, columns = values.shape
    data = ", ".join(repr(float(x)) for x in values.ravel())
    return f"!!opencv-matrix\n  rows: {rows}\n  cols: {columns}\n  dt: d\n  data: [ {data} ]"


def _calibration() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    # OpenCV counts from the middle of the first pixel.
    matrix = np.array([[FX, 0, CX - 0.5], [0, FY, CY - 0.5], [0, 0, 1]])
    poses = [
        np.concatenate([Rotation.from_matrix(turn).as_rotvec(), shift])
        for turn, shift in world_to_camera()
    ]
    return matrix, np.array([[K1, K2, P1, P2, K3]]), np.array(poses)


def opencv_yaml(folder: Path) -> None:
    pictures(folder)
    matrix, lens, both = _calibration()
    listed = "".join(f'   - "{name(i)}.exr"\n' for i in range(COUNT))
    (folder / "calibration.yml").write_text(
        f'%YAML:1.0\n---\ncalibration_time: "today"\nimage_width: {WIDTH}\n'
        f"image_height: {HEIGHT}\ncamera_matrix: {_matrix(matrix)}\n"
        f"distortion_coefficients: {_matrix(lens)}\nextrinsic_parameters: {_matrix(both)}\n"
        f"images:\n{listed}"
    )


def opencv_xml(folder: Path) -> None:
    pictures(folder)
    matrix, lens, _ = _calibration()

    def element(tag: str, values: np.ndarray) -> str:
        rows, columns = values.shape
        data = " ".join(repr(float(x)) for x in values.ravel())
        return (
            f'<{tag} type_id="opencv-matrix"><rows>{rows}</rows><cols>{columns}</cols>'
            f"<dt>d</dt><data>{data}</data></{tag}>\n"
        )

    whole = np.tile(np.eye(4), (COUNT, 1, 1))
    for i, (turn, shift) in enumerate(world_to_camera()):
        whole[i, :3, :3], whole[i, :3, 3] = turn, shift
    (folder / "calibration.xml").write_text(
        '<?xml version="1.0"?>\n<opencv_storage>\n'
        + element("camera_matrix", matrix)
        + element("distortion_coefficients", lens)
        + element("poses", whole.reshape(COUNT, 16))
        + "</opencv_storage>\n"
    )


def mitsuba(folder: Path) -> None:
    pictures(folder)
    angle = float(2 * np.degrees(np.arctan(WIDTH / 2 / FX)))
    sensors = []
    for i, pose in enumerate(poses()):
        matrix = pose.copy()
        matrix[:3, [0, 2]] *= -1
        numbers = ", ".join(repr(float(x)) for x in matrix.ravel())
        sensors.append(
            f'<sensor type="perspective" id="{name(i)}"><float name="fov" value="$angle"/>\n'
            f'<float name="principal_point_offset_x" value="{(0.5 - CX / WIDTH)!r}"/>\n'
            f'<float name="principal_point_offset_y" value="{(0.5 - CY / HEIGHT)!r}"/>\n'
            f'<transform name="to_world"><matrix value="{numbers}"/></transform>\n'
            f'<film type="hdrfilm"><integer name="width" value="{WIDTH}"/>'
            f'<integer name="height" value="{HEIGHT}"/></film></sensor>\n'
        )
    (folder / "scene.xml").write_text(
        f'<scene version="3.0.0">\n<default name="angle" value="{angle!r}"/>\n'
        + "".join(sensors)
        + '<emitter type="directional"><vector name="direction" x="0" y="-0.6" z="-0.8"/>'
        + '<rgb name="irradiance" value="1, 2, 3"/></emitter>\n'
        + '<shape type="sphere"><point name="center" x="0" y="0" z="0"/>'
        + '<float name="radius" value="0.5"/><transform name="to_world">'
        + '<scale value="2"/><translate x="0.1"/></transform></shape>\n</scene>\n'
    )


# What takes Metashape's chunk to the world.
CHUNK = (Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), np.array([0.5, -1, 2]), 1.75)


def metashape(folder: Path) -> None:
    pictures(folder / "images")
    turn, shift, scale = CHUNK
    listed = []
    for i, pose in enumerate(poses()):
        own = np.eye(4)
        own[:3, :3] = turn.T @ pose[:3, :3] @ FLIP
        own[:3, 3] = turn.T @ (pose[:3, 3] - shift) / scale
        numbers = " ".join(repr(float(x)) for x in own.ravel())
        listed.append(
            f'<camera id="{i}" sensor_id="0" component_id="0" label="{name(i)}">'
            f"<transform>{numbers}</transform></camera>\n"
        )
    words = [" ".join(repr(float(x)) for x in np.ravel(part)) for part in (turn, shift, scale)]
    # Its p1 and p2 are the other way round, and its principal point is from the middle.
    calibration = {
        "f": FY, "b1": FX - FY, "cx": CX - WIDTH / 2, "cy": CY - HEIGHT / 2,
        "k1": K1, "k2": K2, "k3": K3, "p1": P2, "p2": P1,
    }  # fmt: skip
    numbers = "".join(f"<{key}>{value!r}</{key}>" for key, value in calibration.items())
    (folder / "cameras.xml").write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0">\n<chunk label="a">\n'
        f'<sensors><sensor id="0" type="frame"><resolution width="{WIDTH}" height="{HEIGHT}"/>'
        f'<calibration type="frame" class="adjusted">{numbers}</calibration></sensor></sensors>\n'
        f'<components><component id="0"><transform><rotation>{words[0]}</rotation>'
        f"<translation>{words[1]}</translation><scale>{words[2]}</scale></transform></component>"
        f"</components>\n<cameras>{''.join(listed)}"
        f'<camera id="9" sensor_id="0" label="lost"/></cameras>\n</chunk>\n</document>\n'
    )


FORMATS: dict[str, Written] = {
    "transforms": Written(transforms),
    "nerfstudio": Written(nerfstudio),
    "colmap text": Written(colmap_text),
    "colmap binary": Written(colmap_binary),
    "opencv yaml": Written(opencv_yaml),
    "opencv xml": Written(opencv_xml),
    "mitsuba": Written(mitsuba, lens=False, square=True),
    "metashape": Written(metashape),
}
SKEWED = metashape_lens([K1], (0.0, 0.0), 0.004)
