"""Options of the command line beside the settings: files, and what overrides them."""

from dataclasses import dataclass, field, make_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contactmodel.common.options import describe_parameters, option
from estimation.estimators import METHODS, RIVALS
from estimation.tracker import method_constants

if TYPE_CHECKING:
    from estimation.frames.noise import Noise
    from estimation.pictures.sensor import Sensor
    from estimation.settings import Choices, Settings


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

    def settings(self, choices: "Choices", constants: Any) -> "Settings":
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
