"""Run the chosen method over pictures, one by one."""

from collections import deque

import numpy as np
from jaxtyping import Shaped

from estimation.estimators.result import Estimate
from estimation.fields.torsion import prepare_faces
from estimation.frames.inspection import LiveInspector
from estimation.frames.recording import Frame, MarkerLayout
from estimation.frames.source import MOST_HELD_FRAMES
from estimation.pictures.reader import ImageSettings, MarkerReader
from estimation.pictures.reading import make_reader, marker_readers
from estimation.pictures.stream import Cutter, Picture
from estimation.settings import Settings
from estimation.slip.alert import Alert
from estimation.slip.margin import Margin
from estimation.slip.shear import Shear
from estimation.softness import expect_scale
from estimation.tracking.tracker import Tracker, expect_time
from estimation.tracking.trackers import label_frame


class ImageTracker:
    """Estimates the object's angle picture by picture, causally, and warns of slip.

    Markers and their reference come from the first usable picture, unless the settings give an
    unloaded picture. If a later picture gives a better reference, the tracker re-evaluates the
    earlier pictures internally, and the next answer is relative to the new reference.

    Attributes:
        settings: method, noise, softness and properties of the pictures.
        reader: reader of the markers; None before the first usable picture.
        tracker: tracker of the angle; None before the first usable picture.

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
        >>> print(f"{answer.state}: {np.degrees(answer.angle):.0f}°, {tracker.alert.level}")
        incipient: 9°, act
    """

    def __init__(self, settings: Settings | None = None) -> None:
        """Make a tracker.

        Args:
            settings: settings as of a run; the defaults if None.

        Raises:
            ValueError: a wrong setting, noise or softness in another unit than the lengths, or no
                markers in the unloaded picture.
        """
        self.settings = Settings() if settings is None else settings
        if not isinstance(self.settings, Settings):
            raise ValueError(
                f"settings are expected, got {type(settings).__name__}: make them, for example "
                "`Settings(images=ImageSettings(Sensor(mm_per_px=0.05)))`"
            )
        self.reader: MarkerReader | None = None
        self.tracker: Tracker | None = None
        self._inspector = LiveInspector()
        self._held: deque[Frame] = deque(maxlen=MOST_HELD_FRAMES)
        self._count = 0
        images = self.settings.images
        self._cutter = Cutter(images.part)
        if isinstance(images.unloaded, int):
            raise ValueError(
                "the number of an unloaded frame cannot be used with pictures that come one by "
                "one: give the unloaded picture, ImageSettings(unloaded=picture)"
            )
        expect_scale(self.settings.softness, images.unit, "the pictures")
        noise = self.settings.noise
        if noise is not None and noise.unit != images.unit:
            raise ValueError(
                f"the noise is given in {noise.unit}, but the pictures' lengths are in "
                f'{images.unit}: use Noise.from_std(…, unit="{images.unit}")'
            )
        marker_readers()  # no picture waits for imports and tables
        if noise is not None:
            prepare_faces()
        unloaded = images.unloaded_picture
        if unloaded is not None:
            rest = self._cutter.cut(Picture(unloaded.image, np.nan, -1))
            if rest.flaw:
                raise ValueError(f"the unloaded picture shows no markers: {rest.flaw}")
            self.reader = _make_reader(rest, images)

    def update(self, image: Shaped[np.ndarray, "h w *colour"], time: float) -> Estimate:
        """The estimate for the next picture; for an unusable picture, the reason instead.

        Args:
            image: grey or BGR picture of 8 or 16 bit.
            time: time stamp [s].

        Raises:
            ValueError: `image` is not a picture, `time` is not a number, or the first usable
                picture shows no markers.
        """
        if not isinstance(image, np.ndarray) or image.ndim not in (2, 3):
            got = image.shape if isinstance(image, np.ndarray) else type(image).__name__
            raise ValueError(
                f"a picture is expected, an array (h, w) or (h, w, 3), got {got}: read a file with "
                "cv2.imread; a camera gives None if it has no picture"
            )
        if image.ndim == 3 and image.shape[2] not in (3, 4):
            if image.shape[2] != 1:
                raise ValueError(
                    f"a picture is expected, an array (h, w) or (h, w, 3), got {image.shape}"
                )
            image = image[..., 0]
        expect_time(time)
        number, self._count = self._count, self._count + 1
        picture = self._cutter.cut(Picture(image, time, number))
        if self.reader is None and picture.flaw:
            return label_frame(Frame(np.zeros((0, 2)), time, number), picture.flaw)
        self.reader = self.reader or _make_reader(picture, self.settings.images)
        frame = self.reader.take(picture)
        frame = self._inspector.inspect(frame, self.reader.layout.reference)
        tracker = self._follow(self.reader.layout)
        if self.reader.provisional:
            self._held.append(frame)
        else:
            self._held.clear()
        return tracker.update(frame)

    @property
    def alert(self) -> Alert:
        """The warning of a macro slip after the last picture."""
        return Alert() if self.tracker is None else self.tracker.alert

    @property
    def margin(self) -> Margin:
        """Angle that remains before macro slip; NaN where the data cannot determine it."""
        return Margin() if self.tracker is None else self.tracker.margin

    @property
    def shear(self) -> Shear:
        """Shear of the gel in the last picture, and whether the object slips along it."""
        return Shear() if self.tracker is None else self.tracker.shear

    def _follow(self, layout: MarkerLayout) -> Tracker:
        """The tracker of a layout; a new one has been given the frames held so far."""
        if self.tracker is None or layout is not self.tracker.layout:
            settings = self.settings
            self.tracker = Tracker(
                layout,
                settings.method,
                noise=settings.noise,
                softness=settings.softness,
                contact=settings.contact,
                alert=settings.alert,
                **settings.constants,
            )
            held = list(self._held)
            for frame in held if self.reader is None else self.reader.reevaluate(held):
                self.tracker.update(frame)
        return self.tracker


def _make_reader(picture: Picture, images: ImageSettings) -> MarkerReader:
    """The reader for a first picture; its errors also name the settings of a loop of one's own."""
    try:
        return make_reader(picture, images)
    except ValueError as error:
        raise ValueError(
            f"{error}. Without the command line, --marker, --dot-radius-px and --dark are "
            "Sensor(marker=…, radius=…, dark=…), and --crop and --mask are Part(…) of "
            "ImageSettings(sensor, part=…)"
        ) from error
