"""The thesis's experiment with a biprism, on computed corners: how well each approach recovers known depths."""

from cyclopean.experiments import (
    DrawingError,
    as_markdown,
    perform,
    standard_setup,
    summary_table,
    synthetic,
    thesis_table,
)

setup = standard_setup(facets=2, baseline=40)  # 3 for trinocular, 4 or more for multi-ocular
depths = range(600, 1601, 200)  # mm
drawing = DrawingError(apex_deg=0.05, distance=1, tilt_deg=0.2)  # by how much what is drawn is off what is built
material = synthetic(setup, depths, drawing=drawing, noise_px=0.05)

experiment = perform(material, ("ray sketch (middle)", "virtual cameras, intrinsics free", "physical model"))
print(as_markdown(thesis_table(experiment)))
print(as_markdown(summary_table(experiment)))
