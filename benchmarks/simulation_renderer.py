"""Our simulated photographs of a board beside those of an independent renderer (Mitsuba 3), setup by setup.

    python -m benchmarks.simulation_renderer [--folders NAME ...] [--photographs N | --full] [--pictures FOLDER]

The renderer's files state the setup, the board and its pose in each photograph; ours are rendered from these and
nothing else but three brightnesses that the files do not state: those of ink and paper, fitted once for each folder,
and that of the empty background, which differs from photograph to photograph. Both take 16 samples a pixel within
the pixel's square, then a Gaussian of 0.5 px, then 8 bits. Transmission at each face of the glass is in both, so that
one ink and one paper must do for photographs with and without the prism.

- corners: our own detector looks at both photographs; root mean square (px, of the length) of the difference, in the
  sub-image where it is largest, and that of either to the exact corners
- levels: grey levels of pixels away from edges, where ours changes by less than 4 levels within 3 px and no seam of
  the prism is within 3 px; the share of them that agree to 2 % of the full scale, the share that agree to 2 % of their
  own level or half a level of rounding, the largest difference and the mean one
- paper, ink: what was fitted, in percent of the full scale

The renderer's board is a picture whose markers lie up to about 0.15 mm off their place; the squares, and so the
corners, are where they should be. Edges of markers therefore differ by some tenths of a px.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.data import data_folder, renderer_setup
from benchmarks.results import table, write
from benchmarks.targets import rig_of
from cyclopean import Camera, Setup, observe, read_photograph
from cyclopean.geometry import Pose
from cyclopean.jobs.experiment_photographs import RenderedSet, rendered_set
from cyclopean.simulation import Scene, render
from cyclopean.simulation.prints import board_surface
from cyclopean.simulation.sensor import Sensor
from cyclopean.targets import DIRECT, Board

RIGS = ("n2", "n2_flip", "n3", "n3_pose", "n4", "n5", "t2_b40", "t3_b40", "t4_b45")
FOLDERS = ("camera_only", *(f"calib_{rig}" for rig in RIGS), *(f"targets_{rig}" for rig in RIGS[-3:]))
CHROMA = "calib_n3_chroma"
INDICES = {"R": 1.51432, "G": 1.51680, "B": 1.52238}  # of the glass in CHROMA, by channel
BLUR = 0.5  # px
AWAY, FLAT = 3, 4  # px from edges and seams; grey levels that an even place may differ by
LEVELS = 0.02  # of the full scale, and of the level itself
_WELL_KNOWN = 0.5  # grey levels, of rounding


@dataclass(frozen=True)
class Brightness:
    """What the renderer's files do not state, as shares of the full scale before the glass takes its part."""

    ink: float
    paper: float
    background: float


@dataclass(frozen=True, eq=False)
class Pair:
    """The same photograph by both, and what a comparison needs to know about it."""

    setup: Setup
    board: Board
    direct: bool  # taken without the optic
    theirs: np.ndarray  # (H, W) uint8
    ours: np.ndarray  # (H, W) uint8
    exact: dict[tuple[int, int], np.ndarray]  # true pixel (2,) of each (view, corner)
    brightness: Brightness


def photographs(
    name: str, numbers: Sequence[int], samples: int, box: tuple[int, int, int, int] | None = None
) -> Iterator[Pair]:
    """Photographs of a folder by both; of a colour one every channel by itself.

    `box` (x, y, width, height) px takes a part of each photograph.
    """
    given = rendered_set(data_folder("mitsuba"), name)
    corners = np.load(given.folder / "corners.npz")
    direct = name == "camera_only"
    setup = renderer_setup("n2" if direct else rig_of(name))
    for channel in "RGB" if name == CHROMA else "G":
        if name == CHROMA:
            setup = replace(setup, optic=replace(setup.optic, glass=INDICES[channel]))
        brightness = None
        for number in numbers:
            theirs = _read(given, number, "RGB".index(channel))
            exact = _exact(corners, number, f"uv_{channel}" if name == CHROMA else "uv")
            part = setup if box is None else cropped(setup, box)
            if box is not None:
                theirs = theirs[box[1] : box[1] + box[3], box[0] : box[0] + box[2]]
                exact = {key: pixel - box[:2] for key, pixel in exact.items()}
            brightness = fitted(part, given.board, given.poses[number], theirs, direct, brightness)
            ours = photograph(part, given.board, given.poses[number], brightness, direct, samples)
            yield Pair(part, given.board, direct, theirs, ours, exact, brightness)


def photograph(
    setup: Setup, board: Board, pose: Pose, brightness: Brightness, direct: bool, samples: int
) -> np.ndarray:
    """Our photograph (H, W) uint8 of a board in front of an even background."""
    surface = board_surface(board, pose, brightness.ink, brightness.paper)
    scene = Scene((surface,), background=(brightness.background,))
    light = render(setup, scene, samples=samples, with_optic=not direct)
    return Sensor(exposure=1.0, blur_sigma=BLUR).expose(light)


def cropped(setup: Setup, box: tuple[int, int, int, int]) -> Setup:
    """The same setup with a part (x, y, width, height) of the sensor."""
    x, y, width, height = box
    camera = setup.camera
    part = Camera((width, height), camera.focal, (camera.centre[0] - x, camera.centre[1] - y), camera.distortion)
    return replace(setup, camera=part)


def fitted(
    setup: Setup, board: Board, pose: Pose, theirs: np.ndarray, direct: bool, known: Brightness | None
) -> Brightness:
    """Brightnesses that explain even places of the renderer's photograph; ink and paper are kept where `known`."""

    def traced(ink, paper, background):
        scene = Scene((board_surface(board, pose, ink, paper),), background=(background,))
        return render(setup, scene, samples=1, with_optic=not direct)

    white, all_white, with_background = traced(0, 1, 0), traced(1, 1, 0), traced(1, 1, 1)
    parts = np.stack([all_white - white, white, with_background - all_white], -1)  # of ink, paper, background
    even = np.ones(theirs.shape, bool)
    for part in (*np.moveaxis(parts, -1, 0), theirs.astype(np.float32) / 255):
        even &= _spread(part) < FLAT / 255 * 2
    levels = theirs[even] / 255
    if known is None:
        return Brightness(*np.linalg.lstsq(parts[even], levels, rcond=None)[0].clip(0, 1).tolist())
    outside = parts[even][:, 2]
    left = levels - parts[even][:, :2] @ [known.ink, known.paper]
    return replace(known, background=float(np.clip(outside @ left / max(outside @ outside, 1e-9), 0, 1)))


def away_from_edges(pair: Pair) -> np.ndarray:
    """(H, W) bool: pixels whose surroundings are even in our photograph, and that no seam is near."""
    even = _spread(pair.ours.astype(np.float32)) < FLAT
    if not pair.direct:
        facets = pair.setup.rig(margin=0.0).facets.astype(np.float32)
        even &= _spread(facets) == 0
    even[:AWAY], even[-AWAY:], even[:, :AWAY], even[:, -AWAY:] = False, False, False, False
    return even


def compared(pair: Pair) -> dict[str, float]:
    """Figures of one photograph."""
    figures = corner_figures(pair)
    even = away_from_edges(pair)
    theirs, ours = pair.theirs[even].astype(float), pair.ours[even].astype(float)
    off = np.abs(ours - theirs)
    return figures | {
        "even_percent": 100 * even.mean(),
        "within_2_percent_of_scale_percent": 100 * np.mean(off <= LEVELS * 255),
        "within_2_percent_of_level_percent": 100 * np.mean(off <= LEVELS * theirs + _WELL_KNOWN),
        "largest_levels": float(off.max()),
        "mean_levels": float((ours - theirs).mean()),
        "paper_percent": 100 * pair.brightness.paper,
        "ink_percent": 100 * pair.brightness.ink,
    }


def corner_figures(pair: Pair) -> dict[str, float]:
    """Root mean square differences (px) of corners, the largest of all sub-images."""
    masks = None if pair.direct else pair.setup.rig().masks
    named = [("theirs", pair.theirs), ("ours", pair.ours)]
    seen, _ = observe(named, pair.board, masks)
    keys = list(zip(seen.view.tolist(), seen.point.tolist(), strict=True))
    places = [{keys[row]: seen.pixels[row] for row in np.flatnonzero(seen.photo == k)} for k in range(2)]
    both = sorted(places[0].keys() & places[1].keys())
    figures = {"corners": float(len(both)), "only_one_has": float(len(places[0].keys() ^ places[1].keys()))}
    for what, one, other in (
        ("ours_theirs", places[1], places[0]),
        ("theirs_exact", places[0], pair.exact),
        ("ours_exact", places[1], pair.exact),
    ):
        by_view = []
        for view in sorted({view for view, _ in both}):
            apart = [one[key] - other[key] for key in both if key[0] == view and key in other]
            by_view.append(np.sqrt(np.mean(np.sum(np.square(apart), axis=-1))))
        figures[f"{what}_px"] = float(max(by_view))
    return figures


def together(found: Sequence[dict[str, float]]) -> dict[str, float]:
    """Figures of several photographs: the worst of each, means of shares, sums of counts."""
    result = {}
    for key in found[0]:
        values = np.array([one[key] for one in found])
        if key in ("corners", "only_one_has"):
            result[key] = values.sum()
        elif key.endswith("_px") or key == "largest_levels":
            result[key] = values.max()
        elif key.startswith("within"):
            result[key] = values.min()
        else:
            result[key] = values.mean()
    return {key: float(value) for key, value in result.items()}


def _read(given: RenderedSet, number: int, channel: int) -> np.ndarray:
    picture = read_photograph(given.paths[number])
    return np.ascontiguousarray(picture[..., channel]) if picture.ndim == 3 else picture


def _exact(corners, number, key):
    rows = np.flatnonzero((corners["view"] == number) & np.isfinite(corners[key]).all(-1))
    views = np.where(corners["facet"][rows] < 0, DIRECT, corners["facet"][rows])
    return {(int(v), int(corners["corner_id"][row])): corners[key][row] for v, row in zip(views, rows, strict=True)}


def _spread(picture):
    """Largest minus smallest within AWAY px of each pixel."""
    square = np.ones((2 * AWAY + 1, 2 * AWAY + 1), np.uint8)
    return cv2.dilate(picture, square) - cv2.erode(picture, square)


def draw(pair: Pair, path: Path) -> None:
    """Write theirs, ours and four times the difference, side by side."""
    difference = np.clip(128 + 4 * (pair.ours.astype(int) - pair.theirs), 0, 255).astype(np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.hstack([pair.theirs, pair.ours, difference]))


def main() -> None:
    """Compare the folders asked for; only a run of all of them is stored."""
    every = (*FOLDERS, CHROMA)
    parser = argparse.ArgumentParser(description="Our simulated photographs beside an independent renderer's.")
    parser.add_argument("--folders", nargs="+", metavar="NAME", choices=every, default=list(every))
    parser.add_argument("--photographs", type=int, default=2, metavar="N", help="of each folder; default: 2")
    parser.add_argument("--full", action="store_true", help="all photographs")
    parser.add_argument("--samples", type=int, default=16, metavar="N", help="rays a pixel; default: 16")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="where to write one comparison of each folder")
    chosen = parser.parse_args()
    rows, stored = [], {}
    for name in chosen.folders:
        count = len(rendered_set(data_folder("mitsuba"), name).paths)
        number = count if chosen.full else min(chosen.photographs, count)
        found = []
        for k, pair in enumerate(photographs(name, range(number), chosen.samples)):
            found.append(compared(pair))
            if chosen.pictures and not k:
                draw(pair, chosen.pictures / f"{name}.png")
        figures = together(found) | {"photographs": float(len(found))}
        stored |= {f"{name}_{key}": value for key, value in figures.items()}
        rows.append([name, len(found), *(figures[key] for key in _COLUMNS)])
        print(f"{name}: {len(found)} photographs, corners differ by {figures['ours_theirs_px']:.4f} px", flush=True)
    table("ours beside the renderer's; the worst photograph and sub-image", ["", "n", *_COLUMNS.values()], rows)
    if set(every) <= set(chosen.folders):
        write("simulation_renderer", stored)


_COLUMNS = {
    "corners": "corners",
    "ours_theirs_px": "both px",
    "theirs_exact_px": "theirs px",
    "ours_exact_px": "ours px",
    "even_percent": "even %",
    "within_2_percent_of_scale_percent": "scale %",
    "within_2_percent_of_level_percent": "level %",
    "largest_levels": "largest",
    "mean_levels": "mean",
    "paper_percent": "paper",
    "ink_percent": "ink",
}


if __name__ == "__main__":
    main()
