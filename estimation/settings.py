"""Settings of a run, shared by command line, summary and Python."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from contactmodel.common.options import given_options
from estimation.choices import Choices, Known, RunChoices
from estimation.estimators import METHODS
from estimation.frames.bags.bag import split_place
from estimation.frames.noise import Noise
from estimation.pictures.part import Part
from estimation.pictures.reader import ImageSettings
from estimation.pictures.rig import read_rig
from estimation.pictures.sensor import Sensor, read_sensor
from estimation.pictures.still import Still, read_still
from estimation.pictures.stream import is_pictures
from estimation.softness import RIGID_OBJECT, Softness, read_softness


@dataclass(frozen=True)
class Settings(RunChoices):
    """Settings of a run; `Choices` and `RunChoices` describe the inherited ones.

    Attributes:
        softness: correction of all methods' angles by Eq. (13).
        noise: noise of the markers; estimated from each recording unless given.
        constants: constants of the chosen method, by name.
        images: properties of the pictures.
        given: options of the command line that were given, each with the inputs it applies to.

    Examples:
        >>> from estimation import Noise, Settings, Stream, simulate_pivot
        >>> settings = Settings(method="rigid", noise=Noise.from_std(1e-3))
        >>> print(*settings.methods)  # all are run, the chosen one first
        rigid tracked incremental paper paper_strict
    """

    softness: Softness = RIGID_OBJECT
    noise: Noise | None = None
    constants: Mapping[str, Any] = field(default_factory=dict)
    images: ImageSettings = field(default_factory=ImageSettings)
    given: Mapping[str, str] = field(default_factory=dict, repr=False)  # values: other fields

    @property
    def methods(self) -> dict[str, Mapping[str, Any]]:
        """All methods of the run, the chosen one first, each with its constants."""
        others = {name: {} for name in METHODS if name != self.method}
        return {self.method: self.constants} | others


def read_settings(choices: Choices, known: Known, constants: Any) -> Settings:
    """Settings of a run from the command line's options, with the named files read.

    The chosen method's constants are a `Constants`; None in it keeps the default.

    Raises:
        ValueError: a value is out of range, or a file's content is wrong.
        OSError: a file cannot be read.
    """
    overrides = {
        "mm_per_px": known.mm_per_px,
        "radius": known.dot_radius_px,
        "dark": known.dark_dots,
        "marker": known.marker,
    }
    sensor = replace(
        Sensor() if known.sensor is None else read_sensor(known.sensor),
        **{name: value for name, value in overrides.items() if value is not None},
    )
    if known.unloaded is not None and known.unloaded_frame is not None:
        raise ValueError(
            "an unloaded picture and an unloaded frame are given: leave out --unloaded or "
            "--unloaded-frame"
        )
    unloaded = known.unloaded_frame
    if known.unloaded is not None:
        unloaded = read_still(known.unloaded, "the unloaded picture (--unloaded)")
    mask = None if known.mask is None else read_still(known.mask, "the mask (--mask)")
    rig = None if known.stereo is None else read_rig(known.stereo)
    return Settings(
        **vars(choices),
        softness=RIGID_OBJECT if known.softness is None else read_softness(known.softness),
        noise=_given_noise(known) or sensor.noise,
        constants={name: value for name, value in vars(constants).items() if value is not None},
        images=ImageSettings(sensor, unloaded, rig, known.fps, Part(known.crop, mask)),
        given=given_options(choices) | given_options(known),
    )


def describe_unused(settings: Settings, path: Path | None) -> tuple[str, ...]:
    """Remarks on options that have no effect on the input at a path; None for the virtual pivot."""
    if path is None:
        kind = "the virtual pivot"
    elif is_pictures(path):
        kind = "pictures"
    else:
        kind = "bags" if split_place(path) else "markers"
    unused: dict[str, list[str]] = {}
    for name, applies_to in settings.given.items():
        if applies_to and kind not in applies_to:
            unused.setdefault(applies_to, []).append(name)
    return tuple(
        f"No effect here: {', '.join(names)}, for {applies_to} only."
        for applies_to, names in unused.items()
    )


def list_fields(name: str, value: object) -> Iterator[tuple[str, str]]:
    """The dotted names and values, as text, of fields in an object; a picture is one value.

    Fields that are not in the object's `repr` repeat others, and are left out.
    """
    if not is_dataclass(value) or isinstance(value, Still):
        yield name, repr(value)
        return
    for part in (part for part in fields(value) if part.repr):
        yield from list_fields(f"{name}.{part.name}", getattr(value, part.name))


def describe_changes(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """What differs between the settings, source and files of two runs, as `identity_of` gives them.

    Runs of two versions may have other settings, so of these only the versions are given.
    """
    if not any("." in name for name in then):
        return ["by an earlier version, which compared other settings"]
    differing = [name for name in {**now, **then} if then.get(name) != now.get(name)]
    changes = []
    for name in ["version"] if "version" in differing else differing:
        before, after = (values.get(name, "none") for values in (then, now))
        setting = name.rpartition(".")[2]
        if name == "files":
            changes.append("the recording's files have changed since")
        else:
            changes.append(f"{setting}={before} then, {setting}={after} now")
    return changes


def _given_noise(known: Known) -> Noise | None:
    if known.noise_um is not None and known.noise_px is not None:
        raise ValueError("the noise is given in µm and in px: give one of --noise-um, --noise-px")
    if known.noise_px is not None:
        return Noise.from_std(known.noise_px, "px")
    return None if known.noise_um is None else Noise.from_std(known.noise_um * 1e-3)
