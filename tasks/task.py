"""A task: a figure that the lower end of the stick draws in the horizontal plane."""

import math
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

Array = np.ndarray

RADIUS_M = 0.02
"""Radius of the figure in training [m]."""
RATE_RAD_S = math.pi
"""Phase rate of the figure in training [rad/s]."""
EPISODE_S = 6.0


class Figure(ABC):
    """Base class of every task; a subclass named `Task` in its own file is one task.

    `radius_m` is the size of the figure; `speed` is its pace as a multiple of the training pace.
    """

    repeats: ClassVar[bool] = False
    """Whether the figure is a closed lap that is entered once and then repeated."""

    def __init__(self, radius_m: float = RADIUS_M, speed: float = 1.0) -> None:
        self.radius_m = radius_m
        self.rate_rad_s = speed * RATE_RAD_S

    @abstractmethod
    def offset_m(self, time_s: Array, heading_rad: Array) -> Array:
        """Horizontal offset of the reference point from the centre [m], shape (N, 2).

        Arguments are the time since the start (N,) [s] and each episode's random heading (N,)
        [rad]. Every figure starts at the centre.
        """
