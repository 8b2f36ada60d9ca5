"""The clock that counts programs which work for this process."""

from __future__ import annotations

import time

from simspec.processes import counted, processor_clock


def test_without_engines_it_is_the_clock_of_the_system():
    assert processor_clock() is time.process_time


def test_others_are_counted_while_they_work():
    with counted(lambda: 100.0), counted(lambda: 20.0):
        clock = processor_clock()
        process_time = time.process_time()
        assert 120.0 + process_time <= clock() <= 121.0 + time.process_time()
    assert processor_clock() is time.process_time
