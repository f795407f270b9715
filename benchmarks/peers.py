"""Other packages' ways to trace rays and project points through glass, each behind the same few lines.

A maker takes a problem and gives a `Contender`; it imports its package inside, so that a missing package is
skipped. Arrays are handed to each package in the layout it likes best, outside the clock.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Layers:
    """Planes that light from the camera crosses in turn."""

    points: np.ndarray  # (S, 3) mm, one on each plane
    normals: np.ndarray  # (S, 3) unit, away from the camera
    indices: tuple[float, ...]  # (S + 1,) refractive index before, between and after the planes
    name: str = ""

    def __iter__(self):
        """Point, normal, and index before over index after, of each plane."""
        ratios = np.divide(self.indices[:-1], self.indices[1:])
        return iter(zip(self.points, self.normals, ratios.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Pinhole:
    """A camera without distortion."""

    focal: tuple[float, float]  # px
    centre: tuple[float, float]  # px
    size: tuple[int, int]  # (width, height) px

    def pixels(self, slopes: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of directions that rise by `slopes` (..., 2) = (x/z, y/z)."""
        return slopes * self.focal + self.centre

    def directions(self, pixels: np.ndarray) -> np.ndarray:
        """Unit vectors (..., 3) along which the camera sees these pixels (..., 2)."""
        slopes = (pixels - self.centre) / self.focal
        directions = np.concatenate([slopes, np.ones_like(slopes[..., :1])], axis=-1)
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Contender:
    """One way to solve a problem.

    Only `run` is timed. It gets what `fresh` gives (a new state for an interface that works in place), and
    `answer` makes an array to check out of what it gives back; None where there is nothing to check.
    """

    name: str
    run: Callable
    answer: Callable | None
    fresh: Callable = lambda: None


# Tracing: camera, layers and pixels (N, 2) -> exit points and directions, (N, 6); unit vectors are made beforehand


def trace(layers: Layers, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Exit points (N, 3) and directions (N, 3) of rays from the origin: Snell's law as vectors, by planes."""
    points = np.zeros(3)
    for plane, normal, ratio in layers:
        cos_in = directions @ normal
        points = points + (((plane - points) @ normal) / cos_in)[:, None] * directions
        cos_out = np.sqrt(1 - ratio**2 * (1 - cos_in**2))
        directions = ratio * directions + (cos_out - ratio * cos_in)[:, None] * normal
    return points, directions


def numpy_tracing(camera: Pinhole, layers: Layers, pixels: np.ndarray) -> Contender:
    """Plain NumPy, the few lines anyone would write."""
    directions = camera.directions(pixels)
    return Contender("NumPy", run=lambda _: trace(layers, directions), answer=np.hstack)


def batoid_tracing(camera: Pinhole, layers: Layers, pixels: np.ndarray) -> Contender:
    """batoid, rays already in its own form and overwritten in place; they stay in the last plane's frame."""
    import batoid

    directions = camera.directions(pixels)
    media = [batoid.ConstMedium(index) for index in layers.indices]
    frames = [batoid.CoordSys(point, frame(normal)) for point, normal, _ in layers]
    plane, zeros, velocities = batoid.Plane(), np.zeros(len(directions)), np.ascontiguousarray(directions.T)

    def fresh():
        return batoid.RayVector(zeros, zeros, zeros, *velocities)

    def run(rays):
        for number, coordinates in enumerate(frames):
            plane.refract(rays, media[number], media[number + 1], coordSys=coordinates)
        return rays

    def answer(rays):
        rays = rays.copy().toCoordSys(batoid.CoordSys())
        return np.hstack([rays.r, rays.v / np.linalg.norm(rays.v, axis=-1, keepdims=True)])

    return Contender("batoid, in place", run, answer, fresh)


def batoid_tracing_arrays(camera: Pinhole, layers: Layers, pixels: np.ndarray) -> Contender:
    """batoid, arrays to arrays: with the making of its rays inside the clock."""
    within = batoid_tracing(camera, layers, pixels)
    return Contender("batoid, new rays", lambda _: within.run(within.fresh()), within.answer)


def optiland_tracing(camera: Pinhole, layers: Layers, pixels: np.ndarray, backend: str = "numpy") -> Contender:
    """optiland, without the records that it can keep at each surface."""
    import optiland.backend as be

    be.set_backend(backend)
    be.set_precision("float64")
    surfaces, directions = optiland_surfaces(layers), camera.directions(pixels)
    columns = [be.array(column) for column in (*np.zeros((3, len(directions))), *directions.T)]
    one = be.array(np.ones(1))

    def run(_):
        from optiland.rays import RealRays

        rays = RealRays(*columns, one, one)
        for surface in surfaces:
            rays = surface.trace(rays, record=False)
        return rays

    def answer(rays):
        return np.stack([be.to_numpy(getattr(rays, name)) for name in "xyzLMN"], axis=-1)

    return Contender(f"optiland, {backend}", run, answer)


def optiland_tracing_torch(camera: Pinhole, layers: Layers, pixels: np.ndarray) -> Contender:
    """optiland on its PyTorch backend (on a processor)."""
    import torch  # noqa: F401

    return optiland_tracing(camera, layers, pixels, "torch")


def optiland_surfaces(layers: Layers) -> list:
    """The layers as optiland's standard surfaces, in its current backend."""
    from optiland.coordinate_system import CoordinateSystem
    from optiland.geometries import Plane
    from optiland.materials import IdealMaterial
    from optiland.surfaces import ObjectSurface, Surface

    before = ObjectSurface(Plane(CoordinateSystem()), IdealMaterial(layers.indices[0]))
    surfaces = []
    for point, normal, index in zip(layers.points, layers.normals, layers.indices[1:], strict=True):
        # optiland turns about x, then y: z -> (sin ry cos rx, -sin rx, cos ry cos rx)
        turns = {"rx": -np.arcsin(normal[1]), "ry": np.arctan2(normal[0], normal[2])}
        before = Surface(before, IdealMaterial(index), Plane(CoordinateSystem(*point, **turns)))
        surfaces.append(before)
    return surfaces


def aquakit_tracing(camera: Pinhole, layers: Layers, pixels: np.ndarray) -> Contender:
    """aquakit's plane intersection and Snell's law, put together for tilted planes (PyTorch)."""
    import torch
    from aquakit import snells_law_3d
    from aquakit.interface import ray_plane_intersection

    start = torch.tensor(camera.directions(pixels))
    origins = torch.zeros_like(start)
    planes = [(torch.tensor(normal), float(point @ normal), ratio) for point, normal, ratio in layers]

    def run(_):
        points, rays = origins, start
        for normal, offset, ratio in planes:
            points, _ = ray_plane_intersection(points, rays, normal, offset)
            rays, _ = snells_law_3d(rays, normal, ratio)
        return points, rays

    def answer(result):
        return np.hstack([part.numpy() for part in result])

    return Contender("aquakit's parts, torch", run, answer)


def frame(normal: np.ndarray) -> np.ndarray:
    """A rotation (3, 3) whose third column is the unit vector `normal`."""
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(normal, across), normal], axis=-1)


TRACING = [
    numpy_tracing,
    batoid_tracing,
    batoid_tracing_arrays,
    optiland_tracing,
    optiland_tracing_torch,
    aquakit_tracing,
]


# Projecting: camera, layers and points (N, 3) -> pixels (N, 2)


def project(camera: Pinhole, layers: Layers, points: np.ndarray) -> np.ndarray:
    """Pixels (N, 2) of points (N, 3) behind the layers: Newton's method on the miss at each point's depth."""

    def miss(slopes):
        exits, directions = trace(layers, camera.directions(camera.pixels(slopes)))
        along = (points[:, 2] - exits[:, 2]) / directions[:, 2]
        return exits[:, :2] + along[:, None] * directions[:, :2] - points[:, :2]

    slopes, step = points[:, :2] / points[:, 2:], 1e-6
    for _ in range(20):
        here = miss(slopes)
        columns = [(miss(slopes + step * axis) - here) / step for axis in np.eye(2)]
        (a, c), (b, d) = columns[0].T, columns[1].T
        determinant = a * d - b * c
        change = np.stack([d * here[:, 0] - b * here[:, 1], a * here[:, 1] - c * here[:, 0]], axis=-1)
        change /= determinant[:, None]
        slopes = slopes - change
        if np.abs(change).max() < 1e-9:  # the next change would be about 1e-6 of this one
            break
    return camera.pixels(slopes)


def numpy_projecting(camera: Pinhole, layers: Layers, points: np.ndarray) -> Contender:
    """Plain NumPy: Newton's method on traced rays, derivatives by differences."""
    return Contender("NumPy, Newton", lambda _: project(camera, layers, points), np.asarray)


def aquakit_projecting(camera: Pinhole, layers: Layers, points: np.ndarray) -> Contender:
    """aquakit: one flat surface that faces the camera."""
    import torch
    from aquakit.projection import RefractiveProjectionModel

    (height,), (index_in, index_out) = layers.points[:, 2], layers.indices
    (fx, fy), (cx, cy) = camera.focal, camera.centre
    matrix = torch.tensor([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=torch.float64)
    identity, zeros = torch.eye(3, dtype=torch.float64), torch.zeros(3, dtype=torch.float64)
    model = RefractiveProjectionModel(matrix, identity, zeros, float(height), -identity[2], index_in, index_out)
    targets = torch.tensor(points)
    return Contender("aquakit, torch", lambda _: model.project(targets), lambda result: result[0].numpy())


def optv_projecting(camera: Pinhole, layers: Layers, points: np.ndarray) -> Contender:
    """OpenPTV's optv: one plate that faces the camera. Its frame has y up and z towards the camera."""
    from optv.calibration import Calibration
    from optv.imgcoord import flat_image_coordinates
    from optv.parameters import ControlParams, MultimediaParams
    from optv.transforms import convert_arr_metric_to_pixel

    far, (before, within, after) = float(layers.points[1, 2]), layers.indices
    media = MultimediaParams(n1=before, n2=[within], n3=after, d=[float(np.diff(layers.points[:, 2])[0])])
    sensor = ControlParams(1, image_size=camera.size, pixel_size=(1 / camera.focal[0], 1 / camera.focal[1]))
    eye = Calibration(
        pos=np.array([0.0, 0.0, 2 * far]),
        angs=np.zeros(3),
        prim_point=np.array([0.0, 0.0, 1.0]),
        rad_dist=np.zeros(3),
        decent=np.zeros(2),
        affine=np.array([1.0, 0.0]),
        glass=np.array([0.0, 0.0, far]),
    )
    turned = np.ascontiguousarray(points * [1.0, -1.0, -1.0] + [0.0, 0.0, 2 * far])
    shift = np.array(camera.centre) - np.array(camera.size) / 2  # optv measures from the picture's middle

    def run(_):
        return convert_arr_metric_to_pixel(flat_image_coordinates(turned, eye, media), sensor)

    return Contender("optv (OpenPTV)", run, lambda pixels: pixels + shift)
