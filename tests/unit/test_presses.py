"""The presses of a push test, as commands and pushes have them."""

import numpy as np

from diagnosis.motion.presses import places, presses

COMMAND = np.repeat([0.0, 0.5, 0.0], [20, 12, 8])
PUSH = np.repeat([0, 1, 0, -1, 0, 2, 0, 1, 0.0], [4, 4, 4, 4, 4, 4, 4, 8, 4])


def test_a_press_is_a_push_at_one_command():
    """Take every push at a constant command with its side, and what follows until the next."""
    found = list(presses(COMMAND, PUSH))
    assert [(p.held_rad, p.side) for p in found] == [(0.0, 1), (0.0, 0), (0.5, 1)]
    assert [(p.pushed.start, p.pushed.stop) for p in found] == [(4, 8), (12, 16), (20, 24)]
    assert [(p.released.start, p.released.stop) for p in found] == [(8, 12), (16, 20), (24, 28)]


def test_a_place_is_pushed_both_ways():
    """Group presses by the position that is held, where it is pushed in both directions."""
    assert places(list(presses(COMMAND, PUSH))) == [[0, 1]]


def test_a_release_ends_where_the_target_moves():
    """End what follows a push at the next command, and count nothing where that is at once."""
    push = np.where(np.arange(40) < 24, PUSH, 0.0)
    later = np.where(np.arange(40) < 30, COMMAND, 1.0)
    assert [p.released.stop for p in presses(later, push)][-1] == 30
    (one,) = presses(np.repeat([0.0, 1.0], 10), np.repeat([0, 1.0, 0], [6, 4, 10]))
    assert one.released.start == one.released.stop == 10


def test_the_hard_part_of_a_press_is_near_its_largest_push():
    """Leave out samples in which a push still grows."""
    (one,) = presses(np.zeros(9), np.array([0, 0, 1, 3, 4, 3, 0, 0, 0.0]))
    assert list(one.hard(np.array([0, 0, 1, 3, 4, 3, 0, 0, 0.0]), 0.7)) == [3, 4, 5]
