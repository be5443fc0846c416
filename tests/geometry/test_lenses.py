"""Lenses, against formulas that are typed in here once more, in numbers of many digits.

- Each formula: OpenCV's with prism, its fisheye, COLMAP's and Metashape's, field of view, division.
- What a lens shows comes back as the same direction, to rounding; so do pixels of a camera.
- Its derivative is the limit of differences.
- Beyond the place where a formula folds back there is no direction; no direction that is found is
  another than the one that is shown, however strong the distortion.
- A fisheye sees behind itself; straight behind no direction has a place.
- Pixels without a ray are not hit; what a pixel covers is the way to its neighbours.
- Numbers that make no lens are refused.
"""

import math

import mpmath
import numpy as np
import pytest
from lens_samples import FISHEYE, NUMBERS, PRISM, camera, lenses

from jaxrender.geometry import (
    LENS_MODELS,
    Division,
    EnhancedUnifiedLens,
    EquirectangularLens,
    FieldOfView,
    FisheyeLens,
    PerspectiveLens,
    Pinhole,
    RadialTangential,
    Skew,
    Sphere,
    look_at,
    observe,
    opencv_lens,
    pixel_steps,
)

POSE = look_at(np.array([0.3, -2.0, 1.0]), np.zeros(3), np.array([0.0, 0, 1]))
ROUNDING = 1e-12


def directions(seed=0, widest=0.7):
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.uniform(-widest, widest, (40, 2)), np.ones((40, 1))], axis=1)


def opencv(x, y, n):
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = [mpmath.mpf(v) for v in n]
    q = x**2 + y**2
    g = (1 + k1 * q + k2 * q**2 + k3 * q**3) / (1 + k4 * q + k5 * q**2 + k6 * q**3)
    return (
        x * g + 2 * p1 * x * y + p2 * (q + 2 * x**2) + s1 * q + s2 * q**2,
        y * g + p1 * (q + 2 * y**2) + 2 * p2 * x * y + s3 * q + s4 * q**2,
    )


def kannala(x, y, n):
    r = mpmath.sqrt(x**2 + y**2)
    theta = mpmath.atan(r)
    bent = theta * (1 + sum(mpmath.mpf(k) * theta ** (2 * i + 2) for i, k in enumerate(n)))
    return x / r * bent, y / r * bent


def thin_prism(x, y, n):
    k1, k2, p1, p2, k3, k4, sx1, sy1 = [mpmath.mpf(v) for v in n]
    r = mpmath.sqrt(x**2 + y**2)
    u, v = x / r * mpmath.atan(r), y / r * mpmath.atan(r)
    q = u**2 + v**2
    g = k1 * q + k2 * q**2 + k3 * q**3 + k4 * q**4
    across = u + u * g + 2 * p1 * u * v + p2 * (q + 2 * u**2) + sx1 * q
    return across, v + v * g + 2 * p2 * u * v + p1 * (q + 2 * v**2) + sy1 * q


def aria(x, y, n):
    radial, (p0, p1), (s0, s1, s2, s3) = n[:6], n[6:8], n[8:]
    u, v = kannala(x, y, radial)
    q = u**2 + v**2
    across = u + 2 * p0 * u * u + q * p0 + 2 * p1 * u * v + s0 * q + s1 * q**2
    return across, v + 2 * p1 * v * v + q * p1 + 2 * p0 * u * v + s2 * q + s3 * q**2


def metashape(x, y, n):
    k1, k2, k3, k4, p1, p2, skew = [mpmath.mpf(v) for v in n]
    q = x**2 + y**2
    g = 1 + k1 * q + k2 * q**2 + k3 * q**3 + k4 * q**4
    across = x * g + p1 * (q + 2 * x**2) + 2 * p2 * x * y
    down = y * g + p2 * (q + 2 * y**2) + 2 * p1 * x * y
    return across + skew * down, down


def devernay(x, y, n):
    r = mpmath.sqrt(x**2 + y**2)
    bent = mpmath.atan(2 * r * mpmath.tan(mpmath.mpf(n[0]) / 2)) / mpmath.mpf(n[0])
    return x / r * bent, y / r * bent


def fitzgibbon(x, y, n):
    r = mpmath.sqrt(x**2 + y**2)
    bent = mpmath.findroot(lambda t: t / (1 + mpmath.mpf(n[0]) * t**2) - r, r)
    return x / r * bent, y / r * bent


def khomutenko(x, y, n):
    alpha, beta = map(mpmath.mpf, n)
    divisor = alpha * mpmath.sqrt(beta * (x**2 + y**2) + 1) + 1 - alpha
    return x / divisor, y / divisor


def panorama(x, y, n):
    return mpmath.atan(x), mpmath.asin(y / mpmath.sqrt(x**2 + y**2 + 1))


def padded(n):
    return [*n, *([0.0] * (12 - len(n)))]


FORMULAS = {
    "SIMPLE_RADIAL": lambda x, y, n: opencv(x, y, padded(n)),
    "RADIAL": lambda x, y, n: opencv(x, y, padded(n)),
    "OPENCV": lambda x, y, n: opencv(x, y, padded(n)),
    "FULL_OPENCV": lambda x, y, n: opencv(x, y, padded(n)),
    "FOV": devernay,
    "SIMPLE_DIVISION": fitzgibbon,
    "DIVISION": fitzgibbon,
    "SIMPLE_FISHEYE": kannala,
    "FISHEYE": kannala,
    "SIMPLE_RADIAL_FISHEYE": kannala,
    "RADIAL_FISHEYE": kannala,
    "OPENCV_FISHEYE": kannala,
    "THIN_PRISM_FISHEYE": thin_prism,
    "RAD_TAN_THIN_PRISM_FISHEYE": aria,
    "EUCM": khomutenko,
    "EQUIRECTANGULAR": panorama,
    "prism": opencv,
    "metashape": metashape,
}
ALL = NUMBERS | {"prism": PRISM, "metashape": [-0.1, 0.02, -0.003, 5e-4, 1e-3, -2e-3, 0.004]}


@pytest.mark.parametrize("name", FORMULAS)
def test_each_formula(name):
    lens, along = lenses()[name], directions()
    wanted = [
        [float(v) for v in FORMULAS[name](mpmath.mpf(x), mpmath.mpf(y), ALL[name])]
        for x, y, _ in along
    ]
    np.testing.assert_allclose(lens.distort(3.5 * along), wanted, atol=ROUNDING)


def test_every_model_is_tried():
    assert set(lenses()) == set(FORMULAS)
    assert set(FORMULAS) >= set(LENS_MODELS) - {"SIMPLE_PINHOLE", "PINHOLE"}
    assert all(LENS_MODELS[name].lens([]) is None for name in ("PINHOLE", "SIMPLE_PINHOLE"))
    assert LENS_MODELS["OPENCV"].lens([0.0] * 4) is None
    assert LENS_MODELS["FOV"].lens([0.0]) is None


@pytest.mark.parametrize("name", FORMULAS)
def test_what_is_shown_comes_back(name):
    lens, along = lenses()[name], directions(1)
    along = np.concatenate([along, [[0.0, 0, 1], [1e-9, 0, 1], [-1e-6, 2e-6, 1]]])
    unit = along / np.linalg.norm(along, axis=1, keepdims=True)
    np.testing.assert_allclose(lens.undistort(lens.distort(along)), unit, atol=ROUNDING)
    batch = lens.distort(along[:42].reshape(6, 7, 3))
    assert lens.undistort(batch).shape == (6, 7, 3)


@pytest.mark.parametrize("name", FORMULAS)
def test_slopes_are_limits_of_differences(name):
    lens, along, step = lenses()[name], directions(2), 1e-6
    slopes = [
        (lens.distort(along + step * axis) - lens.distort(along - step * axis)) / (2 * step)
        for axis in np.eye(3)
    ]
    np.testing.assert_allclose(lens.jacobian(along), np.stack(slopes, axis=-1), atol=1e-8)


@pytest.mark.parametrize("name", FORMULAS)
def test_pixels_of_a_camera_come_back(name):
    own = camera(lenses()[name], POSE)
    origins, along = own.rays()
    seen = np.isfinite(along).all(axis=-1)
    assert seen.mean() > 0.95
    np.testing.assert_allclose(np.linalg.norm(along[seen], axis=-1), 1, atol=ROUNDING)
    rows, columns = np.mgrid[:48, :64] + 0.5
    found = own.project((origins + 2.5 * along)[seen])
    np.testing.assert_allclose(found, np.stack([columns, rows], -1)[seen], atol=1e-9)


def test_a_barrel_that_folds_back_shows_nothing_beyond():
    """r - .3 r^3 turns at 1 / sqrt(.9), where it is 2 / 3 of that."""
    lens, turn = PerspectiveLens((RadialTangential((-0.3,)),)), 1 / math.sqrt(0.9)
    radii = np.array([0.999 * turn, 1.001 * turn, 1.7])
    shown = lens.distort(np.stack([radii, 0 * radii, 1 + 0 * radii], axis=1))
    np.testing.assert_array_equal(np.isnan(shown[:, 0]), [False, True, True])
    places = np.array([0.999, 1.001])[:, None] * [2 / 3 * turn, 0]
    found = lens.undistort(places)
    np.testing.assert_array_equal(np.isnan(found[:, 0]), [False, True])
    assert found[0, 0] / found[0, 2] < turn


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.5, 0.7, 1.0])
def test_a_unified_lens_sees_aside_as_far_as_it_is_one_to_one(alpha):
    lens = EnhancedUnifiedLens(alpha, 1.2)
    angle = np.linspace(0, 0.99 * np.pi, 100)
    along = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    shown = lens.distort(along)
    seen = np.isfinite(shown[:, 0])
    assert seen[0]
    # At one half only what lies straight behind has no place.
    assert seen[-1] == (alpha == 0.5)
    assert (np.diff(shown[seen, 0]) > 0).all()
    np.testing.assert_allclose(lens.undistort(shown[seen]), along[seen], atol=1e-9)
    for bad in ((1.2, 1.0), (0.5, 0.0), (0.5, np.inf)):
        with pytest.raises(ValueError, match=r"alpha is 1\.2|beta is (0\.0|inf)"):
            EnhancedUnifiedLens(*bad)


def test_a_panorama_sees_all_and_no_more():
    lens = EquirectangularLens()
    np.testing.assert_allclose(lens.distort(np.array([0.0, 0, -1])), [np.pi, 0])
    np.testing.assert_allclose(
        lens.distort(np.array([-1.0, 1, -1])), [-0.75 * np.pi, 0.6155], atol=1e-4
    )
    places = np.array([[3.15, 0.0], [0.0, 1.58], [3.14, 1.57]])
    np.testing.assert_array_equal(np.isnan(lens.undistort(places)[:, 0]), [True, True, False])


def test_poles_and_bounds():
    reach = RadialTangential((), (-0.25,)).reach
    assert reach == pytest.approx(2, rel=1e-12)
    assert RadialTangential((0.1, 0.1)).reach == math.inf
    bounded = RadialTangential((), (1.0,))
    # r / (1 + r^2) turns at 1, where it is one half.
    assert bounded.reach == pytest.approx(1, rel=1e-12)
    np.testing.assert_array_equal(np.isnan(bounded.undistort(np.array([[0.6, 0.0]]))), True)
    assert np.isnan(FieldOfView(0.9).undistort(np.array([[1.75, 0.0]]))).all()
    assert np.isfinite(FieldOfView(0.9).undistort(np.array([[1.74, 0.0]]))).all()
    assert np.isnan(Division(-0.3).undistort(np.array([[1.83, 0.0]]))).all()
    assert np.isnan(Division(0.3).distort(np.array([[0.92, 0.0]]))).all()


@pytest.mark.parametrize("seed", range(12))
def test_no_direction_that_is_found_is_another(seed):
    """Strong and absurd coefficients: what comes back is shown where it came from, or is NaN."""
    rng = np.random.default_rng(seed)
    n = rng.normal(size=12) * np.array([0.4, 0.3, 0.03, 0.03, 0.1, *[0.2] * 3, *[0.03] * 4])
    lens = opencv_lens(n.tolist()) if seed % 2 else FisheyeLens((RadialTangential(tuple(n[:4])),))
    places = rng.uniform(-1.5, 1.5, (4000, 2))
    found = lens.undistort(places)
    good = np.isfinite(found).all(axis=-1)
    assert good.sum() > 0
    np.testing.assert_allclose(lens.distort(found[good]), places[good], atol=1e-10)
    # Going outwards along the way to a direction its place never stands still or returns.
    ways = np.linspace(0.05, 1, 60)[:, None, None] * lens._ideal(found[good])[None]
    (distortion,) = lens.distortions
    moved = distortion.distort(ways.reshape(-1, 2)).reshape(ways.shape)
    assert np.isfinite(moved).all()
    step = np.einsum("wsi,wsi->ws", np.diff(moved, axis=0), np.diff(ways, axis=0))
    assert (step > 0).all()


def test_a_fisheye_sees_behind_itself():
    lens = FisheyeLens((RadialTangential(tuple(FISHEYE[:2])),))
    angles = np.radians([30.0, 89.9, 90, 100, 120])
    along = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1)
    shown = lens.distort(along)
    wanted = angles * (1 + FISHEYE[0] * angles**2 + FISHEYE[1] * angles**4)
    np.testing.assert_allclose(shown[:, 0], wanted, atol=ROUNDING)
    np.testing.assert_allclose(lens.undistort(shown), along, atol=ROUNDING)
    assert np.isnan(lens.distort(np.array([0.0, 0, -1]))).all()
    assert np.isnan(FisheyeLens(()).undistort(np.array([3.2, 0]))).all()
    assert np.isnan(PerspectiveLens(()).distort(np.array([0.1, 0, -1]))).all()
    own = camera(FisheyeLens(()), POSE, (260, 48))
    behind = own.rays().directions @ own.world_from_camera[:3, 2] > 0
    assert behind[24, 150]
    assert not behind[24, 31]


def test_pixels_without_a_ray_are_not_hit():
    own = camera(PerspectiveLens((RadialTangential((-0.9,)),)), POSE)
    missing = np.isnan(own.rays().directions).any(axis=-1)
    assert 0.1 < missing.mean() < 0.9
    # A ray straight down would hit it, too.
    view = observe(own, Sphere(np.zeros(3), 2.2))
    np.testing.assert_array_equal(view.hit, ~missing)
    assert np.isfinite(view.points).all()
    assert np.isfinite(view.outgoing).all()


@pytest.mark.parametrize("name", ["prism", "OPENCV_FISHEYE", "metashape"])
def test_what_a_pixel_covers_leads_to_its_neighbours(name):
    aside = {"cx": -200.0, "cy": -150.0}
    own = Pinhole(50, 40, POSE, fl_x=1200.0, fl_y=1300.0, **aside, lens=lenses()[name])
    view = observe(own, Sphere(np.zeros(3), 1.0))
    steps = pixel_steps(own, view)
    inner = np.s_[1:-1, 1:-1]
    assert view.hit[inner].all()
    across = (np.roll(view.points, -1, 1) - np.roll(view.points, 1, 1)) / 2
    down = (np.roll(view.points, -1, 0) - np.roll(view.points, 1, 0)) / 2
    for axis, wanted in enumerate((across, down)):
        found = steps[:, :, axis][inner]
        size = np.linalg.norm(wanted[inner], axis=-1, keepdims=True)
        np.testing.assert_allclose(found / size, wanted[inner] / size, atol=3e-4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RadialTangential((math.nan,)), "numerator is .*finite"),
        (lambda: RadialTangential(tangential=(0.1,)), "tangential has 1 numbers: give 2"),
        (lambda: FieldOfView(4.0), "omega is 4.*between 0 and pi"),
        (lambda: Division(math.inf), "k is"),
        (lambda: Skew(math.nan), "skew is"),
        (lambda: opencv_lens([0.1] * 3), "3 distortion coefficients"),
        (lambda: opencv_lens([0.0] * 12 + [0.1, 0.0]), "a tilted sensor"),
    ],
)
def test_numbers_that_make_no_lens(make, message):
    with pytest.raises(ValueError, match=message):
        make()
