"""What the facet angle does to baseline, common field and depth resolution of a biprism."""

from cyclopean import Camera, Prism, Setup, summarise

camera = Camera((1280, 960), 2400)
print("angle (deg)  baseline (mm)  shared at 900 mm (%)  sigma of depth at 900 mm for 0.1 px (mm)")
for apex_deg in (6, 8, 10, 12):
    rig = Setup(camera, Prism(facets=2, apex_deg=apex_deg, glass="PMMA", distance=120)).rig()
    summary = summarise(rig, depths=(600, 1350))
    middle = summary.fields[2]
    print(
        f"{apex_deg:11d}  {summary.pairs[0].baseline:13.1f}  {100 * middle.share_two:20.0f}  {middle.sigma_two:40.2f}"
    )
