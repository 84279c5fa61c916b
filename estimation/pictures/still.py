"""One picture from a file: of a folder of pictures, or one that stands for itself."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Shaped
from PIL import Image, UnidentifiedImageError

LARGEST = 50_000_000
"""Most pixels of a picture; more is refused before anything is decoded."""


@dataclass(frozen=True, eq=False, repr=False)
class Still:
    """A picture from a file of its own.

    Attributes:
        path: of the file.
        image: grey or BGR, 8 or 16 bit.
    """

    path: Path
    image: Shaped[np.ndarray, "h w *colour"]

    def __repr__(self) -> str:
        """The file's name and the picture's content, by which a changed one is noticed."""
        digest = hashlib.sha256(np.ascontiguousarray(self.image).tobytes()).hexdigest()
        return f"Still({self.path.name}, {self.image.shape}, {digest})"


def read_still(path: Path, what: str) -> Still:
    """Read a picture that is given by itself.

    Args:
        path: of the file.
        what: the picture is given as, for the error.

    Raises:
        OSError: the file cannot be opened.
        ValueError: it is no picture, a damaged or too large one.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}, given as {what}, does not exist or is no file")
    image, flaw = load_picture(path)
    if image is None:
        raise ValueError(f"{path}, given as {what}: {flaw}; give a picture of 8 or 16 bit (PNG, …)")
    return Still(path, image)


def load_picture(path: Path) -> tuple[Shaped[np.ndarray, "h w *colour"] | None, str]:
    """The picture in a file, or why there is none.

    Raises:
        ValueError: its size is not read.
    """
    try:
        with Image.open(path) as header:
            check_size(*header.size, path)
    except (UnidentifiedImageError, OSError):
        return None, f"{path.name} is no image or damaged"
    except Image.DecompressionBombError as error:
        raise ValueError(f"{path}: {error}") from error
    image = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    if image is None:
        return None, f"{path.name} is damaged"
    if image.dtype not in (np.uint8, np.uint16):
        return None, f"{path.name} is not of 8 or 16 bit"
    return image, ""


def check_size(width: int, height: int, what: Path) -> None:
    """Refuse a size before it is decoded.

    Raises:
        ValueError: it is too large, or none.
    """
    if width * height > LARGEST:
        raise ValueError(
            f"{what} declares {width}×{height} pixels; more than {LARGEST // 10**6} million are "
            "not read: scale it down"
        )
    if width * height == 0:
        raise ValueError(f"{what} declares no size: it is damaged")
