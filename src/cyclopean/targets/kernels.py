"""Compiled fit of the blurred-corner model of `corners.py`, one corner after another.

unknowns : (9,) corner x, y (px), directions of both edges' normals (rad), log blur (log px), background, contrast,
and the contrast's gradient along x and y (per half window). shape : (8,) 1 or 0 for the four quadrants that are
white, then for the four that are marked. gaps : (2,) px from the edges to the markers; inf leaves them out.
"""

import math

import numpy as np
from numba import njit

OPTIONS = {"cache": True, "error_model": "numpy", "nogil": True, "fastmath": {"reassoc", "contract", "arcp", "nsz"}}
UNKNOWNS = 9
STEPS = np.array([1, 1, 0.2, 0.2, 0.5, np.inf, np.inf, np.inf, np.inf])  # longest: px, px, rad, rad, log px, ...
_ROOT_2, _ROOT_2_PI = math.sqrt(2.0), math.sqrt(2.0 * math.pi)


@njit(**OPTIONS)
def _phi(x):
    """The normal distribution and its density."""
    if x > 6.0:
        return 1.0, 0.0
    if x < -6.0:
        return 0.0, 0.0
    return 0.5 * math.erfc(-x / _ROOT_2), math.exp(-0.5 * x * x) / _ROOT_2_PI


@njit(**OPTIONS)
def _markers(a, b, blur, shape, gaps):
    """Share that markers cover at distances a, b (in blurs) from the edges; derivatives to a, b and the log blur."""
    cover, to_a, to_b, to_blur = 0.0, 0.0, 0.0, 0.0
    for quadrant in range(4):
        if shape[4 + quadrant] > 0:
            sign_a, sign_b = 2.0 * (quadrant % 2) - 1.0, 2.0 * (quadrant // 2) - 1.0
            beyond_a, beyond_b = sign_a * a - gaps[0] / blur, sign_b * b - gaps[1] / blur
            (inside_a, bell_a), (inside_b, bell_b) = _phi(beyond_a), _phi(beyond_b)
            cover += inside_a * inside_b
            to_a += sign_a * bell_a * inside_b
            to_b += sign_b * inside_a * bell_b
            to_blur -= bell_a * inside_b * beyond_a + inside_a * bell_b * beyond_b
    return cover, to_a, to_b, to_blur


@njit(**OPTIONS)
def cover_one(x, y, unknowns, shape, gaps, slopes):
    """Share of white at a pixel; fills slopes (5,), its derivatives to the first five unknowns."""
    dx, dy, blur = x - unknowns[0], y - unknowns[1], math.exp(unknowns[4])
    cos_a, sin_a = math.cos(unknowns[2]), math.sin(unknowns[2])
    cos_b, sin_b = math.cos(unknowns[3]), math.sin(unknowns[3])
    a, b = (dx * cos_a + dy * sin_a) / blur, (dx * cos_b + dy * sin_b) / blur
    (first, bell_a), (second, bell_b) = _phi(a), _phi(b)
    left = shape[0] + (shape[2] - shape[0]) * second
    right = shape[1] + (shape[3] - shape[1]) * second
    over = shape[0] + (shape[1] - shape[0]) * first
    under = shape[2] + (shape[3] - shape[2]) * first
    cover = left + (right - left) * first
    to_a, to_b = (right - left) * bell_a, (under - over) * bell_b
    to_blur = -to_a * a - to_b * b
    if gaps[0] < np.inf:
        marker, marker_a, marker_b, marker_blur = _markers(a, b, blur, shape, gaps)
        cover, to_a, to_b, to_blur = cover - marker, to_a - marker_a, to_b - marker_b, to_blur - marker_blur
    slopes[0] = -(to_a * cos_a + to_b * cos_b) / blur
    slopes[1] = -(to_a * sin_a + to_b * sin_b) / blur
    slopes[2] = to_a * (dy * cos_a - dx * sin_a) / blur
    slopes[3] = to_b * (dy * cos_b - dx * sin_b) / blur
    slopes[4] = to_blur
    return cover


@njit(**OPTIONS)
def _linearise(x, y, value, unknowns, shape, gaps, base, slopes):
    """Residual at a pixel; fills slopes (9,), the brightness's derivatives. base: window's centre and half width."""
    cover = cover_one(x, y, unknowns, shape, gaps, slopes)
    across, down = (x - base[0]) / base[2], (y - base[1]) / base[2]
    contrast = unknowns[6] + unknowns[7] * across + unknowns[8] * down
    for k in range(5):
        slopes[k] *= contrast
    slopes[5], slopes[6], slopes[7], slopes[8] = 1.0, cover, cover * across, cover * down
    return value - unknowns[5] - contrast * cover


@njit(**OPTIONS)
def _open_window(image, allowed, corner, inverse, second, shape, extent, clear, margin, window, base):
    """Choose the pixels around a corner: rows x, y, value, column, row of window. How many; 0: too many are missing.

    inverse : (2, 2) mm of the board per px; second : see `fit_all`; margin : px kept from the markers' bits. The x, y
    are those that the pixel would have if the map from the board were linear.
    """
    largest = int(math.sqrt(len(window))) // 2
    size = inverse[0, 0] * inverse[1, 1] - inverse[0, 1] * inverse[1, 0]  # mm² per px²
    reach = (
        extent * max(abs(inverse[1, 1]) + abs(inverse[0, 1]), abs(inverse[1, 0]) + abs(inverse[0, 0])) / size
    )  # px, half width of the extent's bounding box
    half = min(max(math.ceil(reach), 2), largest)
    base[0], base[1], base[2] = round(corner[0]), round(corner[1]), half
    near_bits = clear - margin * math.sqrt(size)
    count, wanted = 0, 0
    for row in range(base[1] - half, base[1] + half + 1):
        for column in range(base[0] - half, base[0] + half + 1):
            dx, dy = column - corner[0], row - corner[1]
            x, y = inverse[0, 0] * dx + inverse[0, 1] * dy, inverse[1, 0] * dx + inverse[1, 1] * dy
            if max(abs(x), abs(y)) > extent:
                continue
            marked = shape[4 + (1 if x > 0 else 0) + (2 if y > 0 else 0)] > 0
            if marked and min(abs(x), abs(y)) > near_bits:
                continue
            wanted += 1
            inside = 0 <= row < image.shape[0] and 0 <= column < image.shape[1]
            if inside and allowed[row, column]:
                window[count, 0] = column - 0.5 * (second[0, 0] * x * x + second[2, 0] * y * y) - second[1, 0] * x * y
                window[count, 1] = row - 0.5 * (second[0, 1] * x * x + second[2, 1] * y * y) - second[1, 1] * x * y
                window[count, 2], window[count, 3], window[count, 4] = image[row, column], column, row
                count += 1
            elif dx * dx + dy * dy < 6.25:
                return 0
    return count if count >= max(16, 0.4 * wanted) else 0


@njit(**OPTIONS)
def _start_brightness(window, unknowns, shape, gaps, slopes):
    """Background and contrast by linear regression on the share of white; no gradient."""
    count = len(window)
    cover, total, mean = np.empty(count), 0.0, 0.0
    for i in range(count):
        cover[i] = cover_one(window[i, 0], window[i, 1], unknowns, shape, gaps, slopes)
        total += cover[i]
        mean += window[i, 2]
    total, mean, above, below = total / count, mean / count, 0.0, 1e-9
    for i in range(count):
        above += (cover[i] - total) * (window[i, 2] - mean)
        below += (cover[i] - total) ** 2
    unknowns[6] = above / below
    unknowns[5], unknowns[7], unknowns[8] = mean - unknowns[6] * total, 0.0, 0.0


@njit(**OPTIONS)
def _normal_equations(window, unknowns, shape, gaps, base, normal, right, slopes):
    """Fill the normal equations (9, 9) and (9,); the sum of squared residuals."""
    normal[:], right[:], squares = 0.0, 0.0, 0.0
    for i in range(len(window)):
        residual = _linearise(window[i, 0], window[i, 1], window[i, 2], unknowns, shape, gaps, base, slopes)
        squares += residual * residual
        for j in range(UNKNOWNS):
            right[j] += slopes[j] * residual
            for k in range(j + 1):
                normal[j, k] += slopes[j] * slopes[k]
    for j in range(UNKNOWNS):
        for k in range(j):
            normal[k, j] = normal[j, k]
    return squares


@njit(**OPTIONS)
def _inverse(normal):
    """Inverse of the normal equations, a little stiffened, so that what nothing determines stays."""
    scale = np.empty(UNKNOWNS)
    for j in range(UNKNOWNS):
        scale[j] = 1 / (math.sqrt(normal[j, j]) + 1e-12)
    scaled = normal * scale * scale.reshape(-1, 1)
    for j in range(UNKNOWNS):
        scaled[j, j] += 1e-6
    return np.linalg.inv(scaled) * scale * scale.reshape(-1, 1)


@njit(**OPTIONS)
def _iterate(window, unknowns, shape, gaps, base, iterations):
    """Gauss-Newton with bounded steps, in place; the last sum of squared residuals and inverse normal matrix."""
    normal, right, slopes = np.empty((UNKNOWNS, UNKNOWNS)), np.empty(UNKNOWNS), np.empty(UNKNOWNS)
    squares, inverse = np.nan, normal
    for _ in range(iterations):
        squares = _normal_equations(window, unknowns, shape, gaps, base, normal, right, slopes)
        inverse = _inverse(normal)
        steps, largest = inverse @ right, 0.0
        for k in range(UNKNOWNS):
            step, bound = steps[k], STEPS[k]
            step = min(max(step, -bound), bound)
            unknowns[k] += step
            if k < 4:
                largest = max(largest, abs(step))
        unknowns[4] = min(max(unknowns[4], math.log(0.2)), math.log(float(base[2])))
        if largest < 2e-4:
            break
    return squares, inverse


@njit(**OPTIONS)
def _variance(window, unknowns, shape, gaps, base, inverse, slopes):
    """Variance (px²) of a coordinate from the corner's influence function, with the correlations of 3 × 3 px.

    Bartlett weights 1/2, 1, 1/2 along both axes.
    """
    half = int(base[2])
    side = 2 * half + 3  # with a border of zeros
    influence = np.zeros((side, side, 2))
    for i in range(len(window)):
        residual = _linearise(window[i, 0], window[i, 1], window[i, 2], unknowns, shape, gaps, base, slopes)
        row, column = int(window[i, 4]) - base[1] + half + 1, int(window[i, 3]) - base[0] + half + 1
        for k in range(UNKNOWNS):
            influence[row, column, 0] += inverse[0, k] * slopes[k] * residual
            influence[row, column, 1] += inverse[1, k] * slopes[k] * residual
    total = 0.0
    for row in range(1, side - 1):
        for column in range(1, side - 1):
            for axis in range(2):
                near = 0.0
                for down in range(-1, 2):
                    for across in range(-1, 2):
                        weight = (1 - 0.5 * abs(down)) * (1 - 0.5 * abs(across))
                        near += weight * influence[row + down, column + across, axis]
                total += influence[row, column, axis] * near / 2
    return max(total, 0.0) * len(window) / max(len(window) - UNKNOWNS, 1)


@njit(**OPTIONS)
def fit_one(image, allowed, guess, angles, inverse, second, shape, gaps, extent, clear, room, fit):
    """Fit one corner, see `fit_all`; room : (side squared, 5) for the largest window's pixels."""
    fit[:] = np.nan
    unknowns, base, slopes = np.empty(UNKNOWNS), np.zeros(3, np.int64), np.empty(UNKNOWNS)
    unknowns[:2], unknowns[2:4], unknowns[4] = guess, angles, math.log(1.5)
    window, squares, covariance = room, np.nan, np.empty((UNKNOWNS, UNKNOWNS))
    for turn in range(2):  # the second window lies where the corner is
        margin = 1.5 if turn == 0 else max(1.5, 2.5 * math.exp(unknowns[4]))
        count = _open_window(image, allowed, unknowns[:2], inverse, second, shape, extent, clear, margin, room, base)
        if count == 0:
            return
        window = room[:count]
        if turn == 0:
            _start_brightness(window, unknowns, shape, gaps, slopes)
        squares, covariance = _iterate(window, unknowns, shape, gaps, base, 12 - 6 * turn)
        if not math.isfinite(squares + unknowns[0] + unknowns[1]):
            return
    variance = _variance(window, unknowns, shape, gaps, base, covariance, slopes)
    turned = 0.0
    for edge in range(2):
        angle = abs(unknowns[2 + edge] - angles[edge]) % (2 * math.pi)
        turned = max(turned, min(angle, 2 * math.pi - angle))
    fit[:2], fit[2], fit[3] = unknowns[:2], math.sqrt(variance), unknowns[6]
    fit[4], fit[5], fit[6] = 1 - squares / (len(window) * np.var(window[:, 2]) + 1e-12), turned, math.exp(unknowns[4])


@njit(**OPTIONS)
def fit_all(image, allowed, guesses, angles, inverses, second, shapes, gaps, extent, clear, largest, fits):
    """Fit K corners: fills fits (K, 7) with the columns of `corners.CornerFits`, NaN where the window is too small.

    Parameters
    ----------
    image, allowed : (H, W) float and bool arrays
    guesses : (K, 2) px
    angles : (K, 2) rad, directions of the edges' normals foretold
    inverses : (K, 2, 2) mm of the board per px
    second : (K, 3, 2) px per mm², d² pixel / dx², dx dy, dy² of the board
    shapes : (K, 8);  gaps : (K, 2) px
    extent, clear : float, mm, see `corners.Surroundings`
    largest : int, px, half width of the largest window
    """
    room = np.empty(((2 * largest + 1) ** 2, 5))
    for k in range(len(guesses)):
        fit_one(
            image,
            allowed,
            guesses[k],
            angles[k],
            inverses[k],
            second[k],
            shapes[k],
            gaps[k],
            extent,
            clear,
            room,
            fits[k],
        )
