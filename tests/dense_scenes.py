"""A reconstruction of a small synthetic photograph beside its truth, for the tests of dense depth.

One px of disparity is 5 to 10 % of depth here: f = 600 px, baselines of 16 to 23 mm, 500 to 1200 mm. A depth counts
as wrong when it is off by more than half a px. No depth is never wrong; where there must be some, a test says how much.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from benchmarks.synthetic import DEPTHS, Plane, Shot, prism_rig, quantised, take, texture
from cyclopean import reconstruct
from cyclopean.analysis.reliability import reliability
from cyclopean.pipeline import Reconstruction

BESIDE = {2: 0.0, 3: 90.0, 4: 45.0}  # deg, azimuth of facet 0, by facets


@cache
def rig_of(facets):
    return prism_rig(facets, azimuth_deg=BESIDE[facets])


@cache
def slope(facets):
    """A tilted plane with texture all over."""
    return take(rig_of(facets), Plane(800, texture(800), slope=0.2))


@cache
def found_on(facets):
    """What comes of the tilted plane when nothing is wrong."""
    return look(slope(facets), slope(facets).light)


@dataclass(frozen=True, eq=False, repr=False)
class Look:
    """A reconstruction beside the truth. Shares are of the pixels `where` (H, W) bool."""

    shot: Shot
    found: Reconstruction

    @property
    def there(self):
        """(H, W) bool: pixels that have a depth."""
        return np.isfinite(self.found.depth)

    @property
    def off(self):
        """(H, W) px of disparity that depths are off, in the most sensitive pair; NaN where there is none."""
        return np.abs(1 / self.found.depth - 1 / self.shot.depth) * sensitivity(self.shot.rig)

    def known(self, where):
        """Share that has a depth."""
        return share(self.there, where)

    def wrong(self, where, by=0.5):
        """Share whose depth is off by more than so many px; no depth is not wrong."""
        return share(self.off > by, where)

    def bad(self, where, percent=1.0):
        """Share whose depth is off by more than so many percent."""
        return share(np.abs(self.found.depth / self.shot.depth - 1) > percent / 100, where)

    def median(self, where):
        """Median error of the depths there are, px."""
        return float(np.median(self.off[where & self.there]))

    def sigma(self, where, bins=1):
        """How errors compare with their stated sigma."""
        return reliability((self.found.depth - self.shot.depth)[where], self.found.sigma[where], bins)


@cache
def sensitivity(rig):
    """Movement (px) between the two most sensitive views for 1/mm of inverse depth, on the axis at 800 mm."""
    near, far = (rig.unbounded().project(np.array([0.0, 0.0, z])) for z in (800.0, 801.0))
    move = (far - near)[:, None] - (far - near)
    return float(np.linalg.norm(move, axis=-1).max() / (1 / 800 - 1 / 801))


def share(these, of):
    """Share of the pixels `of` that are among `these`."""
    assert of.sum() > 100, "too few pixels to say anything"
    return float(these[of].mean())


def look(shot, light, noise=0.0, depths=DEPTHS):
    """Reconstruct what a shot looks like in 8 bits, with noise of some grey levels."""
    return Look(shot, reconstruct(quantised(light, noise), shot.rig, depths))


def shaded(light):
    """A lens that darkens towards the corners, by half there."""
    height, width = light.shape[:2]
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    return light * (1 - 0.25 * (x**2 + y**2))
