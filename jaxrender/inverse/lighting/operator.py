"""Photographs as linear measurements of an unknown light of known material (T 6.15, 6.16).

B(x) = sum_lm L_lm [ K_d Y~_lm(x) + K_s V(R) h_l(x) Y_lm(R) ]

Y~_lm(x) = A_l Y_lm(n) where nothing is shadowed (ERRATA 42: A_l, not rho_l), else the transfer
vectors of T 6.10; h_l is any transfer by sample and degree.  The thesis's own operator has the
normalised Fresnel ratio F at the exit angle in its place (``transfer="none"``; ERRATA 44): it does
not use sigma, and what it recovers is the light *as filtered by the lobe*.

The matrix is never held: ``columns`` makes the rows of a few samples at a time.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxrender.brdf import Glossy, normalised_fresnel
from jaxrender.geometry import SurfaceSamples
from jaxrender.harmonics import band_limit_of, coefficient_count, degrees, real_basis
from jaxrender.shapes import AnyArray, Array, Float, checked
from jaxrender.spectra import TRANSFERS, lambertian_transfer, transfer_of_samples

# Diffuse light beyond this degree is under .4 % of the whole; cut at 2, as the thesis does, 1 %.
DIFFUSE_BAND_LIMIT = 8
# Numbers of one chunk of either part of the matrix: 8 MiB in double precision.
_NUMBERS_PER_CHUNK = 2**20


class LightRows(eqx.Module):
    """What the operator knows of each sample.

    ``passed`` is V(R) h_l; ``transfer_vectors``, where given, replace A_l Y_lm(n).
    """

    normals: Float[AnyArray, "sample 3"]
    reflected: Float[AnyArray, "sample 3"]
    passed: Float[AnyArray, "sample degree"]
    transfer_vectors: Float[AnyArray, "sample transfer_coefficient"] | None = None


class LightOperator(eqx.Module):
    """The matrix from light coefficients to radiance, in factors.

    ``kd`` and ``ks`` are those of the material; the light's band limit is that of
    ``rows.passed``, and the diffuse part is kept to ``diffuse_band_limit`` of it.
    Raises ``ValueError`` for transfer vectors that do not reach that far.
    """

    rows: LightRows
    kd: Float[AnyArray, "channel"]
    ks: Float[AnyArray, "channel"]
    diffuse_band_limit: int = eqx.field(static=True, default=DIFFUSE_BAND_LIMIT)

    def __check_init__(self):
        vectors = self.rows.transfer_vectors
        if vectors is not None and vectors.shape[1] < coefficient_count(self._diffuse_limit):
            raise ValueError(
                f"transfer vectors of degree {band_limit_of(vectors.shape[1])} for a diffuse part "
                f"of degree {self._diffuse_limit}: trace more, or lower diffuse_band_limit"
            )

    @property
    def band_limit(self) -> int:
        """The highest degree of the light."""
        return self.rows.passed.shape[1] - 1

    @property
    def count(self) -> int:
        """The number of samples."""
        return self.rows.passed.shape[0]

    @property
    def samples_per_chunk(self) -> int:
        """How many samples to expand at once, so that memory does not grow with their number."""
        return max(_NUMBERS_PER_CHUNK // coefficient_count(self.band_limit), 64)

    def columns(
        self, rows: LightRows
    ) -> tuple[Float[Array, "sample coefficient"], Float[Array, "sample coefficient"]]:
        """Expand some rows: the parts that K_d and K_s multiply, for every coefficient."""
        return self.diffuse(rows), self.specular(rows)

    def diffuse(self, rows: LightRows) -> Float[Array, "sample coefficient"]:
        """Expand Y~_lm(x), zero above the diffuse band limit."""
        limit = self._diffuse_limit
        kept, every = coefficient_count(limit), coefficient_count(self.band_limit)
        if rows.transfer_vectors is None:
            transfer = lambertian_transfer(limit)[degrees(limit)]
            normals = jnp.asarray(rows.normals)
            vectors = real_basis(normals, limit) * jnp.asarray(transfer, normals.dtype)[None, :]
        else:
            vectors = jnp.asarray(rows.transfer_vectors)[:, :kept]
        return jnp.pad(vectors, ((0, 0), (0, every - kept)))

    def specular(self, rows: LightRows) -> Float[Array, "sample coefficient"]:
        """Expand V(R) h_l Y_lm(R)."""
        passed = jnp.asarray(rows.passed)[:, degrees(self.band_limit)]
        return real_basis(jnp.asarray(rows.reflected), self.band_limit) * passed

    @eqx.filter_jit
    @checked
    def apply(
        self, coefficients: Float[AnyArray, "coefficient channel"]
    ) -> Float[Array, "sample channel"]:
        """Photograph a light: the radiance of every sample."""
        light = jnp.asarray(coefficients)
        amplitudes = [jnp.asarray(a, light.dtype)[None, :] for a in (self.kd, self.ks)]
        product = partial(jnp.matmul, precision="highest")

        def chunk(rows: LightRows) -> Float[Array, "sample channel"]:
            diffuse, specular = self.columns(rows)
            return amplitudes[0] * product(diffuse, light) + amplitudes[1] * product(
                specular, light
            )

        chunks = in_chunks(self.rows, self.samples_per_chunk)
        radiance = jax.lax.map(chunk, chunks)
        return radiance.reshape(-1, light.shape[1])[: self.count]

    @property
    def _diffuse_limit(self) -> int:
        return min(self.diffuse_band_limit, self.band_limit)


def light_operator(
    brdf: Glossy,
    samples: SurfaceSamples,
    band_limit: int,
    transfer: str = "exit-cosine",
    *,
    transfer_vectors: Float[AnyArray, "sample coefficient"] | None = None,
    unshadowed: Float[AnyArray, "sample"] | None = None,
    diffuse_band_limit: int = DIFFUSE_BAND_LIMIT,
) -> LightOperator:
    """Build the operator of a glossy material for light of degree ``band_limit``.

    ``transfer`` is one of ``TRANSFERS``, or ``none``: F alone, as T 6.15.  On a concave object give
    the ``transfer_vectors`` of T 6.10 and ``unshadowed``, V(R) of T 6.11.
    Raises ``ValueError`` for another transfer or a negative band limit.
    """
    coefficient_count(band_limit)
    if transfer != "none" and transfer not in TRANSFERS:
        raise ValueError(f"transfer={transfer!r}: choose one of none, {', '.join(TRANSFERS)}")
    cosines = samples.exit_cosines
    if transfer == "none":
        fresnel = brdf.energy * normalised_fresnel(brdf.mu, cosines)
        passed = jnp.broadcast_to(fresnel[:, None], (len(cosines), band_limit + 1))
    else:
        passed = _looked_up(brdf, cosines, band_limit, transfer)
    if unshadowed is not None:
        passed = passed * jnp.asarray(unshadowed, passed.dtype)[:, None]
    rows = LightRows(jnp.asarray(samples.normals), samples.reflected, passed, transfer_vectors)
    return LightOperator(rows, brdf.kd, brdf.ks, diffuse_band_limit)


# One program, in the place of one for each of its steps.
_looked_up = eqx.filter_jit(transfer_of_samples)


def in_chunks(tree, size: int):
    """Cut the leading axis of every array of a pytree into chunks, the last filled with zeros."""

    def cut(values: AnyArray) -> Array:
        values = jnp.asarray(values)
        chunks = -(-values.shape[0] // size)
        missing = chunks * size - values.shape[0]
        padded = jnp.pad(values, ((0, missing), *((0, 0),) * (values.ndim - 1)))
        return padded.reshape(chunks, size, *values.shape[1:])

    return jax.tree.map(cut, tree)


def degree_slices(band_limit: int) -> list[slice]:
    """Return where the coefficients of each degree stand."""
    return [slice(degree**2, (degree + 1) ** 2) for degree in range(band_limit + 1)]


def sizes_by_degree(
    coefficients: Float[np.ndarray, "coefficient channel"],
) -> Float[np.ndarray, "degree"]:
    """Compute the root mean square over the orders and channels of each degree."""
    band_limit = band_limit_of(len(coefficients))
    return np.array([np.sqrt(np.mean(coefficients[s] ** 2)) for s in degree_slices(band_limit)])
