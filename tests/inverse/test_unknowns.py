"""Which parameters are free, and their search variables.

- ``unpack`` undoes ``pack`` for any subset of free parameters.
- Whatever the search variable, the parameter is within its bounds.
- All starting points are inside the bounds, distinct, the user's own first.
- Only a parameter next to its bound counts as at its bound; a gain never does.
- The first photograph's gain is 1; fixed values pass through; wrong bounds are refused.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from inverse_problems import microfacet_unknowns, mu_unknown, sigma_unknown

from jaxrender.brdf import INDEX_BOUNDS, WIDTH_BOUNDS, Microfacet
from jaxrender.inverse import Unknown
from jaxrender.inverse.stated import Stated
from jaxrender.inverse.unknowns import unknowns_of

# Logarithms and an S-shaped curve there and back again, in float64.
ROUND_TRIP = 1e-12
MATERIAL = Microfacet(np.full(3, 0.2), np.full(3, 0.1), 0.1, 1.5)


def fixed(value):
    return Unknown(fixed=(value,))


@pytest.mark.parametrize("sigma", [0.05, 0.16, 0.7])
@pytest.mark.parametrize("mu", [1.1, 1.5, 4.0])
def test_unpack_undoes_pack(sigma, mu):
    found = microfacet_unknowns().unpack(
        jnp.asarray(microfacet_unknowns().pack({"sigma": sigma, "mu": mu}))
    )
    assert float(found.numbers["sigma"]) == pytest.approx(sigma, rel=ROUND_TRIP)
    assert float(found.numbers["mu"]) == pytest.approx(mu, rel=ROUND_TRIP)


def test_unpack_undoes_pack_with_some_fixed():
    unknowns = microfacet_unknowns(sigma=fixed(0.3))
    assert unknowns.names == ("mu",)
    found = unknowns.unpack(jnp.asarray(unknowns.pack({"sigma": 0.1, "mu": 1.7})))
    assert float(found.numbers["sigma"]) == pytest.approx(0.3, rel=ROUND_TRIP)
    assert float(found.numbers["mu"]) == pytest.approx(1.7, rel=ROUND_TRIP)
    unknowns = microfacet_unknowns(mu=fixed(1.4))
    assert unknowns.names == ("sigma",)
    found = unknowns.unpack(jnp.asarray(unknowns.pack({"sigma": 0.1, "mu": 1.7})))
    assert float(found.numbers["sigma"]) == pytest.approx(0.1, rel=ROUND_TRIP)
    assert float(found.numbers["mu"]) == pytest.approx(1.4, rel=ROUND_TRIP)


def test_a_metal_has_no_index():
    unknowns = microfacet_unknowns(mu=None)
    assert unknowns.names == ("sigma",)
    assert unknowns.unpack(jnp.asarray(unknowns.pack({"sigma": 0.2}))).numbers.get("mu") is None


@pytest.mark.parametrize("x", [-50.0, -3.0, 0.0, 3.0, 50.0])
def test_parameters_stay_within_bounds(x):
    unknowns = microfacet_unknowns(sigma=sigma_unknown(lower=0.1, upper=0.4))
    found = unknowns.unpack(jnp.array([x, x]))
    assert 0.1 * (1 - ROUND_TRIP) <= float(found.numbers["sigma"]) <= 0.4 * (1 + ROUND_TRIP)
    assert (
        INDEX_BOUNDS[0] * (1 - ROUND_TRIP)
        <= float(found.numbers["mu"])
        <= INDEX_BOUNDS[1] * (1 + ROUND_TRIP)
    )


def test_parameters_grow_with_their_search_variables():
    unknowns = microfacet_unknowns()
    low, high = (unknowns.unpack(jnp.array([x, x])) for x in (-1.0, 1.0))
    assert float(low.numbers["sigma"]) < float(high.numbers["sigma"])
    assert float(low.numbers["mu"]) < float(high.numbers["mu"])


def test_starts_are_inside_and_distinct_the_users_first():
    unknowns = microfacet_unknowns(
        sigma=sigma_unknown(start=0.31), mu=mu_unknown(start=1.9), free_gains=3
    )
    starts = unknowns.starts(8)
    assert starts.shape == (8, 4)
    assert len(np.unique(starts[:, 0])) == 8
    first = unknowns.unpack(jnp.asarray(starts[0]))
    assert float(first.numbers["sigma"]) == pytest.approx(0.31, rel=ROUND_TRIP)
    assert float(first.numbers["mu"]) == pytest.approx(1.9, rel=ROUND_TRIP)
    found = [unknowns.unpack(jnp.asarray(start)) for start in starts]
    sigmas = np.array([float(physical.numbers["sigma"]) for physical in found])
    assert np.all((sigmas > WIDTH_BOUNDS[0]) & (sigmas < WIDTH_BOUNDS[1]))
    # They cover the bounds, not a corner of them.
    assert sigmas.max() / sigmas.min() > 5
    np.testing.assert_array_equal(starts[:, 2:], 0)


def test_a_start_outside_narrow_bounds_is_moved_inside():
    unknowns = microfacet_unknowns(sigma=sigma_unknown(lower=0.3, upper=0.5))
    sigma = float(unknowns.unpack(jnp.asarray(unknowns.starts(1)[0])).numbers["sigma"])
    assert 0.3 < sigma < 0.5


def test_only_what_is_next_to_a_bound_is_at_it():
    unknowns = microfacet_unknowns(free_gains=2)
    assert unknowns.at_bound(jnp.array([20.0, 0.0, -40.0])).tolist() == [True, False, False]
    assert unknowns.at_bound(jnp.array([0.0, -20.0, 40.0])).tolist() == [False, True, False]
    assert unknowns.at_bound(jnp.array([4.0, -4.0, 0.0])).tolist() == [False, False, False]


@pytest.mark.parametrize("fraction", [0.02, 0.3, 0.5, 0.95])
def test_what_the_bounds_tell_is_the_same_part_of_the_range_everywhere(fraction):
    unknowns = microfacet_unknowns(free_gains=2)
    low, high = WIDTH_BOUNDS
    point = jnp.asarray(unknowns.pack({"sigma": low * (high / low) ** fraction, "mu": 1.5}))

    def part(x):
        sigma = unknowns.unpack(point.at[0].set(x)).numbers["sigma"]
        return jnp.log(sigma / low) / np.log(high / low)

    information = unknowns.range_information(point)
    deviation = abs(jax.grad(part)(point[0])) / np.sqrt(information[0])
    # A logistic curve has the slope 1 / 4 in its middle.
    assert deviation == pytest.approx(np.pi / np.sqrt(3) / 4, rel=1e-6)
    assert information[2] == 0


def test_a_start_at_a_bound_is_tried_again_where_a_search_moves_it():
    """From far out, a step of one in the search variable moves mu by two millionths."""
    unknowns = microfacet_unknowns(free_gains=2)
    inside, at_bound = np.array([1.5, -2.0, 70.0]), np.array([-1.0, 300.0, 70.0])
    starts = unknowns.restarts(np.stack([inside, at_bound]))
    np.testing.assert_array_equal(starts[:2], [inside, at_bound])
    [pulled] = starts[2:]
    assert (pulled[0], pulled[2]) == (-1.0, 70.0)
    by_one = [
        float(
            unknowns.unpack(jnp.asarray(p - [0, 1.0, 0])).numbers["mu"]
            - unknowns.unpack(jnp.asarray(p)).numbers["mu"]
        )
        for p in (at_bound, pulled)
    ]
    assert abs(by_one[1]) > 1e3 * abs(by_one[0])


def test_gains_are_relative_to_the_first_photograph():
    unknowns = microfacet_unknowns(free_gains=3)
    assert unknowns.names == ("sigma", "mu", "gain 1", "gain 2")
    point = jnp.concatenate([jnp.zeros(2), jnp.log(jnp.array([2.0, 0.5]))])
    np.testing.assert_allclose(unknowns.unpack(point).gains, [1, 2, 0.5], rtol=ROUND_TRIP)


def test_wrong_bounds_and_starts_are_refused():
    with pytest.raises(ValueError, match="the lower must be below the upper"):
        Unknown(lower=0.5, upper=0.5)
    with pytest.raises(ValueError, match=r"start 2.0 is outside \[0.0, 1.0\]"):
        Unknown(upper=1.0, start=2.0)


@pytest.mark.parametrize(("name", "bounds"), [("mu", (1.0, 2.0)), ("sigma", (0.1, np.inf))])
def test_bounds_that_a_logarithm_cannot_keep_are_refused(name, bounds):
    """They gave starts at nan: the search looks for log(mu - 1) and log sigma."""
    with pytest.raises(ValueError, match=f"{name}: bounds .*the lower must be above"):
        unknowns_of(MATERIAL, {name: Stated(bounds=bounds)})
    # An amplitude enters linearly, and may be as large as it likes.
    assert unknowns_of(MATERIAL, {"ks": Stated(bounds=(0.1, np.inf))}).amplitudes[1].lower == 0.1


def test_a_step_too_far_leaves_a_slope_to_come_back_on():
    """The logistic curve has none beyond 37, nor beyond 17 in single precision."""
    unknowns = microfacet_unknowns()
    far = jnp.array([100.0, 100.0])
    here, there = unknowns.unpack(far), unknowns.unpack(far - 1)
    assert float(there.numbers["sigma"]) < float(here.numbers["sigma"]) < WIDTH_BOUNDS[1]
    assert float(there.numbers["mu"]) < float(here.numbers["mu"]) < INDEX_BOUNDS[1]
