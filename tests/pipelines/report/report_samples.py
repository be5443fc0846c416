"""A fit that nobody had to compute, its result, and a reader of pages."""

from html.parser import HTMLParser

import jax
import numpy as np

from jaxrender.brdf import Microfacet
from jaxrender.geometry import SurfaceSamples
from jaxrender.imaging import NoiseModel
from jaxrender.inverse import BRDFFit, Observations, Outcome
from jaxrender.inverse.conditioning import WidthEvidence
from jaxrender.inverse.elimination import Data, Fit
from jaxrender.inverse.intervals import Uncertain
from jaxrender.inverse.parameters import Parameters
from jaxrender.inverse.passes import Stop
from jaxrender.inverse.prepared_light import PreparedLight
from jaxrender.lighting import DirectionalSources, Environment, candidates, take
from jaxrender.pipelines.report import FramePictures
from jaxrender.pipelines.report.contents import MaterialContents
from jaxrender.reflection import SourcesNeeded, dual_light

SECTIONS = (
    "outcome",
    "material",
    "photographs",
    "look",
    "light",
    "residuals",
    "spectra",
    "account",
)
SIGMA, BAND_LIMIT = 0.3, 7
KD = (0.2, 0.1, 0.05)
# One 8-bit code around the middle of the sRGB curve, in linear light.
ONE_CODE = 0.006


def sample_stop(channels=3, noise=None):
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    outgoing = np.tile([1.0, 0.0, 0.0], (400, 1))
    normals[:, 0] = np.abs(normals[:, 0])
    predicted = rng.uniform(0.5, 1.5, (400, channels))
    radiance = predicted + 0.01 * rng.normal(size=predicted.shape)
    observations = Observations(SurfaceSamples(normals, outgoing), radiance, np.zeros(400, int))
    data = Data(radiance, np.ones_like(radiance), observations.frame)
    noise = noise or NoiseModel(0.01, 0.001)
    return Stop(Fit(None, None, predicted), None, None, data, observations, noise)


def sample_environment(channels=3):
    rng = np.random.default_rng(1)
    radiance = 0.1 + 0.02 * rng.uniform(size=(16, 32, channels))
    radiance[4, 5] = 20
    radiance[6, 20] = 5
    return Environment(radiance)


def prepared(light):
    if light.environment is None:
        return PreparedLight(dual_light(None, light.directional, 0), None, None)
    split = take(light.environment, candidates(light.environment, SIGMA), 2, SIGMA)
    return PreparedLight(
        dual_light(split, light.directional, BAND_LIMIT), split, SourcesNeeded(2, 0.01, 0.25)
    )


def sample_fit(light, mu=1.5, kd=KD, ks=0.2, refined=True, noise=None):
    channels = len(kd)
    value = Parameters(
        {"kd": np.array(kd), "ks": np.full(channels, ks)},
        {"sigma": np.array(SIGMA)} | ({} if mu is None else {"mu": np.array(mu)}),
        np.ones(1),
        np.array(1.0),
    )
    scaled = [
        jax.tree.map(lambda x, factor=factor: np.asarray(factor * x), value)
        for factor in (0.9, 1.1, 0.05)
    ]
    stop = sample_stop(channels, noise)
    return BRDFFit(
        Microfacet(np.array(kd), np.full(channels, ks), SIGMA, mu),
        Outcome.CONVERGED,
        Uncertain(value, *scaled),
        {"kd": True, "ks": True, "sigma": True, "mu": True},
        WidthEvidence(0.01, 0.02, float("inf")),
        stop,
        stop if refined else None,
        prepared(light),
        (),
    )


def sample_frame(name="view00", size=(20, 30), channels=3, seed=0):
    rng = np.random.default_rng(seed)
    rows, columns = size
    covered = np.zeros(size, bool)
    covered[2 : rows - 2, 3 : columns - 3] = True
    photograph = rng.uniform(0.2, 1, (*size, channels))
    predicted = np.where(covered[..., None], photograph * 1.02, 0)
    usable = covered.copy()
    usable[: rows // 2] = False
    return FramePictures(name, photograph, predicted, usable, covered)


RESULT = {
    "task": "brdf",
    "outcome": "not_identifiable",
    "reasons": ["mu is not identifiable: its 90 % interval is 1.2 to 1.9"],
    "brdf": {"model": "microfacet", "kd": list(KD), "ks": 0.2, "sigma": 0.3, "mu": 1.5},
    "interval90": {
        "kd": [[0.19, 0.21], [0.09, 0.11], [0.04, 0.06]],
        "ks": [0.18, 0.22],
        "sigma": [0.28, 0.32],
        "mu": [1.2, 1.9],
    },
    "standard_error": {"kd": [0.006, 0.006, 0.006], "ks": 0.012, "sigma": 0.012, "mu": 0.21},
    "correlations": {
        "numbers": ["kd[0]", "kd[1]", "kd[2]", "ks", "sigma", "mu"],
        "matrix": [
            [1, 0.5, 0.5, -0.1, 0.2, -0.1],
            [0.5, 1, 0.5, -0.3, 0.2, -0.1],
            [0.5, 0.5, 1, -0.2, 0.2, -0.1],
            [-0.1, -0.3, -0.2, 1, 0.2, -0.97],
            [0.2, 0.2, 0.2, 0.2, 1, 0.1],
            [-0.1, -0.1, -0.1, -0.97, 0.1, 1],
        ],
    },
    "identifiable": {"kd": True, "ks": True, "sigma": True, "mu": False},
    "model_sensitive": {"kd": False, "ks": False, "sigma": True, "mu": False},
    "variants": [
        {
            "fresnel": "half",
            "masking": "smith",
            "chi_squared": 12345.6,
            "kd": list(KD),
            "ks": 0.21,
            "sigma": 0.4321,
            "mu": None,
            "rejected": True,
        }
    ],
    "frequency": {
        "brdf": {"kd": list(KD), "ks": 0.2, "sigma": 0.303, "mu": 1.5},
        "bias": {"kd": [0.01, 0.0, -0.01], "ks": 0.0, "sigma": 0.0123, "mu": 0.0},
        "residual": {"relative_rms": 0.023},
    },
    "noise": {"relative": 0.01, "floor": 0.001},
    "residual": {"relative_rms": 0.0153, "samples": 12000},
    "evidence": {
        "sentence": "sigma rests on grazing angles",
        "all": 0.01,
        "without_grazing": 0.08,
        "spectrum": None,
    },
    "split": {
        "sources": 2,
        "slow_energy": 0.4,
        "error": 0.011,
        "error_without": 0.31,
        "sigma": 0.3,
    },
    "seconds": {"load": 0.12, "solve": 0.0004, "refine": 1.25},
    "provenance": {"jaxrender": "0.1.0", "inputs": {"a.exr": "abc123"}},
}


def rewritten(result, **changes):
    return {key: value for key, value in (result | changes).items() if value is not None}


def source(direction, energy, channels=3):
    return DirectionalSources(np.array([direction], float), np.full((1, channels), float(energy)))


def lambertian(light):
    result = rewritten(
        RESULT, brdf={"model": "lambertian", "kd": list(KD)}, evidence=None, variants=None
    )
    return MaterialContents("diffuse", result, sample_fit(light, ks=0.0), light, (sample_frame(),))


class Reader(HTMLParser):
    """All elements with their attributes, and all text."""

    def __init__(self, source):
        super().__init__()
        self.elements, self.words, self.open = [], [], []
        self.feed(source)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        self.open.append(tag)

    def handle_endtag(self, tag):
        while self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self):
        # Narrow and fixed spaces count as spaces.
        return " ".join(" ".join(self.words).split())

    def attributes(self, *names):
        return [a[name] for _, a in self.elements for name in names if name in a]
