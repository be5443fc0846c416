"""Ways to spoil photographs, masks, exposures and response curves, and what is said of each."""

import numpy as np
from small_captures import edit_json
from spoilt_captures import (
    frame,
    nothing,
    removed,
    write_any,
    written,
)

from jaxrender.io import read_image, write_image


def truncated(name, fraction=0.5):
    def change(folder):
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: int(fraction * len(data))])

    return change


def pixel(place, value, name="images/1.exr"):
    def change(folder):
        image = read_image(folder / name)
        pixels = np.concatenate([image.pixels, image.alpha[..., None]], axis=-1)
        pixels[place] = value
        write_any(folder / name, pixels)

    return change


def keys(**given):
    return lambda folder: edit_json(folder / "transforms.json", lambda all_: all_.update(given))


def small_mask(folder):
    write_image(folder / "mask.png", np.ones((4, 4, 3)))
    frame(0, mask_path="mask.png")(folder)


def eight_bits(folder):
    image = read_image(folder / "images/1.exr")
    write_image(folder / "images/1.png", image.pixels.clip(0, 1))
    frame(1, file_path="images/1.png")(folder)


def black(folder):
    for number in range(3):
        pixel((..., slice(0, 3)), 0, f"images/{number}.exr")(folder)


def clipped(folder):
    for path in sorted((folder / "images").glob("*.exr")):
        image = read_image(path)
        values = np.minimum(image.pixels, 0.01)
        write_any(path, np.concatenate([values, image.alpha[..., None]], axis=-1))


CURVE = "capture.response={curve: cap/c.txt}"
CASES = {
    # Photographs.
    "missing image": (
        removed("images/1.exr"),
        [],
        r"transforms\.json: frame 1 \(images/1\.exr\): `file_path`: .*1\.exr does not exist; mend",
    ),
    "truncated image": (
        truncated("images/1.exr"),
        [],
        r"images/1\.exr: the pixels cannot be read, is the file cut short\?",
    ),
    "empty image": (truncated("images/1.exr", 0), [], r"images/1\.exr: not a readable image"),
    "nan": (
        pixel((8, 7, 1), np.nan),
        [],
        r"images/1\.exr: channel G, pixel \(row 8, column 7\): the value is nan; 1 of 256 pixels "
        r"are negative or not finite: mend the picture, or .* with `invalid: mask`$",
    ),
    "infinite": (
        pixel((3, slice(2, 5), 2), np.inf),
        [],
        r"images/1\.exr: channel B, pixel \(row 3, column 2\): the value is inf; 3 of 256 pixels",
    ),
    "negative": (
        pixel((8, slice(7, 9), 0), -0.5),
        [],
        r"images/1\.exr: channel R, pixel \(row 8, column 7\): the value is -0\.5; 2 of 256",
    ),
    "8 bits without a response": (
        eight_bits,
        [],
        r"images/1\.png: integer pixel values .* state capture\.response: srgb",
    ),
    "size": (
        keys(w=20, h=20),
        [],
        r"images/0\.exr: frame 0: the picture is 16 x 16 pixels, its camera says 20 x 20; scale",
    ),
    "all black": (black, [], r"transforms\.json: every usable pixel is black; check"),
    "all clipped": (
        clipped,
        [],
        r"transforms\.json: 100 % of the usable values are clipped: they stand at the highest",
    ),
    "no usable pixel": (
        nothing,
        ["capture.erode=40"],
        r"no pixel is usable; removed: silhouette \d+; loosen capture\.erode, ",
    ),
    "missing mask": (
        frame(0, mask_path="m.png"),
        [],
        r"frame 0 \(images/0\.exr\): `mask_path`: .*m\.png does not exist; mend the path",
    ),
    "mask of another size": (
        small_mask,
        [],
        r"mask\.png: frame 0: the picture is 4 x 4 pixels, its camera says 16 x 16",
    ),
    "negative exposure": (
        frame(0, exposure=-1),
        [],
        r"frame 0 \(images/0\.exr\): `exposure` is -1; it must be positive$",
    ),
    "no exposure in the metadata": (
        nothing,
        ["capture.exposure=metadata"],
        r"images/0\.exr: no exposure time in its metadata; give frames\[\]\.exposure",
    ),
    # Response.
    "missing curve": (nothing, [CURVE], r"cap/c\.txt: no such file; mend the path$"),
    "broken curve": (
        written("c.txt", "0 0\n.5 x\n"),
        [CURVE],
        r"c\.txt:2: found '\.5 x'; each line is two numbers, value radiance, or four, value red "
        r"green blue$",
    ),
    "descending curve": (
        written("c.txt", "0 0\n1 1\n.5 2\n"),
        [CURVE],
        r"c\.txt: a curve's values must increase strictly, but entry 2 is 0\.5 after 1\.0: sort",
    ),
    "short curve": (
        written("c.txt", "0 0\n.01 1\n"),
        [CURVE],
        r"images/0\.exr: pixel \(row \d+, column \d+\): the values .* leave the response curve, "
        r"which covers 0 to 0\.01; 68 of 68 usable pixels do: extend the curve",
    ),
}
