"""What a run is told, as the command line takes it: plain values with units, and files."""

from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import Any

from contactmodel.common.options import describe_parameters, option
from estimation.estimators import DEFAULT_METHOD, METHODS, RIVALS, method_constants, method_settings
from estimation.fields.contact import SHARE
from estimation.fields.stick import check_positive, check_share
from estimation.frames.recording import ONSET_MM


@dataclass(frozen=True)
class ContactSettings:
    """How the contact and its state are told.

    Attributes:
        onset_mm: displacement of the stick centre from which there is contact [mm].
        contact_share: share of the largest normal displacement that bounds the contact [-].
        stick_share: share of the contact's markers from which the state is `stick` [-].

    Raises:
        ValueError: a value out of range.
    """

    onset_mm: float = ONSET_MM
    contact_share: float = SHARE
    stick_share: float = 0.9

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_positive("onset_mm", self.onset_mm)
        check_share("contact_share", self.contact_share)
        check_share("stick_share", self.stick_share)


@dataclass(frozen=True)
class AlertSettings:
    """When a gripper is warned; see `estimation.slip.alert.Level`.

    Attributes:
        watch_s: time to slip below which the alert is `watch` [s].
        act_s: time to slip below which the alert is `act` [s].
        watch_used: share of the friction limit from which the alert is `watch` [-].
        act_used: share of the friction limit from which the alert is `act` [-].
        act_probability: probability of a slip from which the alert is `act` [-].
        rate_frames: frames over which the rate of turn and load is taken, 5 or more [frames].

    Raises:
        ValueError: a threshold below 0, or a rate over fewer than 5 frames.
    """

    watch_s: float = 1.5
    act_s: float = 0.4
    watch_used: float = 0.7
    act_used: float = 0.9
    act_probability: float = 0.2
    rate_frames: int = 10

    def __post_init__(self) -> None:
        """Check the ranges."""
        if min(vars(self).values()) < 0.0:
            raise ValueError(f"thresholds of alerts must not be below 0: {vars(self)}")
        if self.rate_frames < 5:
            raise ValueError(f"rate_frames is {self.rate_frames}; a rate takes 5 frames or more")


DEFAULT_CONTACT = ContactSettings()
DEFAULT_ALERT = AlertSettings()


@dataclass(frozen=True)
class Choices:
    """What every run is told beside what is known of sensor, object and method.

    Attributes:
        method: method of angles.csv; the others stand beside it in angles_all.csv.
        keep_withdrawn: keep the angles that were reported while the object may have been sliding
            unnoticed. By default they are moved to the columns withdrawn_… of angles.csv.
        topic: topic of a bag to run over; given twice, as for the fingers of a grasp, both are.
        sink: what else takes the answers, frame by frame; it may be given several times. mcap:
            frames.mcap, an MCAP file of ROS messages; zarr: frames.zarr; lerobot: a LeRobot data
            set. All of them can be run over again. json: a line of
            JSON for each frame on standard output. udp:PORT, udp:HOST:PORT: the same as packets.
        seed: seed of the virtual pivot.
        contact: how the contact and its state are told.
        alert: when a gripper is warned.

    Raises:
        ValueError: the seed is below 0.
    """

    method: str = field(
        default=DEFAULT_METHOD, metadata=option(more=f" Of {', '.join(METHODS | RIVALS)}.")
    )
    keep_withdrawn: bool = False
    topic: tuple[str, ...] = field(
        default=(), metadata=option("found, where only one can be meant")
    )
    sink: tuple[str, ...] = field(default=(), metadata=option("none"))
    seed: int = 0
    contact: ContactSettings = field(default_factory=ContactSettings)
    alert: AlertSettings = field(default_factory=AlertSettings)

    def __post_init__(self) -> None:
        """Check the seed."""
        if self.seed < 0:
            raise ValueError(f"the seed is {self.seed} (--seed): it must be 0 or more")


@dataclass(frozen=True)
class RunChoices(Choices):
    """What a run over recordings is told beside.

    Attributes:
        grasp: two recordings of fingers that hold one object.
        preview: write an annotated video, preview.mp4 (needs the extra `video`).
    """

    grasp: bool = False
    preview: bool = False


@dataclass(frozen=True)
class LiveChoices:
    """How a source is followed while it goes on.

    Attributes:
        fast: play a recording as fast as its frames are answered, and leave none out. By default
            it is played at its own pace.
        queue: frames that wait for their answer; when there are more, the oldest is left out and
            counted. A larger number loses fewer frames, and answers may be later [frames].
        silent_s: time without a frame from which the source is reported as silent [s].
        window: show picture or markers, angle, state and alert on a page in the browser, whose
            address is said at the start.
        window_host: address that the page is served at. By default only this machine can see it;
            with another, such as 0.0.0.0, everybody can who reaches it.
        window_port: its port; 0 for any that is free.

    Raises:
        ValueError: a queue without room, a time that is not above 0, or no port.
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
            raise ValueError(f"the queue is {self.queue} frames (--queue): it takes 1 or more")
        check_positive("silent_s", self.silent_s)
        if not 0 <= self.window_port < 65536:
            raise ValueError(f"{self.window_port} is no port (--window-port): give 0 to 65535")


@dataclass(frozen=True)
class Known:
    """What is known of object and sensor.

    Attributes:
        softness: TOML file with the softness correction k, L.
        sensor: TOML file that describes the sensor; options override it.
        mm_per_px: scale [mm/px].
        dot_radius_px: radius of the dots [px].
        dark_dots: dots that are darker or brighter than the pad.
        unloaded_frame: number of an unloaded frame: the number in the picture's name, or counted
            from 0 (angles.csv: source_index).
        unloaded: picture of the same sensor with nothing on it, of the size of the recording's.
            Markers, light and contact count from it.
        crop: part of the pictures that is read, as left column, upper row, width and height [px].
            Positions stay those in the whole picture.
        mask: picture of the size of the recording's, black where nothing is read: mirrors, frames.
        fps: rate of the pictures of a folder without times.csv [1/s].
        marker: kind of markers: corners, dots, speckle.
        stereo: TOML file of a stereo calibration, where mirrors split the picture.
        noise_um: marker noise per in-plane coordinate [µm].
        noise_px: the same of pictures without a scale [px].
    """

    softness: Path | None = field(default=None, metadata=option("a rigid object"))
    sensor: Path | None = field(default=None, metadata=option("none"))
    mm_per_px: float | None = field(default=None, metadata=option("lengths stay in px"))
    dot_radius_px: float | None = field(default=None, metadata=option("detected"))
    dark_dots: bool | None = field(default=None, metadata=option("detected", "--dark/--bright"))
    unloaded_frame: int | None = field(default=None, metadata=option("detected"))
    unloaded: Path | None = field(default=None, metadata=option("detected"))
    crop: tuple[int, int, int, int] | None = field(
        default=None, metadata=option("all", metavar="X Y WIDTH HEIGHT")
    )
    mask: Path | None = field(default=None, metadata=option("none"))
    fps: float | None = field(default=None, metadata=option("30, with a warning"))
    marker: str | None = field(default=None, metadata=option("detected"))
    stereo: Path | None = field(default=None, metadata=option("one view"))
    noise_um: float | None = field(default=None, metadata=option("from the recording"))
    noise_px: float | None = field(default=None, metadata=option("from the recording"))


def _make_constants() -> type:
    """A dataclass of the constants of all methods, described as the methods describe them."""
    said: dict[str, str] = {}
    defaults: dict[str, dict[Any, list[str]]] = {}
    for name in METHODS | RIVALS:
        docs = describe_parameters(type(method_settings(name)))
        for constant, value in method_constants(name).items():
            said.setdefault(constant, docs.get(constant, ""))
            said[constant] = said[constant] or docs.get(constant, "")
            defaults.setdefault(constant, {}).setdefault(value, []).append(name)
    made = make_dataclass(
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
    lines = [f"    {name}: {text}" for name, text in said.items()]
    made.__doc__ = "\n".join(["Constants of the chosen method.", "", "Attributes:", *lines])
    return made


def _show_defaults(values: dict[Any, list[str]]) -> str:
    """Defaults of a constant, with the methods that have it."""

    def show(value: Any) -> str:
        return ("off", "on")[value] if isinstance(value, bool) else f"{value:.4g}"

    return "; ".join(f"{show(value)} {', '.join(those)}" for value, those in values.items())


Constants = _make_constants()
