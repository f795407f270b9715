"""The light on the sensor: what a setup's camera gets from a scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import SetupError
from ..geometry import Rays, launch
from ..optics import Path
from ..rigs import Setup
from .checks import check_optic, check_scene
from .lens import Band, Samples, bands, pupil, spread
from .scene import Scene
from .shading import Shading

LANES = 64  # pixels that the kernels take at a time
_TILE = 2**19  # rays that are held at a time
_MOST_SAMPLES = 2**16
_LARGEST = 2**28  # pixels


def render(
    setup: Setup,
    scene: Scene,
    *,
    samples: int = 16,
    colour: bool = False,
    bandwidth_nm: float = 0.0,
    coating: float | None = None,
    with_optic: bool = True,
    natural_vignetting: bool = False,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> np.ndarray:
    """The light on every pixel of the photograph that a setup would take of a scene.

    Rays leave each pixel spread over its square (a box filter), over the lens's pupil where the setup states f_number
    and focus_distance (a thin lens, as `Setup.blend_band` takes it), and over the wavelengths of the band. Each is
    bent along the first way through the optic that takes it; light that misses the optic is black. Lamps shine
    straight on the scene, not through the optic.

    Parameters
    ----------
    setup : Setup
        Camera and optic.
    scene : Scene
        What stands in front of them.
    samples : int
        Rays a pixel, and a colour where glass splits colours.
    colour : bool
        Red, green and blue instead of grey. Where the glass disperses each is traced at its own wavelength: the
        setup's channel_wavelengths_nm, or 610, 540 and 460 nm. A grey camera sees a colour as the mean of its three.
    bandwidth_nm : float
        Full width of the band of light around the setup's wavelength, or around each channel's.
    coating : float, optional
        Reflectance of every refracting surface, such as 0.005; that of the bare glass where not given (Fresnel,
        unpolarised light). Mirrors lose nothing.
    with_optic : bool
        False: the camera alone.
    natural_vignetting : bool
        Whether light falls off with the fourth power of the cosine of the field angle.
    seed : int
        Of the spread of the rays. The same seed gives the same picture, on any number of threads.
    progress : callable, optional
        Called as ``progress(done, total)`` now and then.

    Returns
    -------
    (H, W) or (H, W, 3) float32 array
        1 is a white matte surface in full light with nothing lost. The even change of radiance with the index of
        the medium that the scene stands in is left out.

    Raises
    ------
    OpticError
        When the camera stands in the glass, or no light reaches it.
    SetupError
        When no surface is in front of the optic, one reaches into it, or an argument makes no sense.
    """
    _check_arguments(setup, samples, coating, seed)
    groups = bands(setup, samples, colour, bandwidth_nm, with_optic)
    paths = groups[len(groups) // 2].lines[len(groups[0].lines) // 2]
    if with_optic:
        check_optic(setup, paths)
    check_scene(setup, scene, paths)
    work = _Work(setup, Shading(scene), samples, coating, natural_vignetting, seed)
    width, height = setup.camera.size
    light = np.empty((height * width, 3 if colour else 1), dtype=np.float32)
    for number, band in enumerate(groups):

        def tell(done, number=number):
            if progress is not None:
                progress(number * len(light) + done, len(groups) * len(light))

        light[:, band.channels] = work.band(band, colour, tell)
    return light.reshape(height, width, 3) if colour else light.reshape(height, width)


def _check_arguments(setup, samples, coating, seed):
    width, height = setup.camera.size
    if samples != int(samples) or not 1 <= samples <= _MOST_SAMPLES:
        raise SetupError(f"samples must be a whole number of rays a pixel, 1 to {_MOST_SAMPLES}, got {samples}")
    if seed != int(seed) or seed < 0:
        raise SetupError(f"the seed must be a whole number of 0 or more, got {seed}")
    if width * height > _LARGEST:
        raise SetupError(
            f"a picture of {width} x {height} px is too large to hold in memory; simulate a smaller camera, "
            "such as one with pixels twice as large"
        )
    if coating is not None and not 0 <= coating < 1:
        raise SetupError(f"the coating's reflectance must lie between 0 and 1, such as 0.005, got {coating}")


@dataclass(frozen=True, eq=False)
class _Rays:
    """Room for the rays of a tile, N of them."""

    origins: np.ndarray  # (N, 3) mm, of rays in air, then behind the optic
    directions: np.ndarray  # (N, 3)
    out_origins: np.ndarray
    out_directions: np.ndarray
    near_origins: np.ndarray  # (N, 3) float32, as Embree takes them
    near_directions: np.ndarray
    way: np.ndarray  # (N,) int8, number of the path, -1 none
    passed: np.ndarray  # (N,) part of the light that gets through the optic
    falloff: np.ndarray  # (N,), or (0,)
    values: np.ndarray  # (N, channels) float32

    @classmethod
    def room(cls, count, channels, falloff):
        """Room for so many rays."""
        double, single = np.empty((4, count, 3)), np.empty((2, count, 3), dtype=np.float32)
        return cls(
            double[0], double[1], double[2], double[3], single[0], single[1], np.empty(count, dtype=np.int8),
            np.empty(count), np.empty(count if falloff else 0), np.empty((count, channels), dtype=np.float32),
        )  # fmt: skip

    def part(self, count):
        """The first so many rays."""
        return _Rays(*(array[:count] for array in vars(self).values()))


@dataclass(frozen=True, eq=False)
class _Work:
    """All that a picture's bands have in common."""

    setup: Setup
    shading: Shading
    samples: int
    coating: float | None
    falloff: bool
    seed: int

    def band(self, band: Band, colour: bool, tell: Callable[[int], None]) -> np.ndarray:
        """Light (H * W, channels of the band) on every pixel; `tell` hears how many pixels are done."""
        width, height = self.setup.camera.size
        spreading = spread(self.samples, len(band.lines), self.seed)
        ways = [_Way.of([line[k] for line in band.lines]) for k in range(len(band.lines[0]))]
        mix = _mix(self.shading.channels, band.channels, colour)
        run = min(self.samples, _TILE // LANES)  # samples at a time
        step = _TILE // run // LANES * LANES  # pixels at a time
        room = _Rays.room(min(step, width * height) * run, self.shading.channels, self.falloff)
        light = np.zeros((width * height, len(band.channels)))
        for first in range(0, len(light), step):
            pixels = min(step, len(light) - first)
            for start in range(0, self.samples, run):
                some = Samples(spreading.places[start : start + run], spreading.line[start : start + run])
                rays = room.part(pixels * len(some.line))
                self._trace(rays, some, ways, first, pixels)
                self._shade(rays, pixels, mix, light[first : first + pixels])
            tell(first + pixels)
        return light / self.samples

    def _trace(self, rays: _Rays, samples: Samples, ways: list[_Way], first: int, pixels: int) -> None:
        """Fill `rays` with those of pixels `first` and on, behind the optic."""
        from . import kernels

        camera = self.setup.camera
        launch(
            kernels.primary_rays, len(rays.way), first, pixels, camera.size[0], samples.places, self.seed % 2**32,
            camera.lens, camera.fold_radius, *pupil(self.setup), rays.origins, rays.directions, rays.falloff,
        )  # fmt: skip
        rays.way.fill(-1)
        rays.passed.fill(0.0)
        rays.near_directions.fill(np.nan)
        coating = np.nan if self.coating is None else float(self.coating)
        for number, way in enumerate(ways):
            shut = np.empty(0, dtype=bool)
            if way.path.blockers:
                shut = way.path.obstructed(Rays(rays.origins, rays.directions))
            launch(
                kernels.send, len(rays.way), rays.origins, rays.directions, pixels, samples.line, number, shut,
                way.path.index_start, way.planes, *way.path.packed[1:], coating, self.shading.triangles.middle,
                rays.way, rays.passed, rays.out_origins, rays.out_directions, rays.near_origins, rays.near_directions,
            )  # fmt: skip

    def _shade(self, rays: _Rays, pixels: int, mix: np.ndarray, out: np.ndarray) -> None:
        """Add the light that comes along the rays of a tile to `out` (pixels, C)."""
        from . import kernels

        hits = self.shading.triangles.first(rays.near_origins, rays.near_directions)
        values = self.shading.values(rays.out_origins, rays.out_directions, hits, rays.values)
        if self.falloff:
            rays.passed[:] *= rays.falloff
        launch(kernels.gather, len(hits), values, rays.passed, pixels, mix, out)


@dataclass(frozen=True, eq=False)
class _Way:
    """One way through the optic, at all wavelengths of a band."""

    path: Path  # at one of them; only the indices differ
    planes: np.ndarray  # (L, S, 6), see optics/kernels.py

    @classmethod
    def of(cls, paths: list[Path]) -> _Way:
        """The way that paths of several wavelengths are."""
        return cls(paths[0], np.stack([path.packed.planes for path in paths]))


def _mix(channels, wanted, colour):
    """(channels, wanted): how the channels of the scene's light make those of the picture."""
    if not colour:
        return np.full((channels, 1), 1 / channels)
    if channels == 1:
        return np.ones((1, len(wanted)))
    return np.eye(3)[:, wanted]
