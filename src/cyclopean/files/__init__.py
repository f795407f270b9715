"""What goes to disk and comes back: setups, photographs, point clouds, depth maps.

Every file is written beside its place and moved there when it is whole, so that a run that stops half-way
leaves the old file or none, never half a file.
"""

from .boards import read_board, write_board
from .clouds import write_ply
from .depths import read_depths, write_depths
from .disk import output_folder, replacing
from .exchange import NamedCamera, flipped, read_cameras, write_camera, write_cameras
from .matches import write_matches
from .meshes import write_mesh
from .observations import read_observations, write_observations
from .photographs import check_exposure, read_photograph, write_image
from .pinholes import read_pinholes, write_pinholes
from .setups import read_setup, write_setup

__all__ = [
    "NamedCamera",
    "check_exposure",
    "flipped",
    "output_folder",
    "read_board",
    "read_cameras",
    "read_depths",
    "read_observations",
    "read_photograph",
    "read_pinholes",
    "read_setup",
    "replacing",
    "write_board",
    "write_camera",
    "write_cameras",
    "write_depths",
    "write_image",
    "write_matches",
    "write_mesh",
    "write_observations",
    "write_pinholes",
    "write_ply",
    "write_setup",
]
