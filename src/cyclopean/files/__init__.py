"""What goes to disk and comes back: setups, photographs, point clouds, depth maps.

Every file is written beside its place and moved there when it is whole, so that a run that stops half-way
leaves the old file or none, never half a file.
"""

from .clouds import write_ply
from .depths import read_depths, write_depths
from .disk import output_folder, replacing
from .photographs import check_exposure, read_photograph, write_image
from .setups import read_setup, write_setup

__all__ = [
    "check_exposure",
    "output_folder",
    "read_depths",
    "read_photograph",
    "read_setup",
    "replacing",
    "write_depths",
    "write_image",
    "write_ply",
    "write_setup",
]
