"""Command ``measure``: lengths, depths, areas and angles in one photograph."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .app import OutFolder, SetupFile, Whole, app, parse_depths

Points = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]


@app.command
def measure(
    photo: Path,
    *,
    setup: SetupFile,
    output: OutFolder = Path("measurements"),
    point: Points = (),
    length: Points = (),
    point_to_line: Points = (),
    point_to_plane: Points = (),
    area: Points = (),
    angle: Points = (),
    depth: str | None = None,
    window: Whole = 21,
    pointing: float = 0.3,
    channel: Literal["all", "red", "green", "blue"] = "all",
    calibration: Path | None = None,
    prompt: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Measure in a photograph, from points given in any one sub-image.

    The points are found in the other sub-images by themselves. Every value comes with an accuracy index (one standard
    deviation) and a word: good, check or refused, with the reason. Points are pixels of the whole photograph, as in
    --length "512,300 640,310"; all these options can be given several times. A point that is matched wrongly is put
    right with its pixel in another sub-image: "512,300=980,312". Behind an option, a number below zero wants an equals
    sign: --point="-5,3". Without any measurement a window opens to click in.
    Writes measurements.json, measurements.csv, measurements.png and report.html.

    Parameters
    ----------
    photo
        The photograph: any format that OpenCV reads, 8 or 16 bit, grey or colour.
    setup
        Setup file (TOML) with camera and optic, calibrated.
    output
        Folder for the results; made if it is not there.
    point
        "x,y": where a point is; its depth is the value.
    length
        "x,y x,y ...": length of a line through two points or more.
    point_to_line
        "p l1 l2": distance of the point p from the straight line through l1 and l2.
    point_to_plane
        "p a b c ...": distance of the point p from the plane through three points or more; positive behind it.
    area
        "a b c ...": area of a polygon with these corners in order.
    angle
        "a v b": angle at v between the lines to a and to b.
    depth
        Depth range to search, mm, as NEAR..FAR. Without it the setup file's, or the rig's working depths.
    window
        Width of the window that is compared, px, odd. Smaller near edges in depth, larger where texture is poor.
    pointing
        Standard deviation of the given pixels, px: how well you point.
    channel
        Colour channel to look at. In white light, with a prism, one channel is far better than all.
    calibration
        Report of the calibration (calibration.json): adds the share of its uncertainty to the accuracy index.
    prompt
        Type measurements line by line instead of clicking: length 512,300 640,310.
    """
    from ..jobs.measurement import MeasureRequest, run_measurement

    points = {
        "point": point, "length": length, "point-to-line": point_to_line, "point-to-plane": point_to_plane,
        "area": area, "angle": angle,
    }  # fmt: skip
    run_measurement(
        MeasureRequest(
            photo, setup, output, points, parse_depths(depth), window, pointing, channel, calibration, prompt
        )
    )
