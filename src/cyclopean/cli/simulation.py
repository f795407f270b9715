"""Command ``simulate``: the photograph that a setup would take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .app import Whole, app, parse_depths

Output = Annotated[Path | None, Parameter(name=["--output", "-o"])]
Flag = Annotated[bool, Parameter(negative="")]


@app.command
def simulate(
    setup: Path,
    *,
    scene: Path | None = None,
    output: Output = None,
    samples: Whole = 16,
    preview: Flag = False,
    colour: Annotated[bool, Parameter(name=["--colour", "--color"], negative="")] = False,
    bits: Literal[8, 12, 16] = 8,
    exposure: float | None = None,
    noise: float = 0.0,
    full_well: float | None = None,
    read_noise: float = 0.0,
    black_level: float = 0.0,
    blur: float = 0.0,
    bandwidth: float = 0.0,
    coating: float | None = None,
    vignetting: Flag = False,
    without_optic: Flag = False,
    truth: bool = True,
    matches: Whole = 2000,
    seed: Whole = 0,
    depth: str | None = None,
    write_scene: Path | None = None,
    calibration: Whole | None = None,
    direct: Whole = 0,
    board: Path | None = None,
) -> None:
    """Show the photograph that a setup would take of a scene, before any glass is bought.

    Writes the photograph, and beside it what is true: NAME_truth.npz with the depth, point, facet and object of every
    pixel and matching points of all views, and NAME_truth.png, the same as a picture. Without --scene a speckled wall
    and a ball are photographed. With --calibration N it writes a folder of photographs of a board instead.

    Parameters
    ----------
    setup
        Setup file (TOML); with f_number and focus_distance_mm the photograph shows blurred seams and depth of field.
    scene
        Scene file (TOML): light and objects.
    output
        Photograph to write, .png or .tif; photo.png without it. With --calibration a folder; calibration without it.
    samples
        Rays a pixel; more is smoother and slower.
    preview
        A quick look: two rays a pixel, and nothing but the photograph.
    colour
        A colour photograph; each colour bent by the glass at its own wavelength.
    bits
        Grey levels of 8, 12 (0 to 4095) or 16 bits.
    exposure
        Share of the full scale that white in full light gets; what suits the picture without it.
    noise
        Noise, standard deviation in grey levels of 8 bits; the simple way.
    full_well
        Electrons that fill a pixel, from the camera's data sheet (EMVA 1288): adds shot noise.
    read_noise
        Electrons of noise in each reading (EMVA 1288: temporal dark noise); needs --full-well.
    black_level
        Grey level where there is no light.
    blur
        Blur of the lens, standard deviation in px.
    bandwidth
        Full width of the band of light, nm, around the setup's wavelength or around each colour's.
    coating
        Light lost at each face of the glass, percent, such as 0.5; what bare glass reflects without it.
    vignetting
        Let the light fall off towards the corners, by the fourth power of the cosine.
    without_optic
        The same camera with nothing before it.
    truth
        With --no-truth only the photograph is written.
    matches
        How many points the truth follows through all views.
    seed
        Of noise and rays: the same seed gives the same photograph.
    depth
        Depth range, mm, as NEAR..FAR, for --calibration and where there is no --scene; the setup's, or the rig's
        working depths, without it.
    write_scene
        Write a scene file to begin with, made to measure for the setup, and nothing else.
    calibration
        Number of photographs of a board, tilted to all sides, near and far; with board.toml and the true poses
        (poses.json), ready for `cyclopean calibrate`.
    direct
        Number of further photographs of the board without the optic, into the folder direct.
    board
        Board file (TOML) for --calibration; a ChArUco board that fits the field without it.
    """
    from ..jobs.simulation import run_simulation
    from ..jobs.simulation_request import Request
    from ..simulation.sensor import Sensor

    sensor = Sensor(bits, exposure, full_well, read_noise, noise, black_level, blur)
    run_simulation(
        Request(
            setup, sensor, scene, output, parse_depths(depth), samples, colour, bandwidth, coating, vignetting,
            without_optic, seed, truth, matches, preview, calibration, direct, board, write_scene,
        )
    )  # fmt: skip
