"""Configs and recipes that are right, and what is said back of others."""

from pathlib import Path

import pytest

from jaxrender.errors import InputError
from jaxrender.pipelines.config import load_recipe, load_run_config

CAPTURE = """\
task: brdf
capture:
  transforms: photos/transforms.json
  geometry: {sphere: {}}
"""
LIGHT = """\
lighting:
  environment: {path: probe.exr}
"""
GOOD = CAPTURE + LIGHT
RECIPE = """\
geometry: {sphere: {}}
brdf: {kd: 0.1, ks: 0.2, sigma: 0.1, mu: 1.5}
lighting:
  directional: [{direction: [0, 0, 1], irradiance: 3}]
"""
FULL = """\
task: brdf
capture:
  transforms: t.json
  images: photos
  geometry: {mesh: cat.ply, scale: 2}
  response: {curve: curve.txt}
  invalid: mask
  saturation: 0.98
  black_level: 1e-6
  erode: 0
  exposure: metadata
  allow_outside: true
lighting:
  environment: {path: probe.exr, convention: mirror-ball, scale: 3, height: 64}
  directional: [{direction: [0, 0.6, 0.8], irradiance: [1, 2, 3]}]
  per_frame: lights.json
  split: 0.5
  free_scale: true
brdf:
  kd: [0.1, 0.2, 0.3]
  ks: {bounds: [0, 1]}
  sigma: {bounds: [0.1, 1], start: 0.2}
  mu: 1.5
  ks_per_channel: true
  fresnel: half
  masking: smith
samples: {min_cosine: 0.2, count: 1e4, seed: 3}
solve:
  band_limit: 12
  transfer: gaussian
  refine_samples: 100
  method: simplex
  loss: cauchy
  noise: {relative: 0.01}
  starts: 2
  free_exposure: true
  variants: false
output: runs/full
"""


def run_config(text, *overrides):
    Path("bad.yaml").write_text(text, encoding="utf-8")
    return load_run_config("bad.yaml", overrides)


def recipe(text):
    Path("bad.yaml").write_text(text, encoding="utf-8")
    return load_recipe("bad.yaml")


def message(text, *overrides, load=run_config):
    with pytest.raises(InputError) as caught:
        load(text, *overrides)
    return str(caught.value)


def brdf_message(entries):
    """The message about one brdf section, without its place."""
    return message(GOOD + f"brdf: {entries}\n").split(": ", 1)[1]
