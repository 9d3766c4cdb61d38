"""User logic of the published example: rotate each JPEG by 90 degrees, clockwise."""

import cv2
import numpy as np

from bagpipe import binpipe

for record in binpipe.read():
    image = cv2.imdecode(np.frombuffer(record.read(), np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise SystemExit(f"{record.name} is no image that OpenCV can read")
    rotated = cv2.rotate(image, cv2.ROTATE_90_CLOCKWISE)
    # PNG keeps every pixel; a JPEG of a JPEG would be another picture.
    _, encoded = cv2.imencode(".png", rotated)
    height, width = rotated.shape[:2]
    binpipe.write(encoded, name=f"{record.name}.png", width=width, height=height)
