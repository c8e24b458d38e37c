"""Other threads of Python go on, and Ctrl-C is heard."""

import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

import whirl

pytestmark = pytest.mark.filterwarnings("ignore::whirl.WhirlWarning")


def test_another_thread_counts_on(record, rig):
    counted, done = [0], threading.Event()

    def count():
        while not done.is_set():
            counted[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    before, begun = counted[0], time.perf_counter()
    whirl.explain(record, rig=rig)
    seconds, during = time.perf_counter() - begun, counted[0] - before
    done.set()
    thread.join()
    # A GIL that is held would let the other thread count a few times at the two ends.
    assert during > 50 * seconds and during > 10, (during, seconds)


def test_threads_of_python_get_the_same_answers(record, rig):
    alone = whirl.identify(record, rig=rig).json_text
    with ThreadPoolExecutor(3) as pool:
        answers = pool.map(lambda _: whirl.identify(record, rig=rig).json_text, range(3))
    assert set(answers) == {alone}


def test_ctrl_c_ends_the_wait(rig):
    long = whirl.simulate(rig, seconds=120, seed=1, effect="quadratic-drag@arm2=2e-6")
    threading.Timer(0.3, signal.raise_signal, [signal.SIGINT]).start()
    begun = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        whirl.explain(long, rig=rig)
        time.sleep(5)
    assert time.perf_counter() - begun < 3
