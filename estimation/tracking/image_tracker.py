"""Run the chosen method over pictures, one at a time."""

from collections import deque

import numpy as np
from jaxtyping import Shaped

from estimation.estimators.result import Estimate
from estimation.frames.inspection import LiveInspector
from estimation.frames.recording import Frame, MarkerLayout
from estimation.pictures.reader import MarkerReader
from estimation.pictures.reading import make_reader
from estimation.pictures.stream import Picture, fit_picture
from estimation.settings import Settings
from estimation.tracking.stream import MOST_HELD
from estimation.tracking.tracker import Tracker, label_frame


class ImageTracker:
    """Estimates the object's angle picture by picture, from the past alone.

    Markers and reference are learnt from the first usable picture, unless an unloaded one is given
    in the settings. Where a better reference is found later, the pictures so far are answered anew
    within, and the next answer counts from it.

    Attributes:
        settings: of method, noise, softness and pictures.
        reader: of the markers; None before the first usable picture.
        tracker: of the angle; None before the first usable picture.

    Examples:
        >>> import numpy as np
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, make_path
        >>> from estimation import ImageTracker, Scene, VirtualClip
        >>> gel, grid = HalfSpace(0.2, poisson_ratio=0.5), Grid((24, 24), (24.0, 24.0))
        >>> contact = Contact(gel, Rigid(), Sphere(20.0), grid, friction_coefficient=0.5)
        >>> path = make_path([Pose(0.0), Pose(0.0), Pose(1.0), Pose(1.0, twist=0.15)], [2, 3, 9])
        >>> tracker = ImageTracker()
        >>> for picture in VirtualClip(Scene(contact=contact, path=path)):
        ...     answer = tracker.update(picture.image, picture.time)
        >>> print(f"{answer.state}: {np.degrees(answer.angle):.0f}°")
        incipient: 9°
    """

    def __init__(self, settings: Settings | None = None) -> None:
        """Make a tracker.

        Args:
            settings: as of a run; the defaults unless given.

        Raises:
            ValueError: a wrong setting, or an unloaded picture without markers.
        """
        self.settings = Settings() if settings is None else settings
        self.reader: MarkerReader | None = None
        self.tracker: Tracker | None = None
        self._inspector = LiveInspector()
        self._held: deque[Frame] = deque(maxlen=MOST_HELD)
        self._size: tuple[int, int] | None = None
        self._given = 0
        images = self.settings.images
        if isinstance(images.unloaded, int):
            raise ValueError(
                "pictures that are given one by one have no unloaded frame to look up: give the "
                "unloaded picture itself, ImageSettings(unloaded=read_still(path, …))"
            )
        if images.unloaded is not None:
            rest = fit_picture(Picture(images.unloaded.image, np.nan, -1), images.part, None)
            self.reader, self._size = make_reader(rest, images), rest.whole

    def update(self, image: Shaped[np.ndarray, "h w *colour"], time: float) -> Estimate:
        """The answer for the next picture; one that cannot be used is labelled.

        Args:
            image: grey or BGR, of 8 or 16 bit.
            time: time stamp [s].

        Raises:
            ValueError: that is no picture, or the first usable one shows no markers.
        """
        if not isinstance(image, np.ndarray) or image.ndim not in (2, 3):
            got = image.shape if isinstance(image, np.ndarray) else type(image).__name__
            raise ValueError(f"a picture is expected, an array (h, w) or (h, w, 3), got {got}")
        images, number, self._given = self.settings.images, self._given, self._given + 1
        picture = fit_picture(Picture(image, time, number), images.part, self._size)
        self._size = self._size or picture.whole
        if self.reader is None and picture.flaw:
            return label_frame(
                Frame(np.zeros((0, 2)), np.zeros(0, bool), time, number), picture.flaw
            )
        self.reader = self.reader or make_reader(picture, images)
        frame = self.reader.frame(self.reader.read(picture))
        frame = self._inspector.inspect(frame, self.reader.layout.reference)
        tracker = self._follow(self.reader.layout)
        if self.reader.provisional:
            self._held.append(frame)
        else:
            self._held.clear()
        return tracker.update(frame)

    def _follow(self, layout: MarkerLayout) -> Tracker:
        """The tracker of a layout; if it is new, after the frames that it may answer."""
        if self.tracker is None or layout is not self.tracker.layout:
            told = self.settings
            about = {"noise": told.noise, "softness": told.softness, "contact": told.contact}
            self.tracker = Tracker(layout, told.method, **about, **told.constants)
            for frame in self._held:
                self.tracker.update(frame)
        return self.tracker
