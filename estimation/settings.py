"""What a run is told: the one settings object of command line, summary and Python."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from estimation.choices import Choices
from estimation.estimators import METHODS
from estimation.frames.noise import Noise
from estimation.observation import RIGID_OBJECT
from estimation.pictures.reader import ImageSettings
from estimation.softness import Softness


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
