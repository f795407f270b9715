"""Route 3: no calibration photographs, only one or two points at known depths.

Ray sketching needs nothing but the drawing, yet the drawing is never quite what was built. The thesis (section 4.1.3)
puts it right with a single "field point test"; two known depths even do without the drawing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..errors import CyclopeanError, SetupError, ShapeError
from ..geometry import Rays, nearest_point
from ..rigs import PinholeView, Region, Rig, Setup, ViewLike, pinhole_rig, sketch
from ..rigs.virtual import boundary_pixel, sketched
from ..triangulation import triangulate

Parameter = Literal["apex", "distance", "index"]

_FIELDS = {"apex": "apex_deg", "distance": "distance", "index": "glass"}
_ITERATIONS = 30
_LARGEST_STEP = 0.2  # of the parameter: the law is smooth, but a drawing that is far off must not jump through zero
_TOLERANCE = 1e-9  # of the depth


@dataclass(frozen=True, eq=False)
class FieldPointTest:
    """A setup put right by one point at a known depth."""

    setup: Setup  # with the parameter adjusted
    rig: Rig  # what depths are to be found with: sketched virtual cameras, or the views of `setup`
    parameter: str
    before: float  # degrees, mm or an index, as the parameter's own unit is
    after: float
    sigma: float  # standard deviation of `after` that comes from the noise of the point's pixels
    depth_before: float  # mm, of the point with the setup as drawn; NaN where its rays do not meet
    depth: float  # mm, with the setup put right
    converged: bool
    message: str


def field_point_test(
    setup: Setup,
    pixels: ArrayLike,
    depth: float,
    parameter: Parameter = "apex",
    method: Literal["sketch", "rays"] = "sketch",
    boundary: Literal["middle", "edge"] | ArrayLike = "middle",
    depths: tuple[float, float] | None = None,
    sigma_px: float = 0.1,
) -> FieldPointTest:
    """Adjust one number of a drawn setup so that one point comes to lie at its known depth.

    Which number? With A = Z / z_apex - 1, depth errs by -A times the relative error of the apex angle, of n - 1 and
    of the focal length, and by the relative error of the prism's distance (first order, thin prism). The first three
    act in one and the same way, as gamma f in s = gamma f (1 - z_apex / Z): one number puts right all of them. They
    are amplified by A, which is above 1 wherever the scene is beyond twice the prism's distance, and so they dominate
    unless the prism is far away and its distance was hardly measured. Hence "apex" is the default; it then stands for
    the product (n - 1) apex f. Choose "distance" where A times the tolerance of the angle is below the tolerance of
    the distance; the entrance pupil inside a long lens may be unknown by centimetres.

    Parameters
    ----------
    setup : Setup
        As drawn; its optic must have the parameter.
    pixels : (V, 2) array
        The point as each view shows it, NaN where one does not. Not too near: at small A it says little about angles.
    depth : float
        Its known depth, mm (z in the camera's frame).
    parameter : "apex", "distance" or "index"
        What is adjusted.
    method : "sketch" or "rays"
        Whether depth comes from sketched virtual cameras, whose own error at this point is then put right as well, or
        from true rays.
    boundary : "middle", "edge" or pixels (V, 2)
        Which boundary ray of each view is sketched, see `sketch`. The pixels are those of the setup as drawn.
    depths : (2,) mm, optional
        Where the departure of sketched cameras is stated; half and double the depth where not given.
    sigma_px : float
        Standard deviation of each pixel coordinate.

    Returns
    -------
    FieldPointTest
        With `converged` False where no value near the drawn one brings the point to its depth.

    References
    ----------
    Xiao, thesis (National University of Singapore), section 4.1.3.
    """
    pixels = np.asarray(pixels, dtype=float)
    before = _value(setup, parameter)
    views = len(setup.optic.paths(setup.wavelength_nm))
    if pixels.shape != (views, 2):
        raise ShapeError(f"pixels must have shape ({views}, 2), one for each view, got {pixels.shape}")
    if np.isfinite(pixels).all(-1).sum() < 2:
        raise SetupError("the field point must be seen in two views at least: give its pixel in each of them")
    if not 0 < depth < np.inf:
        raise SetupError(f"the depth of the field point must be a positive number of mm, got {depth}")
    if method not in ("sketch", "rays"):
        raise SetupError(f"depth comes from a 'sketch' or from 'rays', got {method!r}")
    if not 0 < sigma_px < np.inf:
        raise SetupError(f"the pixel noise must be a positive number of px, got {sigma_px}")

    drawn = setup.rig()
    rims = _rims(drawn, boundary) if method == "sketch" else None

    def depth_at(value):
        return _depth(_changed(setup, parameter, value).rig(), rims, pixels)

    after, message = _solve(depth_at, before, depth)
    changed = _changed(setup, parameter, after)
    rig = changed.rig()
    if rims is not None:
        span = (0.5 * depth, 2 * depth) if depths is None else depths
        rig = pinhole_rig([sketch(view, span, rim) for view, rim in zip(rig, rims, strict=True)], rig)
    found = triangulate(rig.unbounded(), pixels, sigma_px)
    slope = (depth_at(after * 1.001) - depth_at(after * 0.999)) / (0.002 * after)
    at_first = depth_at(before)
    return FieldPointTest(
        changed, rig, parameter, before, after, float(np.sqrt(found.covariance[2, 2]) / abs(slope)),
        at_first if at_first > 0 else np.nan, float(found.points[2]), message == "converged", message,
    )  # fmt: skip


def _rims(drawn, boundary):
    """The boundary pixel of each view."""
    if not isinstance(boundary, str) and np.shape(boundary) != (len(drawn), 2):
        raise ShapeError(
            f"boundary must be 'middle', 'edge' or pixels ({len(drawn)}, 2), got shape {np.shape(boundary)}"
        )
    every = [boundary] * len(drawn) if isinstance(boundary, str) else np.asarray(boundary, dtype=float)
    return [boundary_pixel(view, one) for view, one in zip(drawn, every, strict=True)]


def _value(setup, parameter) -> float:
    if parameter not in _FIELDS:
        raise SetupError(f"a field point adjusts one of {', '.join(_FIELDS)}, got {parameter!r}")
    if not hasattr(setup.optic, _FIELDS[parameter]):
        raise SetupError(f"the optic ({setup.optic.kind}) has no {parameter} to adjust")
    value: Any = getattr(setup.optic, _FIELDS[parameter])
    if parameter == "index":
        names = setup.optic.parameter_names
        value = setup.optic.parameters(setup.wavelength_nm)[names.index("index")]
    return float(value)


def _changed(setup, parameter, value):
    return replace(setup, optic=replace(setup.optic, **{_FIELDS[parameter]: value}))


def _depth(rig, rims, pixels):
    """Depth of a point by true rays, or by cameras sketched with boundary pixels `rims`.

    Where the rays part it is that of the point behind the camera where they would meet.
    """
    views: list[ViewLike] = [view.unbounded() for view in rig]
    if rims is not None:
        still = Region(np.ones(rig.size[::-1], dtype=bool), 0.0)
        lenses = [sketched(view, rim) for view, rim in zip(rig, rims, strict=True)]
        views = [PinholeView(*lens, still, view.mirrored).unbounded() for lens, view in zip(lenses, rig, strict=True)]
    depth = float(triangulate(views, pixels).points[2])
    if np.isfinite(depth):
        return depth
    rays = [view.rays(pixel) for view, pixel in zip(views, pixels, strict=True)]
    bundle = Rays(np.array([r.origins for r in rays]), np.array([r.directions for r in rays]))
    return float(nearest_point(bundle).points[2])


def _solve(depth_at, start, wanted):
    """The parameter that gives the wanted depth, by the secant method, and what came of the search.

    Sought in inverse depth, which is nearly linear in each of the parameters.
    """
    last, value = start, start * 1.01
    error = 1 / depth_at(last) - 1 / wanted
    for _ in range(_ITERATIONS):
        if abs(error) * wanted <= _TOLERANCE:
            return last, "converged"
        try:
            new = 1 / depth_at(value) - 1 / wanted
        except CyclopeanError as fault:
            return last, f"no setup near the drawn one brings the point to its depth: {fault}"
        if not np.isfinite(new) or new == error:
            break
        step = -new * (value - last) / (new - error)
        last, error = value, new
        value = last + float(np.clip(step, -_LARGEST_STEP * last, _LARGEST_STEP * last))
    return last, "no setup near the drawn one brings the point to its depth; is the depth right, is it the same point?"


@dataclass(frozen=True)
class DepthLaw:
    """Depth from how far apart the two images of a point stand: s = gamma f (1 - z0 / Z).

    Holds for a thin biprism near the middle of the picture; towards the edge of the field it errs by percents.

    References
    ----------
    Lee and Kweon 2000, A novel stereo camera system by a biprism: the virtual points behind the law.
    """

    gamma_f: float  # px, s of a point at infinity: the angle between the two axes times the focal length
    apex_depth: float  # mm, z0: where the two images of a point would meet

    def depth(self, separation: ArrayLike) -> np.ndarray:
        """Depth (...,) mm of points whose images stand (...,) px apart; NaN where no depth fits."""
        separation = np.asarray(separation, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = self.apex_depth / (1 - separation / self.gamma_f)
        return np.where((depth > 0) & np.isfinite(depth), depth, np.nan)

    def separation(self, depth: ArrayLike) -> np.ndarray:
        """How far apart (...,) px the images of points at depths (...,) mm stand."""
        return self.gamma_f * (1 - self.apex_depth / np.asarray(depth, dtype=float))

    def depth_per_px(self, depth: ArrayLike) -> np.ndarray:
        """Change of depth (...,) mm for one px at depths (...,) mm."""
        return np.asarray(depth, dtype=float) ** 2 / (self.gamma_f * self.apex_depth)


def two_depths(separations: ArrayLike, depths: ArrayLike) -> DepthLaw:
    """The depth law of a biprism from points at two known depths, or more: no drawing, no calibration.

    Parameters
    ----------
    separations : (N,) array
        How far apart the two images of each point stand, px (see `separation`); N >= 2.
    depths : (N,) array
        Their known depths, mm. More than two are fitted by least squares in s, which is linear in 1 / Z.

    Raises
    ------
    SetupError
        The depths are all the same, or the images do not draw apart as depth grows.
    """
    separations, depths = np.asarray(separations, dtype=float), np.asarray(depths, dtype=float)
    if separations.ndim != 1 or separations.shape != depths.shape or len(depths) < 2:
        raise ShapeError(
            f"wanted two separations or more and as many depths, got shapes {separations.shape} and {depths.shape}"
        )
    if not (np.isfinite(separations).all() and np.isfinite(depths).all() and (depths > 0).all()):
        raise SetupError("separations and depths must be numbers, and the depths positive: leave out what was not seen")
    if np.ptp(1 / depths) < 1e-6 * np.max(1 / depths):
        raise SetupError(f"all depths are the same, {depths[0]:g} mm: the law needs two different ones")
    matrix = np.stack([np.ones_like(depths), -1 / depths], -1)
    gamma_f, product = np.linalg.lstsq(matrix, separations, rcond=None)[0]
    if not (gamma_f > 0 and product > 0):
        raise SetupError(
            f"the images of far points must stand further apart than those of near ones, got {separations} px at "
            f"{depths} mm; are first and second view swapped?"
        )
    return DepthLaw(float(gamma_f), float(product / gamma_f))


def separation(pixels: ArrayLike, azimuth_deg: float = 0.0) -> np.ndarray:
    """How far apart the two images of points stand across the seam of a biprism, px.

    Parameters
    ----------
    pixels : (..., 2, 2) array
        Each point in view 0 and view 1, (x, y).
    azimuth_deg : float
        Direction in the photograph from view 1's sub-image to view 0's: 0 to the right, 90 down. It is the prism's
        `azimuth_deg` when the facets look at the scene.
    """
    pixels = np.asarray(pixels, dtype=float)
    if pixels.shape[-2:] != (2, 2):
        raise ShapeError(f"pixels must have shape (..., 2, 2), a pixel in each of two views, got {pixels.shape}")
    azimuth = np.deg2rad(azimuth_deg)
    return (pixels[..., 0, :] - pixels[..., 1, :]) @ [np.cos(azimuth), np.sin(azimuth)]
