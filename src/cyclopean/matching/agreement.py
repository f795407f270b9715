"""Cross-checking: a point stays if other views' depth maps have it too."""

import numpy as np

from ..errors import ShapeError


def agreement(inverse_depth, seen, tolerance):
    """Say which pixels of a depth map survive a look at the depth maps of the other views.

    Project the points of the map into the other views and look up their maps there (`DepthMap.at`). A view
    agrees if it has the same inverse depth, it objects if it looks through the point at something farther;
    something nearer hides the point and says nothing. A pixel survives if views agree and no more object.

    Parameters
    ----------
    inverse_depth : (h, w) array
        The map to check, 1/mm; NaN unknown.
    seen : (V-1, h, w) array
        What the maps of the other views have where each point lands, 1/mm; NaN unknown.
    tolerance : float or (h, w) array
        Largest difference between maps that agree, 1/mm; one step of the hypotheses (half a pixel) does well.

    Returns
    -------
    (h, w) bool array
        Pixels that survive.
    """
    inverse_depth, seen = np.asarray(inverse_depth), np.asarray(seen)
    if seen.shape[1:] != inverse_depth.shape:
        raise ShapeError(f"seen must have shape (V-1, h, w) with (h, w) = {inverse_depth.shape}, got {seen.shape}")
    nearer = inverse_depth - seen  # of the point, before what the other view sees
    agree = np.sum(np.abs(nearer) <= tolerance, axis=0)  # comparisons with NaN are false: it says nothing
    object_ = np.sum(nearer > tolerance, axis=0)
    return (agree > 0) & (agree >= object_)
