"""What a run is told, as the command line takes it: plain values with units, and files."""

from dataclasses import dataclass, field, make_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contactmodel.common.options import describe_parameters, option
from estimation.estimators import DEFAULT_METHOD, METHODS, RIVALS, method_constants
from estimation.fields.contact import SHARE
from estimation.fields.stick import check_positive, check_share
from estimation.frames.recording import ONSET_MM

if TYPE_CHECKING:
    from estimation.frames.noise import Noise
    from estimation.pictures.sensor import Sensor
    from estimation.settings import Settings


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


DEFAULT_CONTACT = ContactSettings()


@dataclass(frozen=True)
class Choices:
    """What a run is told beside what is known of sensor, object and method.

    Attributes:
        method: method of angles.csv; the others stand beside it in angles_all.csv.
        grasp: two recordings of fingers that hold one object.
        keep_withdrawn: keep the angles that were reported while the object may have been sliding
            unnoticed. By default they are moved to the columns withdrawn_… of angles.csv.
        preview: write an annotated video, preview.mp4 (needs the extra `video`).
        seed: seed of the virtual pivot.
        contact: how the contact and its state are told.

    Raises:
        ValueError: the seed is below 0.
    """

    method: str = field(
        default=DEFAULT_METHOD, metadata=option(more=f" Of {', '.join(METHODS | RIVALS)}.")
    )
    grasp: bool = False
    keep_withdrawn: bool = False
    preview: bool = False
    seed: int = 0
    contact: ContactSettings = field(default_factory=ContactSettings)

    def __post_init__(self) -> None:
        """Check the seed."""
        if self.seed < 0:
            raise ValueError(f"the seed is {self.seed} (--seed): it must be 0 or more")


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
        fps: rate of the pictures of a folder without times.csv [1/s].
        marker: kind of markers: corners, dots, speckle.
        stereo: TOML file of a stereo calibration, where mirrors split the picture.
        noise_um: marker noise per in-plane coordinate [µm].
    """

    softness: Path | None = field(default=None, metadata=option("a rigid object"))
    sensor: Path | None = field(default=None, metadata=option("none"))
    mm_per_px: float | None = field(default=None, metadata=option("lengths stay in px"))
    dot_radius_px: float | None = field(default=None, metadata=option("detected"))
    dark_dots: bool | None = field(default=None, metadata=option("detected", "--dark/--bright"))
    unloaded_frame: int | None = field(default=None, metadata=option("detected"))
    fps: float | None = field(default=None, metadata=option("30, with a warning"))
    marker: str | None = field(default=None, metadata=option("detected"))
    stereo: Path | None = field(default=None, metadata=option("one view"))
    noise_um: float | None = field(default=None, metadata=option("from the recording"))

    def settings(self, choices: Choices, constants: Any) -> "Settings":
        """The settings of a run, with the files read.

        Args:
            choices: made beside.
            constants: of the chosen method, a `Constants`.

        Raises:
            ValueError: a wrong value, or a file that does not say what it should.
            OSError: a file cannot be read.
        """
        from estimation.observation import RIGID_OBJECT
        from estimation.pictures.reader import ImageSettings
        from estimation.pictures.rig import read_rig
        from estimation.settings import Settings
        from estimation.softness import read_softness

        sensor = self._describe_sensor()
        rig = None if self.stereo is None else read_rig(self.stereo)
        given = {name: value for name, value in vars(constants).items() if value is not None}
        return Settings(
            **vars(choices),
            softness=RIGID_OBJECT if self.softness is None else read_softness(self.softness),
            noise=self._noise(sensor),
            constants=given,
            images=ImageSettings(sensor, self.unloaded_frame, rig, self.fps),
        )

    def _describe_sensor(self) -> "Sensor":
        from estimation.pictures.sensor import Sensor, read_sensor

        told = {
            "mm_per_px": self.mm_per_px,
            "radius": self.dot_radius_px,
            "dark": self.dark_dots,
            "marker": self.marker,
        }
        described = Sensor() if self.sensor is None else read_sensor(self.sensor)
        return replace(described, **{name: one for name, one in told.items() if one is not None})

    def _noise(self, sensor: "Sensor") -> "Noise | None":
        from estimation.frames.noise import Noise

        return sensor.noise if self.noise_um is None else Noise.given(self.noise_um * 1e-3)


def _make_constants() -> type:
    """A dataclass of the constants of all methods, described as the methods describe them."""
    said: dict[str, str] = {}
    defaults: dict[str, dict[Any, list[str]]] = {}
    for name, make in (METHODS | RIVALS).items():
        docs = describe_parameters(make.__init__) if isinstance(make, type) else {}
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
