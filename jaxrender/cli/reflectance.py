"""The commands about reflectance: ``measure``, ``compress``, ``nearest`` and ``complete``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from jaxrender.cli import process
from jaxrender.cli.app import DONE, NOT_CONVERGED, app, examples
from jaxrender.cli.reporting import AS_USUAL, Reporting


@app.command(
    help_epilogue=examples(
        "measure sawtooth:teeth=4,rising=45,falling=45 --out grooves.nc",
        "measure velvet:threads=600,length=0.3,lean=20 --out velvet.nc --size 8 --samples 64",
    )
)
def measure(
    patch: str,
    /,
    *,
    out: Path,
    brdf: list[str] | None = None,
    size: list[int] | None = None,
    embedding: Literal["nusselt", "polar"] = "nusselt",
    samples: int = 256,
    bounces: int = 4,
    seed: int = 0,
    region: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0),
    relief: float = 0.1,
    force: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Measure the BRDF of micro-geometry, with masking and interreflection.

    The table holds values and standard errors.  After an interrupt the same command continues.

    Parameters
    ----------
    patch
        sawtooth:teeth=4,rising=45,falling=45 (degrees), velvet:threads=600,length=0.3,lean=20, a
        mesh of one period (.obj, .ply, .glb, .stl), or an image of heights.
    out
        The table to write (.nc).
    brdf
        A facet's BRDF such as lambertian:kd=0.2/0.1/0.1 or microfacet:sigma=0.2, or a file of
        measurements, a table, a tree or a result folder.  Give it several times for materials 0,
        1, ... (rising and falling sides; base and threads).
    size
        Samples along each axis of the table; 16 by default.  Give it four times for kappa_i,
        lambda_i, kappa_r and lambda_r.
    embedding
        How the square of the table holds directions.
    samples
        Paths for each exit direction.
    bounces
        Largest number of reflections between facets; 1 is direct light only.
    seed
        Seed of the random numbers.
    region
        The part u0 v0 u1 v1 of the period that is measured, 0 to 1.
    relief
        Height of white above black in an image, in units of its width.
    force
        Replace the result of another measurement, finished or not.
    """
    process.set_up_jax()
    from jaxrender.pipelines import measure as measuring

    facets = tuple(brdf) if brdf else measuring.DEFAULT_FACETS
    options = measuring.MeasureOptions(
        patch, facets, tuple(size or (16,)), embedding, samples, bounces, seed, region, relief
    )
    done = measuring.measure(options, out, reporting.progress(), force)
    process.say(done.text)
    process.say(f"table: {out}")
    return DONE


@app.command(
    help_epilogue=examples(
        "compress paint.binary --out paint.nc --error 0.05",
        "compress microfacet:sigma=0.2,mu=1.5 --out facets.nc --size 16 --conserve --strict",
    )
)
def compress(
    brdf: str,
    /,
    *,
    out: Annotated[Path, Parameter(alias="-o")],
    keep: float | None = None,
    error: str | None = None,
    size: int = 32,
    wavelet: str | None = None,
    spectral: bool = False,
    cell_samples: int = 16,
    embedding: Literal["nusselt", "half-difference", "auto"] = "nusselt",
    transform: Literal["cube-root", "log", "none"] | None = None,
    conserve: bool = False,
    strict: bool = False,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Compress a BRDF to a tree of wavelet coefficients.

    Prints the size of the tree, the errors of thresholding and of the tree, whether it conserves
    energy, and the cost of an evaluation.  The numbers are also in OUT.json.

    Parameters
    ----------
    brdf
        A file (MERL .binary, Cornell .brdf, ALTA, UTIA .bin, RGL .bsdf, a table or tree .nc), a
        model such as microfacet:sigma=0.2,mu=1.5, or the result folder of a fit.
    out
        The tree to write (NetCDF).
    keep
        Fraction of the coefficients to keep, over all channels together: 0.01 of those that are
        not zero, by default, and 0.03 of all over half-difference.
    error
        Relative error to meet, such as 5% or 0.05, with as few coefficients as possible: the rms of
        the table over nusselt; over half-difference the cosine-weighted absolute error at the
        measured pairs, or at random ones.  It replaces keep.
    size
        Samples along each axis; a power of two.
    wavelet
        haar, cdf-2-2 (linear spline), daubechies-2 or daubechies-4; by default haar over nusselt
        and cdf-2-2 over half-difference.
    spectral
        Keep all wavelengths of a file, not linear RGB.
    cell_samples
        Evaluations in the mean over a cell of nusselt; 1 takes its centre.
    embedding
        nusselt (two directions, four axes: shading, sampling and textures take these),
        half-difference (isotropic, three axes: glossy paints in far fewer coefficients) or auto
        (whichever is nearer to measurements held out).
    transform
        What the tree holds over half-difference: the cube-root (default), log or none of a value.
    conserve
        Dim a BRDF that sends out more light than arrives, as little as leaves no albedo above 1:
        by g(t_i) g(t_r), which keeps it reciprocal.  The loss is printed.
    strict
        Exit with 1 if an albedo of the tree is above 1.
    """
    process.set_up_jax()
    from jaxrender.pipelines import compress as compression

    goal = compression.goal_of(keep, error)
    done = compression.compress(
        brdf,
        out,
        goal,
        size=size,
        wavelet=wavelet,
        spectral=spectral,
        cell_samples=cell_samples,
        progress=reporting.progress(),
        embedding=embedding,
        transform=transform,
        conserve=conserve,
    )
    for line in done.said:
        process.say(line)
    process.say(f"tree: {out}")
    return NOT_CONVERGED if strict and not done.conserves_energy else DONE


@app.command(
    help_epilogue=examples(
        "nearest paint.binary", "nearest paint.binary --metric cosine-l1 --out nearest_paint"
    ),
)
def nearest(
    brdf: str,
    /,
    *,
    out: Annotated[Path | None, Parameter(alias="-o")] = None,
    metric: Literal["cube-root", "cosine-l1", "plain"] = "cube-root",
    model: list[str] | None = None,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Find the models nearest to a measured BRDF, a table, a tree or a result.

    Prints a table: the best model first, what each misses, its numbers with standard errors.  A
    file of scattered measurements is fitted to as it is, a fifth of it held out in turn.

    Parameters
    ----------
    brdf
        A file or folder as ``compress`` takes it, or a model such as microfacet:sigma=0.2.
    out
        A folder for ``nearest.json`` and ``nearest.png`` (lobe, slice, error).
    metric
        What is made small and ranked by: cube-root (about as seen), cosine-l1 (reflected light in
        the wrong place) or plain (root mean square).
    model
        A model to fit, such as ggx.  Give it several times; by default six common ones.
    """
    process.set_up_jax()
    from jaxrender.pipelines import nearest as searching

    done = searching.nearest(brdf, metric, tuple(model or ()), out, reporting.progress())
    for line in done.said:
        process.say(line)
    return DONE


@app.command(
    help_epilogue=examples(
        "complete --materials merl --next 5",
        "complete paint.brdf --materials merl --out paint.binary",
    ),
)
def complete(
    samples: Path | None = None,
    /,
    *,
    materials: Path,
    out: Annotated[Path | None, Parameter(alias="-o")] = None,
    following: Annotated[int, Parameter(name="--next")] = 0,
    noise: float | None = None,
    components: int = 40,
    reporting: Reporting = AS_USUAL,
) -> int:
    """Complete a BRDF from few measurements, by what measured materials have in common.

    Learns principal components of a folder of MERL files (kept in the cache), and fits them to the
    samples. Prints how well they foretell one another, and where to measure next.

    Parameters
    ----------
    samples
        A file of scattered measurements: Cornell .brdf or ALTA text. Without it, ``--next`` says
        where a first measurement tells most.
    materials
        A folder of MERL files (``*.binary``), five at least.
    out
        The completed table, as a MERL file. Beside it lies a ``.json`` of its errors.
    following
        How many pairs of directions to name that are worth measuring next.
    noise
        Relative standard deviation of a measurement, such as 0.03. By default it is found.
    components
        How many principal components to use.
    """
    process.set_up_jax()
    from jaxrender.pipelines.complete import complete_samples

    done = complete_samples(
        samples,
        materials,
        out,
        following=following,
        components=components,
        noise=noise,
        progress=reporting.progress(),
    )
    for line in done.said:
        process.say(line)
    return DONE
