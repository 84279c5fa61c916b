"""Sheets for reading the state of a contact by eye, without any answer of an estimator.

Frames are selected at random from clips of real objects, within strata of the picture's motion. A
row of a sheet shows one frame, from the left: the picture; its difference in brightness from the
clip's median picture; the object's print 4 frames before (red) and 4 frames after (cyan), with the
dots painted out; and the enlarged motion over these 8 frames, of the dots in red and of the print
in green. Both motions are from optical flow ([Lucas1981] B. D. Lucas and T. Kanade, "An Iterative
Image Registration Technique"). The first row of a clip shows ten pictures of the whole clip. The
guide for readers is `readings/README.md`.
"""

from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from estimation.frames.datasets import find, list_files
from estimation.frames.files import write_whole
from estimation.pictures.stream import read_pictures
from papers.items import Track
from papers.marker_images.settings import SHEETS, SheetSettings

Clip = UInt8[np.ndarray, "frames h w 3"]
Picture = UInt8[np.ndarray, "h w 3"]
Sheet = UInt8[np.ndarray, "height width 3"]


COLOURS = {"print": (0, 255, 0), "dots": (80, 80, 255), "print against dots": (0, 255, 255)}


def read_clip(path: Path) -> Clip:
    """All pictures of a video; the last good picture replaces an unusable one.

    Raises:
        ValueError: the first picture is unusable.
        OSError: the file cannot be read.
    """
    pictures: list[Picture] = []
    for picture in read_pictures(path):
        if picture.image is not None:
            pictures.append(picture.image)
        elif pictures:
            pictures.append(pictures[-1])
        else:
            raise ValueError(f"{path}: the first picture cannot be used: {picture.flaw}")
    return np.array(pictures)


def draw(root: Path, settings: SheetSettings = SHEETS) -> dict[str, list[int]]:
    """Random frames by clip, from all videos `OBJECT/EXPERIMENT/CAMERA.avi` in a folder.

    Every object has the same number of clips, every stratum of a clip's motion the same number of
    frames.
    """
    rng = np.random.default_rng(settings.seed)
    drawn: dict[str, list[int]] = {}
    for folder in sorted(path for path in root.iterdir() if path.is_dir()):
        clips = sorted(folder.glob("*/*.avi"))
        if folder.name not in settings.whole:
            chosen = rng.choice(len(clips), min(settings.clips, len(clips)), replace=False)
            clips = [clips[i] for i in sorted(chosen)]
        drawn |= {f"{path.parent.relative_to(root)}/{path.stem}": [] for path in clips}
    for name in drawn:
        drawn[name] = draw_frames(read_clip(root / f"{name}.avi"), rng, settings)
    return drawn


def check_clips(clips: Sequence[str]) -> None:
    """Check the names of videos, paths without suffix, before the data set is downloaded.

    Raises:
        ValueError: a video is neither in the data set nor in its folder here.
    """
    listed = [file.removesuffix(".avi") for file in list_files("state-videos")]
    root = find("state-videos")
    for name in clips:
        if name not in listed and not (root and (root / f"{name}.avi").is_file()):
            raise ValueError(f"no video {name!r} in state-videos: choose from {', '.join(listed)}")


def every_frame(root: Path, clips: Sequence[str]) -> dict[str, range]:
    """All frames of some clips, paths without suffix, with enough frames around them, by clip.

    Raises:
        OSError: a video cannot be read.
    """
    sizes = {name: len(read_clip(root / f"{name}.avi")) for name in clips}
    return {name: range(SHEETS.reach, size - SHEETS.reach) for name, size in sizes.items()}


def draw_frames(clip: Clip, rng: np.random.Generator, settings: SheetSettings) -> list[int]:
    """Random frames of a clip, the same number from each stratum of the picture's motion."""
    frames = np.arange(settings.before, len(clip) - settings.reach)
    grey = clip.mean(axis=-1)
    reach = settings.reach
    motion = np.abs(grey[frames + reach] - grey[frames - reach]).mean(axis=(1, 2))
    drawn: list[int] = []
    for low, high in pairwise(np.quantile(motion, [0.0, *settings.strata, 1.0])):
        stratum = frames[(motion >= low) & (motion <= high) & ~np.isin(frames, drawn)]
        drawn += rng.choice(stratum, min(settings.draws, len(stratum)), replace=False).tolist()
    return sorted(drawn)


def write_sheets(
    root: Path, out: Path, drawn: Mapping[str, Sequence[int]], track: Track = iter
) -> None:
    """Write the sheets of frames, the guide to reading them and an empty table.

    Raises:
        OSError: a video cannot be read, or a file cannot be written.
    """
    for name in track(list(drawn)):
        clip = read_clip(root / f"{name}.avi")
        for i, sheet in enumerate(make_sheets(clip, name, drawn[name])):
            written = cv2.imencode(".png", sheet)[1].tobytes()
            write_whole(out / f"{name.replace('/', '_')}_{i}.png", written)
    table = "".join(f"{name},{t},,,\n" for name, frames in drawn.items() for t in frames)
    write_whole(out / "reading.csv", "clip,frame,contact,motion,state\n" + table)
    guide = resources.files("papers.marker_images") / "readings" / "README.md"
    write_whole(out / "README.md", guide.read_text(encoding="utf-8"))


def make_sheets(
    clip: Clip, name: str, frames: Sequence[int], settings: SheetSettings = SHEETS
) -> Iterator[Sheet]:
    """The sheets of a clip."""
    usual = np.median(clip[:: max(len(clip) // 50, 1)], axis=0)
    head = _make_head(clip, name)
    for start in range(0, len(frames), settings.rows):
        rows = [_make_row(clip, usual, t, settings) for t in frames[start : start + settings.rows]]
        yield np.vstack([head, *rows])


def _make_head(clip: Clip, name: str) -> Sheet:
    numbers = np.linspace(0, len(clip) - 1, 10).astype(int)
    small = [
        _write(
            cv2.resize(_stretch(clip[t]), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA),
            f"{t}",
        )
        for t in numbers
    ]
    row = np.hstack(small)
    title = np.zeros((26, row.shape[1], 3), np.uint8)
    return np.vstack([_write(title, name), row])


def _make_row(
    clip: Clip, usual: Float[np.ndarray, "h w 3"], t: int, settings: SheetSettings
) -> Sheet:
    """The row of one frame."""
    reach = settings.reach
    near = list(clip[t - reach : t + reach + 1])
    plain = [paint_out_dots(picture) for picture in near]
    light = np.clip(128.0 + settings.gain * (clip[t] - usual), 0, 255).astype(np.uint8)
    before, after = _sharpen(plain[0]), _sharpen(plain[-1])
    motion = measure_motion(near, plain, settings)
    row = np.hstack(
        [
            _write(_stretch(clip[t]), f"frame {t}"),
            _write(light, "light - median"),
            _write(
                np.stack([after, after, before], axis=-1),
                f"print {t - reach} red, {t + reach} cyan",
            ),
            *_draw_motion(clip[t], motion, settings),
        ]
    )
    row[:2] = 255
    return row


def find_dots(picture: Picture) -> UInt8[np.ndarray, "h w"]:
    """A mask of the dots: dark blobs smaller than the window of the closing."""
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    closed = cv2.morphologyEx(grey, cv2.MORPH_CLOSE, np.ones((25, 25), np.uint8))
    dark = (closed.astype(int) - grey > 0.35 * closed).astype(np.uint8)
    return cv2.morphologyEx(dark, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))


def paint_out_dots(picture: Picture) -> Picture:
    """The picture with its dots replaced by their surroundings."""
    mask = cv2.dilate(find_dots(picture), np.ones((5, 5), np.uint8))
    return cv2.inpaint(picture, mask, 3, cv2.INPAINT_TELEA)


def follow(
    pictures: Sequence[Picture] | Sequence[UInt8[np.ndarray, "h w"]],
    points: Float[np.ndarray, "n 2"],
    window: int,
) -> Float[np.ndarray, "n 2"]:
    """Positions of the first picture's points in the last [px]; NaN if tracking back fails."""
    if not len(points):
        return points
    ends = _flow(pictures, points, window)
    back = np.linalg.norm(_flow(pictures[::-1], ends, window) - points, axis=1)
    return np.where((back < 0.5)[:, None], ends, np.nan)


def _flow(
    pictures: Sequence[Picture] | Sequence[UInt8[np.ndarray, "h w"]],
    points: Float[np.ndarray, "n 2"],
    window: int,
) -> Float[np.ndarray, "n 2"]:
    """Track points from picture to picture; lost points end far outside the picture."""
    here = points.astype(np.float32)[:, None]
    for before, after in pairwise(pictures):
        moved = here.copy()
        here, tracked, _ = cv2.calcOpticalFlowPyrLK(
            before, after, here, moved, winSize=(window, window), maxLevel=2
        )
        here[tracked[:, 0] == 0] = -1e4
    return here[:, 0].astype(float)


class Motion(NamedTuple):
    """Motion of dots and print over some pictures."""

    dots: Float[np.ndarray, "n 2"]  # positions of the dots in the first picture [px]
    dots_moved: Float[np.ndarray, "n 2"]  # motion of the dots [px]; NaN where unknown
    print: Float[np.ndarray, "m 2"]  # positions with a visible print [px]
    print_moved: Float[np.ndarray, "m 2"]  # motion of the print [px]; NaN where unknown
    apart: Float[np.ndarray, "m 2"]  # motion of the print relative to the dots around it [px]


def measure_motion(
    pictures: Sequence[Picture], plain: Sequence[Picture], settings: SheetSettings = SHEETS
) -> Motion:
    """Motion of dots and print from the first picture to the last; plain ones show no dots."""
    dots = cv2.connectedComponentsWithStats(find_dots(pictures[0]))[3][1:]
    height, width = pictures[0].shape[:2]
    y, x = np.mgrid[16 : height - 15 : 16, 16 : width - 15 : 16]
    shades = cv2.cornerMinEigenVal(_sharpen(plain[0]), 21)[y, x].ravel()
    print_ = np.stack([x.ravel(), y.ravel()], axis=1)[shades > settings.least_shade].astype(float)
    moved = follow(pictures, dots, 21) - dots
    print_moved = follow([_sharpen(picture) for picture in plain], print_, 25) - print_
    tracked = np.isfinite(moved[:, 0])
    weight = 1.0 / (((print_[:, None] - dots[None, tracked]) ** 2).sum(axis=-1) + 25.0) ** 2
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)
    return Motion(dots, moved, print_, print_moved, print_moved - weight @ moved[tracked])


def follow_slip(
    clip: Clip, t: int, settings: SheetSettings = SHEETS
) -> Float[np.ndarray, " later"]:
    """Slip of the print over the gel, since the first picture of a panel, in each later one [px].

    It is the median over the places at which the print has clearly slipped until the last picture,
    and at most places around them as well, along their slip until then; NaN without such a place.

    Args:
        clip: all pictures.
        t: frame of the panel.
        settings: of the sheets.
    """
    least, around = 1.0, 40.0  # slip that counts, and reach of the places around [px]
    near = list(clip[t - settings.reach : t + settings.reach + 1])
    plain = [paint_out_dots(picture) for picture in near]
    motions = [
        measure_motion(near[:stop], plain[:stop], settings) for stop in range(2, len(near) + 1)
    ]
    place, last = motions[-1].print, motions[-1].apart
    far = np.linalg.norm(last, axis=1)
    known = np.isfinite(far)
    place, last, far = place[known], last[known], far[known]
    along = last / np.maximum(far, 1e-9)[:, None]
    close = np.linalg.norm(place - place[:, None], axis=-1) < around
    moved = np.zeros(len(far), dtype=bool)
    for i in np.flatnonzero(far >= least):
        alike = last[close[i]] @ along[i]
        moved[i] = len(alike) > 2 and np.median(alike) > 0.5 * far[i]
    if not moved.any():
        return np.full(len(motions), np.nan)
    return np.array(
        [np.nanmedian(np.sum(step.apart[known] * along, axis=1)[moved]) for step in motions]
    )


def _draw_motion(picture: Picture, motion: Motion, settings: SheetSettings) -> list[Picture]:
    """Two panels: motion of dots and print, and motion of the print relative to the dots."""
    panels = []
    for arrows in (
        [("print", motion.print, motion.print_moved), ("dots", motion.dots, motion.dots_moved)],
        [("print against dots", motion.print, motion.apart)],
    ):
        sizes = [np.linalg.norm(moved, axis=1) for _, _, moved in arrows]
        sizes = [size[np.isfinite(size)] for size in sizes]
        largest = max((np.percentile(size, 90) for size in sizes if len(size)), default=0.0)
        times = settings.enlarged if largest < settings.far else 1.0
        panel = (0.45 * _stretch(picture)).astype(np.uint8)
        labels = [f"x{times:.0f}"]
        for (name, places, moved), size in zip(arrows, sizes, strict=True):
            _draw_arrows(panel, places, times * moved, COLOURS[name])
            if len(size):
                labels.append(f"{name} {np.median(size):.1f}/{np.percentile(size, 90):.1f}")
        panels.append(_write(panel, " ".join(labels)))
    return panels


def _draw_arrows(
    panel: Picture,
    places: Float[np.ndarray, "n 2"],
    moved: Float[np.ndarray, "n 2"],
    colour: tuple[int, int, int],
) -> None:
    """Draw a line from each place, with a dot at its start."""
    for place, step in zip(places, moved, strict=True):
        if np.isfinite(step[0]):
            start, end = (np.round(p).astype(int).tolist() for p in (place, place + step))
            cv2.line(panel, start, end, colour, 1, cv2.LINE_AA)
            cv2.circle(panel, start, 1, colour, -1)


def _stretch(picture: Picture) -> Picture:
    """The picture with more local contrast."""
    lab = cv2.cvtColor(picture, cv2.COLOR_BGR2LAB)
    lab[..., 0] = cv2.createCLAHE(3.0, (4, 4)).apply(np.ascontiguousarray(lab[..., 0]))
    return cv2.cvtColor(lab, cv2.COLOR_LAB2BGR)


def _sharpen(picture: Picture) -> UInt8[np.ndarray, "h w"]:
    """Enhanced edges and texture, without gradual changes of brightness."""
    fine = picture.astype(np.float32)
    fine = cv2.GaussianBlur(fine, (0, 0), 1.0) - cv2.GaussianBlur(fine, (0, 0), 6.0)
    return np.clip(128.0 + 6.0 * fine.mean(axis=-1), 0, 255).astype(np.uint8)


def _write(picture: Picture, text: str) -> Picture:
    picture = np.ascontiguousarray(picture)
    for colour, thick in (((0, 0, 0), 3), ((255, 255, 255), 1)):
        cv2.putText(
            picture, text, (4, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, thick, cv2.LINE_AA
        )
    return picture
