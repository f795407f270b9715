"""Compiled sums of the normal equations, photograph by photograph."""

import numpy as np
from numba import njit, prange

from ..optics.kernels import OPTIONS


@njit(parallel=True, **OPTIONS)
def grams(order, starts, weights, to_shared, to_pose, miss, out):
    """Gram matrices out (B, S + 7, S + 7) of the weighted rows of each photograph.

    Columns are to_shared (N, 2, S), to_pose (N, 2, 6) and miss (N, 2); order (N,) lists the rows photograph by
    photograph, starts (B + 1,) says where each begins; rows of weight 0 do not count.
    """
    size = to_shared.shape[2]
    whole = size + 7
    for b in prange(len(starts) - 1):
        line = np.empty(whole)
        block = np.zeros((whole, whole))
        for k in range(starts[b], starts[b + 1]):
            row = order[k]
            weight = weights[row]
            if not weight > 0:
                continue
            for c in range(2):
                line[:size] = to_shared[row, c]
                line[size : size + 6] = to_pose[row, c]
                line[size + 6] = miss[row, c]
                for i in range(whole):
                    scaled = weight * line[i]
                    for j in range(i, whole):
                        block[i, j] += scaled * line[j]
        for i in range(whole):
            for j in range(i):
                block[i, j] = block[j, i]
        out[b] = block
