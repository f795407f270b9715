"""A camera alone as TOML: the [camera] table that a setup file begins with."""

from __future__ import annotations

from ... import __version__
from ...cameras import Camera
from ..disk import PathLike, replacing

_HOW_TO_GO_ON = """\

# This is a camera, not yet a setup. Add what stands in front of the lens, for example:
#
# [optic]
# kind = "prism"
# facets = 2                # 2 is a biprism
# apex_deg = 10.0           # angle between the flat face and each facet
# glass = "N-BK7"
# distance_mm = 60.0        # from the pinhole to the prism
#
# [scene]
# depth_mm = [600.0, 1600.0]
"""


def write_camera(path: PathLike, camera: Camera, source: str = "") -> None:
    """Write the [camera] table of a camera, with a word on how to make a setup file of it.

    Parameters
    ----------
    path : path
    camera : Camera
    source : str
        Where the camera comes from, for the first line of the file.
    """
    lines = [
        f"# cyclopean camera{f' from {_one_line(source)}' if source else ''}, written by cyclopean {__version__}",
        "# Pixel (0, 0) is the centre of the top-left one; distortion is k1 k2 p1 p2 k3.",
        "",
        "[camera]",
        f"size_px = {list(camera.size)}",
        f"focal_px = {list(camera.focal)}",
        f"centre_px = {list(camera.centre)}",
        f"distortion = {list(camera.distortion)}",
    ]
    if camera.pixel_pitch is not None:
        lines.append(f"pixel_pitch_um = {camera.pixel_pitch * 1000!r}")
    with replacing(path) as file:
        file.write(("\n".join(lines) + "\n" + _HOW_TO_GO_ON).encode())


def _one_line(text: str) -> str:
    return " ".join(text.split())
