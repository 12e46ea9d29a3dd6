"""A photograph's bytes become an upright array of colours, or one line says why not."""

import io
import warnings

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

from bayesdeg.errors import BayesdegError

#: A photograph of 100 megapixels takes 0.3 GB as an array; a file of a few kB can claim any size.
MOST_PIXELS = 100_000_000
#: On fewer pixels along its shorter side no line is traced to 0.1 mm.
LEAST_SIDE = 200

Colours = NDArray[np.uint8]


def read_picture(name: str, content: bytes) -> Colours:
    """Return a photograph, upright as its EXIF orientation says.

    Parameters
    ----------
    name : str
        For messages.
    content : bytes
        Of the file: JPEG, PNG, TIFF or what else Pillow reads, with 8 bits a channel.

    Returns
    -------
    array of uint8, shape (rows, columns, 3)
        Blue, green and red, as OpenCV has them.

    Raises
    ------
    BayesdegError
        If it is no picture, is truncated, claims too many pixels, has several frames, too few
        pixels, or colours other than 8-bit grey, RGB or palette.

    Examples
    --------
    >>> read_picture("a.jpg", b"text")
    Traceback (most recent call last):
    bayesdeg.errors.BayesdegError: a.jpg: it is no picture; give a JPEG, PNG or TIFF file
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # sizes are judged here
            image = Image.open(io.BytesIO(content))
            _refuse(name, image)
            upright = ImageOps.exif_transpose(image).convert("RGB")
    except UnidentifiedImageError as fault:
        raise _fault(name, "it is no picture", "give a JPEG, PNG or TIFF file") from fault
    except Image.DecompressionBombError as fault:
        raise _too_large(name) from fault
    except (OSError, SyntaxError, ValueError, EOFError) as fault:
        raise _fault(name, "it is truncated or damaged", "copy it from the camera again") from fault
    return np.ascontiguousarray(np.asarray(upright)[:, :, ::-1])


def _fault(name: str, problem: str, remedy: str) -> BayesdegError:
    return BayesdegError(f"{name}: {problem}; {remedy}")


def _too_large(name: str) -> BayesdegError:
    most = MOST_PIXELS // 1_000_000
    return _fault(name, f"it claims more than {most} megapixels", "save it smaller")


def _refuse(name: str, image: Image.Image) -> None:
    width, height = image.size
    if width * height > MOST_PIXELS:
        raise _too_large(name)
    if min(width, height) < LEAST_SIDE:
        raise _fault(
            name,
            f"it has {width} × {height} pixels, too few to trace a line",
            f"give a photograph of at least {LEAST_SIDE} pixels along each side",
        )
    if getattr(image, "n_frames", 1) > 1:
        raise _fault(name, "it has several frames", "save the one that is meant as a file")
    if image.mode == "CMYK":
        raise _fault(name, "its colours are CMYK, those of a print", "save it as RGB")
    if image.mode not in ("RGB", "RGBA", "L", "LA", "P", "1"):
        raise _fault(name, f"it has {image.mode} pixels, not 8 bits a channel", "save it as RGB")
