"""User logic: find pedestrians in photographs (walking.py has the detector).

One record for each pedestrian, with the box in pixels of the photograph; none where nobody walks.
"""

import cv2
import numpy as np
from walking import pedestrians

from bagpipe import binpipe

for record in binpipe.read():
    image = cv2.imdecode(np.frombuffer(record.read(), np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise SystemExit(f"{record.name} is no image that OpenCV can read")
    for (left, top, width, height), weight in pedestrians(image):
        cut = image[max(0, top) : top + height, max(0, left) : left + width]
        _, encoded = cv2.imencode(".png", cut)
        binpipe.write(
            encoded,
            left=left, top=top, width=width, height=height, per_mille=round(weight * 1000),
        )  # fmt: skip
