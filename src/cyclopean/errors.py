"""Every exception of the package. A message says what came, what was wanted and what to try."""


class CyclopeanError(Exception):
    """Base of all errors that this package raises on purpose."""


class ShapeError(CyclopeanError, ValueError):
    """An array has the wrong shape."""


class MediumError(CyclopeanError, ValueError):
    """An optical medium is unknown, or asked for outside the range of its data."""


class OpticError(CyclopeanError, ValueError):
    """An optic cannot exist, or lets no light through."""


class SetupError(CyclopeanError, ValueError):
    """A setup, or the file that describes it, is wrong."""


class ImageError(CyclopeanError, ValueError):
    """A photograph is missing, unreadable, or does not belong to the setup."""


class CalibrationError(CyclopeanError, ValueError):
    """A calibration ended with something that cannot be right."""


class MeasurementError(CyclopeanError, ValueError):
    """Points do not make the thing that is to be measured."""


class OutputError(CyclopeanError, OSError):
    """Results cannot be written."""
