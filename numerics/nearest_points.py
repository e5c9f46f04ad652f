"""Points as pictures: which of them is nearest to each pixel."""

import numpy as np
from numba import njit


@njit(cache=True)
def nearest_to_pixels(
    places: np.ndarray, lower: np.ndarray, pixel: np.ndarray, shape: tuple[int, int], reach: float
) -> np.ndarray:
    """Number of the point nearest to the centre of each pixel (rows, columns), -1 where none is within reach.

    places : (n, 2) [length]. lower : corner of the first pixel (2,). pixel : its width and height (2,) [length].
    shape : columns and rows. Each point offers itself to the pixels within reach, far fewer than a search would look at.
    """
    columns, rows = shape
    nearest = np.full((rows, columns), -1)
    least = np.full((rows, columns), reach**2)
    for point in range(len(places)):
        x, y = (places[point] - lower) / pixel - 0.5  # in pixels, from the centre of the first
        across, up = reach / pixel
        for row in range(max(0, int(np.ceil(y - up))), min(rows - 1, int(np.floor(y + up))) + 1):
            for column in range(max(0, int(np.ceil(x - across))), min(columns - 1, int(np.floor(x + across))) + 1):
                distance = ((column - x) * pixel[0]) ** 2 + ((row - y) * pixel[1]) ** 2
                if distance < least[row, column]:
                    least[row, column] = distance
                    nearest[row, column] = point
    return nearest
