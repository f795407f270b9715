"""A window to measure in: clicks in one sub-image, matches in the others at once.

`MeasuringWindow` works on any matplotlib figure; only `measure_in_window` needs a display.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from ..errors import CyclopeanError, MeasurementError
from ..plotting.measurement import draw_measurements, draw_points
from ..plotting.pictures import draw_outlines
from .measurement_session import Session, shown_value

KEYS = {
    "p": "point", "l": "length", "n": "point-to-line", "d": "point-to-plane", "a": "area", "g": "angle",
}  # fmt: skip
_HELP = (
    "p point   l length   n point-to-line   d depth below a plane   a area   g angle\n"
    "left click: point   right click in another sub-image: correct its match   enter: finish   u undo   s save   q quit"
)


class MeasuringWindow:
    """Draws a session on a figure and passes clicks and keys on to it."""

    def __init__(self, figure: Figure, session: Session, photograph: np.ndarray, save: Callable[[], None]):
        self.figure, self.session, self.save = figure, session, save
        self.closed = False
        self.axes = figure.add_subplot()
        figure.subplots_adjust(left=0.01, right=0.99, bottom=0.09, top=0.95)
        draw_outlines(self.axes, photograph, session.scene.rig)
        self.axes.set_xlim(self.axes.get_xlim())
        self.help = figure.text(0.01, 0.01, _HELP, fontsize=8, va="bottom")
        self.status = figure.text(0.01, 0.97, "", fontsize=10, va="center")
        self._base = set(self.axes.get_children())
        figure.canvas.mpl_connect("button_press_event", self.click)
        figure.canvas.mpl_connect("key_press_event", self.key)
        self.draw()

    def click(self, event) -> None:
        """A mouse button was pressed: a point, or the correction of its match."""
        zooming = getattr(getattr(self.figure.canvas, "toolbar", None), "mode", "")
        if event.inaxes is not self.axes or zooming or event.xdata is None:
            return
        self._do(lambda: self._point(event))

    def key(self, event) -> None:
        """A key was pressed."""
        if event.key in KEYS:
            self._do(lambda: self.session.choose(KEYS[event.key]))
        elif event.key == "enter":
            self._do(self.session.finish)
        elif event.key in ("u", "backspace"):
            self._do(self.session.undo)
        elif event.key == "s":
            self._do(self._save)
        elif event.key == "q":
            self.closed = True
            self.figure.canvas.stop_event_loop()

    def draw(self) -> None:
        """Show the session as it is now."""
        for artist in set(self.axes.get_children()) - self._base:
            artist.remove()
        done = self.session.done
        draw_measurements(self.axes, done, [shown_value(found) for found in done])
        for point, row in zip(self.session.points, self.session.rows, strict=True):
            draw_points(self.axes, [point], row)
        self.status.set_text(f"{self.session.kind}   |   {self.session.message}")
        self.figure.canvas.draw_idle()

    def _point(self, event):
        pixel = (event.xdata, event.ydata)
        if event.button == 1:
            self.session.add(pixel)
        elif event.button == 3:
            self.session.correct(pixel)

    def _save(self):
        self.save()
        self.session.message = f"saved, {len(self.session.done)} measurements"

    def _do(self, action):
        try:
            action()
        except CyclopeanError as error:
            self.session.message = str(error)
        self.draw()


def check_display() -> None:
    """Raise MeasurementError where no window can be opened."""
    headless = sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    if headless or sys.stdout is None or not sys.stdout.isatty():
        raise MeasurementError(
            'there is no display to click in: give points, for example --length "512,300 640,310" (cyclopean measure '
            "--help lists all kinds), or type measurements line by line with --prompt"
        )


def measure_in_window(session: Session, photograph: np.ndarray, save: Callable[[], None]) -> None:
    """Open a window and let the person measure until it is closed.

    Raises
    ------
    MeasurementError
        When matplotlib has no way to open one.
    """
    import matplotlib
    import matplotlib.pyplot as plt

    figure = plt.figure("cyclopean measure", figsize=(12, 9.5))
    if matplotlib.get_backend().lower() in ("agg", "pdf", "svg", "ps", "cairo", "template"):
        raise MeasurementError(
            "matplotlib can open no window here: install a backend (pip install PySide6), or type measurements line by "
            "line with --prompt"
        )
    if figure.canvas.manager is not None and figure.canvas.manager.key_press_handler_id is not None:
        figure.canvas.mpl_disconnect(figure.canvas.manager.key_press_handler_id)  # our keys, not matplotlib's
    window = MeasuringWindow(figure, session, photograph, save)
    figure.canvas.mpl_connect("close_event", lambda event: window.key(type("Closed", (), {"key": "q"})))
    figure.show()
    if not window.closed:
        figure.canvas.start_event_loop()
    plt.close(figure)
