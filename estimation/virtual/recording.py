"""The virtual pivot: simulated recordings with known truth.

A sphere is pressed into a flat elastomer and twisted. Pressing follows Hertz, twisting the torsion
of a Hertz contact with slip, and reversals Masing's rule (`contactmodel.analytic`). The closed
forms hold for pressing without friction, and for bodies that do not couple pressure to shear. They
are extended to finite rotations: every point at radius r moves on its circle by the angle u_θ(r)/r,
so that sticking points move exactly with the object.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from contactmodel import analytic
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.neighbours import grid_neighbours
from estimation.frames.recording import Frame, MarkerLayout, Recording


class PivotModel(NamedTuple):
    """Sphere, elastomer and markers of a virtual pivot.

    Both bodies, the sphere included, twist like half-spaces. Therefore do not fit this data with
    the radius of a ball (`calibration softness --radius-mm`).

    Attributes:
        contact_radius: a under full load [mm].
        approach: the elastomer's share of δ under full load [mm].
        friction_ratio: μp0/2G* [-]; together with the twist it determines the extent of slip.
        shear_modulus: of the elastomer [MPa].
        poisson_ratio: of the elastomer [-].
        stiffness_ratio: k = G_S/G_B [-].
        grid_shape: rows and columns of the markers.
        pitch: distance between markers [mm].
        offset: of the object's axis from the middle of the markers [mm].
        grid_angle: rotation of the markers' rows [rad].
        noise: standard deviation of each marker's x and y [mm].
        normal_noise: standard deviation of each marker's z [mm].

    Examples:
        >>> from estimation import PivotModel, simulate_pivot
        >>> model = PivotModel(contact_radius=4.0, grid_shape=(10, 12), pitch=1.5)
        >>> recording, truth = simulate_pivot(model)
        >>> print(recording.layout.grid_shape, f"{truth.contact[-1].sum()} markers in contact")
        (10, 12) 21 markers in contact
    """

    contact_radius: float = 5.0
    approach: float = 1.2
    friction_ratio: float = 0.15
    shear_modulus: float = 0.2
    poisson_ratio: float = 0.48
    stiffness_ratio: float = 0.0
    grid_shape: tuple[int, int] = (20, 20)
    pitch: float = 1.0
    offset: tuple[float, float] = (0.3, -0.2)
    grid_angle: float = 0.0
    noise: float = 1e-3
    normal_noise: float = 3.5e-3


class Truth(NamedTuple):
    """Truth of a virtual recording.

    Attributes:
        angle: the object's rotation since first contact [rad, counter-clockwise]; NaN before.
        contact: markers under the object.
        stick: markers that have stuck ever since full load.
        sticking_now: markers that do not slip now, even if they slipped before the last reversal.
        slip: of the object against the elastomer at each marker in contact, along x and y [mm].
        stick_radius: radius within which markers do not slip now [mm]; 0 without contact.
        moment: of the object on the sensor about z [N·mm].
        macro_slip: frames with contact in which fewer than three markers do not slip.
        stiffness_ratio: k [-].
        load_term: L = L_xy − L_yx [rad]; 0 for half-spaces.

    Examples:
        >>> import numpy as np
        >>> from estimation import simulate_pivot
        >>> _, truth = simulate_pivot()
        >>> first = np.flatnonzero(truth.macro_slip)[0]
        >>> print(f"macro slip from frame {first} on, at {np.degrees(truth.angle[first]):.1f}°")
        macro slip from frame 158 on, at -18.3°
    """

    angle: Float[np.ndarray, " frames"]
    contact: Bool[np.ndarray, "frames n"]
    stick: Bool[np.ndarray, "frames n"]
    sticking_now: Bool[np.ndarray, "frames n"]
    slip: Float[np.ndarray, "frames n 2"]
    stick_radius: Float[np.ndarray, " frames"]
    moment: Float[np.ndarray, " frames"]
    macro_slip: Bool[np.ndarray, " frames"]
    stiffness_ratio: float
    load_term: float = 0.0

    def take(self, rows: Int[np.ndarray, " rows"] | slice) -> "Truth":
        """Select frames of the truth."""
        arrays = {
            name: value[rows]
            for name, value in self._asdict().items()
            if isinstance(value, np.ndarray)
        }
        return self._replace(**arrays)


class Timing(NamedTuple):
    """Timing of a camera's frames.

    Attributes:
        rate: frames per second [1/s].
        dropped: share of lost frames [-].
        jitter: standard deviation of the time stamps [s].

    Examples:
        >>> import numpy as np
        >>> from estimation import Timing, simulate_pivot
        >>> exact = Timing(rate=50.0, dropped=0.0, jitter=0.0)
        >>> recording, _ = simulate_pivot(timing=exact)
        >>> print(np.diff(recording.time)[:3].round(3))  # s
        [0.02 0.02 0.02]
    """

    rate: float = 30.0
    dropped: float = 0.05
    jitter: float = 2e-3


class Camera(NamedTuple):
    """Imperfections of a sensor: noise, lost frames and an uneven clock."""

    # standard deviation of each marker's x and y, and of its z [mm]
    noise: tuple[float, float] = (1e-3, 3.5e-3)
    timing: Timing = Timing()  # timing of the frames
    noise_window: int = 3  # length of the tracker's running mean [frames]; 1 for white noise
    seed: int = 0  # of the random numbers


def simulate_pivot(
    model: PivotModel | None = None,
    *,
    angles_deg: Sequence[float] = (0.0, 10.0, 10.0, -30.0),
    frames: Sequence[int] = (40, 15, 120),
    unloaded: int = 10,
    pressing: int = 15,
    timing: Timing | None = None,
    noise_window: int = 3,
    seed: int = 0,
) -> tuple[Recording, Truth]:
    """Simulate a pivot: unloaded, pressed, then twisted from angle to angle.

    The default path is a lift, a hold, and a reversal through zero up to macro slip.

    Args:
        model: sphere, elastomer and markers.
        angles_deg: the object's angle at the ends of the path's legs [deg].
        frames: number of frames of each leg.
        unloaded: number of frames before the object touches.
        pressing: number of frames of the approach, without twist.
        timing: timing of the frames; by default 30 a second, of which one in twenty is lost.
        noise_window: length of the tracker's running mean [frames]; 1 for white noise.
        seed: of the random numbers.

    Returns:
        The recording, and the truth of its frames.

    Raises:
        ValueError: a leg has no frames.

    Examples:
        >>> from estimation import simulate_pivot
        >>> recording, truth = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> print(recording.positions.shape, f"{truth.sticking_now[-1].sum()} markers stick")
        (43, 400, 3) 13 markers stick
    """
    model, timing = model or PivotModel(), timing or Timing()
    if min(frames) < 1:
        raise ValueError(f"frames is {tuple(frames)}; every leg must have at least 1 frame")
    legs = zip(angles_deg[:-1], angles_deg[1:], frames, strict=True)
    twist = np.radians(np.concatenate([np.linspace(a, b, count + 1)[1:] for a, b, count in legs]))
    load = np.r_[np.zeros(unloaded), np.arange(1, pressing + 1) / pressing, np.ones(len(twist))]
    twist = np.r_[np.full(unloaded, np.nan), np.zeros(pressing), twist]
    layout = lay_out_markers(model)
    positions, truth = deform(model, layout, load, twist)
    force = np.pad(-_normal_force(model, load)[:, None], ((0, 0), (2, 0)))
    camera = Camera((model.noise, model.normal_noise), timing, noise_window, seed)
    source = f"virtual pivot from closed forms, seed {seed}"
    perfect = see_all(layout, positions, force=force, name="virtual-pivot", source=source)
    return record(perfect, truth, camera)


def see_all(
    layout: MarkerLayout, positions: Float[np.ndarray, "frames n 3"], **about: Any
) -> Recording:
    """A recording that sees all markers in 30 frames per second; `about` are its other fields."""
    rows = np.arange(len(positions))
    seen = np.ones(positions.shape[:2], dtype=bool)
    return Recording(layout, positions, seen, rows / 30.0, rows, **about)


def record(perfect: Recording, truth: Truth, camera: Camera) -> tuple[Recording, Truth]:
    """Add moments, and a camera's noise, lost frames and uneven clock, to a perfect recording.

    Returns:
        The recording, and the truth of its frames.
    """
    rng, window = np.random.default_rng(camera.seed), camera.noise_window
    timing = camera.timing
    count = len(perfect)
    white = rng.normal(size=(count + window - 1, *perfect.layout.reference.shape))
    running = np.cumsum(np.pad(white, ((1, 0), (0, 0), (0, 0))), axis=0)
    noise = (running[window:] - running[:-window]) / np.sqrt(window)
    lateral, normal = camera.noise
    positions = perfect.positions + noise * np.array([lateral, lateral, normal])
    rows = np.nonzero(rng.random(count) >= timing.dropped)[0]
    ticks = np.arange(count) / timing.rate + rng.normal(size=count) * timing.jitter
    recording = replace(
        perfect.take(rows),
        positions=positions[rows],
        time=np.maximum.accumulate(ticks)[rows] + 1e-6 * np.arange(len(rows)),
        moment=truth.moment[rows, None] * np.array([0.0, 0.0, 1.0]),
    )
    return recording, truth.take(rows)


def simulate_frame(
    model: PivotModel, angle: float, rng: np.random.Generator
) -> tuple[MarkerLayout, Frame, Bool[np.ndarray, " n"]]:
    """Simulate one frame under full load, pressed and then twisted by an angle [rad].

    Returns:
        The markers, the frame, and the markers that stick.
    """
    layout = lay_out_markers(model)
    positions, truth = deform(model, layout, np.ones(1), np.array([angle]))
    positions = positions[0] + rng.normal(size=positions[0].shape) * _noise_scale(model)
    frame = Frame(
        positions=positions,
        time=0.0,
        source_index=0,
        wrench=(*[np.nan] * 5, float(truth.moment[0])),
    )
    return layout, frame, truth.stick[0]


def lay_out_markers(model: PivotModel) -> MarkerLayout:
    """Lay out the markers of the unloaded, flat elastomer, with the object's axis at the origin."""
    rows, columns = model.grid_shape
    y, x = np.meshgrid(
        np.arange(rows) - (rows - 1) / 2, np.arange(columns) - (columns - 1) / 2, indexing="ij"
    )
    c, s = np.cos(model.grid_angle), np.sin(model.grid_angle)
    points = model.pitch * np.stack([c * x - s * y, s * x + c * y, 0.0 * x], -1).reshape(-1, 3)
    return MarkerLayout(
        reference=points - np.array([*model.offset, 0.0]),
        neighbours=grid_neighbours(model.grid_shape),
        grid_shape=model.grid_shape,
    )


def deform(
    model: PivotModel,
    layout: MarkerLayout,
    load: Float[np.ndarray, " frames"],
    twist: Float[np.ndarray, " frames"],
) -> tuple[Float[np.ndarray, "frames n 3"], Truth]:
    """Compute positions without noise, and the truth, for loads and twists.

    Loads are shares of the full approach [-]. Twists [rad] are NaN without contact.
    """
    points = layout.reference[:, :2]
    r = np.hypot(points[:, 0], points[:, 1])
    turned, stick_radius, moment = twist_rotation(model, r, np.nan_to_num(twist))
    radius = model.contact_radius * np.sqrt(load)[:, None]
    depth, stretch = press_depth(model, r, load)
    surface = stretch[..., None] * _turn(points, turned)
    sticking_turn = (1.0 + model.stiffness_ratio) * turned  # of the object if it had stuck
    slip = _turn(points, np.nan_to_num(twist)[:, None]) - _turn(points, sticking_turn)
    touching = load > 0
    contact = r < radius
    stick_radius = np.where(touching, stick_radius, 0.0)
    sticking = contact & (r < stick_radius[:, None])
    slipping = touching & (stick_radius < radius[:, 0])
    ever = np.minimum.accumulate(np.where(touching, stick_radius, np.inf))
    truth = Truth(
        angle=np.where(touching, twist, np.nan),
        contact=contact,
        stick=contact & (r < ever[:, None]),
        sticking_now=sticking,
        slip=np.where(contact[..., None], slip, 0.0),
        stick_radius=stick_radius,
        moment=np.where(touching, moment, 0.0),
        macro_slip=slipping & (sticking.sum(axis=1) < MIN_STICK_MARKERS),
        stiffness_ratio=model.stiffness_ratio,
    )
    return np.concatenate([surface, -depth[..., None]], axis=-1), truth


def _turn(
    points: Float[np.ndarray, "n 2"], angle: Float[np.ndarray, "frames k"]
) -> Float[np.ndarray, "frames n 2"]:
    """Rotate points about the origin [mm]."""
    (x, y), c, s = points.T, np.cos(angle), np.sin(angle)
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def twist_rotation(
    model: PivotModel, r: Float[np.ndarray, " n"], twist: Float[np.ndarray, " frames"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation of the elastomer at each radius, stick radius and moment along a path of twists."""
    turns = analytic.open_turns(twist.tolist())
    branches = [
        (0.5 * (end - opened[-1]) if opened else end)
        for opened, end in zip(turns, twist.tolist(), strict=True)
    ]
    needed = {*branches, *(opened[0] for opened in turns if opened)}
    needed |= {0.5 * (b - a) for opened in turns for a, b in pairwise(opened)}
    arguments = sorted(needed)
    rotations, ratios, moments = _virgin(
        r, np.array(arguments), model.contact_radius, model.friction_ratio
    )
    place = {argument: i for i, argument in enumerate(arguments)}

    def follow(table: np.ndarray) -> np.ndarray:
        return np.stack(
            [
                analytic.masing(lambda t: table[place[t]], opened, end)
                for opened, end in zip(turns, twist.tolist(), strict=True)
            ]
        )

    pair_modulus = model.shear_modulus / (1.0 + model.stiffness_ratio)
    return (
        follow(rotations) / (1.0 + model.stiffness_ratio),
        model.contact_radius * ratios[[place[branch] for branch in branches]],
        follow(moments) * pair_modulus,
    )


def press_depth(
    model: PivotModel, r: Float[np.ndarray, " n"], load: Float[np.ndarray, " frames"]
) -> tuple[np.ndarray, np.ndarray]:
    """Depth of each point under each load [mm], and the factor by which its radius changes [-]."""
    scale = np.sqrt(np.maximum(load, 1e-18))
    radius = (model.contact_radius * scale)[:, None]
    peak = (_peak_pressure(model) * scale)[:, None]
    modulus, poisson_ratio = model.shear_modulus, model.poisson_ratio
    depth = analytic.hertz_indentation(r, radius, peak, 2.0 * modulus / (1.0 - poisson_ratio))
    inward = analytic.hertz_radial_displacement(r, radius, peak, modulus, poisson_ratio)
    return np.asarray(depth), np.asarray(1.0 + inward / np.maximum(r, 1e-12))


def _virgin(
    r: Float[np.ndarray, " n"], twist: Float[np.ndarray, " m"], radius: float, friction_ratio: float
) -> tuple[Float[np.ndarray, "m n"], Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """First loading: u_θ/r of the pair at each radius, κ, and the moment over G*."""
    density = analytic.hertz_density(radius, friction_ratio)
    ratio = np.asarray(analytic.lubkin_stick_ratio(twist, friction_ratio))
    displacement = analytic.torsion_displacement(r, density, ratio[:, None] * radius, radius)
    rotation = np.sign(twist)[:, None] * np.asarray(displacement) / np.maximum(r, 1e-12)
    moment = np.sign(twist) * np.asarray(
        analytic.torsion_moment(density, ratio * radius, radius, 1.0)
    )
    return rotation, ratio, moment


def _peak_pressure(model: PivotModel) -> float:
    """p0 at full load, from the elastomer's share of the approach [MPa]."""
    modulus = 2.0 * model.shear_modulus / (1.0 - model.poisson_ratio)
    return 2.0 * modulus * model.approach / (np.pi * model.contact_radius)


def _normal_force(model: PivotModel, load: np.ndarray) -> np.ndarray:
    """P [N]."""
    return 2.0 / 3.0 * np.pi * model.contact_radius**2 * _peak_pressure(model) * load**1.5


def _noise_scale(model: PivotModel) -> np.ndarray:
    return np.array([model.noise, model.noise, model.normal_noise])
