"""How far pixels lie from epipolar curves, and at which depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ShapeError
from ..geometry import launch
from .curves import EpipolarCurves


def distance_to_curves(
    curves: EpipolarCurves, pixels: ArrayLike, beyond: float = 5.0, within: float = np.inf
) -> tuple[np.ndarray, np.ndarray]:
    """Distance of pixels from epipolar curves, and the inverse depth of their feet.

    Parameters
    ----------
    curves : EpipolarCurves
        (...,) curves in V views.
    pixels : (..., V, 2) array
        Pixels, one in each view, NaN for none. What stands before V broadcasts with the shape of the curves: curves
        of shape (N, 1) and pixels (M, V, 2) give all N x M pairs.
    beyond : float
        A foot may lie this many standard deviations of the curve (and 0.01 px at least) beyond the ends of the depth
        range.
    within : float
        Distance (px) beyond which a pixel is of no interest and its answer NaN: much faster for many candidates.

    Returns
    -------
    distance : (..., V) array
        px; positive to the right of the curve as one walks from far to near in the photograph. NaN beyond the ends of
        the curve. Where the border of a sub-image cuts a curve, it goes on for one step between samples.
    inverse_depth : (..., V) array
        1/mm, of the foot.

    Notes
    -----
    Between samples the curve is a cubic with the slopes of parabolas through neighbours (Catmull and Rom 1974).
    """
    from . import kernels

    pixels = np.asarray(pixels, dtype=float)
    views, count = curves.pixels.shape[-3:-1]
    if pixels.shape[-2:] != (views, 2):
        raise ShapeError(f"pixels must have shape (..., {views}, 2), one pixel for each view, got {pixels.shape}")
    before = curves.pixels.shape[:-3]
    try:
        shape = np.broadcast_shapes(before, pixels.shape[:-2])
    except ValueError:
        raise ShapeError(f"curves of shape {before} and pixels of shape {pixels.shape} do not broadcast") from None
    samples = np.ascontiguousarray(curves.pixels).reshape(-1, views, count, 2)
    bands = np.maximum(np.nan_to_num(curves.sigma, posinf=0.0) * beyond, 0.01).reshape(-1, views, count)
    flat = np.ascontiguousarray(pixels).reshape(-1, views, 2)
    curve_of, pixel_of = (
        np.ascontiguousarray(np.broadcast_to(np.arange(rows).reshape(given), shape)).reshape(-1)
        for rows, given in ((len(samples), before), (len(flat), pixels.shape[:-2]))
    )
    out = np.empty((len(curve_of), views, 2))
    strips = np.empty((len(samples), views, 4))
    launch(kernels.strips, len(samples) * count, samples, strips)
    launch(kernels.feet, len(curve_of) * 8, samples, strips, bands, flat, float(within), curve_of, pixel_of, out)
    out = out.reshape(*shape, views, 2)
    step = curves.inverse_depths[1] - curves.inverse_depths[0]
    return out[..., 0], curves.inverse_depths[0] + out[..., 1] * step
