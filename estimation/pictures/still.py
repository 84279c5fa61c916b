"""Single pictures, from files and from a bag's messages, and small copies of them."""

import hashlib
import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Shaped
from PIL import Image, UnidentifiedImageError

from estimation.frames.tac3d import is_tac3d

MOST_PIXELS = 50_000_000
"""Most pixels of a picture; larger pictures are rejected before they are decoded."""


@dataclass(frozen=True, eq=False, repr=False)
class Still:
    """A picture with the file that it was read from.

    Attributes:
        path: of the file.
        image: grey or BGR, 8 or 16 bit.
    """

    path: Path
    image: Shaped[np.ndarray, "h w *colour"]

    def __repr__(self) -> str:
        """The file's name and a digest of the picture, so that a changed picture is noticed."""
        digest = hashlib.sha256(np.ascontiguousarray(self.image).tobytes()).hexdigest()
        return f"Still({self.path.name}, {self.image.shape}, {digest})"


def read_still(path: Path, what: str) -> Still:
    """Read a picture from a file.

    Args:
        path: of the file.
        what: use of the picture, for the error message.

    Raises:
        OSError: the file cannot be opened.
        ValueError: the file is not a picture, is damaged or is too large.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}, given as {what}, does not exist or is not a file")
    image, flaw = load_picture(path)
    if image is None:
        raise ValueError(f"{path}, given as {what}, {flaw}: give an 8 or 16 bit picture (PNG, …)")
    return Still(path, image)


def is_image(path: Path) -> bool:
    """Whether the path names an image, by its suffix."""
    return path.suffix.lower() in (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")


def advise_on(path: Path) -> str:
    """What to do with a file that is no recording, after a semicolon; empty if that is unknown."""
    if is_image(path) and (flaw := load_picture(path)[1]):
        return f"; it {flaw}"
    if is_tac3d(path.parent) or is_image(path):
        return f"; give its folder, {path.parent}/"
    if path.suffix.lower() in (".npy", ".csv", ".tsv", ".xlsx", ".mat"):
        return "; convert a table of marker positions as examples/markers_table.py does"
    if path.suffix.lower() in (".gif", ".apng"):
        return f"; convert it to a video first (ffmpeg -i {path.name} {path.stem}.mp4)"
    return "" if path.is_file() else "; save the stream as a video first, for example as .mp4"


def load_picture(path: Path) -> tuple[Shaped[np.ndarray, "h w *colour"] | None, str]:
    """Read the picture in a file.

    Returns:
        The picture, or None and what is wrong, in words that follow the file's name.

    Raises:
        ValueError: the picture has too many pixels or none.
    """
    try:
        return decode_picture(path.read_bytes(), path)
    except OSError:
        return None, "is not an image, or is damaged"


def turn_upright(
    image: Shaped[np.ndarray, "h w *colour"], turn: tuple[int, int, int, int]
) -> Shaped[np.ndarray, "h2 w2 *colour"]:
    """Turn or mirror a picture to the way in which it is meant to be shown.

    Args:
        image: the stored picture.
        turn: a, b, c, d, of which the signs count: the point (x, y) is shown at
            (a x + c y, b x + d y), up to a shift. Angles between the axes count as the nearer one.
    """
    a, b, c, d = turn
    right, down = a, d
    if abs(b) > abs(a):
        image, right, down = cv2.transpose(image), c, b
    if right < 0 or down < 0:
        image = cv2.flip(image, -1 if right < 0 and down < 0 else int(right < 0))
    return image


def find_exposure_flaw(image: Shaped[np.ndarray, "h w *colour"]) -> str:
    """Why a picture shows nothing: it is black or saturated; empty if it is not."""
    # mean grey levels (of 255) below and above which a picture shows nothing
    black, white = 8.0, 247.0
    channels, deep = 1 if image.ndim == 2 else image.shape[2], image.dtype == np.uint16
    level = sum(cv2.mean(image[::16])[:channels]) / channels  # few rows are enough
    level *= 255.0 / 65535.0 if deep else 1.0
    if level < black:
        advice = (
            f": no value above {image.max()} of 65535; multiply values of 10, 12 or 14 bit by 64, "
            "16 or 4"
        )
        return "the picture is black" + (advice if deep else "")
    return "the picture is saturated" if level > white else ""


def sample_pictures(files: Sequence[Path]) -> list[np.ndarray]:
    """A few of the pictures in files, evenly spread, without those that cannot be read."""
    most = 9  # number of pictures
    images = (load_picture(file)[0] for file in files[:: len(files) // most + 1])
    return [image for image in images if image is not None]


def kind_of(image: np.ndarray | None) -> str:
    """Whether a picture is grey or in colour; empty if there is none."""
    return "" if image is None else "grey" if image.ndim == 2 else "in colour"


def find_usual_size(images: Sequence[np.ndarray]) -> tuple[int, int] | None:
    """The most frequent width and height of pictures [px]; None without a picture."""
    sizes = Counter((image.shape[1], image.shape[0]) for image in images)
    return sizes.most_common(1)[0][0] if sizes else None


def doubt_depth(images: Sequence[np.ndarray]) -> tuple[str, ...]:
    """A warning if 16-bit pictures of one source seem to hold values of 14 bit or less."""
    largest = max((int(image.max()) for image in images), default=0)
    bits = largest.bit_length()
    if bits > 14 or not images or any(image.dtype != np.uint16 for image in images):
        return ()
    return (
        f"The pictures have 16 bit, but no value above {largest} of 65535: they are read as dark. "
        f"If the camera has {bits} bit, multiply the values by {2 ** (16 - bits)}.",
    )


def decode_picture(data: bytes, what: Path) -> tuple[Shaped[np.ndarray, "h w *colour"] | None, str]:
    """Decode the content of a picture file.

    Args:
        data: the file's content.
        what: file or message that holds it, for the error message.

    Returns:
        The picture, or None and what is wrong, in words that follow the file's name.

    Raises:
        ValueError: the picture has too many pixels or none.
    """
    most = 2  # number of images in a file with a single picture: itself and a thumbnail
    try:
        with Image.open(io.BytesIO(data)) as header:
            check_size(*header.size, what)
            images = getattr(header, "n_frames", 1)
    except (UnidentifiedImageError, OSError):
        return None, "is not an image, or is damaged"
    except Image.DecompressionBombError as error:
        raise ValueError(f"{what}: {error}") from error
    if images > most:
        return None, f"holds {images} pictures: convert it to a video or to single pictures"
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if image is None:
        return None, "is damaged"
    if image.dtype not in (np.uint8, np.uint16):
        return None, "has neither 8 nor 16 bit"
    return image, ""


def unpack_picture(
    message: Any, what: Path
) -> tuple[Shaped[np.ndarray, "h w *colour"] | None, str]:
    """Unpack the picture of a ROS message, `Image` or `CompressedImage`.

    Args:
        message: with the ROS fields as attributes.
        what: topic that holds it, for the error message.

    Returns:
        The picture, or None and the reason why there is none.

    Raises:
        ValueError: the picture has too many pixels or none.
    """
    # by encoding: channels, bytes per channel, and the conversion to grey or BGR
    colours = {
        "mono": (1, None),
        "bgr": (3, None),
        "rgb": (3, cv2.COLOR_RGB2BGR),
        "bgra": (4, cv2.COLOR_BGRA2BGR),
        "rgba": (4, cv2.COLOR_RGBA2BGR),
        "bayer_rggb": (1, cv2.COLOR_BayerRGGB2BGR),
        "bayer_bggr": (1, cv2.COLOR_BayerBGGR2BGR),
        "bayer_gbrg": (1, cv2.COLOR_BayerGBRG2BGR),
        "bayer_grbg": (1, cv2.COLOR_BayerGRBG2BGR),
    }
    kinds = {
        f"{name}{8 * size}": (channels, size, conversion)
        for name, (channels, conversion) in colours.items()
        for size in (1, 2)
    }
    kinds |= {f"{8 * size}UC{n}": (n, size, None) for n in (1, 3) for size in (1, 2)}
    kinds |= dict.fromkeys(("yuv422", "uyvy"), (2, 1, cv2.COLOR_YUV2BGR_UYVY))
    kinds |= dict.fromkeys(("yuv422_yuy2", "yuyv"), (2, 1, cv2.COLOR_YUV2BGR_YUY2))
    data = np.ascontiguousarray(message.data)
    if not hasattr(message, "encoding"):
        image, flaw = decode_picture(data.tobytes(), what)
        return image, flaw and f"{what.name} {flaw}"
    if message.encoding not in kinds:
        return None, (
            f"pictures encoded as {message.encoding} are not read: convert them, for example to "
            "mono8 or bgr8"
        )
    channels, size, conversion = kinds[message.encoding]
    height, width, step = message.height, message.width, message.step
    if channels == 2:
        width -= width % 2  # two pixels share their colour
    if not 0 < width * channels * size <= step or not 0 < height * step <= data.nbytes:
        return None, f"the message has {data.nbytes} bytes for {height} rows of {step}"
    kind = np.dtype((">" if message.is_bigendian else "<") + f"u{size}")
    strides = (step, channels * size, size)
    image = np.ndarray((height, width, channels), kind, data, strides=strides)
    image = np.ascontiguousarray(image.squeeze(2) if channels == 1 else image, f"u{size}")
    return (image if conversion is None else cv2.cvtColor(image, conversion)), ""


def check_size(width: int, height: int, what: Path) -> None:
    """Reject a picture's size before the picture is decoded.

    Raises:
        ValueError: the picture has too many pixels or none.
    """
    if width * height > MOST_PIXELS:
        raise ValueError(
            f"{what} declares {width}×{height} pixels; at most {MOST_PIXELS // 10**6} million are "
            "read: scale it down"
        )
    if width * height == 0:
        raise ValueError(f"{what} declares no size: it is damaged")


class Copy(NamedTuple):
    """A small copy of a picture.

    Attributes:
        jpeg: content of the JPEG file.
        size: width and height of the copy [px].
        scale: pixels of the copy per pixel of the picture.
    """

    jpeg: bytes
    size: tuple[int, int]
    scale: float

    def place(self, spots: Float[np.ndarray, "views n 2"]) -> Float[np.ndarray, "views n 2"]:
        """Positions in the copy of points in the picture [px].

        Args:
            spots: points in the picture [px].
        """
        return self.scale * (spots + 0.5) - 0.5


class Shown:
    """A picture that is stored until its frame has been answered; large pictures are shrunk."""

    def __init__(self, image: Shaped[np.ndarray, "h w *colour"]) -> None:
        """Store a picture, grey or BGR, 8 or 16 bit."""
        largest = 960  # longest side of a stored picture [px]
        self._image, self._scale = _shrink(image, largest)

    @cached_property
    def copy(self) -> Copy:
        """The picture as a JPEG, encoded on first use."""
        return _pack(self._image, self._scale, quality=80)


class Album:
    """Small copies of a source's pictures, evenly spread over the recording."""

    def __init__(self, most: int = 256, largest: int = 320) -> None:
        """Start with no copies.

        Args:
            most: largest number of copies.
            largest: longer side of a copy [px].
        """
        self._most, self._largest, self._stride = most, largest, 1
        self._copies: dict[int, tuple[int, Copy]] = {}

    def take(self, row: int, number: int, image: Shaped[np.ndarray, "h w *colour"]) -> None:
        """Store a copy of a picture if its row is one of the evenly spread rows.

        Args:
            row: index of the frame in the recording.
            number: of the picture.
            image: grey or BGR, 8 or 16 bit.
        """
        if row % self._stride:
            return
        self._copies[number] = row, copy_picture(image, self._largest, quality=70)
        if row // self._stride >= self._most:
            self._stride *= 2
            copies = self._copies.items()
            self._copies = {number: copy for number, copy in copies if not copy[0] % self._stride}

    def find(self, number: int) -> Copy | None:
        """The copy of a picture; None if it is not stored."""
        return self._copies[number][1] if number in self._copies else None


def copy_picture(image: Shaped[np.ndarray, "h w *colour"], largest: int, quality: int) -> Copy:
    """Copy a picture as a JPEG.

    Args:
        image: grey or BGR, 8 or 16 bit.
        largest: longest side; larger pictures are shrunk to it [px].
        quality: of the JPEG, from 0 to 100.
    """
    return _pack(*_shrink(image, largest), quality)


def _shrink(
    image: Shaped[np.ndarray, "h w *colour"], largest: int
) -> tuple[Shaped[np.ndarray, "smaller_h smaller_w *colour"], float]:
    """The picture shrunk to the largest side, and its pixels per original pixel."""
    scale = min(largest / max(image.shape[:2]), 1.0)
    if scale < 1.0:
        height, width = (max(round(scale * side), 1) for side in image.shape[:2])
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return image, scale


def _pack(image: Shaped[np.ndarray, "h w *colour"], scale: float, quality: int) -> Copy:
    if image.dtype == np.uint16:
        image = (image // 257).astype(np.uint8)
    _, jpeg = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, quality))
    return Copy(jpeg.tobytes(), (image.shape[1], image.shape[0]), scale)
