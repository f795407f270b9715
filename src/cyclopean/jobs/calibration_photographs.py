"""Photographs of a board for calibration: which files, what is in them, and where they show the board."""

from __future__ import annotations

import glob
import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import CyclopeanError, ImageError
from ..files import read_photograph
from ..targets import Board, Observations, observe

ENDINGS = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".webp", ".pgm", ".ppm")
COLOURS = ("red", "green", "blue")
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Pictures:
    """Photographs of one kind: through the optic, or without it."""

    names: tuple[str, ...]
    images: tuple[np.ndarray, ...]  # each (H, W) or (H, W, 3)
    size: tuple[int, int]  # (width, height) px, of all of them

    def of_channel(self, channel: str) -> list[tuple[str, np.ndarray]]:
        """Names and images of one colour; of all colours for "all"."""
        if channel == "all":
            return list(zip(self.names, self.images, strict=True))
        grey = next((name for name, image in zip(self.names, self.images, strict=True) if image.ndim == 2), None)
        if grey is not None:
            raise ImageError(f"{grey} is grey: it has no {channel} channel; leave --channel out")
        number = COLOURS.index(channel)
        return [(name, image[..., number]) for name, image in zip(self.names, self.images, strict=True)]


def find_files(given: Sequence[Path], option: str) -> tuple[list[Path], list[str]]:
    """The photographs that paths, folders and patterns stand for, each once, and remarks on those left out."""
    files: list[Path] = []
    for path in given:
        if path.is_dir():
            inside = sorted(p for p in path.iterdir() if p.suffix.lower() in ENDINGS and not p.name.startswith("."))
            if not inside:
                raise ImageError(f"{path}: there are no photographs ({', '.join(ENDINGS)}) in this folder")
            files += inside
        elif glob.has_magic(str(path)) and not path.exists():  # shells that leave patterns to the program
            inside = sorted(map(Path, glob.glob(str(path))))
            if not inside:
                raise ImageError(f"{path}: no file has a name like this")
            files += inside
        elif path.suffix.lower() in (".toml", ".csv", ".json"):
            raise ImageError(f"{path} is no photograph: {option} takes photographs; was an option left out before it?")
        else:
            files.append(path)
    kept, remarks = list(dict.fromkeys(path.absolute() for path in files)), []
    if len(kept) < len(files):
        twice = sorted({path.name for path in files if [p.absolute() for p in files].count(path.absolute()) > 1})
        remarks.append(f"named twice, used once: {', '.join(twice)}")
    shown = {path.absolute(): path for path in reversed(files)}  # as the person wrote them, for messages
    return [shown[path] for path in kept], remarks


def read_pictures(
    files: Sequence[Path],
    size: tuple[int, int] | None,
    taken: Sequence[str],
    progress: Progress,
    what: str = "reading",
) -> tuple[Pictures, list[str]]:
    """Read photographs of one size, and remarks on those that are copies of each other.

    Names are those of the files, with the folder's before them where one is `taken` or occurs twice.
    """
    images: dict[Path, np.ndarray] = {}
    copies: dict[bytes, Path] = {}
    remarks = []
    for done, path in enumerate(files):
        image = read_photograph(path, size if size is not None or not images else None)
        digest = hashlib.blake2b(image.tobytes() + str(image.shape).encode()).digest()
        if digest in copies:
            remarks.append(f"{path.name} is a copy of {copies[digest].name}: left out")
        else:
            copies[digest], images[path] = path, image
        progress(what, done + 1, len(files))
    sizes = {path: (image.shape[1], image.shape[0]) for path, image in images.items()}
    first, wanted = next(iter(sizes.items()))
    for path, other in sizes.items():
        if other != wanted:
            raise ImageError(
                f"photographs of one setup have one size: {first} has {wanted[0]}x{wanted[1]} px, {path} has "
                f"{other[0]}x{other[1]} px"
            )
    names = [path.name for path in images]
    if len({*names, *taken}) < len(names) + len(taken):
        names = [f"{path.absolute().parent.name}/{path.name}" for path in images]
    return Pictures(_unlike(names), tuple(images.values()), wanted), remarks


def _unlike(names):
    """Names, numbered where they are still alike."""
    return tuple(name if names.count(name) == 1 else f"{k}/{name}" for k, name in enumerate(names))


def detect(
    pictures: Pictures,
    board: Board,
    masks: np.ndarray | None,
    mirrored: Sequence[bool | None] | None,
    channels: Sequence[str],
    progress: Progress,
    what: str,
) -> tuple[Observations, list[str]]:
    """Find the board in every photograph and colour; notes on views that are not as they should be."""
    parts, notes = [], []
    for number, channel in enumerate(channels):

        def show(done, each, before=number):
            progress(what, before * each + done, len(channels) * each)

        found, said = observe(pictures.of_channel(channel), board, masks, mirrored, show)
        parts.append(replace(found, channel=np.full(len(found), number)))
        notes += [f"{channel}: {note}" for note in said] if len(channels) > 1 else said
    return _side_by_side(parts), notes


def _side_by_side(parts):
    """Observations of the same photographs in several colours as one."""
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("photo", "view", "point", "pixels", "sigma", "channel")
    }
    return Observations(photos=parts[0].photos, **joined)


def seams_moved(masks: np.ndarray, there: np.ndarray) -> float:
    """How far (px) the borders of masks (V, H, W) moved, at the pixel that moved most; infinite if one was empty."""
    import cv2

    moved = 0.0
    for old, new in zip(masks, there, strict=True):
        for one, other in ((old, new), (new, old)):
            left = one & ~other
            if not other.any():
                return float("inf")
            if left.any():
                moved = max(moved, float(cv2.distanceTransform((~other).astype(np.uint8), cv2.DIST_L2, 5)[left].max()))
    return moved


def clear_of_seams(observations: Observations, rig, margin: float) -> Observations:
    """The observations that lie `margin` px or more from the seams; all where that leaves too few."""
    keep = observations.view < 0
    for number, view in enumerate(rig):
        mine = observations.view == number
        keep[mine] = view.region.with_margin(margin).contains(observations.pixels[mine])
    through = observations.view >= 0
    return observations.select(keep) if 2 * keep[through].sum() > through.sum() else observations


def named(option: str, fault: CyclopeanError) -> ImageError:
    """The same fault, with the option that it belongs to."""
    return ImageError(f"{option}: {fault}")
