"""Virtual clips with known truth: an object that prints through a gel with dots.

The contact model moves the gel (a sticking core, a slipping ring, macro slip), and the object moves
over it. The dots move with the gel, and the print with the object: the object's relief bends the
gel where it presses, and three lamps of different colours show the slopes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter, map_coordinates

from contactmodel.contact import Contact
from contactmodel.grid import Grid
from contactmodel.pose import Pose
from estimation.choices import ContactSettings
from estimation.estimators.result import State
from estimation.fields.plane import fit_motion
from estimation.pictures.render import Camera, cover_with_dots, digitise, project_discs
from estimation.pictures.stream import Picture
from estimation.virtual.contact import values_at
from estimation.virtual.gel import Gel, count_from_touch, move_gel, press_object
from estimation.virtual.relief import Lamps, make_relief


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Content of a virtual clip; all random numbers come from the seed.

    Attributes:
        contact: pad, object, its shape, friction, and a grid that covers the view, with its origin
            at the point of first contact.
        path: poses of the object, one for each frame. The object touches where the approach is
            above 0; rotation and shift count from the last frame before first contact.
        relief: the object's print, texture, edges, stripes or smooth.
        slope: root mean square of the relief's slope where it is steep [-].
        centre: point of first contact, from the middle of the view [mm].
        first: number of poses before the clip; the clip starts loaded if the object touches then.
        kinetic: friction after long macro slip, as a share of static friction [-]. It is valid
            while everything slides in one direction.
        weakening: sliding distance over which friction falls to it [mm].
        pitch: distance between dots [mm].
        dot_radius: of the dots [mm].
        dot_angle: rotation of the dots' rows [rad].
        camera: size, scale, blur, noise, level of the light, and contrast of the dots.
        lamps: around the view.
        rate: pictures per second [1/s].
        seed: of relief, noise and positions of the dots.

    Raises:
        ValueError: fewer than two poses remain after the first, or a share or length is out of
            range.

    Examples:
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, make_path
        >>> from estimation import Scene, VirtualClip
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, friction_coefficient=0.5)
        >>> path = make_path([Pose(0.0), Pose(0.0), Pose(1.0)], steps=[2, 2])
        >>> scene = Scene(contact=contact, path=path, relief="edges", pitch=1.2, rate=50.0)
        >>> clip = VirtualClip(scene)
        >>> print(f"{len(clip.dots)} dots, {len(clip) / scene.rate:.2f} s")
        252 dots, 0.08 s
    """

    contact: Contact
    path: Pose
    relief: str = "texture"
    slope: float = 0.1
    centre: tuple[float, float] = (0.0, 0.0)
    first: int = 0
    kinetic: float = 1.0
    weakening: float = 0.3
    pitch: float = 1.9
    dot_radius: float = 0.3
    dot_angle: float = 0.0
    camera: Camera = field(
        default_factory=lambda: Camera(
            320, 240, 0.06, background=125.0, contrast=95.0, shading=0.15
        )
    )
    lamps: Lamps = field(default_factory=Lamps)
    rate: float = 25.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.path.approach.ndim != 1 or not 0 <= self.first < len(self.path.approach) - 1:
            raise ValueError(
                f"a clip requires a path of two poses or more after the first {self.first}: make "
                "one with contactmodel.make_path"
            )
        if not (0.0 <= self.kinetic <= 1.0 and self.weakening > 0.0):
            raise ValueError(
                f"kinetic is {self.kinetic}, weakening {self.weakening} mm: friction falls to a "
                "share from 0 to 1, over a distance above 0"
            )


class ClipTruth(NamedTuple):
    """Truth of a virtual clip, by frame.

    Attributes:
        state: of the contact: `macro_slip` if at most 2 % of it stick, else by the share of
            sticking dots under the object.
        holding: number of sticking dots under the object.
        angle: of the object since first contact [rad, from x to y of the picture]; NaN before.
        shift: of the object's axis since first contact [mm]; NaN before.
        gel_angle: rotation of the gel under the object, from the tenth of it that has slipped least
            [rad]; NaN before.
        gel_shift: displacement of the same gel at the object's first axis [mm]; NaN before.
        slip: of the object over the gel where it has slipped least [mm]: 0 while a cell has stuck
            since first contact, and near the centre of a rotation; NaN before.
        stick_ratio: share of the contact that sticks [-].
        force: on the gel [N].
        moment: on the gel about the object's axis [N·mm].

    Examples:
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, make_path
        >>> from estimation import Scene, VirtualClip
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, friction_coefficient=0.5)
        >>> path = make_path([Pose(0.0), Pose(0.0), Pose(1.0), Pose(1.0, twist=0.15)], [2, 3, 9])
        >>> truth = VirtualClip(Scene(contact=contact, path=path)).truth
        >>> print(f"{truth.state[-1]}, {truth.moment[-1]:.1f} N·mm, onset {truth.onset}")
        incipient, 5.7 N·mm, onset None
    """

    state: tuple[State, ...]
    holding: Int[np.ndarray, " frames"]
    angle: Float[np.ndarray, " frames"]
    shift: Float[np.ndarray, "frames 2"]
    gel_angle: Float[np.ndarray, " frames"]
    gel_shift: Float[np.ndarray, "frames 2"]
    slip: Float[np.ndarray, " frames"]
    stick_ratio: Float[np.ndarray, " frames"]
    force: Float[np.ndarray, "frames 3"]
    moment: Float[np.ndarray, " frames"]

    @property
    def slip_angle(self) -> Float[np.ndarray, " frames"]:
        """Rotation of the object against the gel that has slipped least [rad]."""
        return self.angle - self.gel_angle

    @property
    def onset(self) -> int | None:
        """First frame of macro slip; None without one."""
        return self.state.index(State.MACRO_SLIP) if State.MACRO_SLIP in self.state else None


class VirtualClip:
    """A virtual clip: its truth, and its pictures, which are drawn on demand.

    Attributes:
        scene: content of the clip.
        dots: positions in the undeformed gel, from the middle of the view [mm].
        gel: the gel in each frame.
        truth: of each frame.

    Examples:
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, make_path
        >>> from estimation import Scene, VirtualClip
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, friction_coefficient=0.5)
        >>> path = make_path([Pose(0.0), Pose(0.0), Pose(1.0)], steps=[2, 2])
        >>> clip = VirtualClip(Scene(contact=contact, path=path))
        >>> print(f"{len(clip)} pictures of {len(clip.dots)} dots, {clip.draw(0).shape}")
        4 pictures of 120 dots, (240, 320, 3)
    """

    def __init__(self, scene: Scene) -> None:
        """Solve the contact along the path.

        Args:
            scene: content of the clip.

        Raises:
            ValueError: there is no such relief.
            RuntimeError: the contact solver does not converge.
        """
        fine = 0.25  # cell of the relief [px]
        self.scene = scene
        rng = np.random.default_rng(scene.seed)
        self.dots = _lay_dots(scene, rng)
        camera = scene.camera
        reach = np.hypot(camera.width, camera.height) * camera.mm_per_px
        self._relief = make_relief(scene.relief, scene.slope, reach, fine * camera.mm_per_px, rng)
        rows = slice(scene.first, None)
        self.gel = move_gel(scene.contact, scene.path, scene.kinetic, scene.weakening).take(rows)
        self._place = np.asarray(scene.path.shift)[rows]
        self._turned = np.asarray(scene.path.twist)[rows]
        self._press = press_object(scene.contact, np.asarray(scene.path.approach)[rows])
        poses = count_from_touch(scene.path)
        self.truth = _find_truth(
            self.gel,
            np.asarray(poses.twist)[rows],
            np.asarray(poses.shift)[rows],
            self.dots - np.array(scene.centre),
        )

    def __len__(self) -> int:
        """Number of pictures."""
        return len(self.truth.angle)

    def __iter__(self) -> Iterator[Picture]:
        """The pictures in order."""
        for frame in range(len(self)):
            yield Picture(self.draw(frame), frame / self.scene.rate, frame)

    def draw(self, frame: int) -> UInt8[np.ndarray, "height width 3"]:
        """Draw the picture of a frame, in BGR.

        Args:
            frame: of the clip, counted from 0.
        """
        scene, camera = self.scene, self.scene.camera
        rng = np.random.default_rng((scene.seed, frame))
        level = scene.lamps.light(camera, self.height(frame))
        if camera.blur > 0.0:
            level = cv2.GaussianBlur(level, (0, 0), camera.blur)

        def move(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
            return points + self.moved(frame, points)

        centres, axes = project_discs(camera, move, self.dots, scene.dot_radius)
        cover = cover_with_dots(camera, centres, axes)[..., None]
        return digitise(camera, level * (1.0 - camera.contrast / camera.background * cover), rng)

    def height(self, frame: int) -> Float[np.ndarray, "height width"]:
        """Depth of the gel's surface at each pixel, including the object's relief [mm].

        Args:
            frame: of the clip.
        """
        # share of the largest pressure from which the object's relief prints completely [-]
        full_print = 0.3
        scene, (depth, pressure) = self.scene, (field[frame] for field in self._press)
        if not pressure.any():
            return np.zeros((scene.camera.height, scene.camera.width))
        seen = np.minimum(pressure / (full_print * pressure.max()), 1.0)
        depth, seen = self._show(frame, [depth, seen])
        return depth + np.clip(seen, 0.0, 1.0) * self.relief_at(frame)

    def relief_at(self, frame: int) -> Float32[np.ndarray, "height width"]:
        """Height of the object's relief at each pixel, even without contact [mm].

        Args:
            frame: of the clip.
        """
        axis = np.array(self.scene.centre) + self._place[frame]
        return self._relief.at(self.scene.camera, axis, float(self._turned[frame]))

    def _show(self, frame: int, fields: list[np.ndarray]) -> list[np.ndarray]:
        """Fields of the object's face at each pixel, which turn and shift with the object."""
        step = 4  # spacing of the points at which the fields are looked up [px]
        camera, truth = self.scene.camera, self.truth
        y, x = (step * np.arange(-(-size // step) + 1.0) for size in (camera.height, camera.width))
        middle = 0.5 * (np.array([camera.width, camera.height]) - 1)
        now = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) - middle
        arm = camera.mm_per_px * now - self.scene.centre - truth.shift[frame]
        own = arm @ _rotation(truth.angle[frame])
        pixels = np.arange(camera.height), np.arange(camera.width)
        coarse = [_look_up(self.gel.grid, gaussian_filter(values, 1.0), own) for values in fields]
        # a spline has smooth slopes; other interpolations would print a lattice into the picture
        return [RectBivariateSpline(y, x, values.reshape(len(y), -1))(*pixels) for values in coarse]

    def moved(self, frame: int, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Displacement of points of the gel [mm].

        Args:
            frame: of the clip.
            points: positions in the undeformed gel, from the middle of the view [mm].
        """
        own = points - np.array(self.scene.centre)
        fields = self.gel.displacement[frame]
        return np.column_stack([_look_up(self.gel.grid, field, own) for field in fields])


def write_pictures(clip: VirtualClip, folder: Path) -> None:
    """Write a clip as a folder of pictures with `times.csv`, which `estimation run` reads.

    Args:
        clip: the clip.
        folder: of the pictures; created if it does not exist.

    Raises:
        OSError: the folder cannot be written to.

    Examples:
        >>> from pathlib import Path
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, make_path
        >>> from estimation import Scene, VirtualClip, write_pictures
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, friction_coefficient=0.5)
        >>> path = make_path([Pose(0.0), Pose(0.0), Pose(1.0)], steps=[2, 2])
        >>> write_pictures(VirtualClip(Scene(contact=contact, path=path)), Path("clip"))
        >>> print(*sorted(file.name for file in Path("clip").iterdir())[-3:])
        0002.png 0003.png times.csv
    """
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["frame,time_s"]
    for picture in clip:
        name = folder / f"{picture.number:04d}.png"
        if picture.image is None or not cv2.imwrite(str(name), picture.image):
            raise OSError(f"{name} cannot be written: check free space and permissions")
        lines.append(f"{picture.number},{picture.time:.6f}")
    (folder / "times.csv").write_text("\n".join(lines) + "\n")


def _look_up(grid: Grid, field: np.ndarray, points: np.ndarray) -> np.ndarray:
    """A field of the grid at points [mm]; outside the grid, its value at the rim."""
    place = points / np.array(grid.spacing) + 0.5 * (np.array(grid.shape) - 1)
    return map_coordinates(field, place.T, order=3, mode="nearest")


def _lay_dots(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Dots of the unloaded gel, in and around the view [mm]."""
    camera = scene.camera
    reach = 0.5 * np.hypot(camera.width, camera.height) * camera.mm_per_px + 2.0 * scene.pitch
    row = np.arange(-np.ceil(reach / scene.pitch), np.ceil(reach / scene.pitch) + 1)
    nodes = np.stack(np.meshgrid(row, row), axis=-1).reshape(-1, 2) + rng.uniform(-0.5, 0.5, 2)
    dots = scene.pitch * nodes @ _rotation(scene.dot_angle).T
    half = 0.5 * np.array([camera.width, camera.height]) * camera.mm_per_px + scene.pitch
    return dots[(np.abs(dots) < half).all(axis=1)]


def _find_truth(gel: Gel, twist: np.ndarray, shift: np.ndarray, dots: np.ndarray) -> ClipTruth:
    # the gel's motion is that of the cells that have slipped least: their share of the contact
    # [-], and their least number
    followers, fewest = 0.1, 4
    contact = gel.contact
    touching = np.asarray(contact.any(axis=(1, 2)))
    angle = np.where(touching, twist, np.nan)
    gel_angle, slip = np.full((2, len(angle)), np.nan)
    gel_shift = np.full((len(angle), 2), np.nan)
    for frame in np.flatnonzero(touching):
        far = np.linalg.norm(gel.slip[frame][:, contact[frame]], axis=0)
        best = np.argsort(far)[: max(int(followers * len(far)), fewest)]
        moved = gel.displacement[frame][:, contact[frame]][:, best]
        slip[frame] = far.min()
        points = np.asarray(gel.grid.points)[:, contact[frame]][:, best]
        gel_angle[frame], gel_shift[frame] = _move_rigidly(points, moved)
    under, holding = (values_at(gel.grid, mask, dots).sum(axis=1) for mask in (contact, gel.stick))
    ratio = gel.stick.sum(axis=(1, 2)) / np.maximum(contact.sum(axis=(1, 2)), 1)
    return ClipTruth(
        state=tuple(
            map(_judge, under.tolist(), holding.tolist(), ratio.tolist(), touching.tolist())
        ),
        holding=holding,
        angle=angle,
        shift=np.where(touching[:, None], shift, np.nan),
        gel_angle=gel_angle,
        gel_shift=gel_shift,
        slip=slip,
        stick_ratio=ratio,
        force=gel.force,
        moment=gel.moment,
    )


def _move_rigidly(points: np.ndarray, moved: np.ndarray) -> tuple[float, np.ndarray]:
    """Rotation of points that have moved as a rigid body [rad], and motion of the origin [mm]."""
    x, y = (place[0] + 1j * place[1] for place in (points, points + moved))
    motion = fit_motion(x, y)
    turn = motion.angle
    to = motion.image - np.exp(1j * turn) * motion.origin
    return turn, np.array([to.real, to.imag])


def _rotation(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _judge(under: int, holding: int, ratio: float, touching: bool) -> State:
    """The state, by the dots under the object, the sticking dots and the sticking area's ratio."""
    if not touching:
        return State.NO_CONTACT
    if ratio < 0.02:  # not 0, because the centre of a rotation on the spot rests
        return State.MACRO_SLIP
    enough = holding >= ContactSettings().stick_share * under
    return State.STICK if enough else State.INCIPIENT
