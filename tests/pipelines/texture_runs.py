"""Runs of ``task: texture`` on painted balls, and the arrays that they write."""

import h5netcdf
import numpy as np
from painted_captures import write_config
from small_captures import read_result

from jaxrender.io import read_image
from jaxrender.pipelines import fit, load_run_config
from jaxrender.pipelines.render import render_config

ROWS = 16
TASK = "task: texture\ntexture: {size: 16}\nsolve: {starts: 1, refine: off}\n"
DIFFUSE_TASK = "task: texture\ntexture: {size: 16}\nbrdf: {model: lambertian}\n"


def run(capture, text, *overrides, **config):
    path = write_config(capture, text, **config)
    out = capture.parent / f"out{abs(hash((text, overrides, str(config))))}"
    fit(load_run_config(path, [*overrides, f"output={out}"]))
    return out, read_result(out)


def arrays(folder):
    with h5netcdf.File(folder / "result.nc") as file:
        group = file["texture"]
        return {name: np.asarray(group[name][:]) for name in group.variables}


def off_photograph(capture, folder, again):
    """Render a result again into a folder: how far are that and the prediction off a photograph?"""
    out = render_config(folder, again)
    photograph, rendered = (read_image(p).pixels for p in (capture / "images/1.exr", out / "1.exr"))
    inside = photograph.sum(axis=-1) > 0.2 * photograph.max()
    images = rendered, read_image(folder / "images/1_predicted.exr").pixels
    return max(np.median(np.abs(one[inside] / photograph[inside, :3] - 1)) for one in images)
