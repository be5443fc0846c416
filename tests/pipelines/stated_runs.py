"""Runs of every kind, as texts of configs, and another value of every key."""

from jaxrender.catalogue import MODELS
from jaxrender.pipelines.config.tasks import TASKS

_LIT = "lighting: {environment: {path: probe.exr}}\n"
_TEXTURE = "task: texture\ntexture: {size: 8}\n"
_GIVEN = "brdf: {kd: 0.2, ks: 0.1, sigma: 0.1, mu: 1.5}\n"
RUNS = {
    # Every task as short as it can be; some need more, and say so below.
    **{name: f"task: {name}\n{_LIT if task.dark is None else ''}" for name, task in TASKS.items()},
    "brdf of sources": "task: brdf\nlighting: {directional: [{direction: [0, 0, 1], "
    "irradiance: 1}]}\n",
    "brdf of point sources": "task: brdf\nlighting: {point: [{position: [0, 0, 5], "
    "intensity: 9}]}\n",
    "brdf under skies": "task: brdf\nlighting: {clear_sky: {sun: [0, 1, 1], zenith: 1}, "
    "overcast_sky: {zenith: 0.1}, harmonic: {coefficients: [1, 0.1, 0, 0.2]}}\n",
    "brdf of moving sources": "task: brdf\nlighting: {per_frame: lights.txt}\n",
    "brdf of several lights": "task: brdf\nlighting: {environment: {path: probe.exr}}\ncaptures: "
    "[{transforms: other.json, lighting: {environment: {path: other.exr}}}]\n",
    "brdf compared": f"task: brdf\nbrdf: {{model: ggx, compare: [ward, phong]}}\n{_LIT}",
    "brdf by a ladder": f"task: brdf\nbrdf: {{compare: auto}}\n{_LIT}",
    "brdf by frequency alone": f"task: brdf\nsolve: {{refine: off}}\n{_LIT}",
    "brdf with azimuth": f"task: brdf\nsolve: {{model: azimuthal}}\n{_LIT}",
    "brdf of a known lobe": f"task: brdf\nbrdf: {{sigma: 0.1, mu: none}}\n{_LIT}",
    "brdf up to a scale": "task: brdf\nlighting: {environment: {path: probe.exr}, "
    "free_scale: true}\n",
    "two lobes up to a scale": "task: brdf\nbrdf: {model: two-ggx}\nlighting: {environment: "
    "{path: probe.exr}, free_scale: true}\n",
    "layers up to a scale": "task: brdf\nbrdf: {model: principled}\nlighting: {environment: "
    "{path: probe.exr}, free_scale: true}\n",
    "brdf with bounces": f"task: brdf\nsolve: {{interreflection: true}}\n{_LIT}",
    **{
        f"brdf of {model}": f"task: brdf\nbrdf: {{model: {model}}}\n{_LIT}"
        for model in (
            *("lafortune", "he-torrance", "anisotropic-ward", "poulin-fournier", "two-ggx"),
            "anisotropic-ggx",
            *("metallic-roughness", "principled", "openpbr", "free"),
        )
    },
    "brdf of a glTF metal": f"task: brdf\nbrdf: {{model: metallic-roughness, metallic: 1}}\n{_LIT}",
    "brdf of Disney's metal": f"task: brdf\nbrdf: {{model: principled, metallic: 1}}\n{_LIT}",
    "brdf of an OpenPBR metal": f"task: brdf\nbrdf: {{model: openpbr, base_metalness: 1}}\n{_LIT}",
    "brdf with a table": f"task: brdf\nbrdf: {{model: ggx, table: true}}\n{_LIT}",
    "brdf of bank": f"task: brdf\nbrdf: {{model: bank}}\n{_LIT}",
    "brdf of lambertian": f"task: brdf\nbrdf: {{model: lambertian}}\n{_LIT}",
    "lighting": f"task: lighting\n{_GIVEN}",
    "lighting of lambertian": "task: lighting\nbrdf: {model: lambertian, kd: 0.2}\n",
    "factorize by ratio": "task: factorize\nbrdf: {kd: 0.2, ks: 0.1}\n",
    "factorize compared": "task: factorize\nbrdf: {compare: [ward]}\n",
    "factorize lambertian": "task: factorize\nbrdf: {model: lambertian}\n",
    "factorize anisotropic-ward": "task: factorize\nbrdf: {model: anisotropic-ward}\n",
    "texture": f"{_TEXTURE}{_LIT}",
    "texture by simplex": f"{_TEXTURE}solve: {{method: simplex}}\n{_LIT}",
    "texture of a known lobe": f"{_TEXTURE}brdf: {{sigma: 0.1, mu: 1.5}}\n{_LIT}",
    "texture of varying sigma": f"task: texture\ntexture: {{size: 8, sigma: varying}}\n{_LIT}",
    "texture of maps": f"task: texture\ntexture: {{size: 8, sigma: map, normals: map}}\n{_LIT}",
    "texture of a coloured ks": f"task: texture\ntexture: {{size: 8, ks: color}}\n{_LIT}",
    "texture of metal": "task: texture\ntexture: {size: 8, roughness: map, metalness: map}\n"
    f"brdf: {{model: metallic-roughness}}\n{_LIT}",
    "texture of even metal": f"{_TEXTURE}brdf: {{model: metallic-roughness}}\n{_LIT}",
    "texture of regions": f"task: texture\ntexture: {{size: 8, regions: regions.png}}\n{_LIT}",
    "texture of lambertian": f"{_TEXTURE}brdf: {{model: lambertian}}\n{_LIT}",
    "texture in the dark": _TEXTURE,
    "texture of lambertian in the dark": _TEXTURE + "brdf: {model: lambertian}\n",
}
_SHAPES = {"brdf of lambertian": "mesh: ball.ply"}

# Of renderers' materials alone: their indices, and all others.
_INDICES = ("ior", "specular_ior", "coat_ior")
# The numbers of free facets.
WAVES = tuple(f"wave_{k}" for k in (2, 3, 4))
RISES = tuple(f"rise_{degrees}" for degrees in (45, 60, 75, 90))

LAYERS = tuple(
    dict.fromkeys(
        number.name
        for model in ("metallic-roughness", "principled", "openpbr")
        for number in MODELS[model].numbers
        if number.name != "roughness"
    )
)


def _of_layer(name: str) -> dict[str, str]:
    """State a number in every way."""
    if name in _INDICES:
        return {"fixed": "1.7", "bounds": "[1.2, 1.9]", "start": "1.6", "prior": "[1.5, 0.1]"}
    return {"fixed": "0.4", "bounds": "[0.3, 0.6]", "start": "0.45", "prior": "[0.4, 0.2]"}


# Another value of each key, or two.
OTHER = {
    "task": ("brdf", "texture"),
    "capture.transforms": "other.json",
    "capture.recipe": "recipe.yaml",
    "capture.images": "images",
    "capture.camera_axes": "opencv",
    "capture.mirrored": "true",
    "capture.geometry.sphere.center": "[0.1, 0, 0]",
    "capture.geometry.sphere.radius": "1.1",
    "capture.geometry.mesh": "other.ply",
    "capture.geometry.scale": "1.1",
    "capture.geometry.rotation": "[0, 0, 5]",
    "capture.geometry.translation": "[0, 0, 0.01]",
    "capture.response": "srgb",
    "capture.response.curve": "curve.txt",
    "capture.invalid": "mask",
    "capture.saturation": ("0.9", "auto"),
    "capture.saturation_grow": "1",
    "capture.black_level": "0.01",
    "capture.erode": "1",
    "capture.exposure": "metadata",
    "capture.allow_outside": "true",
    "captures": "[{transforms: other.json, lighting: {environment: {path: other.exr}, "
    "per_frame: lights.txt}}]",
    "lighting.environment.path": "other.exr",
    "lighting.environment.convention": "y-up",
    "lighting.environment.mirrored": "true",
    "lighting.environment.yaw": "20",
    "lighting.environment.scale": "2",
    "lighting.environment.height": "14",
    "lighting.directional": "[{direction: [1, 0, 0], irradiance: 2}]",
    "lighting.point": "[{position: [1, 0, 4], intensity: 2}]",
    "lighting.area": "[{direction: [1, 0, 0], width_degrees: 20, radiance: 2}]",
    "lighting.overcast_sky.zenith": "0.2",
    "lighting.clear_sky.sun": "[1, 0, 1]",
    "lighting.clear_sky.zenith": "2",
    "lighting.clear_sky.air": "polluted",
    "lighting.harmonic.coefficients": "[1, 0.2, 0, 0.2]",
    "lighting.per_frame": "other.txt",
    "lighting.per_frame_irradiance": "irradiance.txt",
    "lighting.split": "off",
    "lighting.free_scale": ("true", "false"),
    "brdf.model": ("beckmann", "lambertian", "metallic-roughness"),
    "brdf.compare": ("[oren-nayar]", "auto"),
    "brdf.ks_per_channel": "true",
    "brdf.fresnel": ("half", "exit"),
    "brdf.masking": ("smith", "none"),
    "brdf.gauge": ("metal", "dielectric"),
    **{
        f"brdf.{name}.{key}": value
        for name in ("kd", "ks", "ks_broad", "sigma", "roughness", "roughness_y")
        for key, value in {
            "fixed": "0.3",
            "bounds": "[0.1, 0.4]",
            "start": "0.3",
            "prior": "[0.3, 0.2]",
        }.items()
    },
    **{f"brdf.{name}.{key}": value for name in LAYERS for key, value in _of_layer(name).items()},
    "brdf.multiple_scattering": "facets",
    "brdf.table": ("true", "false"),
    **{
        f"brdf.{name}.{key}": value
        for name in ("spread", "tail", *RISES)
        for key, value in {
            "fixed": "3",
            "bounds": "[2, 9]",
            "start": "3",
            "prior": "[3, 1]",
        }.items()
    },
    **{
        f"brdf.{name}.{key}": value
        for name in WAVES
        for key, value in {
            "fixed": "0.2",
            "bounds": "[-0.4, 0.4]",
            "start": "0.2",
            "prior": "[0.2, 0.1]",
        }.items()
    },
    "brdf.exponent.fixed": "20",
    "brdf.exponent.bounds": "[5, 50]",
    "brdf.exponent.start": "20",
    "brdf.exponent.prior": "[20, 5]",
    "brdf.mu.fixed": "1.6",
    "brdf.mu.bounds": "[1.2, 1.9]",
    "brdf.mu.start": "1.7",
    "brdf.mu.prior": "[1.5, 0.1]",
    "brdf.c_z": "0.9",
    "brdf.deviation": "0.4",
    "brdf.spacing": "3",
    "brdf.height": "0.5",
    "samples.min_cosine": "0.3",
    "samples.count": "90",
    "samples.seed": "1",
    "solve.band_limit": "3",
    "solve.model": ("shrm", "dual"),
    "solve.view_degree": "3",
    "solve.transfer": "gaussian",
    "solve.refine": ("off", "exact"),
    "solve.refine_samples": "80",
    "solve.method": ("simplex", "variable-projection"),
    "solve.loss": "cauchy",
    "solve.noise.relative": "0.02",
    "solve.noise.floor": "0.02",
    "solve.starts": "3",
    "solve.free_exposure": "true",
    "solve.most_sources": "3",
    "solve.variants": ("true", "false"),
    "solve.free": ("[camera]", "auto"),
    "solve.diagnose": ("true", "false"),
    "solve.held_out": "0.3",
    "solve.interreflection": ("true", "false"),
    "texture.size": "6",
    "texture.regions": "regions.png",
    "texture.sigma": ("varying", "even", "map"),
    "texture.normals": ("map", "shape"),
    "texture.ks": ("color", "single"),
    "texture.roughness": ("map", "even"),
    "texture.metalness": ("map", "even"),
    "texture.control_points": "5",
    "texture.unknown_light": "true",
    "texture.prior": "variance",
    "texture.dilate": "3",
    "spectrum.order": "4",
    "spectrum.reciprocal": "false",
    "output": "elsewhere",
}


def text_of(name: str) -> str:
    """Write the config of a run, whose files lie beside it."""
    shape = _SHAPES.get(name, "sphere: {radius: 1}")
    return f"capture: {{transforms: transforms.json, geometry: {{{shape}}}}}\n{RUNS[name]}"


def others(key: str) -> tuple[str, ...]:
    """List the other values of a key."""
    return OTHER[key] if isinstance(OTHER[key], tuple) else (OTHER[key],)
