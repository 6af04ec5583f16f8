"""The best rotation against Kabsch's, and what stands where it is not determined."""

import numpy as np
import oracles
import pytest
from numpy.typing import NDArray

from mdtopo.geometry.rigid import best_rotations, covariance, rotation_angles

Points = NDArray[np.float64]
Generator = np.random.Generator


def fit(x0: Points, x1: Points, offsets: list[int] | None = None) -> Points:
    groups = np.array(offsets or [0, len(x0)])
    correlation, size = covariance(x0, x1, np.arange(len(x0)), groups)
    return best_rotations(correlation[np.newaxis], np.array([size]))[0]


def rotation(rng: Generator, angle: float | None = None) -> Points:
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    angle = rng.uniform(0, np.pi) if angle is None else angle
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)


def angle_of(r: Points) -> float:
    return float(rotation_angles(r[np.newaxis])[0])


def test_the_rotation_is_that_of_the_oracle_and_proper() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        x0 = rng.normal(size=(12, 3))
        x1 = (x0 + rng.normal(0, 0.3, x0.shape)) @ rotation(rng).T + rng.normal(size=3)
        found = fit(x0, x1)
        np.testing.assert_allclose(found, oracles.best_rotation(x0, x1), atol=1e-9)
        np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(found) == pytest.approx(1.0, abs=1e-14)


def test_a_mirror_image_is_still_fitted_by_a_proper_rotation() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        x0 = rng.normal(size=(10, 3))
        found = fit(x0, x0 * [1.0, 1.0, -1.0])
        assert np.linalg.det(found) == pytest.approx(1.0, abs=1e-14)
        np.testing.assert_allclose(found, oracles.best_rotation(x0, x0 * [1.0, 1.0, -1.0]), atol=1e-9)


@pytest.mark.parametrize(
    "shape", [(1.0, 1.0, 1.0), (10.0, 1.0, 1.0), (30.0, 1.0, 0.5), (10.0, 10.0, 0.0), (100.0, 1.0, 1.0)]
)
@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.5, 3.0, np.pi])
def test_a_known_rotation_is_recovered_for_round_flat_and_long_bodies(
    shape: tuple[float, float, float], angle: float
) -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        x0, r = rng.normal(size=(20, 3)) * shape, rotation(rng, angle)
        x1 = x0 @ r.T
        found = fit(x0, x1 + rng.normal(size=3))
        # a millionth of a turn about a long axis is below the rounding of the fit: then it may be left in
        left_in = 5e-6 if angle == 1e-6 else 1e-8
        assert np.abs(x1 @ found.T - x0).max() < left_in * max(1.0, *shape[1:])
        assert angle_of(found) == pytest.approx(np.degrees(angle), abs=1e-4)


def straight(rng: Generator, noise: float, n: int = 15) -> Points:
    x = np.zeros((n, 3))
    x[:, 0] = 3.8 * np.arange(n)
    return x + rng.normal(0, noise, x.shape)


@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0, 3.1])
def test_points_on_a_line_take_the_least_turn_that_aligns_the_lines(angle: float) -> None:
    rng = np.random.default_rng(4)
    for _ in range(10):
        x0 = straight(rng, 0.0)
        r = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        about_itself = np.diag([1.0, 0, 0]) + np.array([[0, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]])
        found = fit(x0, x0 @ about_itself.T @ r.T)
        np.testing.assert_allclose(found @ r[:, 0], [1, 0, 0], atol=1e-9)
        assert angle_of(found) == pytest.approx(np.degrees(angle), abs=1e-6)


def test_a_line_turned_end_to_end_takes_a_proper_half_turn() -> None:
    x0 = straight(np.random.default_rng(5), 0.0)
    found = fit(x0, -x0)
    assert np.linalg.det(found) == pytest.approx(1.0, abs=1e-14)
    assert angle_of(found) == pytest.approx(180.0, abs=1e-6)
    np.testing.assert_allclose(found @ [-1.0, 0, 0], [1, 0, 0], atol=1e-12)


def test_noise_about_a_line_does_not_turn_it_about_itself() -> None:
    rng, freely = np.random.default_rng(6), 0
    for _ in range(50):
        x0, x1 = straight(rng, 0.1, 40), straight(rng, 0.1, 40)
        assert angle_of(fit(x0, x1)) < 2.0
        freely += angle_of(oracles.best_rotation(x0, x1)) > 20.0
    assert freely > 25  # the plain fit turns by whatever noise says


def test_a_single_point_and_coincident_points_are_not_turned() -> None:
    np.testing.assert_array_equal(fit(np.ones((1, 3)), np.zeros((1, 3))), np.eye(3))
    np.testing.assert_array_equal(fit(np.ones((4, 3)), np.full((4, 3), 7.0)), np.eye(3))


def test_strands_in_other_images_leave_no_mark_where_each_has_its_own_centre() -> None:
    rng = np.random.default_rng(7)
    x0 = rng.normal(size=(12, 3))
    x1 = x0 @ rotation(rng, 0.4).T + rng.normal(0, 0.05, x0.shape)
    shifted = x1 + np.repeat([[0, 0, 0], [30.0, -10, 4]], 6, axis=0)
    np.testing.assert_allclose(fit(x0, shifted, [0, 6, 12]), fit(x0, x1, [0, 6, 12]), atol=1e-10)
    assert np.abs(fit(x0, shifted) - fit(x0, x1)).max() > 0.1


def test_each_rotation_depends_on_its_own_step_alone_bit_for_bit() -> None:
    rng = np.random.default_rng(8)
    pairs = [(straight(rng, noise), straight(rng, noise)) for noise in (0.0, 0.1, 3.0, 0.1, 8.0)]
    vertices, group = np.arange(15), np.array([0, 15])
    found = [covariance(a, b, vertices, group) for a, b in pairs]
    together = best_rotations(np.array([c for c, _ in found]), np.array([size for _, size in found]))
    for k, (a, b) in enumerate(pairs):
        assert together[k].tobytes() == fit(a, b).tobytes()


def test_angles_are_right_at_both_ends_of_their_range() -> None:
    rng = np.random.default_rng(9)
    angles = [0.0, 1e-9, 1e-3, 1.0, np.pi - 1e-6, np.pi]
    found = rotation_angles(np.array([rotation(rng, angle) for angle in angles]))
    np.testing.assert_allclose(found, np.degrees(angles), atol=1e-6)
    assert found[1] == pytest.approx(np.degrees(1e-9), rel=1e-5)
