"""Dots that all look the same, matched with 2, 3, 4 and 5 views of one prism: more views leave fewer false matches."""

import numpy as np

from cyclopean import Camera, Prism, Rig, Setup
from cyclopean.correspondence import match_points
from cyclopean.epipolar import epipolar_curves

camera = Camera((1280, 960), 2400)
views = Setup(camera, Prism(facets=5, apex_deg=12, glass="N-BK7", distance=60, azimuth_deg=90)).rig().views

# a tilted sheet of dots 5 mm apart, whose rows run along the epipolar curves of the first two views
curve = epipolar_curves(Rig(views), 0, camera.centre, (300, 3000), bounded=False).pixels[1]
roll = np.arctan2(*(curve[-1] - curve[0])[::-1])
x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-150, 150, 5.0), np.arange(-150, 150, 5.0)))
x, y = np.cos(roll) * x - np.sin(roll) * y, np.sin(roll) * x + np.cos(roll) * y
dots = np.stack([x, y, 700 + 0.15 * x - 0.1 * y], axis=-1)

print("views  matches  false (%)  of those in 3 views (%)  of those that are clear (%)")
for count in (2, 3, 4, 5):
    rig, random = Rig(views[:count]), np.random.default_rng(0)
    numbers = [np.flatnonzero(np.isfinite(view.project(dots)[:, 0])) for view in rig]
    pixels = [
        view.project(dots[seen]) + random.normal(0, 0.1, (len(seen), 2))
        for view, seen in zip(rig, numbers, strict=True)
    ]
    matches = match_points(rig, pixels, depths=(300, 3000), sigma=0.1, max_ambiguity=1)

    # the matcher never saw the dots' numbers; here they tell which matches join different dots
    named = np.stack([np.append(seen, -1)[rows] for seen, rows in zip(numbers, matches.source.T, strict=True)], axis=1)
    false = ((named != named.max(axis=1, keepdims=True)) & (matches.source >= 0)).any(axis=1)
    sure, clear = matches.views >= 3, matches.ambiguity <= 0.2
    of_sure = f"{100 * false[sure].mean():23.1f}" if sure.any() else " " * 22 + "-"
    print(f"{count:5d}  {len(matches):7d}  {100 * false.mean():9.1f}  {of_sure}  {100 * false[clear].mean():27.1f}")
