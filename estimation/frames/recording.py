"""Recordings of a sensor: marker positions over time, and the layout of the markers."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, cast

import numpy as np
from jaxtyping import Bool, Float, Int

from contactmodel.common.arrays import declared_arrays, fill_masked, make_arrays
from estimation.frames.neighbours import delaunay_neighbours, find_grid, grid_neighbours


def _expect_shape(name: str, array: np.ndarray, *shape: int) -> None:
    """Raise a ValueError unless `array` has the shape that its object requires."""
    if array.shape != shape:
        raise ValueError(f"`{name}` has shape {array.shape}; it must be {shape} to fit the rest")


def _expect_positions(positions: np.ndarray, valid: np.ndarray) -> None:
    """Raise a ValueError unless every valid marker has a finite position."""
    if not np.isfinite(positions[valid]).all():
        raise ValueError("a marker marked `valid` has no finite position: mark it invalid")


ONSET_MM = 0.1
"""Displacement from which a marker counts as moved by an object [mm]."""
LARGEST_VALUE = 1e9
"""Length, force, moment or angle from which a value is no measurement [mm, N, N·mm, rad]."""


class Flaw(StrEnum):
    """Flaws of frames in which an object is seen, or has been, but gives no angle."""

    NOT_SETTLED = "a contact at the edge of the view has not settled"
    TOO_LIGHT = "the object touches too lightly to move the markers"
    DEPARTED = "the object's print has faded: it has left the view"


class Hidden(StrEnum):
    """Flaws of frames in which so much of the contact is hidden that its state is unknown."""

    CENTRE = "none of the markers in the contact's centre is visible"
    MASKED = "the mask covers a third of the contact or more"


UNHELD_FLAWS = frozenset({Flaw.TOO_LIGHT, Flaw.DEPARTED})
"""Flaws of frames that hold nothing: the next angle counts from the next contact."""


def expect_places(reference: Float[np.ndarray, "n d"]) -> None:
    """Check that positions at rest are an array of points, finite and below `LARGEST_VALUE`.

    Raises:
        ValueError: a position is not.
    """
    _expect_points(reference)
    if not (np.abs(reference) < LARGEST_VALUE).all():
        why = "that are not finite, or too far away: leave out these markers"
        raise ValueError(f"`reference` has positions {why}")


def _expect_points(reference: np.ndarray) -> None:
    if np.ndim(reference) != 2 or np.shape(reference)[1] not in (2, 3):
        raise ValueError(
            f"`reference` has shape {np.shape(reference)}; it must be (markers, 2) or (markers, 3)"
        )


@dataclass(frozen=True)
class MarkerLayout:
    """The markers of a sensor in its unloaded state.

    Attributes:
        reference: unloaded positions [mm].
        neighbours: indices of each marker's neighbours; −1 for none.
        grid_shape: rows and columns if the markers form a regular grid (marker
            `row * columns + column`), else None.

    Raises:
        ValueError: the arrays do not fit each other, a reference position is not finite, or a
            neighbour is not a marker.

    Examples:
        >>> import numpy as np
        >>> from estimation import MarkerLayout
        >>> corners = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]])  # mm
        >>> around = np.array([[1, 2], [0, 3], [0, 3], [1, 2]])
        >>> layout = MarkerLayout(corners, around, grid_shape=(2, 2))
        >>> print(layout.reference[layout.neighbours[0]])  # next to the first marker
        [[2. 0.]
         [0. 2.]]
    """

    reference: Float[np.ndarray, "n d"]
    neighbours: Int[np.ndarray, "n k"]
    grid_shape: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        """Check that the parts fit."""
        make_arrays(self)
        _expect_points(self.reference)
        if not np.isfinite(self.reference).all():
            raise ValueError(
                "`reference` has positions that are not finite: leave out these markers"
            )
        markers = len(self.reference)
        if self.neighbours.ndim != 2 or len(self.neighbours) != markers:
            raise ValueError(
                f"`neighbours` has shape {self.neighbours.shape}; it must have a row for each of "
                f"the {markers} markers"
            )
        around, shape = self.neighbours, self.grid_shape
        if around.size and not -1 <= around.min() <= around.max() < markers:
            raise ValueError(f"`neighbours` must be −1 or the index of one of {markers} markers")
        if shape is not None and (len(shape) != 2 or min(shape) < 1 or np.prod(shape) != markers):
            raise ValueError(
                f"`grid_shape` is {shape}: its rows and columns do not hold {markers} markers"
            )


def layout_markers(reference: Float[np.ndarray, "n d"]) -> MarkerLayout:
    """Make the layout of markers: neighbours on a regular grid if there is one, else Delaunay's.

    Args:
        reference: unloaded positions [mm].

    Raises:
        ValueError: a position is not finite or too far away, or all markers are on one line.

    Examples:
        >>> import numpy as np
        >>> from estimation import layout_markers
        >>> x, y = np.meshgrid(np.arange(5.0), np.arange(4.0))  # mm
        >>> layout = layout_markers(np.stack([x.ravel(), y.ravel()], axis=1))
        >>> print(layout.grid_shape, layout.neighbours[6])  # four around marker 6
        (4, 5) [ 1 11  5  7]
    """
    reference = fill_masked(reference)  # a copy, since the caller may reuse its array
    expect_places(reference)
    shape = find_grid(reference)
    neighbours = delaunay_neighbours(reference) if shape is None else grid_neighbours(shape)
    return MarkerLayout(reference, neighbours, shape)


@dataclass(frozen=True)
class Frame:
    """One frame of a recording.

    Attributes:
        positions: marker positions [mm, or px without a scale]; NaN where a marker is not visible.
        time: time stamp [s].
        source_index: the source's frame number; gaps are lost frames.
        valid: which markers can be used; by default all with a position.
        wrench: resultant force and moment on the sensor about its origin, (Fx, Fy, Fz, Mx, My, Mz)
            [N, N·mm]; NaN where unknown. z points out of the pad, so pressing makes Fz negative.
        forces: force at each marker [N], if the source measures it.
        flaw: why the frame cannot be used; empty if it can.
        contact: which markers are in contact, if the source measures it. Otherwise the contact
            follows from the markers' depth; in two dimensions, all count as in contact.
        imprint: rotation of the object's print and its standard error [rad]; NaN where unknown.
        print_point: x and y of a point of the print, in the frame from which its rotation counts
            and now [mm], then variances and covariance of the latter [mm²]; NaN if unknown.
        rotation: of the line features at each marker [rad], if the source measures it directly
            instead of from the markers' neighbours; NaN where unknown.
        hold: correlation of the object's print on the gel with the print half a second to a second
            before, with the print a few frames before, and the tenth percentile of the latter; NaN
            if unknown [-].
        others: which markers lie under and around other contacts, which the source shows apart and
            whose positions it leaves out; None if there are none.
        pictured: whether a picture shows the contact. Its outline is not exact then, and the reader
            of the picture has left out the markers that it misread.

    Raises:
        ValueError: the arrays do not fit each other, a valid marker has no position, or one is
            neither in contact nor not.

    Examples:
        >>> from estimation import Frame, Tracker, simulate_pivot
        >>> layout = simulate_pivot()[0].layout
        >>> frame = Frame(layout.reference, time=0.0, source_index=0)
        >>> print(Tracker(layout).update(frame).reason)
        no contact: moved by less than 0.1 mm
    """

    positions: Float[np.ndarray, "n d"]
    time: float
    source_index: int
    valid: Bool[np.ndarray, " n"] = field(default=cast("Any", None))
    wrench: tuple[float, ...] = (float("nan"),) * 6
    forces: Float[np.ndarray, "n d"] | None = None
    flaw: str = ""
    contact: Bool[np.ndarray, " n"] | None = None
    imprint: tuple[float, float] = (float("nan"), float("nan"))
    print_point: tuple[float, ...] = (float("nan"),) * 7
    rotation: Float[np.ndarray, " n"] | None = None
    hold: tuple[float, float, float] = (float("nan"), float("nan"), float("nan"))
    others: Bool[np.ndarray, " n"] | None = None
    pictured: bool = False

    def __post_init__(self) -> None:
        """Check that the parts fit."""
        make_arrays(self)
        positions = self.positions.astype(float)
        object.__setattr__(self, "positions", np.where(np.isinf(positions), np.nan, positions))
        if self.valid is None:
            seen = np.asarray(np.isfinite(self.positions).all(axis=-1))
            object.__setattr__(self, "valid", seen)
        for name in ("valid", "contact", "others"):
            if (marks := getattr(self, name)) is not None:
                _expect_shape(name, marks, *self.positions.shape[:1])
        _expect_shape("wrench", np.array(self.wrench), 6)
        if self.forces is not None:
            _expect_shape("forces", self.forces, *self.positions.shape)
        if self.rotation is not None:
            _expect_shape("rotation", self.rotation, *self.positions.shape[:1])
        _expect_positions(self.positions, self.valid)

    def without_print(self) -> "Frame":
        """The frame without what the object's print shows."""
        return replace(self, imprint=Frame.imprint, print_point=Frame.print_point, hold=Frame.hold)

    @property
    def normal_force(self) -> float:
        """The pressing force [N]; NaN where unknown."""
        return -self.wrench[2]

    @property
    def moment(self) -> float:
        """The moment about the contact normal [N·mm]; NaN where unknown."""
        return self.wrench[5]


@dataclass(frozen=True, repr=False)
class Recording:
    """Marker positions over time.

    The sensor frame has x and y in the contact plane and z out of the elastomer towards the
    object. In two dimensions the positions are x and y.

    Attributes:
        layout: the markers' reference positions and neighbours.
        positions: marker positions [mm]; NaN where a marker is not visible.
        valid: which markers of each frame can be used.
        time: time stamps [s].
        source_index: the source's frame numbers; gaps are dropped frames.
        force: resultant force on the sensor [N], if the source measures it.
        moment: resultant moment on the sensor [N·mm], if the source measures it.
        forces: force at each marker [N], if the source measures it.
        flaws: why each frame cannot be used; empty if it can.
        contact: the contact region in each frame, if the source measures it.
        imprint: as in `Frame`, in each frame, if the source measures it [rad].
        print_point: as in `Frame`, in each frame, if the source measures it.
        rotation: of the line features at each marker [rad], if the source measures it.
        hold: as in `Frame`, in each frame, if the source measures it [-].
        others: as in `Frame`, in each frame, if the source shows other contacts apart.
        pictured: as in `Frame`, in all frames.
        unit: of lengths: mm, or px if the source has no scale.
        name: short name, used for folders and titles.
        source: origin of the recording, such as a path.
        convention: directions of the source's axes, and their conversion to the sensor frame.
        notes: remarks for readers of the recording, in sentences.
        warnings: assumptions and doubts about the recording, in sentences; commands print them.

    Raises:
        ValueError: the arrays do not fit each other, or a valid marker has no position.

    Examples:
        >>> import numpy as np
        >>> from estimation import Recording, layout_markers
        >>> x, y = np.meshgrid(np.arange(5.0), np.arange(4.0))  # mm
        >>> layout = layout_markers(np.stack([x.ravel(), y.ravel()], axis=1))
        >>> positions = np.stack([layout.reference, layout.reference + 0.01])  # two frames
        >>> valid, time = np.isfinite(positions).all(axis=-1), np.array([0.0, 0.04])
        >>> recording = Recording(layout, positions, valid, time, source_index=np.array([0, 1]))
        >>> print(len(recording), [frame.time for frame in recording])
        2 [0.0, 0.04]
    """

    layout: MarkerLayout
    positions: Float[np.ndarray, "frames n d"]
    valid: Bool[np.ndarray, "frames n"]
    time: Float[np.ndarray, " frames"]
    source_index: Int[np.ndarray, " frames"]
    force: Float[np.ndarray, "frames 3"] | None = None
    moment: Float[np.ndarray, "frames 3"] | None = None
    forces: Float[np.ndarray, "frames n d"] | None = None
    flaws: tuple[str, ...] = ()
    contact: Bool[np.ndarray, "frames n"] | None = None
    imprint: Float[np.ndarray, "frames 2"] | None = None
    print_point: Float[np.ndarray, "frames 7"] | None = None
    rotation: Float[np.ndarray, "frames n"] | None = None
    hold: Float[np.ndarray, "frames 3"] | None = None
    others: Bool[np.ndarray, "frames n"] | None = None
    pictured: bool = False
    unit: str = "mm"
    name: str = "recording"
    source: str = ""
    convention: str = "z out of the elastomer towards the object"
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check that the parts fit."""
        make_arrays(self)
        if self.positions.ndim != 3 or len(self.positions) == 0:
            raise ValueError(
                f"`positions` has shape {self.positions.shape}; it must be (frames, markers, 2) or "
                "(frames, markers, 3) with at least one frame"
            )
        frames = len(self.positions)
        size = dict(zip(("n", "d"), self.layout.reference.shape, strict=True)) | {"frames": frames}
        for name, kind in declared_arrays(Recording).items():
            if (array := getattr(self, name)) is not None:
                shape = (size[axis] if axis in size else int(axis) for axis in kind.dim_str.split())
                _expect_shape(name, array, *shape)
        if self.unit not in ("mm", "px"):
            raise ValueError(f"`unit` is {self.unit!r}; it must be mm or px")
        if self.flaws and len(self.flaws) != frames:
            raise ValueError(f"{len(self.flaws)} `flaws` for {frames} frames: give one for each")
        _expect_positions(self.positions, self.valid)

    def __repr__(self) -> str:
        """The name and the size."""
        return f"Recording({self.name}: {len(self)} frames of {self.positions.shape[1]} markers)"

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.time)

    @property
    def live(self) -> bool:
        """False: a recording is complete."""
        return False

    @property
    def provisional(self) -> bool:
        """False: the reference of a recording is final."""
        return False

    def head(self, frames: int) -> "Recording":
        """The recording's first frames."""
        return self.take(slice(frames))

    def take(self, rows: slice | Int[np.ndarray, " rows"]) -> "Recording":
        """Select frames of the recording.

        Args:
            rows: of the selected frames.
        """
        arrays = declared_arrays(Recording).items()
        per_frame = [name for name, kind in arrays if kind.dim_str.split()[0] == "frames"]
        present = {name: value for name in per_frame if (value := getattr(self, name)) is not None}
        flaws = tuple(np.array(self.flaws, dtype=object)[rows]) if self.flaws else ()
        return replace(self, flaws=flaws, **{name: value[rows] for name, value in present.items()})

    def __iter__(self) -> Iterator[Frame]:
        """The frames in order, as `Tracker.update` takes them."""
        at_markers = ("forces", "contact", "rotation", "others")
        present = {name: of for name in at_markers if (of := getattr(self, name)) is not None}
        sizes = {"imprint": 2, "print_point": 7, "hold": 3}
        for i in range(len(self)):
            yield Frame(
                positions=self.positions[i],
                valid=self.valid[i],
                time=float(self.time[i]),
                source_index=int(self.source_index[i]),
                wrench=(*_numbers(self.force, i, 3), *_numbers(self.moment, i, 3)),
                flaw=self.flaws[i] if self.flaws else "",
                pictured=self.pictured,
                **{name: _numbers(getattr(self, name), i, size) for name, size in sizes.items()},
                **{name: of[i] for name, of in present.items()},
            )


def _numbers(values: Float[np.ndarray, "frames some"] | None, frame: int, count: int) -> Any:
    """The numbers of a frame; `count` times NaN if there are none."""
    return (np.nan,) * count if values is None else tuple(values[frame].tolist())
