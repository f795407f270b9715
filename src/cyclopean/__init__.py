"""Stereo vision with a single lens: prisms and mirrors that fold several views into one photograph.

>>> from cyclopean import Camera, Prism, Setup
>>> setup = Setup(Camera((1280, 960), 2400), Prism(facets=3, apex_deg=12, glass="N-BK7", distance=60))
>>> rig = setup.rig()  # three views
"""

from __future__ import annotations

from .lazy import lazy

__version__ = "0.1.0"

_HOMES = {
    "Board": "targets",
    "Camera": "cameras",
    "FieldOfView": "analysis",
    "Matches": "correspondence",
    "Mirror": "optics",
    "Mirrors": "optics",
    "Observations": "targets",
    "Plate": "optics",
    "Prism": "optics",
    "Reason": "optics",
    "Rays": "geometry",
    "Requirements": "design",
    "Rig": "rigs",
    "Scene": "simulation",
    "Setup": "rigs",
    "View": "rigs",
    "VirtualCamera": "rigs",
    "build_mesh": "fusion",
    "calibrate": "calibration",
    "common_volume": "analysis",
    "epipolar_curves": "epipolar",
    "error_budget": "analysis",
    "errors": "",
    "find_designs": "design",
    "fuse": "fusion",
    "match_features": "correspondence",
    "match_points": "correspondence",
    "measure": "measurement",
    "media": "optics",
    "medium": "optics",
    "observe": "targets",
    "read_photograph": "files",
    "read_setup": "files",
    "reconstruct": "pipeline",
    "reconstruct_by_pairs": "pipeline",
    "reliability": "analysis",
    "render": "simulation",
    "sgbm": "matching",
    "summarise": "analysis",
    "tolerance_analysis": "analysis",
    "trace_truth": "simulation",
    "triangulate": "triangulation",
    "write_setup": "files",
}
__all__ = sorted([*_HOMES, "__version__"])
__getattr__ = lazy(__name__, _HOMES)  # `import cyclopean` itself costs nothing


def __dir__():
    return __all__
