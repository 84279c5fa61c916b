"""The published clips with changed pictures: light, noise, sharpness, size, sides and coding.

The reference turns of the unchanged clips hold, since no change moves the object from one picture
to the next. Finished changes are kept, so that an interrupted run resumes.
"""

import itertools
import json
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple, cast

import cv2
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from estimation.frames import datasets
from estimation.frames.files import write_whole
from estimation.pictures.stream import DEFAULT_RATE, count_pictures, read_pictures
from papers.items import Track, hash_code
from papers.marker_images import clips, registered, settings
from papers.marker_images.answers import answer_pictures
from papers.tables import finish

if TYPE_CHECKING:
    from av.video.stream import VideoStream

Image = Float[np.ndarray, "h w 3"]
Reference = tuple[int, int, float]
"""Two frames, and the turn of the object between them [deg]."""
Turns = dict[str, list[clips.Turn]]
"""Turns by change."""

KEPT = Path("build/changed")
"""Folder of the finished changes: a file each, in a folder for each version of the code."""

UNCHANGED = "as they are"
QUICK = (UNCHANGED, "a black border of 15 px")


class Coding(NamedTuple):
    """How a video is coded: at a constant quality, or at a constant rate."""

    codec: str
    pixels: str = "yuv420p"
    crf: int | None = None  # constant rate factor of libx264 [-]; larger is coarser
    bits: float | None = None  # constant rate [bits per pixel]


LOSSLESS = Coding("ffv1", "bgr0")
CODINGS = {
    "H.264, -crf 23": Coding("libx264", crf=23),
    "H.264, -crf 28": Coding("libx264", crf=28),
    "H.264, -crf 35": Coding("libx264", crf=35),
    "H.264, 0.035 bits per pixel": Coding("libx264", bits=0.035),
    "H.264, 0.02 bits per pixel": Coding("libx264", bits=0.02),
    "MPEG-4, 0.11 bits per pixel": Coding("mpeg4", bits=0.11),
}
"""Codings of unchanged pictures by name."""


def _shade_corners(image: Image, *_: object) -> Image:
    y, x = (np.linspace(-1.0, 1.0, side) for side in image.shape[:2])
    return image * (1.0 - 0.3 * (x**2 + y[:, None] ** 2))[..., None]


def _halve_dots(image: Image, *_: object) -> Image:
    around = cv2.medianBlur(image.astype(np.uint8), 31).astype(float)
    return np.where(image < around, 0.5 * (image + around), image)


def _blacken_sides(image: Image, *_: object) -> Image:
    return np.pad(image[15:-15, 15:-15], ((15, 15), (15, 15), (0, 0)))


def _scale(factor: float) -> Callable[..., Image]:
    way = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_CUBIC
    return lambda image, *_: cv2.resize(image, None, fx=factor, fy=factor, interpolation=way)


def _code_as_jpeg(image: Image, *_: object) -> Image:
    coded = cv2.imencode(".jpg", image.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 25])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), dtype=float)


CHANGES: dict[str, Callable[[Image, float, np.random.Generator], Image]] = {
    UNCHANGED: lambda image, *_: image,
    "0.3 of the brightness": lambda image, *_: 0.3 * image,
    "brightness falls by 30 % over the clip": lambda image, share, _: image * (1.0 - 0.3 * share),
    "exposure swings between 1 and 0.7": lambda image, share, _: (
        image * (0.85 + 0.15 * np.cos(10.0 * np.pi * share))
    ),
    "corners 60 % darker": _shade_corners,
    "1.3 times as bright, saturated": lambda image, *_: 1.3 * image,
    "γ = 1.6": lambda image, *_: 255.0 * (image / 255.0) ** 1.6,
    "colours exchanged": lambda image, *_: image[..., ::-1],
    "grey": lambda image, *_: np.repeat(image.mean(axis=-1, keepdims=True), 3, axis=-1),
    "contrast of the dots halved": _halve_dots,
    "blur of 1 px": lambda image, *_: cv2.GaussianBlur(image, (0, 0), 1.0),
    "noise of 5 grey levels": lambda image, _, rng: image + rng.normal(0.0, 5.0, image.shape),
    "turned by 90°": lambda image, *_: np.rot90(image),
    "0.7 times the size": _scale(0.7),
    "twice the size": _scale(2.0),
    "a tenth cut off at one side": lambda image, *_: image[:, image.shape[1] // 10 :],
    "a black border of 15 px": _blacken_sides,
    "JPEG, quality 25": _code_as_jpeg,
}
"""Changes of a picture by name: of its levels (0 to 255), the share of the clip before it, and a
generator of noise. The changed levels are rounded and clipped, and coded without loss."""

NAMES = (*CHANGES, *CODINGS)
"""Names of all changes."""


def compute(quick: bool = False, track: Track = iter) -> Turns:
    """The turns of all changes; if quick, of two changes in the two shortest clips."""
    return answer_changes(QUICK if quick else NAMES, quick, track)


def answer_changes(names: Sequence[str], quick: bool = False, track: Track = iter) -> Turns:
    """The turns of some changes; those that the same code has finished are read from `KEPT`.

    Raises:
        ValueError: there is no such change.
        OSError: the clips cannot be fetched, or the folder cannot be written to.
    """
    if unknown := [name for name in names if name not in NAMES]:
        raise ValueError(f"there is no change {unknown[0]!r}; choose from: {'; '.join(NAMES)}")
    root = datasets.fetch("state-videos")
    videos = {clip: root / f"{clip}.avi" for clip in settings.CHANGED_CLIPS}
    videos = {clip: video for clip, video in videos.items() if video.is_file()}
    videos = clips.take_shortest(videos) if quick else videos
    references, turns = find_references(root, videos), Turns()
    version = hash_code(__name__, ("estimation",), json.dumps(references).encode())
    for name in track(names):
        file = KEPT / version / f"{name}.json"
        if not file.is_file():
            found = []
            for clip, pairs in references.items():
                with TemporaryDirectory() as folder:
                    write_changed(videos[clip], name, Path(folder) / "changed.mkv")
                    answers = answer_pictures(Path(folder) / "changed.mkv").frames
                found += [clips.compare_turn(clip, *pair, answers) for pair in pairs]
            write_whole(file, json.dumps([turn._asdict() for turn in found]))
        turns[name] = [clips.Turn(**turn) for turn in json.loads(file.read_text("utf-8"))]
        figures = clips.summarise(turns[name])
        print(name, *(f"{key}: {value}" for key, value in figures.items()), sep="; ")
    return turns


def find_references(root: Path, videos: Mapping[str, Path]) -> dict[str, list[Reference]]:
    """The reference turns of unchanged clips: those of `clips`, else those of `registered`."""
    known, references = clips.read_references(root), {}
    for clip, video in videos.items():
        if clip in known:
            references[clip] = join_turns(known[clip])
            continue
        pairs = registered.draw_pairs(clip, count_pictures(video))
        turns = zip(pairs, registered.register_pairs(video, pairs), strict=True)
        references[clip] = [(*pair, turn) for pair, turn in turns if np.isfinite(turn)]
    return references


def join_turns(known: Sequence[Reference]) -> list[Reference]:
    """The known turns, and those between two frames whose turns from a third one are known."""
    turns = {(first, last): turn for first, last, turn in known}
    since: dict[int, dict[int, float]] = defaultdict(dict)
    for first, last, turn in known:
        since[first][last], since[last][first] = turn, -turn
    for frames in since.values():
        for first, last in itertools.combinations(sorted(frames), 2):
            turns.setdefault((first, last), frames[last] - frames[first])
    return [(*pair, turn) for pair, turn in turns.items()]


def write_changed(video: Path, name: str, out: Path) -> None:
    """Write the changed pictures of a video; the noise is the same in each call.

    Raises:
        OSError: the video cannot be read, or the file cannot be written.
    """
    import av

    count, rng = count_pictures(video), np.random.default_rng(3)
    change, coding = CHANGES.get(name, CHANGES[UNCHANGED]), CODINGS.get(name, LOSSLESS)
    with av.open(str(video)) as source, av.open(str(out), "w") as target:
        rate = source.streams.video[0].average_rate or int(DEFAULT_RATE)
        options = {} if coding.crf is None else {"crf": str(coding.crf)}
        added = target.add_stream(coding.codec, rate=rate, options=options)
        stream = cast("VideoStream", added)
        stream.pix_fmt = coding.pixels
        for i, picture in enumerate(read_pictures(video)):
            if picture.image is None:
                continue
            levels = change(picture.image.astype(float), i / count, rng)
            image = np.ascontiguousarray(np.clip(np.rint(levels), 0, 255).astype(np.uint8))
            if not stream.codec_context.is_open:
                stream.height, stream.width = image.shape[:2]
                if coding.bits is not None:
                    stream.bit_rate = int(coding.bits * image[..., 0].size * rate)
            target.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        target.mux(stream.encode())


def tables(result: Turns) -> dict[str, list[dict[str, object]]]:
    """Tables by change and by turn."""
    return {
        "": [{"pictures": name, **clips.summarise(turns)} for name, turns in result.items()],
        "_turns": [
            {"pictures": name, **clips.row_of_turn(turn)}
            for name, turns in result.items()
            for turn in turns
        ],
    }


def plot(result: Turns) -> Figure:
    """Errors and intervals of the turns by change; turns outside their interval are orange."""
    figure, axis = plt.subplots(figsize=(9.0, 1.5 + 0.35 * len(result)), layout="constrained")
    for place, turns in enumerate(result.values()):
        for turn, off in zip(turns, np.linspace(-0.3, 0.3, len(turns)), strict=True):
            colour = "C1" if turn.outside else "C0"
            ends = np.array([turn.low, turn.high]) - turn.reference
            axis.plot(ends, [place + off] * 2, color=colour, lw=0.4)
            axis.plot(turn.error, place + off, ".", color=colour, ms=3)
    axis.set_yticks(range(len(result)), list(result))
    axis.invert_yaxis()
    finish(axis, xlabel="our turn − reference, with its 95 % interval [°]")
    return figure
