"""What drives and measures the CD player of an engine in Python, and tells it as the other programs do: `tell NAME COUNTS` and `row NAME EVENTS NANOSECONDS...`."""

from time import perf_counter_ns

# The actions, in the order of their counts.
ACTIONS = [
    "start_playback", "open_drawer", "close_drawer", "store_cd_info", "stop_playback", "pause_playback",
    "resume_playback", "stop_and_open", "stopped_again", "next_song", "previous_song",
]

# What is done to the player in one pass, which ends where it began.
SCRIPT = (
    ["open_close", "open_close", "cd", "play"]
    + 10 * ["next", "next", "prev", "prev"]
    + ["pause", "end_pause", "pause", "stop", "stop", "open_close", "open_close"]
)

# How long one measurement takes at least, and how many there are.
LONG_ENOUGH_NS = 20_000_000
MEASUREMENTS = 10

COUNTS = [0] * len(ACTIONS)


def action(name):
    """A function that counts one action."""
    index = ACTIONS.index(name)

    def count(*_):
        COUNTS[index] += 1

    return count


def measure(name, event, dispatch):
    """Measures an engine. `event` makes what `dispatch` takes from an event's name; it is made once, not each time."""
    script = [event(name) for name in SCRIPT]

    def run():
        for event in script:
            dispatch(event)

    run()
    before = list(COUNTS)
    run()
    print(f"tell cd51-{name}", *(now - then for now, then in zip(COUNTS, before)))

    def of(times):
        started = perf_counter_ns()
        for _ in range(times):
            run()
        return perf_counter_ns() - started

    times = 1
    while of(times) < LONG_ENOUGH_NS:
        times *= 2
    print(f"row cd51-{name}", len(script), *(f"{of(times) / times:.1f}" for _ in range(MEASUREMENTS)))
