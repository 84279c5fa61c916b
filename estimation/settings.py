"""What a run is told: the one settings object of command line, summary and Python."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from contactmodel.common.options import option
from estimation.estimators import DEFAULT_METHOD, METHODS, RIVALS
from estimation.frames.noise import Noise
from estimation.observation import RIGID_OBJECT, ContactSettings
from estimation.pictures.reader import ImageSettings
from estimation.softness import Softness


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
    """

    method: str = field(
        default=DEFAULT_METHOD, metadata=option(more=f" Of {', '.join(METHODS | RIVALS)}.")
    )
    grasp: bool = False
    keep_withdrawn: bool = False
    preview: bool = False
    seed: int = 0
    contact: ContactSettings = field(default_factory=ContactSettings)


@dataclass(frozen=True)
class Settings(Choices):
    """What a run is told; see `Choices` for the rest.

    Attributes:
        softness: correction by Eq. (13), for every method.
        noise: of the markers; estimated from each recording unless given.
        constants: of the chosen method.
        images: what is known of pictures.
    """

    softness: Softness = RIGID_OBJECT
    noise: Noise | None = None
    constants: Mapping[str, Any] = field(default_factory=dict)
    images: ImageSettings = field(default_factory=ImageSettings)

    @property
    def methods(self) -> dict[str, Mapping[str, Any]]:
        """All methods that are run, the chosen one first, each with its constants."""
        others = {name: {} for name in METHODS if name != self.method}
        return {self.method: self.constants} | others
