"""What another view shows where reference pixels are seen, all at one hypothesis or each at its own depth."""

import numpy as np
from numba import njit, prange

FAST = {"contract", "reassoc", "nsz", "arcp"}  # no "nnan": NaN has a meaning here
UNKNOWN = 1e4  # stands for the inverse depth (in steps) of pixels that have none: no neighbour resembles it


@njit(parallel=True, cache=True, fastmath=FAST)
def look(image, mask, nodes, spacing, top, own, margin, warped, seen):
    """What another view shows where reference pixels of one hypothesis are seen, by bilinear interpolation.

    Parameters
    ----------
    image : (H, W, C) float32 array
        Photograph.
    mask : (H, W) bool array
        Pixels of the other view.
    nodes : (Ny, Nx, 2) float32 array
        Where the nodes of the lattice are seen, px.
    spacing, top : int
        Pixels between nodes; row of the box that is row 0 of ``own``.
    own : (h, w) bool array
        Pixels of the reference view.
    margin : int
        Columns of the written arrays before column 0 of the box.
    warped : (C, h, ...) float32 array, written
        The other view's picture.
    seen : (h, ...) float32 array, written
        1 where both views count, else 0.
    """
    height, width = own.shape
    for y in prange(height):
        j = (top + y) // spacing
        below = min(j + 1, nodes.shape[0] - 1)
        t = np.float32((top + y) % spacing) / np.float32(spacing)
        line = nodes[j] + t * (nodes[below] - nodes[j]) if t > 0 else nodes[j].copy()
        seen[y] = 0
        warped[:, y] = 0
        for x in range(width):
            if not own[y, x]:
                continue
            i = x // spacing
            s = np.float32(x - i * spacing) / np.float32(spacing)
            right = i + 1 if s > 0 else i
            u = line[i, 0] + s * (line[right, 0] - line[i, 0])
            v = line[i, 1] + s * (line[right, 1] - line[i, 1])
            if not (u >= 0 and v >= 0 and u < mask.shape[1] - 1 and v < mask.shape[0] - 1):
                continue
            if not mask[int(v + np.float32(0.5)), int(u + np.float32(0.5))]:
                continue
            a, b = int(u), int(v)
            u, v = u - np.float32(a), v - np.float32(b)
            seen[y, x + margin] = 1
            for c in range(image.shape[2]):
                upper = image[b, a, c] + u * (image[b, a + 1, c] - image[b, a, c])
                lower = image[b + 1, a, c] + u * (image[b + 1, a + 1, c] - image[b + 1, a, c])
                warped[c, y, x + margin] = upper + v * (lower - upper)


@njit(cache=True, fastmath=FAST)
def _spline_weights(t, weights, slopes):
    """Cubic B-spline and its derivative at the four pixels around a fraction t of a pixel."""
    s = np.float32(1) - t
    sixth, half = np.float32(1 / 6), np.float32(0.5)
    weights[0], weights[3] = sixth * s * s * s, sixth * t * t * t
    weights[1] = np.float32(2 / 3) - half * t * t * (np.float32(2) - t)
    weights[2] = np.float32(2 / 3) - half * s * s * (np.float32(2) - s)
    slopes[0], slopes[3] = -half * s * s, half * t * t
    slopes[1] = half * t * (np.float32(3) * t - np.float32(4))
    slopes[2] = -half * s * (np.float32(3) * s - np.float32(4))


@njit(cache=True, fastmath=FAST)
def _place(nodes, spacing, row, column, hypothesis, place):
    """Where a reference pixel is seen at a hypothesis, and how far one more step moves it: x, y, dx, dy."""
    j, i = row // spacing, column // spacing
    t, s = np.float32(row % spacing) / np.float32(spacing), np.float32(column % spacing) / np.float32(spacing)
    below, right = (j + 1 if t > 0 else j), (i + 1 if s > 0 else i)
    k = min(max(int(hypothesis), 0), nodes.shape[0] - 2)
    one = np.float32(1)
    for axis in range(2):
        near = (one - t) * ((one - s) * nodes[k, j, i, axis] + s * nodes[k, j, right, axis])
        near += t * ((one - s) * nodes[k, below, i, axis] + s * nodes[k, below, right, axis])
        far = (one - t) * ((one - s) * nodes[k + 1, j, i, axis] + s * nodes[k + 1, j, right, axis])
        far += t * ((one - s) * nodes[k + 1, below, i, axis] + s * nodes[k + 1, below, right, axis])
        place[2 + axis] = far - near
        place[axis] = near + (hypothesis - np.float32(k)) * (far - near)


@njit(parallel=True, cache=True, fastmath=FAST)
def sample(spline, mask, nodes, spacing, top, guess, margin, values, slopes, seen):
    """Look up another view where each reference pixel is seen at its present inverse depth.

    Parameters
    ----------
    spline : (H, W, C) float32 array
        Cubic B-spline coefficients of the photograph.
    mask : (H, W) bool array
        Pixels of the other view.
    nodes : (D, Ny, Nx, 2) float32 array
        Maps into the other view.
    spacing, top : int
        Pixels between nodes; row of the box that is row 0 of ``guess``.
    guess : (h, w) float32 array
        Inverse depth in steps; NaN unknown.
    margin : int
        Rows and columns of the written arrays before row and column 0 of ``guess``.
    values, slopes : (C, ...) float32 arrays, written
        The other view and its change per step of inverse depth.
    seen : (...) float32 array, written
        1 where the view sees the pixel, else 0.
    """
    height, width = guess.shape
    channels = spline.shape[2]
    for y in prange(height):
        place = np.empty(4, np.float32)
        wx, wy, gx, gy = np.empty((4, 4), np.float32)
        for x in range(width):
            to = y + margin, x + margin
            seen[to] = 0
            values[:, to[0], to[1]] = slopes[:, to[0], to[1]] = 0
            if np.isnan(guess[y, x]):
                continue
            _place(nodes, spacing, top + y, x, guess[y, x], place)
            u, v = place[0], place[1]
            if not (u >= 1 and v >= 1 and u < mask.shape[1] - 2 and v < mask.shape[0] - 2):
                continue
            if not mask[int(v + np.float32(0.5)), int(u + np.float32(0.5))]:
                continue
            i, j = int(u), int(v)
            _spline_weights(u - np.float32(i), wx, gx)
            _spline_weights(v - np.float32(j), wy, gy)
            seen[to] = 1
            for n in range(4):
                for m in range(4):
                    flat = wy[n] * wx[m]
                    tilt = place[2] * wy[n] * gx[m] + place[3] * gy[n] * wx[m]
                    for c in range(channels):
                        coefficient = spline[j + n - 1, i + m - 1, c]
                        values[c, to[0], to[1]] += flat * coefficient
                        slopes[c, to[0], to[1]] += tilt * coefficient
