"""Options of a run as the command line takes them: plain values with units, and paths."""

from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import Any

from contactmodel.common.options import (
    describe_parameters,
    expect_none,
    given_options,
    option,
)
from contactmodel.common.ranges import check_positive, check_share
from estimation.estimators import (
    DEFAULT_METHOD,
    METHODS,
    PUBLISHED_METHODS,
    method_constants,
    method_settings,
)
from estimation.frames.recording import ONSET_MM


@dataclass(frozen=True)
class ContactSettings:
    """Thresholds of contact and state.

    Attributes:
        onset_mm: displacement of the stick centre from which a contact is reported. Larger values
            ignore light touches and noise [mm].
        contact_share: share of the largest indentation above which a marker is in contact. Larger
            values make the contact smaller. By default the contact's edge is fitted, whatever the
            object's shape and the gel's thickness [-].
        stick_share: share of the contact's markers that must stick for the state `stick`. Larger
            values report `incipient` earlier [-].

    Raises:
        ValueError: a value out of range.

    Examples:
        >>> from estimation import ContactSettings, estimate_angles, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> for onset in (0.1, 0.5):  # mm
        ...     result = estimate_angles(recording, contact=ContactSettings(onset_mm=onset))
        ...     print(f"{onset} mm: {(result.contact_markers > 0).sum()} frames in contact")
        0.1 mm: 33 frames in contact
        0.5 mm: 29 frames in contact
    """

    onset_mm: float = ONSET_MM
    contact_share: float | None = field(default=None, metadata=option("fitted"))
    stick_share: float = 0.9

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_positive("onset_mm", self.onset_mm)
        if self.contact_share is not None:
            check_share("contact_share", self.contact_share)
        check_share("stick_share", self.stick_share)


@dataclass(frozen=True)
class AlertSettings:
    """Thresholds of the alerts to a gripper; see `estimation.slip.alert.AlertLevel`.

    Attributes:
        watch_s: predicted time to slip below which the alert is `watch`. Larger values warn earlier
            [s].
        act_s: predicted time to slip below which the alert is `act`. Larger values warn earlier
            [s].
        watch_friction_share: share of the friction limit in use above which the alert is `watch`
            [-].
        act_friction_share: share of the friction limit in use above which the alert is `act` [-].
        act_probability: probability of a slip above which the alert is `act` [-].
        rate_frames: frames over which the rates of angle and load are computed, 5 or more. More
            frames give smoother, later alerts [frames].

    Raises:
        ValueError: a threshold that is not 0 or more, or a rate over fewer than 5 frames.
    """

    watch_s: float = 1.5
    act_s: float = 0.4
    watch_friction_share: float = 0.7
    act_friction_share: float = 0.9
    act_probability: float = 0.2
    rate_frames: int = 10

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, value in vars(self).items():
            if not value >= 0.0:  # NaN too
                raise ValueError(f"{name} is {value}; it must be 0 or more")
        if self.rate_frames < 5:
            raise ValueError(f"rate_frames is {self.rate_frames}; give 5 frames or more")


@dataclass(frozen=True)
class Choices:
    """Choices of every run; `Known` describes the sensor and the object.

    Attributes:
        method: method whose angles go to angles.csv; angles_all.csv also has the angles of the
            other estimators.
        keep_withdrawn: keep the angles that were reported while the object may have been sliding
            unnoticed, and the states before a slip was noticed. By default the angles are moved to
            the columns `withdrawn_…` of angles.csv.
        topic: topic of a bag to read, or video of a LeRobot data set. Give it twice for two, such
            as the fingers of a grasp.
        sink: further output for each frame; can be given several times. mcap writes frames.mcap, an
            MCAP file of ROS messages; zarr writes frames.zarr; lerobot writes a LeRobot data set.
            `run` reads all three. rrd writes frames.rrd for Rerun's viewer; rerun opens the viewer
            and shows each frame at once; rerun:PORT or rerun:HOST:PORT sends the frames to an open
            viewer. json prints a line of JSON for each frame; udp:PORT or udp:HOST:PORT sends the
            same lines as packets.
        seed: random seed of the virtual pivot.
        contact: thresholds of contact and state.
        alert: thresholds of the alerts.

    Raises:
        ValueError: the seed is below 0.
    """

    method: str = field(
        default=DEFAULT_METHOD,
        metadata=option(more=f" One of {', '.join(METHODS | PUBLISHED_METHODS)}."),
    )
    keep_withdrawn: bool = False
    topic: tuple[str, ...] = field(default=(), metadata=option("the only topic that can be read"))
    sink: tuple[str, ...] = field(default=(), metadata=option("none"))
    seed: int = field(default=0, metadata=option(of="the virtual pivot"))
    contact: ContactSettings = field(default_factory=ContactSettings)
    alert: AlertSettings = field(default_factory=AlertSettings)

    def __post_init__(self) -> None:
        """Check the seed."""
        if self.seed < 0:
            raise ValueError(f"the seed is {self.seed} (--seed): it must be 0 or more")


@dataclass(frozen=True)
class RunChoices(Choices):
    """Further choices of a run over recordings.

    Attributes:
        grasp: compare and join two recordings, of two fingers that hold one object.
        preview: write an annotated video, preview.mp4 (needs the extra `video`).
    """

    grasp: bool = False
    preview: bool = False


@dataclass(frozen=True)
class LiveChoices:
    """Choices for a source that is followed live.

    Attributes:
        fast: play a recording as fast as its frames are answered, without dropping any. By default
            it plays at its own pace.
        queue: largest number of frames that wait for their answer, and 24 more at the start; when
            there are more, the oldest is dropped and counted. Larger values drop fewer frames and
            may answer later [frames].
        silent_s: time without a frame after which the source is reported as silent [s].
        window: show picture or markers, angle, state and alert on a page in the browser; its
            address is printed at the start.
        window_host: network address that serves the page. By default only this machine can open it;
            with 0.0.0.0, everybody on the network can.
        window_port: port of the page; 0 chooses a free one.

    Raises:
        ValueError: a queue below 1, a time that is not above 0, a port outside 0 to 65535, or an
            address without the window.
    """

    fast: bool = False
    queue: int = 8
    silent_s: float = 5.0
    window: bool = False
    window_host: str = "127.0.0.1"
    window_port: int = 0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.queue < 1:
            raise ValueError(f"the queue is {self.queue} frames (--queue): give 1 or more")
        check_positive("silent_s", self.silent_s)
        served = [name for name in given_options(self) if name.startswith("--window-")]
        if not self.window:
            expect_none(served, "without --window")
        if not 0 <= self.window_port < 65536:
            raise ValueError(f"{self.window_port} is no port (--window-port): give 0 to 65535")


@dataclass(frozen=True)
class Known:
    """Known properties of object and sensor.

    Attributes:
        softness: TOML file with the object's softness, from `calibration softness`.
        sensor: TOML file that describes the sensor; options override its values.
        mm_per_px: scale of the pictures [mm/px].
        dot_radius_px: radius of the printed dots [px].
        dark_dots: whether the dots are darker or brighter than the pad.
        unloaded_frame: number of a frame with nothing on the pad: the number in the picture's name,
            or its count from 0 (source_index in angles.csv).
        unloaded: picture of the same sensor with nothing on it, of the same size as the recording's
            pictures. It is the reference of markers, light and contact.
        crop: part of the pictures to read: left column, upper row, width and height. Positions
            still count from the corner of the whole picture [px].
        mask: picture of the same size as the recording's, black over the parts to ignore: mirrors,
            frames, covers.
        fps: frame rate of a folder of pictures without times.csv [1/s].
        marker: kind of markers: corners, dots or speckle.
        stereo: TOML file of a stereo calibration, for pictures that mirrors split into two views.
        noise_um: standard deviation of a marker's in-plane coordinates. Larger values widen the
            intervals [µm].
        noise_px: standard deviation of a marker's coordinates in pictures without a scale. Larger
            values widen the intervals [px].
    """

    softness: Path | None = field(default=None, metadata=option("a rigid object"))
    sensor: Path | None = field(default=None, metadata=option("none"))
    mm_per_px: float | None = field(
        default=None, metadata=option("lengths stay in px", of="pictures")
    )
    dot_radius_px: float | None = field(default=None, metadata=option("detected", of="pictures"))
    dark_dots: bool | None = field(
        default=None, metadata=option("detected", "--dark/--bright", of="pictures")
    )
    unloaded_frame: int | None = field(
        default=None, metadata=option("detected", of="pictures and bags")
    )
    unloaded: Path | None = field(default=None, metadata=option("detected", of="pictures"))
    crop: tuple[int, int, int, int] | None = field(
        default=None, metadata=option("all", metavar="X Y WIDTH HEIGHT", of="pictures")
    )
    mask: Path | None = field(default=None, metadata=option("none", of="pictures"))
    fps: float | None = field(default=None, metadata=option("30, with a warning", of="pictures"))
    marker: str | None = field(default=None, metadata=option("detected", of="pictures"))
    stereo: Path | None = field(default=None, metadata=option("one view", of="pictures"))
    noise_um: float | None = field(default=None, metadata=option("from the recording"))
    noise_px: float | None = field(default=None, metadata=option("from the recording"))


def _make_constants() -> type:
    """A dataclass of the constants of all methods, with the methods' own descriptions."""
    described: dict[str, str] = {}
    defaults: dict[str, dict[Any, list[str]]] = {}
    for name in METHODS | PUBLISHED_METHODS:
        docs = describe_parameters(type(method_settings(name)))
        for constant, value in method_constants(name).items():
            described[constant] = described.get(constant) or docs.get(constant, "")
            defaults.setdefault(constant, {}).setdefault(value, []).append(name)
    constants = make_dataclass(
        "Constants",
        [
            (
                constant,
                type(next(iter(values))) | None,
                field(default=None, metadata=option(_show_defaults(values))),
            )
            for constant, values in defaults.items()
        ],
        frozen=True,
    )
    lines = [f"    {name}: {text}" for name, text in described.items()]
    constants.__doc__ = "\n".join(["Constants of the chosen method.", "", "Attributes:", *lines])
    return constants


def _show_defaults(values: dict[Any, list[str]]) -> str:
    """Default values of a constant, each with the names of its methods."""

    def show(value: Any) -> str:
        return ("off", "on")[value] if isinstance(value, bool) else f"{value:.4g}"

    return "; ".join(f"{show(value)} {', '.join(methods)}" for value, methods in values.items())


Constants = _make_constants()
