"""The compiled loops of fusion beside slow twins."""

import numpy as np

from cyclopean.fusion import kernels
from cyclopean.matching import DepthMap


def look_up_slowly(place, depth, sigma, slack, other, right, down, deviations):
    """Inverse depth, its sigma, and whether the map has the point at all."""
    height, width = other.inverse_depth.shape
    left, top = np.floor(np.subtract(place, other.origin)).astype(int)
    near = [(r, c) for r in (top, top + 1) for c in (left, left + 1) if 0 <= r < height and 0 <= c < width]
    whole = len(near) == 4 and right[top, left] and right[top + 1, left] and down[top, left] and down[top, left + 1]
    x, y = np.subtract(place, other.origin) - (left, top)
    weights = np.outer([1 - y, y], [1 - x, x]).ravel()
    if whole:
        found = [
            sum(w * grid[one] for w, one in zip(weights, near, strict=True))
            for grid in (other.inverse_depth, other.sigma)
        ]
        agrees = abs(found[0] - depth) <= deviations * np.hypot(sigma, found[1]) + slack
        return (*found, True) if agrees else (np.nan, np.nan, False)
    limits = [deviations * np.hypot(sigma, other.sigma[one]) + slack for one in near]
    apart = [abs(other.inverse_depth[one] - depth) for one in near]
    return np.nan, np.nan, any(a <= limit for a, limit in zip(apart, limits, strict=True))


def test_looking_up_is_what_it_says():
    rng = np.random.default_rng(3)
    values = 1e-3 + 1e-5 * rng.integers(0, 3, (7, 9)) + 1e-7 * rng.normal(size=(7, 9))
    values[rng.uniform(size=values.shape) < 0.2] = np.nan
    other = DepthMap((20, 30), values, np.full((7, 9), 2e-6), np.ones((7, 9)))
    right, down = rng.uniform(size=(2, 7, 9)) < 0.85
    places = rng.uniform((18, 28), (31, 39), (800, 2))
    depth = 1e-3 + rng.uniform(-1e-5, 3e-5, 800)
    sigma, slack = rng.uniform(0, 2e-6, 800), rng.uniform(0, 5e-6, 800)
    found, agree = np.empty((801, 2)), np.empty(801, bool)
    places, depth, sigma, slack = (np.concatenate([a, a[:1]]) for a in (places, depth, sigma, slack))
    places[-1] = np.nan
    kernels.look_up(places, depth, sigma, slack, 20, 30, values, other.sigma, right, down, 2.0, found, agree)
    assert np.isnan(found[-1]).all()
    assert not agree[-1]
    slow = [
        look_up_slowly(*each, other, right, down, 2.0) for each in zip(places[:-1], depth, sigma, slack, strict=False)
    ]
    np.testing.assert_allclose(np.column_stack([found, agree])[:-1], np.array(slow, dtype=float), rtol=1e-12)
    assert 0.03 < np.isfinite(found[:, 0]).mean() < agree.mean() < 0.8  # all three happen


def reachable(right, down, row, column, radius):
    """Pixels that can be reached along the row, then along columns."""
    found = []
    for towards in (-1, 1):
        for c in range(column, column + towards * (radius + 1), towards):
            if c != column and not right[row, min(c, c - towards)]:
                break
            for rise in (-1, 1):
                for r in range(row, row + rise * (radius + 1), rise):
                    if r != row and not down[min(r, r - rise), c]:
                        break
                    found.append((r, c))
    return sorted(set(found))


def test_planes_are_fitted_to_what_can_be_reached():
    rng = np.random.default_rng(4)
    depth = rng.normal(size=(8, 9))
    sigma, right, down = rng.uniform(0.5, 1, (8, 9)), *(rng.uniform(size=(2, 8, 9)) < 0.75)
    right[:, -1] = down[-1] = False
    rows, columns = (grid.ravel() for grid in np.mgrid[:8, :9])
    found = np.empty((72, 3))
    kernels.planes(rows, columns, depth, sigma, right, down, 3, found)
    for n, (row, column) in enumerate(zip(rows, columns, strict=True)):
        r, c = np.array(reachable(right, down, row, column, 3)).T
        design = np.stack([np.ones(len(r)), c - column, r - row], -1)
        weights = 1 / sigma[r, c]
        if len(r) < 4 or np.linalg.det(np.cov(design[:, 1:].T, aweights=weights**2, ddof=0)) <= 0.05:
            assert np.isnan(found[n]).all()
        else:
            np.testing.assert_allclose(
                found[n], np.linalg.lstsq(weights[:, None] * design, weights * depth[r, c])[0], atol=1e-9
            )
    assert 0.3 < np.isfinite(found[:, 0]).mean() < 1


def test_covering_triangles_are_found():
    rng = np.random.default_rng(5)
    depth = 1 + 0.1 * rng.normal(size=(6, 7))
    cells = rng.integers(kernels.NONE, kernels.ADC + 1, (5, 6)).astype(np.uint8)
    corners = {kernels.ABC: "abc", kernels.BDC: "bdc", kernels.ABD: "abd", kernels.ADC: "adc"}
    at = {"a": (0, 0), "b": (1, 0), "c": (0, 1), "d": (1, 1)}
    places = rng.uniform(-0.5, (6.5, 5.5), (600, 2))
    goal = 1 + 0.1 * rng.normal(size=600)
    found = np.empty(600, int)
    kernels.cover(places, goal, np.full(600, 0.05), depth, cells, found)
    for place, wanted, node in zip(places, goal, found, strict=True):
        column, row = np.floor(place).astype(int)
        expected = -1
        kind = cells[row, column] if 0 <= row < 5 and 0 <= column < 6 else kernels.NONE
        if kind in corners:
            nodes = np.add([at[name] for name in corners[kind]], (column, row))
            weights = np.linalg.solve(np.vstack([nodes.T, np.ones(3)]), [*place, 1])  # barycentric
            value = weights @ depth[nodes[:, 1], nodes[:, 0]]
            if (weights >= 0).all() and abs(value - wanted) <= 0.05:
                x, y = nodes[np.linalg.norm(nodes - place, axis=1).argmin()]
                expected = y * 7 + x
        elif kind == kernels.BOTH:
            x, y = place - (column, row)
            square = depth[row : row + 2, column : column + 2]
            if abs(np.array([1 - y, y]) @ square @ np.array([1 - x, x]) - wanted) <= 0.05:
                expected = (row + round(y)) * 7 + column + round(x)
        assert node == expected
    assert 0.05 < np.mean(found >= 0) < 0.9
