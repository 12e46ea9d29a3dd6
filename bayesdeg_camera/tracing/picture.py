"""Decode a photograph into an upright array of colours, or say why not."""

import io
import warnings

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

from bayesdeg.errors import BayesdegError

#: A photograph of 100 megapixels takes 0.3 GB as an array; a file of a few kB can claim any size.
MOST_PIXELS = 100_000_000
#: With fewer pixels along the shorter side no line can be traced to 0.1 mm.
LEAST_SIDE = 200
_TOO_LARGE = f"it claims more than {MOST_PIXELS // 1_000_000} megapixels; save it smaller"

Colours = NDArray[np.uint8]


def read_picture(name: str, content: bytes) -> Colours:
    """Return a photograph, upright by its EXIF orientation.

    Parameters
    ----------
    name : str
        Name for messages.
    content : bytes
        The file: JPEG, PNG, TIFF or any other format of Pillow, with 8 bits per channel.

    Returns
    -------
    array of uint8, shape (rows, columns, 3)
        Blue, green and red, as in OpenCV.

    Raises
    ------
    BayesdegError
        If it is not a picture, is truncated, claims too many pixels, has several frames, too few
        pixels, or colours other than 8-bit grey, RGB or palette.

    Examples
    --------
    >>> read_picture("a.jpg", b"text")
    Traceback (most recent call last):
    bayesdeg.errors.BayesdegError: a.jpg: it is not a picture; give a JPEG, PNG or TIFF file
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # sizes are checked here
            image = Image.open(io.BytesIO(content))
            _refuse_unsuitable(name, image)
            upright = ImageOps.exif_transpose(image).convert("RGB")
    except UnidentifiedImageError as fault:
        raise BayesdegError(
            f"{name}: it is not a picture; give a JPEG, PNG or TIFF file"
        ) from fault
    except Image.DecompressionBombError as fault:
        raise BayesdegError(f"{name}: {_TOO_LARGE}") from fault
    except (OSError, SyntaxError, ValueError, EOFError) as fault:
        raise BayesdegError(
            f"{name}: it is truncated or damaged; copy it from the camera again"
        ) from fault
    return np.ascontiguousarray(np.asarray(upright)[:, :, ::-1])


def resized(image: Colours, factor: float) -> Colours:
    """Return a picture with this many times the pixels along each side, averaged where fewer."""
    made = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    return np.asarray(made, dtype=np.uint8)


def _refuse_unsuitable(name: str, image: Image.Image) -> None:
    width, height = image.size
    why = ""
    if width * height > MOST_PIXELS:
        why = _TOO_LARGE
    elif min(width, height) < LEAST_SIDE:
        why = (
            f"it has {width} × {height} pixels, too few to trace a line; give a photograph of at "
            f"least {LEAST_SIDE} pixels along each side"
        )
    elif getattr(image, "n_frames", 1) > 1:
        why = "it has several frames; save the intended one as a file"
    elif image.mode == "CMYK":
        why = "its colours are CMYK; save it as RGB"
    elif image.mode not in ("RGB", "RGBA", "L", "LA", "P", "1"):
        why = f"it has {image.mode} pixels, not 8 bits per channel; save it as RGB"
    if why:
        raise BayesdegError(f"{name}: {why}")
