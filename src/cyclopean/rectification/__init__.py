"""Views brought side by side: maps between sub-images that serve a matcher."""

from .channel_shifts import ChannelShifts, channel_shifts
from .dispersion import (
    channel_rigs,
    check_channels,
    compensated,
    expected_shifts,
    knows_channels,
    middle_inverse_depth,
    places,
)
from .pairs import Pair, exact_depth, partners, per_disparity, pinhole_depth, rectify
from .pinholes import TiltedPinhole, tilted_pinhole
from .sweeps import at_inverse_depths, inverse_depths, sweep

__all__ = [
    "ChannelShifts",
    "Pair",
    "TiltedPinhole",
    "at_inverse_depths",
    "channel_rigs",
    "channel_shifts",
    "check_channels",
    "compensated",
    "exact_depth",
    "expected_shifts",
    "inverse_depths",
    "knows_channels",
    "middle_inverse_depth",
    "partners",
    "per_disparity",
    "pinhole_depth",
    "places",
    "rectify",
    "sweep",
    "tilted_pinhole",
]
