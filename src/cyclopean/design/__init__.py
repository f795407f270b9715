"""From what is wanted to the prism to buy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import lazy

if TYPE_CHECKING:
    from .catalogue import ToleranceGrade, grade, stock_angles_deg
    from .choice import choose, judge_choices
    from .evaluation import evaluate
    from .judgement import KeptAccuracy, keep_accuracy
    from .requirements import Candidate, Choice, Designs, Explanation, Figures, Relaxation, Requirements
    from .search import find_designs

_HOMES = {
    "Candidate": "requirements",
    "Choice": "requirements",
    "Designs": "requirements",
    "Explanation": "requirements",
    "Figures": "requirements",
    "KeptAccuracy": "judgement",
    "Relaxation": "requirements",
    "Requirements": "requirements",
    "ToleranceGrade": "catalogue",
    "choose": "choice",
    "evaluate": "evaluation",
    "find_designs": "search",
    "grade": "catalogue",
    "judge_choices": "choice",
    "keep_accuracy": "judgement",
    "stock_angles_deg": "catalogue",
}
__all__ = [
    "Candidate",
    "Choice",
    "Designs",
    "Explanation",
    "Figures",
    "KeptAccuracy",
    "Relaxation",
    "Requirements",
    "ToleranceGrade",
    "choose",
    "evaluate",
    "find_designs",
    "grade",
    "judge_choices",
    "keep_accuracy",
    "stock_angles_deg",
]
__getattr__ = lazy(__name__, _HOMES)
