"""A video of the pictures, annotated with markers, states and angles."""

from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int

from estimation.frames.extras import require_extra
from estimation.frames.inspection import disordered_times
from estimation.output.found import Run
from estimation.output.record import KeptMarkers
from estimation.output.scene import MARKER_COLOURS, marker_signs, sticking_markers
from estimation.pictures.reader import ImageSettings
from estimation.pictures.stream import DEFAULT_RATE, is_camera, read_pictures
from estimation.slip.alert import AlertLevel
from estimation.slip.motion import follow_gel

H264_ENCODERS = ("libx264", "libopenh264")
"""H.264 encoders that run on any processor, in order of preference."""
TICKS_PER_SECOND = 90_000
"""Resolution of a video's times [1/s]."""


def find_encoder() -> str:
    """Name of the H.264 encoder for previews.

    Raises:
        MissingExtraError: PyAV is not installed.
        ValueError: the installed PyAV has no such encoder.
    """
    require_extra("video", "a preview (--preview)")
    import av
    from av.codec.codec import UnknownCodecError

    for name in H264_ENCODERS:
        with suppress(UnknownCodecError):
            return av.Codec(name, "w").name
    raise ValueError(
        f"a preview (--preview) needs an H.264 encoder, {' or '.join(H264_ENCODERS)}; PyAV "
        f"{av.__version__} was built without one: install its wheel with `pip install "
        "--force-reinstall --only-binary av av`"
    )


def write_preview(run: Run, images: ImageSettings, path: Path) -> None:
    """Write an annotated video: markers that stick, slip or have no contact, state and angles.

    The video is H.264 in MP4, which browsers play, with the recording's times. It shows whole
    pictures; parts outside of crop and mask are darker. Pictures of another size are omitted.

    Args:
        run: run over pictures, with the markers of all frames stored. The pictures are read again.
        images: settings that the pictures were read with.
        path: path of the video, `*.mp4`, which is written completely or not at all.

    Raises:
        ValueError: the pictures cannot be read again, or their video cannot be encoded.
        OSError: the video cannot be written.
    """
    source = Path(run.source)
    if is_camera(source):
        raise ValueError("a camera's pictures are not stored, so there is no preview of them")
    gel = np.degrees(follow_gel(run.main))
    ticks = to_ticks(run.main.time)

    def pictures() -> Iterator[tuple[int, np.ndarray]]:
        size = None
        for markers, picture in zip(run.markers(), read_pictures(source), strict=False):
            size = size or picture.whole  # `whole` is None if the size differs from the others
            if picture.image is None or picture.size != size:
                continue
            spots = images.locate(markers.positions)
            shown, turned = images.part.darken(picture.image), float(gel[markers.row])
            yield int(ticks[markers.row]), annotate(shown, run, markers, spots, turned)

    draft = path.with_name(f".{path.name}")
    try:
        _encode(pictures(), draft)
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def _encode(pictures: Iterator[tuple[int, np.ndarray]], path: Path) -> None:
    """Write pictures of one size, each with its time in ticks, as H.264 in MP4."""
    import av
    from av.error import FFmpegError

    ahead = next(pictures, None)
    if ahead is None:
        raise ValueError("no picture can be read again")
    try:
        place = str(path.absolute())  # FFmpeg takes the `13` of `13:06/preview.mp4` for a protocol
        with av.open(place, "w", options={"movflags": "+faststart"}) as container:
            stream = container.add_stream(find_encoder())
            assert isinstance(stream, av.VideoStream)
            stream.height, stream.width = ahead[1].shape[:2]
            stream.pix_fmt = "yuv420p"
            stream.codec_context.time_base = Fraction(1, TICKS_PER_SECOND)
            stream.codec_context.max_b_frames = 0  # they would end the video before its last frame
            for tick, image in chain([ahead], pictures):
                frame = av.VideoFrame.from_ndarray(image, format="bgr24")
                frame.pts, frame.time_base = tick, Fraction(1, TICKS_PER_SECOND)
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
    except FFmpegError as error:
        raise ValueError(f"{path.name} cannot be encoded: {error}") from error


def to_ticks(time: Float[np.ndarray, " frames"]) -> Int[np.ndarray, " frames"]:
    """Times since the first frame [1 / `TICKS_PER_SECOND` s], interpolated where none is valid."""
    rows = np.arange(len(time))
    good = np.flatnonzero(np.isfinite(time) & ~disordered_times(time))
    step = (
        float(np.median(np.diff(time[good]) / np.diff(good)))
        if len(good) > 1
        else 1.0 / DEFAULT_RATE
    )
    if not len(good):
        return np.rint(rows * step * TICKS_PER_SECOND).astype(int)
    since = np.interp(rows, good, time[good] - time[good[0]])
    since += step * (np.minimum(rows - good[0], 0) + np.maximum(rows - good[-1], 0))
    ticks = np.rint((since - since[0]) * TICKS_PER_SECOND).astype(int)
    return np.maximum.accumulate(ticks - rows) + rows


def annotate(
    picture: np.ndarray,
    run: Run,
    markers: KeptMarkers,
    spots: Float[np.ndarray, "views n 2"],
    gel_deg: float,
) -> np.ndarray:
    """An enlarged picture, annotated with markers, state and angles.

    The markers lie at `spots` in each view [px]; the gel has turned by `gel_deg` [deg].
    """
    tall = 960  # height up to which pictures are enlarged, by at most three [px]
    enlarged = int(np.clip(tall // picture.shape[0], 1, 3))
    image = picture if picture.dtype == np.uint8 else (picture // 257).astype(np.uint8)
    image = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image[..., :3]
    image = cv2.resize(image, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_LINEAR)
    thickness = max(26, image.shape[0] // 24)  # of a line of text [px]
    odd = np.array(image.shape[:2]) % 2  # H.264 takes even sizes
    below, right = 2 * thickness + int(odd[0]), int(odd[1])
    image = cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_CONSTANT, value=(0, 0, 0))
    result, row = run.main, markers.row
    signs = marker_signs(sticking_markers(result, markers), markers.contact)
    for i in np.flatnonzero(markers.valid):
        for spot in enlarged * spots[:, i] + 0.5 * (enlarged - 1):
            mark_spot(image, spot, signs[i])
    angle, turned = np.degrees(result.angle[row]), np.degrees(run.imprint[row])
    values = {"angle": angle, "gel": gel_deg, "imprint": turned, "imprint - gel": turned - gel_deg}
    words = [f"{name} {value:z.1f}" for name, value in values.items() if np.isfinite(value)]
    for line, text in enumerate(
        (_describe(run, row), f"{'  '.join(words)} deg" if words else "no angle")
    ):
        place = (8, image.shape[0] - 2 * thickness + (line + 1) * thickness - 8)
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(image, text, place, font, thickness / 43, (255, 255, 255), 1, cv2.LINE_AA)
    return image


def mark_spot(image: np.ndarray, spot: Float[np.ndarray, " 2"], sign: str, radius: int = 7) -> None:
    """Draw a marker at a spot of a BGR picture [px]: a cross if it slips, otherwise a ring."""
    colour = dict(zip("ox.", MARKER_COLOURS.values(), strict=True))[sign]
    shade = tuple(int(colour[i : i + 2], 16) for i in (5, 3, 1))  # of #rrggbb
    x, y = np.rint(spot).astype(int).tolist()
    if sign == "x":
        across = cv2.MARKER_TILTED_CROSS
        cv2.drawMarker(image, (x, y), shade, across, 2 * radius, 2, cv2.LINE_AA)
    else:
        cv2.circle(image, (x, y), radius, shade, 2, cv2.LINE_AA)


def _describe(run: Run, row: int) -> str:
    """A line with a frame's state, slip, alert and reason."""
    result, shears, level = run.main, run.shears, run.grips.level[row]
    words = [f"frame {result.source_index[row]}", str(result.state[row])]
    if np.isfinite(slipped := shears.slip_probability[row]):
        words.append(f"slips {slipped:.0%}")
    if np.isfinite(slip := shears.slip[row]):
        places = 2 if run.unit == "mm" else 1
        half = shears.slip_error[row]
        words.append(f"slid {slip:z.{places}f} +- {half:.{places}f} {run.unit}")
    if level in (AlertLevel.WATCH, AlertLevel.ACT):
        words.append(f"alert {level}")
    return "  ".join([*words, result.reason[row]])
