"""Made-up photographs of views side by side, whose pictures move with depth, and their exact maps."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from cyclopean.matching import Warps

STEP = 0.5  # px that one hypothesis moves a picture, for a way of 1


class Texture:
    """A random picture of three channels that can be looked up anywhere: sums of waves of some lengths in px."""

    def __init__(self, seed=1, lengths=(4, 20), waves=60):
        rng = np.random.default_rng(seed)
        angle, length = rng.uniform(0, 2 * np.pi, waves), rng.uniform(*lengths, waves)
        self.wave = 2 * np.pi / length * np.stack([np.cos(angle), np.sin(angle)])
        self.phase, self.weight = rng.uniform(0, 2 * np.pi, (waves, 3)), rng.uniform(3, 9, (waves, 3))

    def __call__(self, x, y):
        angle = np.stack([x, y], axis=-1) @ self.wave
        return 128 + np.sum(self.weight * np.cos(angle[..., None] + self.phase), axis=-2)


@dataclass(frozen=True)
class Views:
    """Views of one size side by side: view v shows hypothesis k at x + ways[v] STEP k."""

    ways: tuple[float, ...] = (0, 1)
    size: tuple[int, int] = (110, 84)
    depths: int = 25
    corner: tuple[int, int] = (0, 0)  # px before the first view

    @property
    def inverse(self):
        """Inverse depths (D,), 1/mm."""
        return np.linspace(1 / 1500, 1 / 650, self.depths)

    def left(self, view):
        """First column of a view; there are 3 px between views."""
        return self.corner[0] + view * (self.size[0] + 3)

    def grid(self):
        """Columns and rows (h, w) of one view."""
        width, height = self.size
        return np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))

    @property
    def masks(self):
        """Pixels (V, H, W) of each view, corners left out."""
        width, height = self.size
        shape = self.corner[1] + height, self.left(len(self.ways))
        masks = np.zeros((len(self.ways), *shape), bool)
        x, y = self.grid()
        for view, mask in enumerate(masks):
            mask[self.corner[1] :, self.left(view) : self.left(view) + width] = (x + y > 5) & (x - y < width - 4)
        return masks

    def warps(self, spacing=8, crooked=0.0, channels=1):
        """The maps of each view; those that are crooked are cubic in depth, with some px of noise at the nodes."""
        rng, (width, height) = np.random.default_rng(8), self.size
        x, y = np.meshgrid(*(spacing * np.arange((n - 2) // spacing + 2) for n in (width, height)))
        result, masks = [], self.masks
        for view, way in enumerate(self.ways):
            others = [k for k in range(len(self.ways)) if k != view]
            coefficients = np.zeros((len(others), channels, *x.shape, 2, 4 if crooked else 2), np.float32)
            for k, other in enumerate(others):
                move = (self.ways[other] - way) * STEP * (self.depths - 1) / 2
                coefficients[k, ..., 0, 0], coefficients[k, ..., 1, 0] = x + self.left(other) + move, y + self.corner[1]
                coefficients[k, ..., 0, 1] = move
            coefficients += crooked * rng.uniform(-1, 1, coefficients.shape)
            origin = self.left(view), self.corner[1]
            result.append(Warps(origin, self.size, self.inverse, spacing, coefficients, masks[[view, *others]]))
        return tuple(result)

    def photograph(self, surfaces, *, rounded=True):
        """What the views show, (H, W, 3): noise between them, and of some surfaces the foremost of each pixel.

        A surface is (texture, (a, b, c), where): it has hypothesis a + b x + c y at pixels where(x, y).
        """
        image = np.random.default_rng(9).uniform(0, 255, (*self.masks.shape[1:], 3))
        for view in range(len(self.ways)):
            x, y = self.grid()
            shown = np.full((*x.shape, 3), 128.0)
            for texture, _, base, there, _ in self._placed(surfaces, view):
                shown = np.where(there[..., None], texture(base, y), shown)
            image[self.corner[1] :, self.left(view) : self.left(view) + self.size[0]] = shown
        return np.clip(np.rint(image), 0, 255).astype(np.uint8) if rounded else image

    def truth(self, surfaces, view):
        """Hypothesis (h, w) of each pixel of a view."""
        truth = np.full(self.size[::-1], np.nan)
        for *_, there, steps in self._placed(surfaces, view):
            truth = np.where(there, steps, truth)
        return truth

    def seen(self, steps, view):
        """Pixels (h, w) of a view whose point lies well inside another view."""
        x, y = self.grid()
        away = (np.delete(self.ways, view) - self.ways[view])[:, None, None] * STEP * steps
        inside = (x > 8) & (x < self.size[0] - 8) & (y > 8) & (y < self.size[1] - 8)
        return inside & np.any((x + away > 8) & (x + away < self.size[0] - 8), axis=0)

    def _placed(self, surfaces, view):
        """Each surface as a view sees it: texture, plane, its x, whether it is there, hypotheses."""
        x, y = self.grid()
        way = self.ways[view] * STEP
        for texture, (a, b, c), where in surfaces:
            base = (x - way * (a + c * y)) / (1 + way * b)
            yield texture, (a, b, c), base, where(base, y), a + b * base + c * y


def everywhere(x, y):
    """The place of a surface without end."""
    return np.ones(x.shape, bool)


def slow_places(warps, x, y, steps):
    """Where pixels (x, y) of the box are seen at their hypotheses, (V-1, C, ..., 2) px, in double precision."""
    coefficients, (rows, columns) = warps.coefficients.astype(float), warps.lattice
    axes = warps.spacing * np.arange(rows), warps.spacing * np.arange(columns)
    nodes = np.moveaxis(coefficients, (2, 3), (0, 1))
    at = RegularGridInterpolator(axes, nodes, bounds_error=False, fill_value=None)(np.stack([y, x], -1))
    s = 2 * np.asarray(steps) / (len(warps.inverse_depths) - 1) - 1
    at = np.moveaxis(at, np.arange(np.ndim(x)), np.arange(2, 2 + np.ndim(x)))  # (V-1, C, ..., 2, K)
    return np.polynomial.polynomial.polyval(s[..., None], np.moveaxis(at, -1, 0), tensor=False)


def whole(layout, flat, view):
    """The picture of a view with its rim, from an array that holds those of all views."""
    width, height = layout.frames[view, 2:4].astype(int)
    return flat[layout.starts[view] : layout.starts[view + 1]].reshape(height, width)


def in_picture(layout, view, pixels):
    """Columns and rows in a view's picture with its rim, of pixels (..., 2) of the photograph."""
    return np.moveaxis((pixels - layout.frames[view, :2]) * layout.scale, -1, 0)
