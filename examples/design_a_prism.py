"""From a camera, a working depth and an accuracy to prisms: what fits, and what each keeps once it is really made."""

from cyclopean import Camera
from cyclopean.design import Requirements, find_designs
from cyclopean.design.catalogue import GRADES
from cyclopean.design.judgement import keep_accuracy

requirements = Requirements(
    camera=Camera((1280, 960), 25 / 0.0055, pixel_pitch=0.0055),  # a 25 mm lens on pixels of 5.5 um
    depths=(600, 1600),
    accuracy=0.001,  # 0.1 % of the depth, at every depth
    facets=(2, 3),
    glasses=("N-BK7",),
    max_diameter=120,
    tolerances=GRADES["commercial"],
)
designs = find_designs(requirements)
print(f"{designs.screened} prisms looked at, {designs.traced} traced, {len(designs.candidates)} fit")

for choice, candidate in zip(designs.chosen[:3], designs.options, strict=False):
    figures, kept = candidate.figures, keep_accuracy(candidate, requirements, draws=100)
    width, height = figures.field
    print(f"{candidate.name}: {', '.join(choice.reasons)}")
    print(
        f"  baseline {figures.baseline:.1f} mm, diameter {figures.diameter:.0f} mm, field {width:.0f} x {height:.0f} mm"
    )
    print(f"  depth to {100 * figures.accuracy:.3f} % on paper, {100 * kept.worst:.3f} % in 95 of 100 prisms as made")
