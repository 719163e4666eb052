"""Pictures from files that may be hostile: the header first, so that its size can be refused before it is decoded."""

from __future__ import annotations

import io

from PIL import Image

#: Other formats that Pillow knows are not asked for, and one of them starts another program.
FORMATS = ("PNG", "JPEG", "WEBP")


def opened(data: bytes) -> Image.Image:
    """The picture with its header read; nothing is decoded yet.

    Pillow's own limit on pixels is lower than ours and cannot be passed in: the caller holds the size against its own.

    Raises:
        OSError: it is none of :data:`FORMATS`, or broken; ``SyntaxError`` and ``ValueError`` likewise.
    """
    theirs, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        return Image.open(io.BytesIO(data), formats=FORMATS)
    finally:
        Image.MAX_IMAGE_PIXELS = theirs
