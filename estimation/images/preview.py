"""A video of the pictures with what was found drawn into them."""

import tempfile
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from estimation.images.stereo import Rig
from estimation.recording import Recording
from estimation.result import Result
from estimation.sensor import Sensor
from estimation.slip import follow_gel
from estimation.sources.pictures import is_camera, read_pictures

TALL = 960
"""Height up to which pictures are enlarged, and at most threefold [px]."""
STICKS, SLIPS, ELSEWHERE = (60, 220, 60), (60, 60, 240), (200, 200, 200)
LINE = 26


def write_preview(
    recording: Recording, result: Result, sensor: Sensor, path: Path, rig: Rig | None = None
) -> None:
    """Write an annotated video: markers that stick, slip or are elsewhere, state and angles.

    Args:
        recording: read from pictures, which are read again.
        result: of one method.
        sensor: what the recording was read with.
        rig: the two views' calibration, where mirrors split the pictures.
        path: of the video, an `.avi`; it appears whole or not at all.

    Raises:
        ValueError: the pictures cannot be read again.
        OSError: the video cannot be written.
    """
    source = Path(recording.source)
    if is_camera(source):
        raise ValueError("a camera's pictures are not kept: there is no preview of them")
    if recording.positions.shape[2] == 3 and rig is None:
        raise ValueError("positions in space are drawn only with the views' calibration (--stereo)")
    gel = np.degrees(follow_gel(result))
    rate = 1.0 / max(float(np.median(np.diff(recording.time))), 1e-3) if len(recording) > 1 else 25
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        draft = Path(folder) / path.name
        writer, size = None, (0, 0)
        for row, picture in zip(range(len(result.time)), read_pictures(source), strict=False):
            if picture.image is None:
                continue
            there = recording.positions[row]
            spots = sensor.to_pixels(there)[None] if rig is None else rig.locate(there)
            image = annotate(picture.image, recording, result, row, spots, float(gel[row]))
            if writer is None:
                size = (image.shape[1], image.shape[0])
                writer = cv2.VideoWriter(str(draft), cv2.VideoWriter.fourcc(*"MJPG"), rate, size)
            if (image.shape[1], image.shape[0]) == size:
                writer.write(image)
        if writer is None or not writer.isOpened():
            raise OSError(f"{path} cannot be written as a video")
        writer.release()
        draft.replace(path)


def annotate(
    picture: np.ndarray,
    recording: Recording,
    result: Result,
    row: int,
    spots: Float[np.ndarray, "views n 2"],
    gel_deg: float,
) -> np.ndarray:
    """One picture, enlarged, with what was found drawn into it.

    Args:
        picture: of the frame.
        recording: that it belongs to.
        result: of one method.
        row: of the frame.
        spots: where its markers are in it, in each view [px].
        gel_deg: rotation of the gel [deg].
    """
    enlarged = int(np.clip(TALL // picture.shape[0], 1, 3))
    image = picture if picture.dtype == np.uint8 else (picture // 257).astype(np.uint8)
    image = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image[..., :3]
    image = cv2.resize(image, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_LINEAR)
    image = cv2.copyMakeBorder(image, 0, 2 * LINE, 0, 0, cv2.BORDER_CONSTANT, value=(0, 0, 0))
    for i in np.flatnonzero(recording.valid[row]):
        sticks, touches = result.stick[row, i], result.contact[row, i]
        colour = STICKS if sticks else SLIPS if touches else ELSEWHERE
        for x, y in np.rint(enlarged * spots[:, i] + 0.5 * (enlarged - 1)).astype(int).tolist():
            cv2.circle(image, (x, y), 7, colour, 2, cv2.LINE_AA)
    angle, turned = np.degrees(result.angle[row]), np.nan
    if recording.imprint is not None:
        turned = np.degrees(recording.imprint[row, 0])
    values = {"angle": angle, "gel": gel_deg, "imprint": turned, "imprint - gel": turned - gel_deg}
    known = [f"{name} {value:.1f}" for name, value in values.items() if np.isfinite(value)]
    texts = (
        f"frame {result.source_index[row]}  {result.state[row]}  {result.reason[row]}",
        f"{'  '.join(known)} deg" if known else "no angle",
    )
    for line, text in enumerate(texts):
        place = (8, image.shape[0] - 2 * LINE + (line + 1) * LINE - 8)
        cv2.putText(
            image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1, cv2.LINE_AA
        )
    return image
