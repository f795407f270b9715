"""Rendered photographs with the true point of every few pixels, and how depths are judged by them."""

import json
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.data import data_folder, renderer_setup
from cyclopean import Rig, Setup

SAME_POINT = 0.01  # of the depth: two true samples so near to each other are one point
ONE_SIGMA_PERCENT = 68.27
BEST = 0.98  # the share of errors, the least, whose root mean square is taken
_NEARBY = 1e-4  # change of inverse depth, as a share of it, by which motions of pixels are taken


@dataclass(frozen=True, eq=False)
class Scene:
    """A photograph with its truth, sampled every `step` px."""

    setup: Setup
    photograph: np.ndarray  # (H, W, 3) uint8, RGB; (H, W) green
    step: int
    points: np.ndarray  # (h, w, 3) mm, the true point of each sampled pixel

    @property
    def pixels(self) -> np.ndarray:
        """The sampled pixels (h, w, 2)."""
        height, width = self.points.shape[:2]
        return np.stack(np.meshgrid(self.step * np.arange(width), self.step * np.arange(height)), axis=-1)


def scene_names() -> list[str]:
    """All scenes; NAME_green is the green channel of a scene with dispersion."""
    folder = data_folder("mitsuba") / "scenes"
    names = sorted(path.stem for path in folder.glob("*.png"))
    return sorted([*names, *(f"{name}_green" for name in names if "chroma" in name)])


def scene(name: str) -> Scene:
    """Read `mitsuba/scenes/NAME`."""
    stem = data_folder("mitsuba") / "scenes" / name.removesuffix("_green")
    truth = np.load(stem.with_suffix(".npz"))
    photograph = cv2.cvtColor(cv2.imread(str(stem.with_suffix(".png"))), cv2.COLOR_BGR2RGB)
    if name.endswith("_green"):
        photograph = photograph[..., 1].copy()
    return Scene(renderer_setup(rig_name(name)), photograph, int(truth["step"]), truth["xyz"].astype(float))


def rig_name(name: str) -> str:
    """The rig that a scene was taken with."""
    return _told(name)["rig"]


def channel_indices(name: str) -> tuple[float, float, float]:
    """Index of the glass for red, green and blue light in a scene with dispersion."""
    indices = _told(name)["image_noise"]["index_rgb"]
    return indices["R"], indices["G"], indices["B"]


def _told(name):
    stem = data_folder("mitsuba") / "scenes" / name.removesuffix("_green")
    return json.loads(stem.with_suffix(".json").read_text())


def seen_by(rig: Rig, truth: Scene) -> np.ndarray:
    """(h, w, V) bool: which views see the true point of each sampled pixel, themselves included."""
    height, width = truth.points.shape[:2]
    seen = []
    for view in rig:
        pixels = view.project(truth.points)
        inside = view.region.contains(pixels)
        x, y = np.moveaxis(np.rint(np.where(inside[..., None], pixels, 0) / truth.step).astype(int), -1, 0)
        around = [(np.clip(y + j, 0, height - 1), np.clip(x + i, 0, width - 1)) for j in (-1, 0, 1) for i in (-1, 0, 1)]
        apart = np.min([np.linalg.norm(truth.points[place] - truth.points, axis=-1) for place in around], axis=0)
        seen.append(inside & (apart < SAME_POINT * truth.points[..., 2]))
    return np.stack(seen, axis=-1)


def others(rig: Rig, truth: Scene, seen: np.ndarray) -> np.ndarray:
    """(h, w, V) bool: the views but its own that see the true point of each sampled pixel of a mask."""
    masks = np.moveaxis(rig.masks[:, :: truth.step, :: truth.step], 0, -1)
    return seen & masks.any(-1)[..., None] & ~masks


def motions(rig: Rig, truth: Scene) -> np.ndarray:
    """(h, w, V) px mm: how far each view's picture of a pixel's true point moves for a change of inverse depth."""
    result = np.full((*truth.points.shape[:2], len(rig)), np.nan)
    masks = rig.masks[:, :: truth.step, :: truth.step]
    for k, view in enumerate(rig):
        mine = masks[k] & np.isfinite(truth.points[..., 2])
        rays, inverse = view.unbounded().rays(truth.pixels[mine]), 1 / truth.points[mine][:, 2]
        change = _NEARBY * inverse
        near, far = rays.at_depth(1 / (inverse + change)), rays.at_depth(1 / (inverse - change))
        for j, other in enumerate(rig):
            if j != k:
                moved = other.unbounded().project(near) - other.unbounded().project(far)
                result[mine, j] = np.linalg.norm(moved, axis=-1) / (2 * change)
    return result


def judged(
    depth: np.ndarray, truth: np.ndarray, sigma: np.ndarray | None = None, motion: np.ndarray | None = None
) -> dict[str, float]:
    """Figures of depths (N,) beside the true ones, both in mm, NaN where there is none.

    `sigma` (N,) mm is what was stated; `motion` (N,) px mm turns errors of inverse depth into px.
    """
    known = np.isfinite(depth)
    error = np.abs(depth - truth)[known]
    percent = 100 * error / truth[known]
    figures = {
        "complete_percent": 100 * known.mean(),
        "bad1_percent": 100 * np.mean(percent > 1),
        "bad2_percent": 100 * np.mean(percent > 2),
        "bad5_percent": 100 * np.mean(percent > 5),
        "bad1_or_none_percent": 100 * (1 - np.count_nonzero(percent <= 1) / len(known)),
        "median_percent": np.median(percent),
        "rms98_percent": best_rms(percent),
    }
    if sigma is not None:
        figures["error_over_sigma_times"] = np.percentile(error / sigma[known], ONE_SIGMA_PERCENT)
    if motion is not None:
        figures["rms98_px"] = best_rms(np.abs(1 / depth[known] - 1 / truth[known]) * motion[known])
    return {name: float(value) for name, value in figures.items()}


def best_rms(errors: np.ndarray) -> float:
    """Root mean square of the best 98 % of some errors (N,)."""
    least = np.sort(errors)[: int(BEST * len(errors))]
    return float(np.sqrt(np.mean(least**2)))
