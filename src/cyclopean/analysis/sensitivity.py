"""How far a triangulated point moves for every parameter that the setup is wrong about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SetupError
from ..geometry import as_points
from ..rigs import Setup
from ..triangulation.sensitivity import PointResponse, point_response


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Shifts of triangulated points (...,) per unit of each parameter.

    Positive means: the **real** setup exceeds the one that is **believed**. Pixels of the real one are triangulated by
    the believed one. First-order formulas that raise the believed parameter instead have the opposite sign.
    """

    names: tuple[str, ...]  # (P,) those of `setup.parameter_names`
    points: np.ndarray  # (..., 3) mm, in the rig frame
    matrix: np.ndarray  # (..., 3, P) mm per unit (mm, rad, px, 1); NaN where fewer than two views see the point
    response: PointResponse  # what pixels do, (...,)

    @property
    def depth(self) -> np.ndarray:
        """(..., P) mm of depth z per unit of each parameter."""
        return self.matrix[..., 2, :]

    def shift(self, changes: Mapping[str, float]) -> np.ndarray:
        """Shift (..., 3) mm for changes (mm, rad, px, 1) of several parameters by name, to first order."""
        unknown = [name for name in changes if name not in self.names]
        if unknown:
            raise SetupError(f"this setup has no parameter {unknown[0]!r}; it has {', '.join(self.names)}")
        return self.matrix @ np.array([changes.get(name, 0.0) for name in self.names])

    def noise(self, sigma: float = 0.1) -> np.ndarray:
        """Standard deviations (..., 3) mm for independent noise of sigma px in every pixel coordinate."""
        return sigma * np.sqrt(np.diagonal(self.response.covariance, axis1=-2, axis2=-1))


def point_sensitivity(setup: Setup, points: ArrayLike, *, seen: ArrayLike | None = None) -> Sensitivity:
    """Derivatives of triangulated points to every parameter of camera and optic.

    Parameters
    ----------
    setup : Setup
        The believed setup.
    points : (..., 3) array
        Points in the rig frame, mm.
    seen : (..., V) bool array, optional
        Which views count; those that see the point where it is not given.

    Returns
    -------
    Sensitivity
        Shift of the point that n-view least squares finds, per unit by which the real setup exceeds the believed.

    Raises
    ------
    SetupError
        When the setup has fewer than two views.
    """
    check_views(setup)
    points = as_points(points)
    response = point_response(setup.rig(), points, seen)
    return Sensitivity(setup.parameter_names, points, response.shifts, response)


def check_views(setup: Setup) -> None:
    """Raise SetupError where an optic gives fewer than the two views that depth needs."""
    views = len(setup.optic.paths(setup.wavelength_nm))
    if views < 2:
        raise SetupError(
            f"depth needs two views or more, and this {setup.optic.kind} gives {views}; "
            "take a prism, or mirrors with a second way of light"
        )
