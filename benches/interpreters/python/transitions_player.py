"""The CD player for transitions, with its nested states."""

from transitions.extensions import HierarchicalMachine

from harness import action, measure

STATES = [
    "Empty", "Open", "Stopped", "Paused",
    {"name": "Playing", "initial": "One", "children": ["One", "Two", "Three"]},
]
TRANSITIONS = [
    ("open_close", "Empty", "Open", "open_drawer"),
    ("cd", "Empty", "Stopped", "store_cd_info"),
    ("open_close", "Open", "Empty", "close_drawer"),
    ("play", "Stopped", "Playing", "start_playback"),
    ("open_close", "Stopped", "Open", "open_drawer"),
    ("stop", "Stopped", "Stopped", "stopped_again"),
    ("stop", "Playing", "Stopped", "stop_playback"),
    ("pause", "Playing", "Paused", "pause_playback"),
    ("open_close", "Playing", "Open", "stop_and_open"),
    ("end_pause", "Paused", "Playing", "resume_playback"),
    ("stop", "Paused", "Stopped", "stop_playback"),
    ("open_close", "Paused", "Open", "stop_and_open"),
    ("next", "Playing_One", "Playing_Two", "next_song"),
    ("next", "Playing_Two", "Playing_Three", "next_song"),
    ("prev", "Playing_Two", "Playing_One", "previous_song"),
    ("prev", "Playing_Three", "Playing_Two", "previous_song"),
]

player = HierarchicalMachine(
    states=STATES,
    transitions=[
        {"trigger": event, "source": source, "dest": target, "before": action(name)}
        for event, source, target, name in TRANSITIONS
    ],
    initial="Empty",
    auto_transitions=False,
)
measure("transitions", str, player.trigger)
