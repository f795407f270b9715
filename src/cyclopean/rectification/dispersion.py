"""Colours that glass spreads: the channels of a photograph brought together, each along its own true rays.

A prism bends red less than blue, so each sub-image shows the three channels some pixels apart, and apart otherwise
in each view. Of three rigs, one for each channel, the middle one (green) is the reference. Its pixels stay; the
other channels are resampled so that they show there what green shows of a surface at one middle depth. What remains
away from that depth, some tenths of a pixel, is no error of the maps: `places` follows each channel's own rays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ImageError, SetupError
from ..geometry import as_pixels, launch
from ..rigs import Region, Rig, Setup, View, ViewLike
from ..rigs.colours import bends_colours, coloured, dispersing

_SPACING = 16  # px between the pixels that are traced exactly; what lies between is off by some 1e-4 px


def channel_rigs(setups: Setup | Sequence[Setup], depths: tuple[float, float] | None = None) -> tuple[Rig, ...]:
    """Rigs of red, green and blue light, with the same pixels in each view.

    Parameters
    ----------
    setups : Setup or sequence of three Setups
        One setup that states its `channel_wavelengths_nm` and whose glass has a dispersion; or a setup for each
        channel, as a calibration of each gives them.
    depths : (2,) mm, optional
        Nearest and farthest depth of interest; the setup's or the rig's where not given.

    Returns
    -------
    tuple of three Rigs
        Red, green, blue. A view's pixels are those of green at which the other channels, too, look through that
        view's facet; along seams they end up to some pixels earlier than those of one channel. Mirrors treat all
        colours alike: three times the same rig.

    Raises
    ------
    SetupError
        When the setup does not state its wavelengths, or the setups do not belong together.
    MediumError
        When the glass is but a number, or has no data at a wavelength.
    """
    setups = _three(setups)
    if not any(bends_colours(setup) for setup in setups):
        rig = setups[1].rig()
        return rig, rig, rig
    rigs = check_channels([setup.rig() for setup in setups])
    if depths is None:
        depths = setups[1].depths or rigs[1].working_depths
    middle = middle_inverse_depth(depths)
    regions = [_shared_region(rigs, k, middle) for k in range(len(rigs[1]))]
    return tuple(
        Rig(tuple(_with_region(view, region) for view, region in zip(rig, regions, strict=True))) for rig in rigs
    )


def knows_channels(setup: Setup) -> bool:
    """Whether a setup states all that `channel_rigs` asks for."""
    if setup.channel_wavelengths_nm is None:
        return False
    return bends_colours(setup) and dispersing(setup) is not None


def middle_inverse_depth(depths: tuple[float, float]) -> float:
    """The inverse depth (1/mm) halfway between those of a range of depths (near, far) mm."""
    return (1 / depths[0] + 1 / depths[1]) / 2


def check_channels(rigs: Rig | Sequence[Rig]) -> tuple[Rig, ...]:
    """Rigs (C,) of the channels of one photograph; of one rig a tuple of one. SetupError where they do not match."""
    channels = (rigs,) if isinstance(rigs, Rig) else tuple(rigs)
    if not channels or len(channels) % 2 == 0:
        raise SetupError(f"give one rig, or three for red, green and blue, got {len(channels)}")
    for what, values in (
        ("views", [len(rig) for rig in channels]),
        ("sizes of photograph", [rig.size for rig in channels]),
    ):
        if len(set(values)) > 1:
            raise SetupError(
                f"the rigs of the channels have different {what}, {', '.join(map(str, values))}: they must be those of "
                "one photograph"
            )
    return channels


def compensated(photograph: np.ndarray, rigs: Sequence[Rig], middle: float) -> np.ndarray:
    """A colour photograph whose channels agree at one depth.

    Parameters
    ----------
    photograph : (H, W, 3) array
        uint8, uint16 or float, red, green, blue.
    rigs : sequence of three Rigs
        Of the channels, from `channel_rigs`.
    middle : float
        Inverse depth (1/mm) at which they agree, such as `middle_inverse_depth` of the depths to search.

    Returns
    -------
    (H, W, 3) array
        Of the same type. Pixel x of a channel shows what the photograph's channel has where its rig sees the point
        that green sees at x at the middle depth, by cubic B-splines. Green, and pixels of no view, stay as they are.

    References
    ----------
    Unser 1999, Splines: a perfect fit for signal and image processing (interpolation by cubic B-splines).
    """
    from scipy.ndimage import spline_filter

    rigs = check_channels(rigs)
    photograph = np.asarray(photograph)
    width, height = rigs[0].size
    if photograph.shape != (height, width, len(rigs)):
        raise ImageError(
            f"colours of a photograph of shape ({height}, {width}, {len(rigs)}) can be brought together, got "
            f"{photograph.shape}"
        )
    result = photograph.copy()
    green = rigs[len(rigs) // 2]
    for c, rig in enumerate(rigs):
        if rig is green:
            continue
        spline = spline_filter(photograph[..., c], order=3, output=np.float32, mode="mirror")
        for own, other in zip(green, rig, strict=True):
            if own.region.traced.any():
                _resampled(spline, own, _lattice(own, other, middle), result[..., c])
    return result


def expected_shifts(rigs: Sequence[Rig], middle: float) -> np.ndarray:
    """Shifts (V, C, 2) px of each channel against green, in the middle of each view, at an inverse depth 1/mm.

    What green shows at x, the photograph's channel shows at x + shift.
    """
    rigs = check_channels(rigs)
    green = rigs[len(rigs) // 2]
    shifts = np.empty((len(green), len(rigs), 2))
    for k, view in enumerate(green):
        centre = view.region.centre
        for c, rig in enumerate(rigs):
            shifts[k, c] = across(view.unbounded(), rig[k].unbounded(), centre, middle) - centre
    return shifts


def places(
    rigs: Rig | Sequence[Rig],
    reference: int,
    pixels: ArrayLike,
    inverse: ArrayLike,
    middle: float | None = None,
) -> np.ndarray:
    """Where the other views show what pixels of a reference view show, by channel, in a compensated photograph.

    Parameters
    ----------
    rigs : Rig or sequence of three Rigs
        One rig for all colours (C = 1), or those of the channels.
    reference : int
        Number of the view that the pixels belong to.
    pixels : (..., 2) array
        Pixels (x, y).
    inverse : (D,) array
        Inverse depths, 1/mm.
    middle : float, optional
        The inverse depth at which the photograph is `compensated`, 1/mm; the middle of the ends of `inverse` where
        not given. One rig needs none.

    Returns
    -------
    (V - 1, D, C, ..., 2) array
        Pixels in the other views, in the order of the rig, along views without borders; NaN where there is no ray.
        A channel's pixel of the compensated photograph looks along that channel's own ray through the place that it
        was taken from, and the point on it at an inverse depth is projected in that channel, then brought back to
        where the compensated photograph of the other view shows it.
    """
    rigs = check_channels(rigs)
    green = rigs[len(rigs) // 2].unbounded()
    pixels, inverse = as_pixels(pixels), np.asarray(inverse, dtype=float)
    at = (inverse[0] + inverse[-1]) / 2 if middle is None else middle
    others = [k for k in range(len(green)) if k != reference]
    result = np.empty((len(others), len(inverse), len(rigs), *pixels.shape))
    for c, channel in enumerate(rigs):
        rig, same = channel.unbounded(), channel is rigs[len(rigs) // 2]
        taken = pixels if same else across(green[reference], rig[reference], pixels, at)
        rays = rig[reference].rays(taken)
        for d, w in enumerate(inverse):  # one depth at a time: the points of all might not fit in memory
            points = rays.at_depth(1 / w)
            for j, other in enumerate(others):
                seen = rig[other].project(points)
                result[j, d, c] = seen if same else across(rig[other], green[other], seen, at)
    return result


def across(source: ViewLike, target: ViewLike, pixels: ArrayLike, inverse_depth: ArrayLike) -> np.ndarray:
    """Where one view sees the points that another sees at pixels, at one depth.

    Parameters
    ----------
    source, target : views
    pixels : (..., 2) array
        Pixels of the source.
    inverse_depth : (...,) array
        Of the points, 1/mm.

    Returns
    -------
    (..., 2) array
        Pixels of the target.
    """
    return target.project(source.rays(pixels).at_depth(1 / np.asarray(inverse_depth)))


def _three(setups):
    if not isinstance(setups, Setup):
        setups = tuple(setups)
        if len(setups) != 3:
            raise SetupError(f"give one setup, or three for red, green and blue, got {len(setups)}")
        return setups
    if setups.channel_wavelengths_nm is None:
        raise SetupError(
            "the setup does not state the wavelengths of its colour channels: give channel_wavelengths_nm, such as "
            "(610, 540, 460), or a setup for each channel"
        )
    return tuple(coloured(setups, nm) for nm in setups.channel_wavelengths_nm)


def _shared_region(rigs, k, middle):
    """The pixels of a view in green at which every other channel looks through the same facet, margins taken off."""
    green = rigs[len(rigs) // 2][k]
    traced, pictured = green.region.traced.copy(), np.ones_like(green.region.traced)
    for rig in rigs:
        if rig[k] is not green and traced.any():
            lattice = _lattice(green, rig[k], middle)
            traced &= _resampled(rig[k].region.traced.astype(np.float32), green, lattice) >= 0.5
            _leave_out_beyond_border(pictured, lattice)
    return Region(Region(traced, green.margin).mask & pictured, 0.0)  # beside the picture's border no margin is due


def _leave_out_beyond_border(pictured, lattice):
    """Take those pixels from a mask (H, W) whose places lie beyond the border of the picture."""
    left, top, nodes = lattice
    height, width = pictured.shape
    reach = int(np.ceil(np.nanmax(np.abs(nodes), initial=0.0)))
    strip = np.ones_like(pictured)
    strip[reach : height - reach, reach : width - reach] = False
    covered = np.zeros_like(pictured)
    covered[top : top + _SPACING * (len(nodes) - 1), left : left + _SPACING * (nodes.shape[1] - 1)] = True
    rows, columns = np.nonzero(strip & covered)
    places = _between(nodes, (columns - left) / _SPACING, (rows - top) / _SPACING) + np.stack([columns, rows], -1)
    pictured[rows, columns] &= ((places >= -0.5) & (places <= np.array([width, height]) - 0.5)).all(-1)


def _with_region(view, region):
    if not isinstance(view, View):
        raise SetupError(f"channels are those of setups; {type(view).__name__} is no view of one")
    return view.with_region(region)


def _lattice(own, other, middle):
    """Left and top px of a lattice over a view's traced pixels, and the shifts (Ny, Nx, 2) of its nodes."""
    used_rows, used_columns = np.flatnonzero(own.region.traced.any(1)), np.flatnonzero(own.region.traced.any(0))
    top, left = int(used_rows[0]), int(used_columns[0])
    width, height = int(used_columns[-1]) - left + 1, int(used_rows[-1]) - top + 1
    columns = left + _SPACING * np.arange(-(-width // _SPACING) + 1)
    rows = top + _SPACING * np.arange(-(-height // _SPACING) + 1)
    pixels = np.stack(np.meshgrid(columns, rows), -1)
    return left, top, across(own.unbounded(), other.unbounded(), pixels, middle) - pixels


def _resampled(spline, own, lattice, out=None):
    """What a channel's B-spline (H, W) has at the places of a view's traced pixels; 0, or what `out` had, elsewhere."""
    from . import kernels

    left, top, nodes = lattice
    out = np.zeros_like(spline) if out is None else out
    largest = float(np.iinfo(out.dtype).max) if np.issubdtype(out.dtype, np.integer) else -1.0
    traced = own.region.traced
    launch(kernels.resample, traced.size, spline, traced, nodes, left, top, _SPACING, largest, out)
    return out


def _between(nodes, u, v):
    """Values (N, 2) of lattice nodes (Ny, Nx, 2) at columns u and rows v (N,), bilinear."""
    from scipy.ndimage import map_coordinates

    return np.stack([map_coordinates(nodes[..., axis], [v, u], order=1) for axis in range(2)], axis=-1)
