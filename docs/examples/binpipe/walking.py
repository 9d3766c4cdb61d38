"""Pedestrians in a picture, by OpenCV's own detector (HOG and a linear SVM)."""

from collections.abc import Iterator

import cv2
import numpy as np

# The detector looks for people from 64 x 128 pixels on, so people close by need a small picture.
WIDTH = 240

detector = cv2.HOGDescriptor()
detector.setSVMDetector(cv2.HOGDescriptor_getDefaultPeopleDetector())
cv2.setNumThreads(1)


def pedestrians(image: np.ndarray) -> Iterator[tuple[list[int], float]]:
    """(left, top, width, height) in pixels of the picture (BGR), and how sure the SVM is."""
    scale = image.shape[1] / WIDTH
    small = cv2.resize(image, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA)
    boxes, weights = detector.detectMultiScale(small, padding=(32, 32), scale=1.03)
    for box, weight in zip(boxes, weights, strict=True):
        yield [round(float(value) * scale) for value in box], float(weight)
