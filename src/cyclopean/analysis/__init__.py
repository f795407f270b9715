"""What a rig can do: its virtual cameras, baselines, common field of view and depth resolution."""

from .summary import FieldAtDepth, RigSummary, ViewPair, field_at, summarise

__all__ = ["FieldAtDepth", "RigSummary", "ViewPair", "field_at", "summarise"]
