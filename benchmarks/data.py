"""Where the photographs with known truth lie, and what took them; the tests look here too."""

import json
import os
from pathlib import Path

from cyclopean import Camera, Prism, Setup

ROOT = Path(__file__).resolve().parents[1]


def data_folder(name: str) -> Path:
    """Find a folder of test photographs.

    Parameters
    ----------
    name : str
        `mitsuba` for rendered photographs with the true point of every pixel, `real` for real ones.

    Returns
    -------
    Path
        The folder of that name inside the one that the environment variable `CYCLOPEAN_DATA` names; if unset,
        inside `shared/data` beside the repository.

    Raises
    ------
    FileNotFoundError
        There is no such folder.
    """
    given = os.environ.get("CYCLOPEAN_DATA")
    folder = (Path(given) if given else ROOT.parent / "shared" / "data") / name
    if not folder.is_dir():
        raise FileNotFoundError(f"no folder {folder}; set CYCLOPEAN_DATA to the folder that holds {name}/")
    return folder


def renderer_setup(name: str) -> Setup:
    """The true setup of rendered photographs, from `mitsuba/rigs/NAME.json`."""
    rig = json.loads((data_folder("mitsuba") / "rigs" / f"{name}.json").read_text())
    camera, prism = rig["camera"], rig["prism"]
    size, distortion = (camera["width"], camera["height"]), camera["dist_k1k2p1p2k3"]
    return Setup(
        Camera.from_matrix(camera["K"], size, distortion),
        Prism(
            facets=prism["n_facets"],
            apex_deg=prism["alpha_deg"],
            glass=prism["index"],
            distance=prism["standoff"],
            thickness=prism["apex_height"],
            radius=prism["radius"],
            facing={"apex_scene": "scene", "apex_camera": "camera"}[prism["orientation"]],
            azimuth_deg=prism["phi0_deg"],
            tilt_deg=tuple(prism["tilt_rvec_deg"]),
            shift=tuple(prism["shift_xy"]),
        ),
    )
