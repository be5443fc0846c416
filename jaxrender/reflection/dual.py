"""The dual model of T 6.9: diffuse and slow light in frequency, fast light in angle.

B = K_d E(n) + K_s [ sum_l h_l(t_o) sum_m L_lm Y_lm(R)  +  sum_j F S(t_h,j) / (4 cos t_o) E_j ]

The slow part of the light is known by its coefficients and filtered; the sources are summed
exactly, like in the integral.  What the model gets wrong is therefore known in closed form: each
point mass left in the slow part contributes its energy times (lobe - azimuthal mean of the lobe).
``sources_needed`` adds that up, so a split is as fine as the error asked for, and no finer.  With
the transfer named ``facets`` the slow part's lobe is not its mean but integrated
(:mod:`.facet_integral`): ten times more accurate where it counts, at more than the mean's cost;
with ``azimuthal-P`` some of its azimuth is kept, and with ``shrm-P`` it is that of a spherical
harmonic reflection map (:mod:`.shrm`).

On concave shapes ``Shadows`` make it T 6.12: transfer vectors instead of harmonics of the normal,
and the visibilities of R and of the sources.  They depend on geometry and viewpoint only, and are
traced once (``cast_shadows``).
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxrender.batches import in_batches
from jaxrender.brdf import BRDF, Glossy
from jaxrender.geometry import (
    Components,
    Shape,
    SurfacePlaces,
    SurfaceSamples,
    pair_in_frame,
    visible_along,
    world_from_local,
)
from jaxrender.harmonics import band_limit_of, degree_table, degrees, real_basis
from jaxrender.lighting import DirectionalSources, Environment, LightNodes, LightSplit
from jaxrender.programs import stored
from jaxrender.reflection.facet_integral import facet_coefficients, reflect_by_facets
from jaxrender.reflection.integral import (
    FrameNodes,
    integral_columns,
    integral_columns_by_frame,
    visible_nodes,
)
from jaxrender.reflection.irradiance import irradiance
from jaxrender.reflection.shrm import (
    ViewFilter,
    mirror_coefficients_of,
    mirror_light,
    reflect_mirror_light,
)
from jaxrender.reflection.transfer import shadowed_irradiance
from jaxrender.shapes import AnyArray, Array, Bool, Float, Int, checked
from jaxrender.spectra import light_coefficients, transfer_of_samples

# Not a transfer, which has only degrees, but the slow part's integral over the lobe's facets.
FACETS = "facets"
# Sources are summed in blocks of so many, the last one filled up with dark ones.
SOURCES_AT_ONCE = 128


class DualGoal(NamedTuple):
    """What a split is to reach: the dual model's relative error, and at what cost.

    ``transfer`` is how the model filters what is left in the slow part.
    """

    error: float
    most_sources: int
    band_limit: int
    transfer: str = "exit-cosine"


class SourcesNeeded(NamedTuple):
    """How many sources meet a goal, the error with them, and the error with none."""

    count: int
    error: float
    error_without: float


class DualLight(eqx.Module):
    """Light as the dual model sees it: coefficients of the slow part, and directional sources.

    ``frames`` holds what is a different source in each photograph (moving light).
    """

    slow: Float[AnyArray, "coefficient channel"]
    sources: DirectionalSources
    frames: FrameNodes | None = None

    @property
    def band_limit(self) -> int:
        """The highest degree of the slow part."""
        return band_limit_of(self.slow.shape[0])

    @checked
    def for_frames(self, frame_of_sample: Int[AnyArray, "sample"]) -> "DualLight":
        """Make the same light ready for other samples, of the given photographs."""
        frames = self.frames
        if frames is not None:
            frames = frames._replace(frame_of_sample=frame_of_sample)
        return DualLight(self.slow, self.sources, frames)


def dual_light(
    split: LightSplit | None,
    directional: DirectionalSources,
    band_limit: int,
    frames: FrameNodes | None = None,
) -> DualLight:
    """Join a split environment and given directional sources.

    The slow coefficients are those of the whole environment less those of the sources taken out of
    it, so what the sources' cells blurred is put right in every degree that the model keeps.
    """
    channels = directional.irradiance.shape[-1]
    if split is None:
        dark = jnp.zeros((1, channels), directional.irradiance.dtype)
        return DualLight(dark, directional, frames)
    whole = light_coefficients(split.environment, band_limit)
    slow = whole - light_coefficients(split.sources, band_limit)
    sources = DirectionalSources(
        np.concatenate([split.sources.directions, directional.directions]),
        np.concatenate([split.sources.irradiance, directional.irradiance]),
    )
    return DualLight(slow, sources, frames)


class Shadows(NamedTuple):
    """What a concave shape keeps from the light, for each sample: the visibilities of T 6.12."""

    transfer: Float[AnyArray, "sample coefficient"]  # Y~_lm(x): of slow light into the diffuse part
    reflected: Bool[AnyArray, "sample"]  # V(R): of slow light in the specular part
    sources: Bool[AnyArray, "sample source"]  # V_j
    frame_sources: Bool[AnyArray, "sample node"] | None = None  # the same of DualLight.frames


@checked
def cast_shadows(
    shape: Shape,
    places: SurfacePlaces,
    samples: SurfaceSamples,
    light: DualLight,
    transfer: Float[AnyArray, "sample coefficient"],
) -> Shadows:
    """Trace what T 6.12 asks for: the reflected rays, and those to every source (host side).

    ``places`` are the samples' own; their transfer vectors are those of
    :mod:`jaxrender.reflection.transfer`.
    """
    reflected = visible_along(shape, places, np.asarray(samples.reflected, np.float64))
    sources = visible_nodes(shape, places, light.sources.nodes())
    frames = light.frames
    by_frame = None if frames is None else visible_nodes(shape, places, frames)
    return Shadows(transfer, reflected, sources, by_frame)


def filled_up(light: DualLight, shadows: Shadows | None = None) -> tuple[DualLight, Shadows | None]:
    """Fill up the last block of sources with dark ones, so that few shapes are ever compiled."""
    sources = light.sources
    missing = -sources.directions.shape[0] % SOURCES_AT_ONCE
    up = np.tile([[0.0, 0.0, 1.0]], (missing, 1))
    dark = np.zeros((missing, sources.irradiance.shape[1]))
    filled = DirectionalSources(
        np.concatenate([sources.directions, up]), np.concatenate([sources.irradiance, dark])
    )
    if shadows is not None:
        seen = np.pad(np.asarray(shadows.sources).astype(bool), ((0, 0), (0, missing)))
        shadows = shadows._replace(sources=seen)
    return DualLight(light.slow, filled, light.frames), shadows


@eqx.filter_jit
@checked
def dual_columns(
    brdf: BRDF,
    samples: SurfaceSamples,
    light: DualLight,
    transfer: str = "exit-cosine",
    shadows: Shadows | None = None,
    *,
    widths: Float[AnyArray, "sample"] | None = None,
) -> Float[Array, "sample lobe channel"]:
    """Evaluate T 6.9 with the named transfer: the columns of kd and, of a glossy BRDF, of ks.

    With ``shadows`` it is T 6.12; diffuse light is then summed to the transfer vectors' degree.
    ``widths`` give the lobe a sigma of its own at each sample, which only the transfer ``facets``
    knows how to use.
    """
    seen, seen_by_frame = None, None
    if shadows is not None:
        seen = _mask(shadows.sources)
        seen_by_frame = None if shadows.frame_sources is None else _mask(shadows.frame_sources)
    fast = integral_columns(brdf, samples, light.sources.nodes(), seen, widths=widths)
    if light.frames is not None:
        fast = fast + integral_columns_by_frame(
            brdf, samples, light.frames, seen_by_frame, widths=widths
        )
    if shadows is None:
        slow = [irradiance(light.slow, samples.normals)]
    else:
        slow = [shadowed_irradiance(light.slow, shadows.transfer)]
    if isinstance(brdf, Glossy):
        specular = slow_specular(brdf, samples, light.slow, transfer, widths)
        if shadows is not None:
            specular = jnp.where(_mask(shadows.reflected)[:, None], specular, 0)
        slow.append(specular)
    return jnp.stack(slow, axis=1) + fast


def _mask(visibility: Bool[AnyArray, "*any"] | Float[AnyArray, "*any"]) -> Bool[Array, "*any"]:
    """Take 1 or 0 for true or false."""
    return jnp.asarray(visibility).astype(bool)


def slow_specular(
    brdf: Glossy,
    samples: SurfaceSamples,
    slow: Float[AnyArray, "coefficient channel"],
    transfer: str = "exit-cosine",
    widths: Float[AnyArray, "sample"] | None = None,
) -> Float[Array, "sample channel"]:
    """Filter the slow light by the lobe and look it up at R: sum_l h_l(t_o) sum_m L_lm Y_lm(R).

    With the transfer ``facets`` integrate it; only then may each sample have its own width.  With
    ``shrm-P`` keep the azimuth about R and the viewer's direction to degree P (T 5.10), with
    ``azimuthal-P`` the azimuth to order P at the exact exit angle.
    """
    if transfer == FACETS:
        return reflect_by_facets(brdf, samples, slow, widths)
    if widths is not None:
        raise ValueError(f"transfer={transfer!r} is for lobes of one width: choose {FACETS!r}")
    view = ViewFilter.named(transfer)
    if view is not None:
        seen = mirror_light(samples, slow, view.degree)
        return reflect_mirror_light(brdf, samples.exit_cosines, seen, view)
    table = degree_table(jnp.asarray(slow), samples.reflected)
    band_limit = table.shape[1] - 1
    passed = transfer_of_samples(brdf, samples.exit_cosines, band_limit, transfer)
    return jnp.einsum("sl,slc->sc", passed, table, precision="highest")


@checked
def sources_needed(
    environment: Environment,
    candidates: DirectionalSources,
    brdf: Glossy,
    samples: SurfaceSamples,
    goal: DualGoal,
) -> SourcesNeeded:
    """Count the strongest candidates that must be sources for the dual model to meet the goal.

    The error is that of the specular column, root mean square over the samples relative to the
    column itself, against the exact sum over the environment's nodes.
    """
    count = min(goal.most_sources, candidates.directions.shape[0])
    # Filled up with dark candidates: one compiled program serves every light.
    short = ((0, max(goal.most_sources, 1) - count), (0, 0))
    unit = 3**-0.5
    directions = np.pad(np.asarray(candidates.directions)[:count], short, constant_values=unit)
    energies = np.pad(np.asarray(candidates.irradiance)[:count], short)
    whole = light_coefficients(environment, goal.band_limit)
    nodes = environment.nodes()
    padded = LightNodes(jnp.asarray(directions), jnp.asarray(energies))
    errors = np.asarray(_errors_by_count(brdf, samples, whole, nodes, padded, goal.transfer))
    errors = errors[: count + 1]
    enough = np.flatnonzero(errors <= goal.error)
    needed = int(enough[0]) if enough.size else int(np.argmin(errors))
    return SourcesNeeded(needed, float(errors[needed]), float(errors[0]))


@stored(effort="less")
def _errors_by_count(
    brdf: Glossy,
    samples: SurfaceSamples,
    whole: Float[Array, "coefficient channel"],
    nodes: LightNodes,
    candidates: LightNodes,
    transfer: str,
) -> Float[Array, "count"]:
    band_limit = band_limit_of(whole.shape[0])
    exact = integral_columns(brdf, samples, nodes)[:, 1, :]
    slow = _slow_lobe(brdf, samples, band_limit, transfer)
    error = exact - jnp.matmul(slow, whole, precision="highest")
    basis = real_basis(candidates.directions, band_limit)

    def gains(sample: tuple[SurfaceSamples, Array]) -> Float[Array, "node"]:
        surface, own = sample
        frame = world_from_local(surface.normals)
        pair = Components.of(candidates.directions), Components.of(surface.outgoing)
        lobe = brdf.transfer(*pair_in_frame(*pair, frame))[1]
        return lobe - jnp.matmul(basis, own, precision="highest")

    gain = in_batches(gains, (samples, slow), 16)
    taken = jnp.cumsum(gain[:, :, None] * candidates.irradiance[None], axis=1)
    left = jnp.concatenate([error[:, None], error[:, None] - taken], axis=1)
    scale = jnp.mean(exact**2)
    # Where nothing is reflected there is nothing to be wrong about.
    return jnp.sqrt(jnp.mean(left**2, axis=(0, 2)) / jnp.where(scale > 0, scale, 1))


def _slow_lobe(
    brdf: Glossy, samples: SurfaceSamples, band_limit: int, transfer: str
) -> Float[Array, "sample coefficient"]:
    """Expand the lobe of ``slow_specular`` in harmonics: its column under light Y_lm."""
    if transfer == FACETS:
        return facet_coefficients(brdf, samples, band_limit)
    view = ViewFilter.named(transfer)
    if view is not None:
        return mirror_coefficients_of(brdf, samples, band_limit, view)
    passed = transfer_of_samples(brdf, samples.exit_cosines, band_limit, transfer)
    return passed[:, degrees(band_limit)] * real_basis(samples.reflected, band_limit)
