"""A real photograph with four sub-images: dots of a stepped block, found, named and checked by plain linear cameras."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.data import data_folder
from cyclopean import read_photograph
from cyclopean.targets.assignment import assign, linear_camera, project_linear
from cyclopean.targets.dots import Dots, find_dots

QUADRANTS = ((0, 0), (512, 0), (512, 512), (0, 512))  # px, top left corner of the four sub-images
_HALF = 256.0  # px, half the width of a sub-image
_PITCH = 0.02  # mm, of a pixel
_BAND = 20  # px that a sub-image reaches beyond its quadrant: at the seams both sides mix
_GLASS, _LIQUID, _THICKNESS = 1.49, 1.41, 7.5  # indices of wall and liquid; mm of the wall


def splitter_observations() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Dots of the block, and where the four views show them.

    Returns
    -------
    (135, 3) array
        The dots, mm.
    dict
        `photo`, `view`, `point` (N,) int (view 0 top left, 1 top right, 2 bottom right, 3 bottom left), `pixels`
        (N, 2) and `sigma` (N,) px: the rows of `cyclopean.targets.Observations`.
    """
    folder = data_folder("real") / "ptv_splitter4" / "cal"
    points = np.genfromtxt(folder / "calblock_new.txt")[:, 1:4]
    photograph = read_photograph(folder / "C001H001S0001000001.tif")
    dots = find_dots(photograph, dark=False, min_diameter=4, max_diameter=14, min_contrast=0.02)
    parts = []
    for view, corner in enumerate(QUADRANTS):
        guess = rough_pixels(folder / f"cam_{view + 1}.tif", points) + corner
        rows, named = named_dots(dots, guess, points, np.array(corner))
        parts.append((np.full(len(rows), view), named, dots.pixels[rows], dots.sigma[rows]))
    view, point, pixels, sigma = (np.concatenate(column) for column in zip(*parts, strict=True))
    return points, {"photo": np.zeros(len(view), int), "view": view, "point": point, "pixels": pixels, "sigma": sigma}


def named_dots(
    dots: Dots, guess: np.ndarray, points: np.ndarray, corner: np.ndarray, tolerance: float = 2.5
) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the dots in one sub-image that are points of the block, and which."""
    inside = ((dots.pixels >= corner - _BAND) & (dots.pixels < corner + 2 * _HALF + _BAND)).all(axis=1)
    rows = np.flatnonzero(inside)
    named = assign(dots.pixels[rows], guess, points, tolerance=tolerance)
    return rows[named >= 0], named[named >= 0]


def rough_pixels(orientation: Path, points: np.ndarray) -> np.ndarray:
    """Pixels (P, 2) in the sub-image at which a saved OpenPTV camera sees points (P, 3), 2 px at best."""
    rows = [row.split() for row in orientation.with_name(orientation.name + ".ori").read_text().splitlines()]
    numbers = [np.array(row, dtype=float) for row in rows if row]
    centre, rotation = numbers[0], np.array(numbers[2:5])
    (shift_x, shift_y), (focal,), glass = numbers[5], numbers[6], numbers[7]
    seen = apparent_points(points, centre, float(glass[2])) - centre
    in_camera = seen @ rotation  # the file holds world_from_camera
    x = shift_x - focal * in_camera[:, 0] / in_camera[:, 2]
    y = shift_y - focal * in_camera[:, 1] / in_camera[:, 2]
    return np.column_stack([_HALF + x / _PITCH, _HALF - y / _PITCH])


def apparent_points(points: np.ndarray, centre: np.ndarray, wall: float) -> np.ndarray:
    """Where on the inner face of the wall, z = wall, straight lines from the camera must aim to reach the points.

    The rays bend at both faces of a flat wall; the sideways reach of each is found by halving.
    """
    across = points[:, :2] - centre[:2]
    reach = np.linalg.norm(across, axis=1)
    air, liquid = centre[2] - wall - _THICKNESS, wall - points[:, 2]
    low, high = np.zeros(len(points)), np.full(len(points), 1.0 - 1e-9)
    for _ in range(60):
        sine = (low + high) / 2  # of the ray in air, to the wall's normal
        sideways = sum(
            part * (sine / index) / np.sqrt(1 - (sine / index) ** 2)
            for part, index in ((air, 1.0), (_THICKNESS, _GLASS), (liquid, _LIQUID))
        )
        low, high = np.where(sideways < reach, sine, low), np.where(sideways < reach, high, sine)
    length = (centre[2] - wall) * sine / np.sqrt(1 - sine**2)
    aim = centre[:2] + across / np.maximum(reach, 1e-9)[:, None] * length[:, None]
    return np.column_stack([aim, np.full(len(points), wall)])


def linear_figures(points: np.ndarray, rows: dict[str, np.ndarray]) -> dict[str, object]:
    """Residuals of a plain linear camera in each view, px, and of the dots seen in three or more views, mm."""
    cameras, rms = [], []
    for view in range(len(QUADRANTS)):
        mine = rows["view"] == view
        camera = linear_camera(points[rows["point"][mine]], rows["pixels"][mine])
        gap = project_linear(camera, points[rows["point"][mine]]) - rows["pixels"][mine]
        cameras.append(camera)
        rms.append(float(np.sqrt((gap**2).sum(axis=1).mean())))
    errors = []
    for point in np.unique(rows["point"]):
        mine = np.flatnonzero(rows["point"] == point)
        if len(mine) >= 3:
            matrix = np.concatenate(
                [
                    pixel[:, None] * cameras[v][2] - cameras[v][:2]
                    for pixel, v in zip(rows["pixels"][mine], rows["view"][mine], strict=True)
                ]
            )
            found = np.linalg.lstsq(matrix[:, :3], -matrix[:, 3], rcond=None)[0]
            errors.append(found - points[point])
    error = np.array(errors)
    return {
        "dots": len(rows["view"]),
        "rms_px": rms,
        "points_in_three": len(error),
        "rms_mm": float(np.sqrt((error**2).sum(axis=1).mean())),
        "rms_xyz_mm": np.sqrt((error**2).mean(axis=0)).tolist(),
    }


if __name__ == "__main__":
    print(linear_figures(*splitter_observations()))
